//! Hulls of balls, and the two economies against their definitions.

use proptest::prelude::*;

use glam::{DMat3, DVec2};

use super::carve::{MaskTable, carve_grid};
use super::*;
use crate::picture::Picture;

/// A camera at `centre` that looks at `target`.
fn camera(centre: DVec3, target: DVec3, size: usize, focal: f64) -> Camera {
    let forward = (target - centre).normalize();
    let right = forward.cross(DVec3::new(0.1, 1.0, 0.2)).normalize();
    Camera {
        width: size,
        height: size,
        focal: DVec2::splat(focal),
        principal: DVec2::splat(size as f64 / 2.0),
        world_from_camera: DMat3::from_cols(right, forward.cross(right), forward),
        centre,
    }
}

/// The mask of a ball, from the rays through the pixel centres.
fn ball_mask(camera: &Camera, ball: DVec3, radius: f64) -> Mask {
    let coverage = (0..camera.width * camera.height)
        .map(|i| {
            let pixel = DVec2::new((i % camera.width) as f64 + 0.5, (i / camera.width) as f64 + 0.5);
            let ray = (camera.unproject(pixel, 1.0) - camera.centre).normalize();
            let to_ball = ball - camera.centre;
            let off = (to_ball - ray * to_ball.dot(ray)).length();
            f32::from(u8::from(off < radius))
        })
        .collect();
    Mask { width: camera.width, height: camera.height, coverage }
}

fn around(ball: DVec3) -> Vec<Camera> {
    let places = [
        DVec3::new(1.0, 0.3, 0.1),
        DVec3::new(-0.8, 0.5, 0.4),
        DVec3::new(0.1, 0.9, -0.7),
        DVec3::new(0.2, -0.9, 0.6),
        DVec3::new(-0.3, 0.1, 1.1),
        DVec3::new(-0.5, -0.4, -0.9),
    ];
    places.iter().map(|place| camera(ball + *place, ball, 160, 200.0)).collect()
}

#[test]
fn the_hull_of_a_ball_is_little_more_than_the_ball() {
    let (ball, radius) = (DVec3::new(0.4, -0.2, 3.0), 0.2);
    let cameras = around(ball);
    let masks: Vec<Mask> = cameras.iter().map(|camera| ball_mask(camera, ball, radius)).collect();
    let views: Vec<HullView> = cameras.iter().zip(&masks).map(|(camera, mask)| HullView { camera, mask }).collect();
    let hull = Hull::carve(&views, &HullSettings::default()).expect("a hull");
    let excess = hull.volume() / (4.0 / 3.0 * std::f64::consts::PI * radius.powi(3));
    assert!((1.0..1.25).contains(&excess), "{excess}");
    let (low, high) = hull.bounds();
    // The box holds the ball, and the grid is used to the full.
    assert!(low.cmple(ball - radius + 0.01).all() && high.cmpge(ball + radius - 0.01).all());
    assert!((high - low).max_element() < 2.6 * radius && hull.cell < 2.6 * radius / 50.0);
    for view in &views {
        assert!(hull.reprojection_iou(view) > 0.96);
    }
    // Normals point outwards, and a point in front of a camera takes its colour.
    let surface = hull.surface();
    let outward = surface.iter().filter(|point| point.normal.dot((point.position - ball).normalize()) > 0.7).count();
    assert!(outward as f64 > 0.95 * surface.len() as f64);
    let red = Picture { width: 160, height: 160, rgb: [1.0, 0.0, 0.0].repeat(160 * 160) };
    let colours = hull.colours(&surface, &[(&cameras[0], &red)]);
    for (point, colour) in surface.iter().zip(&colours) {
        let facing = point.normal.dot((cameras[0].centre - point.position).normalize());
        if facing > 0.5 {
            assert!((colour[0] - 1.0).abs() < 1e-6 && colour[1..] == [0.0; 2], "{colour:?}");
        } else if facing < -0.2 {
            assert_eq!(*colour, [0.5; 3], "seen through the object");
        }
    }
}

#[test]
fn masks_that_do_not_meet_and_empty_masks_have_no_hull() {
    let ball = DVec3::ZERO;
    let cameras = around(ball);
    let mut masks: Vec<Mask> = cameras.iter().map(|camera| ball_mask(camera, ball, 0.1)).collect();
    masks[0] = ball_mask(&cameras[0], DVec3::new(0.0, 0.25, 0.0), 0.05);
    let views =
        |masks: &[Mask]| -> Vec<(Camera, Mask)> { cameras.iter().cloned().zip(masks.iter().cloned()).collect() };
    let carve = |views: &[(Camera, Mask)], tolerated_misses| {
        let views: Vec<HullView> = views.iter().map(|(camera, mask)| HullView { camera, mask }).collect();
        Hull::carve(&views, &HullSettings { resolution: 32, tolerated_misses })
    };
    assert_eq!(carve(&views(&masks), 0), None);
    let hull = carve(&views(&masks), 1).expect("one view may disagree");
    assert!(hull.contains(ball) && !hull.contains(DVec3::new(0.0, 0.25, 0.0)));
    masks.iter_mut().for_each(|mask| mask.coverage.fill(0.0));
    assert_eq!(carve(&views(&masks), 0), None);
    assert_eq!(carve(&[], 0), None);
}

#[test]
fn an_object_cut_by_the_border_is_not_carved_there() {
    let ball = DVec3::ZERO;
    let mut cameras = around(ball);
    // The first camera sees half of the ball only.
    cameras[0].width = 80;
    let masks: Vec<Mask> = cameras.iter().map(|camera| ball_mask(camera, ball, 0.15)).collect();
    assert!(masks[0].touches_border());
    let views: Vec<HullView> = cameras.iter().zip(&masks).map(|(camera, mask)| HullView { camera, mask }).collect();
    let hull = Hull::carve(&views, &HullSettings::default()).expect("a hull");
    let right = cameras[0].world_from_camera.x_axis;
    assert!(hull.contains(right * 0.1) && hull.contains(-right * 0.1));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// The hierarchy is an economy: every cell comes out as if its centre had been tested in every view.
    #[test]
    fn carving_by_cubes_equals_testing_every_cell(
        balls in prop::collection::vec((prop::array::uniform3(-0.2..0.2_f64), 0.02..0.2_f64), 1..4),
        places in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 2..5),
        tolerated in 0..2_usize,
    ) {
        let cameras: Vec<Camera> = places
            .iter()
            .map(|place| camera(DVec3::from_array(*place).normalize_or(DVec3::X), DVec3::ZERO, 48, 40.0))
            .collect();
        let masks: Vec<Mask> = cameras
            .iter()
            .map(|camera| {
                let mut union = ball_mask(camera, DVec3::ZERO, 0.03);
                for (ball, radius) in &balls {
                    let mask = ball_mask(camera, DVec3::from_array(*ball), *radius);
                    union.coverage.iter_mut().zip(&mask.coverage).for_each(|(a, b)| *a = a.max(*b));
                }
                union
            })
            .collect();
        let views: Vec<HullView> =
            cameras.iter().zip(&masks).map(|(camera, mask)| HullView { camera, mask }).collect();
        let tables: Vec<MaskTable> = views.iter().map(MaskTable::new).collect();
        // A grid that reaches behind the cameras.
        let (low, cell, size) = (DVec3::splat(-1.2), 0.1, [24, 22, 20]);
        let carved = carve_grid(&tables, low, cell, size, tolerated);
        for (i, &occupied) in carved.iter().enumerate() {
            let index = DVec3::new((i % 24) as f64, (i / 24 % 22) as f64, (i / (24 * 22)) as f64);
            let centre = low + (index + 0.5) * cell;
            let misses = tables.iter().filter(|table| !table.contains_point(centre)).count();
            prop_assert_eq!(occupied, misses <= tolerated, "at {}", centre);
        }
    }

    /// Walking from cell to cell finds what small steps along the ray find.
    #[test]
    fn rays_enter_the_first_occupied_cell(
        occupied in prop::collection::vec(prop::bool::weighted(0.05), 8 * 6 * 5),
        start in prop::array::uniform3(-2.0..2.0_f64),
        target in prop::array::uniform3(0.0..0.5_f64),
    ) {
        let hull = Hull { origin: DVec3::ZERO, cell: 0.1, size: [8, 6, 5], occupied };
        let (start, target) = (DVec3::from_array(start), DVec3::from_array(target));
        let direction = (target - start).normalize_or(DVec3::X);
        let stepped = (0..60_000).map(|i| f64::from(i) * 1e-4).find(|&t| hull.contains(start + direction * t));
        match (hull.first_hit(start, direction), stepped) {
            // Steps may jump over a corner that the ray clips, never the other way round.
            (Some(walked), Some(stepped)) => prop_assert!(walked <= stepped + 1e-9),
            (None, Some(_)) => prop_assert!(false, "a hit was missed"),
            _ => {}
        }
        if let Some(walked) = hull.first_hit(start, direction) {
            let inside = (0..3).any(|i| hull.contains(start + direction * (walked + 1e-9 * 10.0_f64.powi(i))));
            prop_assert!(inside || stepped.is_none(), "no cell at {walked}");
        }
    }
}
