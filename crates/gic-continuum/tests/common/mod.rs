//! Bodies with a known surface, seen by cameras and covered with Gaussians.
#![allow(unreachable_pub)]

use gic_continuum::MaskedView;
use gic_scene::Camera;
use gic_splat::{Gaussians, Shape};
use glam::{DMat3, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A body given by its signed distance [m], negative inside; a lower bound of the distance is enough outside.
pub struct Body {
    pub name: &'static str,
    pub distance: fn(DVec3) -> f64,
    /// Volume of what filling should give [m^3]: closed cavities count as full.
    pub volume: f64,
    /// Surface area [m^2].
    pub area: f64,
    /// Largest side [m].
    pub size: f64,
}

fn block(p: DVec3, half: DVec3) -> f64 {
    let q = p.abs() - half;
    q.max(DVec3::ZERO).length() + q.max_element().min(0.0)
}

/// A ball of radius 0.15.
pub fn sphere() -> Body {
    Body {
        name: "sphere",
        distance: |p| p.length() - 0.15,
        volume: 4.0 / 3.0 * std::f64::consts::PI * 0.15f64.powi(3),
        area: 4.0 * std::f64::consts::PI * 0.15f64.powi(2),
        size: 0.3,
    }
}

/// A ring of radius 0.12 with a tube of radius 0.05: cameras see through its hole.
pub fn torus() -> Body {
    use std::f64::consts::PI;
    Body {
        name: "torus",
        distance: |p| DVec2::new(DVec2::new(p.x, p.z).length() - 0.12, p.y).length() - 0.05,
        volume: 2.0 * PI * PI * 0.12 * 0.05 * 0.05,
        area: 4.0 * PI * PI * 0.12 * 0.05,
        size: 0.34,
    }
}

/// A box with a closed hollow that no camera sees.
pub fn hollow_box() -> Body {
    Body {
        name: "box with a hollow",
        distance: |p| block(p, DVec3::new(0.15, 0.1, 0.12)).max(-block(p, DVec3::splat(0.05))),
        volume: 0.3 * 0.2 * 0.24,
        area: 2.0 * (0.3 * 0.2 + 0.2 * 0.24 + 0.3 * 0.24),
        size: 0.3,
    }
}

/// Two plates 15 mm thick, 60 mm apart: cameras see between them.
pub fn plates() -> Body {
    Body {
        name: "two thin plates",
        distance: |p| block(DVec3::new(p.x, p.y.abs() - 0.0375, p.z), DVec3::new(0.15, 0.0075, 0.15)),
        volume: 2.0 * 0.3 * 0.3 * 0.015,
        area: 2.0 * (2.0 * 0.3 * 0.3 + 4.0 * 0.3 * 0.015),
        size: 0.3,
    }
}

/// A flat pile on the ground y = 0: a cap of 0.22 m radius and 0.06 m height, 31 degrees steep at its rim.
pub fn pile() -> Body {
    const HEIGHT: f64 = 0.06;
    const RIM: f64 = 0.22;
    const BALL: f64 = (RIM * RIM + HEIGHT * HEIGHT) / (2.0 * HEIGHT);
    use std::f64::consts::PI;
    Body {
        name: "pile",
        distance: |p| ((p - DVec3::Y * (HEIGHT - BALL)).length() - BALL).max(-p.y),
        volume: PI * HEIGHT * HEIGHT * (BALL - HEIGHT / 3.0),
        area: PI * (2.0 * BALL * HEIGHT + RIM * RIM),
        size: 2.0 * RIM,
    }
}

/// A block on two legs: the notch between them opens to the front, to the back and downwards.
pub fn bridge() -> Body {
    Body {
        name: "bridge",
        distance: |p| {
            let notch = block(p + DVec3::Y * 0.1, DVec3::new(0.07, 0.1, 1.0));
            block(p, DVec3::new(0.15, 0.1, 0.12)).max(-notch)
        },
        volume: 0.3 * 0.2 * 0.24 - 0.14 * 0.1 * 0.24,
        area: 2.0 * (0.3 * 0.2 - 0.14 * 0.1 + 0.2 * 0.24 + 0.3 * 0.24 + 0.1 * 0.24),
        size: 0.3,
    }
}

/// Cameras on all sides, at several heights, looking at the origin.
pub fn cameras() -> Vec<Camera> {
    cameras_at(&[-0.9, -0.35, 0.05, 0.45, 1.0])
}

/// Cameras that all look down on the origin, 35 to 75 degrees steep.
pub fn cameras_above() -> Vec<Camera> {
    cameras_at(&[0.6, 0.95, 1.3])
}

/// Four cameras at each elevation [radians], a metre from the origin.
fn cameras_at(elevations: &[f64]) -> Vec<Camera> {
    let mut cameras = Vec::new();
    for (ring, elevation) in elevations.iter().enumerate() {
        for k in 0..4 {
            let azimuth = (k as f64 + 0.37 * ring as f64) * std::f64::consts::FRAC_PI_2;
            let centre = DVec3::new(azimuth.cos() * elevation.cos(), elevation.sin(), azimuth.sin() * elevation.cos());
            let forward = -centre;
            let right = forward.cross(DVec3::Y).normalize();
            cameras.push(Camera {
                width: 160,
                height: 160,
                focal: DVec2::splat(220.0),
                principal: DVec2::splat(80.0),
                world_from_camera: DMat3::from_cols(right, forward.cross(right), forward),
                centre,
            });
        }
    }
    cameras
}

/// Antialiased coverage of the body in a camera's image: 3x3 rays for a pixel at whose corners not all rays agree.
pub fn mask(body: &Body, camera: &Camera) -> Vec<f32> {
    let hits = |pixel: DVec2| {
        let direction = (camera.unproject(pixel, 1.0) - camera.centre).normalize();
        let mut t = 0.4;
        while t < 1.6 {
            let d = (body.distance)(camera.centre + t * direction);
            if d < 1e-4 {
                return true;
            }
            t += d;
        }
        false
    };
    let (w, h) = (camera.width, camera.height);
    let corners: Vec<bool> =
        (0..(w + 1) * (h + 1)).map(|i| hits(DVec2::new((i % (w + 1)) as f64, (i / (w + 1)) as f64))).collect();
    (0..w * h)
        .map(|i| {
            let (x, y) = (i % w, i / w);
            let first = y * (w + 1) + x;
            let around = [first, first + 1, first + w + 1, first + w + 2].map(|k| corners[k]);
            if around.iter().all(|&c| c == around[0]) {
                return f32::from(u8::from(around[0]));
            }
            let corner = DVec2::new(x as f64, y as f64);
            let sub = (0..9).filter(|k| hits(corner + (DVec2::new((k % 3) as f64, (k / 3) as f64) + 0.5) / 3.0));
            sub.count() as f32 / 9.0
        })
        .collect()
}

/// Outward unit normal by central differences.
pub fn normal(body: &Body, p: DVec3) -> DVec3 {
    let along = |axis: DVec3| (body.distance)(p + 1e-5 * axis) - (body.distance)(p - 1e-5 * axis);
    DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z)).normalize()
}

/// Points on the outer surface [m], about `spacing` apart: lattice points near it moved onto it.
pub fn surface_points(body: &Body, spacing: f64) -> Vec<DVec3> {
    let n = (0.5 * body.size / spacing).ceil() as i64 + 2;
    let mut points = Vec::new();
    for z in -n..=n {
        for y in -n..=n {
            for x in -n..=n {
                // Odd numbers avoid the planes of symmetry, where normals are not defined.
                let mut p = spacing * (DVec3::new(x as f64, y as f64, z as f64) + DVec3::new(0.21, 0.37, 0.43));
                if (body.distance)(p).abs() > 0.5 * spacing {
                    continue;
                }
                for _ in 0..4 {
                    p -= (body.distance)(p) * normal(body, p);
                }
                points.push(p);
            }
        }
    }
    points
}

/// Standard deviation of the Gaussians over the body's size: about half of the finest voxels.
const SCALE: f64 = 1.0 / 150.0;
/// Their distance from each other, in standard deviations.
const SPACING: f64 = 1.15;
/// How far their centres lie below the surface, in standard deviations: less than those of trained ones, for which the
/// settings are made, because depth maps of Gaussians that lie in one layer are rippled and the emptiest view counts.
const INSET: f64 = 1.75;
/// ... and over the body's size.
const INSET_OF_SIZE: f64 = 1.0 / 200.0;

/// Opaque Gaussians all over the surface.
pub fn perfect_gaussians(body: &Body) -> Gaussians {
    let scale = SCALE * body.size;
    let depth = INSET * scale + INSET_OF_SIZE * body.size;
    let positions: Vec<[f32; 3]> = surface_points(body, SPACING * scale)
        .into_iter()
        .map(|p| (p - depth * normal(body, p)).as_vec3().to_array())
        .collect();
    let n = positions.len();
    Gaussians {
        positions,
        opacities: vec![0.9; n],
        shape: Shape::Isotropic { scales: vec![scale as f32; n] },
        sh_degree: 0,
        sh: vec![[0.0; 3]; n],
    }
}

/// Noisy Gaussians: 30 % missing, centres off by a fifth of a standard deviation, and one in twenty an outlier anywhere
/// in the box, half of them faint.
pub fn noisy_gaussians(body: &Body, seed: u64) -> Gaussians {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let scale = (SCALE * body.size) as f32;
    let perfect = perfect_gaussians(body);
    let Shape::Isotropic { scales } = &perfect.shape else { unreachable!("perfect Gaussians are isotropic") };
    let mut noisy = Gaussians { positions: vec![], opacities: vec![], sh: vec![], ..perfect.clone() };
    let mut kept = Vec::new();
    for i in 0..perfect.positions.len() {
        if random.random::<f64>() < 0.3 {
            continue;
        }
        let outlier = random.random::<f64>() < 0.05;
        let mut u = || random.random::<f32>() * 2.0 - 1.0;
        let p = perfect.positions[i];
        noisy.positions.push(if outlier {
            [u(), u(), u()].map(|c| 0.25 * c)
        } else {
            p.map(|c| c + 0.36 * scale * u())
        });
        noisy.opacities.push(if outlier && i % 2 == 0 { 0.01 } else { 0.9 });
        noisy.sh.push([0.0; 3]);
        kept.push(scales[i]);
    }
    noisy.shape = Shape::Isotropic { scales: kept };
    noisy
}

/// The cameras with their masks.
pub fn views<'a>(cameras: &'a [Camera], masks: &'a [Vec<f32>]) -> Vec<MaskedView<'a>> {
    cameras.iter().zip(masks).map(|(camera, mask)| MaskedView { camera, mask: Some(mask) }).collect()
}
