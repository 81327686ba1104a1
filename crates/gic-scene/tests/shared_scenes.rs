//! True particles project into the masks: poses, intrinsics, axes, times and masks of every format fit together.
//! Needs the measured scenes next to the repository (`../shared`); says so and passes without them.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use gic_scene::{Camera, Format, Mask, Scene};
use glam::DVec3;

fn shared(relative: &str) -> Option<PathBuf> {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")).join(relative);
    if !path.exists() {
        println!("SKIPPED: {} is not there", path.display());
        return None;
    }
    Some(path)
}

fn particles(path: &Path) -> Vec<DVec3> {
    let file = File::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut archive = npyz::npz::NpzArchive::new(BufReader::new(file)).expect("an npz archive");
    let array = archive.by_name("x").expect("readable").expect("key x");
    let values: Vec<f32> = array.into_vec().expect("f32");
    values.chunks_exact(3).map(|x| DVec3::new(x[0].into(), x[1].into(), x[2].into())).collect()
}

/// Fraction of the points that fall on the mask, and fraction of the mask's pixels within three pixels (a particle's spacing) of one.
fn overlap(camera: &Camera, mask: &Mask, points: &[DVec3]) -> (f64, f64) {
    let mut near = vec![false; mask.width * mask.height];
    let mut inside = 0;
    for &x in points {
        let Some((pixel, _)) = camera.project(x) else { continue };
        let (column, row) = (pixel.x.floor() as i64, pixel.y.floor() as i64);
        if mask.sample(pixel.x, pixel.y) > 0.05 {
            inside += 1;
        }
        for y in (row - 3).max(0)..(row + 4).min(mask.height as i64) {
            for x in (column - 3).max(0)..(column + 4).min(mask.width as i64) {
                near[y as usize * mask.width + x as usize] = true;
            }
        }
    }
    let covered = mask.coverage.iter().zip(&near).filter(|&(&a, _)| a > 0.5);
    let (hit, all) = covered.fold((0_usize, 0_usize), |(hit, all), (_, &near)| (hit + usize::from(near), all + 1));
    (f64::from(inside) / points.len() as f64, hit as f64 / all.max(1) as f64)
}

fn check(relative: &str, format: Format, cameras: usize, frames: usize, rate: f64) {
    let Some(root) = shared(relative) else { return };
    let scene = Scene::open(&root).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((scene.format, scene.cameras.len(), scene.times.len()), (format, cameras, frames), "{relative}");
    assert_eq!(scene.views.len(), cameras * frames);
    assert!((scene.frame_rate.expect("even") - rate).abs() < 0.01 * rate);
    assert_eq!(scene.times[0], 0.0);
    for frame in [0, frames / 2, frames - 1] {
        let points = particles(&root.join(format!("gt/particles_{frame}.npz")));
        for view in scene.views_at(frame) {
            let mask = scene.load_mask(view).expect("mask");
            let (inside, hit) = overlap(scene.camera_of(view), &mask, &points);
            assert!(
                inside > 0.99 && hit > 0.99,
                "{}: {inside} of the points, {hit} of the mask",
                view.picture.display()
            );
        }
    }
}

#[test]
fn pac_nerf_particles_project_into_the_masks() {
    check("demo", Format::PacNerf, 11, 14, 24.0);
    check("scenes/torus", Format::PacNerf, 11, 14, 24.0);
    check("scenes/sand_1", Format::PacNerf, 11, 14, 24.0);
}

#[test]
fn spring_gaus_synthetic_particles_project_into_the_masks() {
    check("spring_gaus/sg_torus", Format::SpringGausSynthetic, 10, 30, 100.0 / 3.0);
    check("spring_gaus/sg_cross", Format::SpringGausSynthetic, 10, 30, 100.0 / 3.0);
}
