//! A cross of three bars, three cameras that look at it, and their outlines: what tests share.

use gic_scene::Camera;
use gic_splat::{Gaussians, Shape};
use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::MaskedView;

/// Distance from a box around the origin [m], negative inside.
fn cuboid(p: DVec3, half: DVec3) -> f64 {
    let q = p.abs() - half;
    q.max(DVec3::ZERO).length() + q.max_element().min(0.0)
}

/// Three bars of different lengths, crosswise.
pub(crate) fn upright_cross(p: DVec3) -> f64 {
    let bars = [DVec3::new(0.16, 0.04, 0.04), DVec3::new(0.04, 0.13, 0.04), DVec3::new(0.04, 0.04, 0.145)];
    bars.map(|half| cuboid(p, half)).into_iter().fold(f64::INFINITY, f64::min)
}

pub(crate) fn turned() -> DQuat {
    DQuat::from_euler(glam::EulerRot::XYZ, 0.4, 0.7, -0.3)
}

const SIZE: usize = 120;

fn camera(from: DVec3) -> Camera {
    let z = (CENTRE - from).normalize();
    let x = z.cross(DVec3::Y).normalize();
    Camera {
        width: SIZE,
        height: SIZE,
        focal: DVec2::splat(150.0),
        principal: DVec2::splat(0.5 * SIZE as f64),
        world_from_camera: DMat3::from_cols(x, z.cross(x), z),
        centre: from,
    }
}

pub(crate) const CENTRE: DVec3 = DVec3::new(0.02, 0.4, -0.03);

pub(crate) fn cameras() -> Vec<Camera> {
    [DVec3::new(0.9, 0.9, 0.2), DVec3::new(-0.5, 0.7, 0.8), DVec3::new(-0.4, 1.0, -0.7)].map(camera).to_vec()
}

/// Where the ray of a pixel hits a body, by marching.
pub(crate) fn hit(camera: &Camera, pixel: DVec2, distance: &dyn Fn(DVec3) -> f64) -> Option<DVec3> {
    let direction = (camera.unproject(pixel, 1.0) - camera.centre).normalize();
    let mut along = 0.3;
    while along < 2.2 {
        let point = camera.centre + along * direction;
        let off = distance(point);
        if off < 1e-4 {
            return Some(point);
        }
        along += off.max(1e-4);
    }
    None
}

/// The mask of a body, by rays of four to a pixel.
fn mask(camera: &Camera, distance: &dyn Fn(DVec3) -> f64) -> Vec<f32> {
    let corners = [DVec2::new(0.25, 0.25), DVec2::new(0.75, 0.25), DVec2::new(0.25, 0.75), DVec2::new(0.75, 0.75)];
    let covered = |pixel: DVec2| corners.iter().filter(|c| hit(camera, pixel + **c, distance).is_some()).count();
    (0..SIZE * SIZE).map(|i| covered(DVec2::new((i % SIZE) as f64, (i / SIZE) as f64)) as f32 / 4.0).collect()
}

/// A body's masks in all cameras.
pub(crate) fn masks(cameras: &[Camera], distance: &dyn Fn(DVec3) -> f64) -> Vec<Vec<f32>> {
    cameras.iter().map(|camera| mask(camera, distance)).collect()
}

/// Volume of the cross [m^3]: its three bars share the middle.
pub(crate) const VOLUME: f64 = 8.0 * 0.04 * 0.04 * (0.16 + 0.13 + 0.145) - 2.0 * 0.08 * 0.08 * 0.08;

/// The cross at its place, `moved` [m].
pub(crate) fn cross(p: DVec3, moved: DVec3) -> f64 {
    upright_cross(turned().inverse() * (p - CENTRE - moved))
}

pub(crate) fn views<'a>(cameras: &'a [Camera], masks: &'a [Vec<f32>]) -> Vec<MaskedView<'a>> {
    cameras.iter().zip(masks).map(|(camera, mask)| MaskedView { camera, mask: Some(mask) }).collect()
}

/// Gaussians all over the cross.
pub(crate) fn gaussians() -> Gaussians {
    let range = -16..=16;
    let places = range.clone().flat_map(|x| {
        range
            .clone()
            .flat_map(move |y| (-16..=16).map(move |z| 0.01 * DVec3::new(f64::from(x), f64::from(y), f64::from(z))))
    });
    let positions: Vec<[f32; 3]> = places
        .map(|p| CENTRE + turned() * p)
        .filter(|p| cross(*p, DVec3::ZERO) < 0.0)
        .map(|p| p.as_vec3().to_array())
        .collect();
    let count = positions.len();
    Gaussians {
        positions,
        opacities: vec![0.9; count],
        shape: Shape::Isotropic { scales: vec![0.005; count] },
        sh_degree: 0,
        sh: vec![[0.0; 3]; count],
    }
}
