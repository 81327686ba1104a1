//! From drawn particles to a picture: light, and what lies behind.

use gic_scene::{Camera, Picture};
use gic_splat::Rendered;
use glam::{DVec2, DVec3};

use super::shadow::FloorShadow;

/// Share of the light that has no direction.
const AMBIENT: f32 = 0.55;
/// Light on outlines, which have no normal.
const OUTLINE: f32 = 0.75;
/// Pixels whose alpha is below this have no surface to shade.
const SURFACE_ALPHA: f32 = 0.5;
/// Side of the floor's squares [m].
const TILE_M: f64 = 0.1;

/// What the matter stands before.
pub(super) struct Environment<'a> {
    pub(super) backdrop: Backdrop<'a>,
    /// Up in the world.
    pub(super) up: DVec3,
}

pub(super) enum Backdrop<'a> {
    /// One colour.
    Plain([f32; 3]),
    /// Planes, each a point [m] and its normal.
    Floor(Vec<(DVec3, DVec3)>),
    /// A picture of the camera's size.
    Picture(&'a Picture),
}

/// Lights what was drawn over black, unless it is lit already, and puts it before the backdrop, whose first plane may
/// have a shadow.
pub(super) fn compose(
    rendered: &Rendered,
    camera: &Camera,
    environment: &Environment<'_>,
    is_lit: bool,
    shadow: Option<&FloorShadow>,
) -> Picture {
    let (width, height) = (camera.width, camera.height);
    // From above, beside the camera.
    let light = (environment.up * 1.2 - camera.world_from_camera.x_axis * 0.5 - camera.world_from_camera.z_axis * 0.7)
        .normalize();
    let mut rgb = Vec::with_capacity(3 * width * height);
    for y in 0..height {
        for x in 0..width {
            let i = y * width + x;
            let behind = environment.backdrop.color(camera, x, y, shadow);
            let left = 1.0 - rendered.alpha[i];
            let shade = match is_lit {
                true => 1.0,
                false => normal(rendered, camera, x, y)
                    .map_or(OUTLINE, |n| AMBIENT + (1.0 - AMBIENT) * 1.2 * n.dot(light).max(0.0) as f32),
            };
            for c in 0..3 {
                rgb.push((rendered.color[i][c] * shade + left * behind[c]).clamp(0.0, 1.0));
            }
        }
    }
    Picture { width, height, rgb }
}

/// Normal of the drawn surface in a pixel, from the depths of its neighbours; `None` on outlines.
fn normal(rendered: &Rendered, camera: &Camera, x: usize, y: usize) -> Option<DVec3> {
    let point = |x: usize, y: usize| {
        let inside = x < camera.width && y < camera.height;
        let i = y * camera.width + x;
        (inside && rendered.alpha[i] > SURFACE_ALPHA).then(|| {
            let depth = f64::from(rendered.depth[i] / rendered.alpha[i]);
            camera.unproject(DVec2::new(x as f64 + 0.5, y as f64 + 0.5), depth)
        })
    };
    // Two pixels apart: particles' own bumps average out.
    let across = point(x + 2, y)? - point(x.checked_sub(2)?, y)?;
    let down = point(x, y + 2)? - point(x, y.checked_sub(2)?)?;
    // x right, y down, z forward: this order looks at the camera.
    down.cross(across).try_normalize()
}

impl Backdrop<'_> {
    /// The first plane of a floor, which may have a shadow.
    pub(super) fn first_plane(&self) -> Option<(DVec3, DVec3)> {
        match self {
            Self::Floor(planes) => planes.first().copied(),
            Self::Plain(_) | Self::Picture(_) => None,
        }
    }

    fn color(&self, camera: &Camera, x: usize, y: usize, shadow: Option<&FloorShadow>) -> [f32; 3] {
        match self {
            Self::Plain(color) => *color,
            Self::Picture(picture) if x < picture.width && y < picture.height => picture.at(x, y),
            Self::Picture(_) => [0.0; 3],
            Self::Floor(planes) => floor(planes, camera, DVec2::new(x as f64 + 0.5, y as f64 + 0.5), shadow),
        }
    }
}

/// The nearest plane in front of the camera, in squares that fade into the distance.
fn floor(planes: &[(DVec3, DVec3)], camera: &Camera, pixel: DVec2, shadow: Option<&FloorShadow>) -> [f32; 3] {
    const SKY: f32 = 0.93;
    let ray = camera.unproject(pixel, 1.0) - camera.centre;
    let hit = |(index, &(point, normal)): (usize, &(DVec3, DVec3))| {
        // Only from the side that the normal points to.
        let distance = (point - camera.centre).dot(normal) / ray.dot(normal);
        (ray.dot(normal) < 0.0 && distance > 0.0).then_some((distance, point, normal, index))
    };
    let nearest = planes.iter().enumerate().filter_map(hit).min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((distance, point, normal, index)) = nearest else { return [SKY; 3] };
    let (u, v) = normal.any_orthonormal_pair();
    let at = camera.centre + ray * distance - point;
    let odd = ((at.dot(u) / TILE_M).floor() + (at.dot(v) / TILE_M).floor()).rem_euclid(2.0) > 0.5;
    let fade = (-0.25 * distance).exp() as f32;
    let tile = if odd { 0.72 } else { 0.82 };
    let light = shadow.filter(|_| index == 0).map_or(1.0, |shadow| shadow.light(point + at));
    [(SKY + (tile - SKY) * fade) * light; 3]
}
