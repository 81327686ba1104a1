//! Boards as cameras see them: rectangles of black on white paper, through a lens, with noise.

#![allow(dead_code)]

use std::collections::HashMap;
use std::path::Path;

use gic_calibrate::{Black, Board, Lens};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rayon::prelude::*;

/// Places across a pixel that are averaged.
const PLACES: usize = 3;
/// Side of a cell that rectangles are looked up by [m].
const CELL_M: f64 = 0.006;
/// White around what is black [m].
const WHITE_M: f64 = 0.01;

/// A page in the world, its rectangles by the cells that they touch.
pub(crate) struct Page {
    world_from_page: Isometry3<f64>,
    cells: HashMap<[i64; 2], Vec<Black>>,
}

impl Page {
    /// A page that lies in the world.
    pub(crate) fn new(world_from_page: Isometry3<f64>, black: &[Black]) -> Page {
        let mut cells: HashMap<[i64; 2], Vec<Black>> = HashMap::new();
        for b in black {
            let low = b.corner.map(|c| cell(c - WHITE_M));
            let high = [0, 1].map(|axis| cell(b.corner[axis] + b.sides[axis] + WHITE_M));
            for x in low[0]..=high[0] {
                (low[1]..=high[1]).for_each(|y| cells.entry([x, y]).or_default().push(*b));
            }
        }
        Page { world_from_page, cells }
    }
}

fn cell(place: f64) -> i64 {
    (place / CELL_M).floor() as i64
}

/// A camera of a test.
pub(crate) struct Camera {
    pub(crate) lens: Lens,
    pub(crate) size: [usize; 2],
    pub(crate) world_from_camera: Isometry3<f64>,
}

impl Camera {
    /// A camera at `eye` [m] that looks at `target` [m], z up.
    pub(crate) fn looking(lens: Lens, size: [usize; 2], eye: [f64; 3], target: [f64; 3]) -> Camera {
        let forward = (Vector3::from(target) - Vector3::from(eye)).normalize();
        let right = forward.cross(&Vector3::z()).normalize();
        let axes = Matrix3::from_columns(&[right, forward.cross(&right), forward]);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        Camera {
            lens,
            size,
            world_from_camera: Isometry3::from_parts(Translation3::from(Vector3::from(eye)), rotation),
        }
    }

    /// The direction that a pixel shows: Newton's method on the lens, with differences.
    fn direction(&self, pixel: [f64; 2]) -> Vector3<f64> {
        let [fx, fy] = self.lens.focal_px();
        let [cx, cy] = self.lens.principal_px();
        let mut ray = Vector3::new((pixel[0] - cx) / fx, (pixel[1] - cy) / fy, 1.0);
        for _ in 0..5 {
            let seen = self.lens.project(&ray).expect("before the camera");
            ray += Vector3::new((pixel[0] - seen.x) / fx, (pixel[1] - seen.y) / fy, 0.0);
        }
        ray
    }

    /// The picture of pages that lie in the world, grey and with noise of `noise` levels, as PNG.
    pub(crate) fn draw(&self, pages: &[Page], noise: f64, seed: u64, file: &Path) {
        let [width, height] = self.size;
        let pixel = |n: usize| {
            let mut white = 0.0;
            for sub in 0..PLACES * PLACES {
                let place = |k: usize| (k as f64 + 0.5) / PLACES as f64;
                let at = [(n % width) as f64 + place(sub % PLACES), (n / width) as f64 + place(sub / PLACES)];
                white += self.brightness(pages, at) / (PLACES * PLACES) as f64;
            }
            let random: f64 = (0..4).map(|k| uniform(seed, (4 * n + k) as u64) - 0.5).sum::<f64>() * 3f64.sqrt();
            image::Luma([(white + noise * random).round().clamp(0.0, 255.0) as u8])
        };
        let pixels: Vec<image::Luma<u8>> = (0..width * height).into_par_iter().map(pixel).collect();
        let picture =
            image::GrayImage::from_fn(width as u32, height as u32, |x, y| pixels[y as usize * width + x as usize]);
        image::DynamicImage::ImageLuma8(picture).into_rgb8().save(file).expect("written");
    }

    /// White paper, ink, and a grey floor beside them.
    fn brightness(&self, pages: &[Page], pixel: [f64; 2]) -> f64 {
        let ray = self.world_from_camera.rotation * self.direction(pixel);
        let eye = self.world_from_camera.translation.vector;
        for Page { world_from_page, cells } in pages {
            let (ray, eye) = (world_from_page.inverse() * ray, world_from_page.inverse() * Point3::from(eye));
            let depth = -eye.z / ray.z;
            if depth.is_nan() || depth <= 0.0 {
                continue;
            }
            let [x, y] = [eye.x + depth * ray.x, eye.y + depth * ray.y];
            let inside = |b: &Black, around: f64| {
                x > b.corner[0] - around
                    && x < b.corner[0] + b.sides[0] + around
                    && y > b.corner[1] - around
                    && y < b.corner[1] + b.sides[1] + around
            };
            let Some(black) = cells.get(&[cell(x), cell(y)]) else { continue };
            if black.iter().any(|b| inside(b, 0.0)) {
                return 40.0;
            }
            if black.iter().any(|b| inside(b, WHITE_M)) {
                return 210.0;
            }
        }
        120.0
    }
}

/// A number from 0 to 1 by a seed and a place (SplitMix64).
fn uniform(seed: u64, n: u64) -> f64 {
    let mut z = seed.wrapping_mul(0x1000_0001).wrapping_add(n.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// A page on the floor: turned [rad], then shifted [m].
pub(crate) fn on_floor(board: Board, sheet: usize, side_m: f64, angle: f64, shift: [f64; 2]) -> Page {
    let place = Isometry3::new(Vector3::new(shift[0], shift[1], 0.0), Vector3::z() * angle);
    Page::new(place, &board.black(sheet, side_m))
}

impl Page {
    /// Where it lies.
    pub(crate) fn place(&self) -> Isometry3<f64> {
        self.world_from_page
    }
}
