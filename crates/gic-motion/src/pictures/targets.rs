//! The pictures to reproduce: the object over black inside its mask's box; all else is known to be empty.

use gic_scene::{Camera, Mask, Picture, Scene, SceneError, Split, View};
use rayon::prelude::*;

/// Rows of a picture per parallel task, at least.
const ROWS_PER_TASK: usize = 32;

/// One training or test picture.
#[derive(Clone, Debug)]
pub struct Target {
    /// The camera; its size is the picture's.
    pub camera: Camera,
    /// Its index in the scene's list.
    pub camera_index: usize,
    /// Number of the frame.
    pub frame: usize,
    /// Time of the frame [s].
    pub time: f64,
    /// Area of the mask [pixels].
    pub area: f64,
    /// Mean of the mask's pixels, image coordinates [pixels].
    pub centre: [f64; 2],
    /// Where the mask is above zero.
    pub bounds: Bounds,
    /// Width of its pixels in those of the picture on disk.
    pub pixel: f64,
    /// Colour over black and coverage, 8 bits each like the pictures on disk, inside `bounds`.
    pixels: Vec<[u8; 4]>,
}

/// Columns `x0..x1`, rows `y0..y1` of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bounds {
    /// First column.
    pub x0: usize,
    /// First row.
    pub y0: usize,
    /// One past the last column.
    pub x1: usize,
    /// One past the last row.
    pub y1: usize,
}

impl Bounds {
    /// No pixel; the union with it changes nothing.
    pub const EMPTY: Bounds = Bounds { x0: usize::MAX, y0: usize::MAX, x1: 0, y1: 0 };

    /// Whether it holds no pixel.
    pub fn is_empty(&self) -> bool {
        self.x1 <= self.x0 || self.y1 <= self.y0
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.x1.saturating_sub(self.x0)
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.y1.saturating_sub(self.y0)
    }

    /// Columns and rows of its pixels, row by row.
    fn pixels(self) -> impl Iterator<Item = (usize, usize)> {
        (self.y0..self.y1).flat_map(move |y| (self.x0..self.x1).map(move |x| (x, y)))
    }

    /// The smallest rectangle that holds both.
    pub fn union(self, other: Bounds) -> Bounds {
        Bounds {
            x0: self.x0.min(other.x0),
            y0: self.y0.min(other.y0),
            x1: self.x1.max(other.x1),
            y1: self.y1.max(other.y1),
        }
    }
}

impl Target {
    fn new(scene: &Scene, view: &View, picture: &Picture, mask: &Mask) -> Target {
        let byte = |v: f32| (v * 255.0).round().clamp(0.0, 255.0) as u8;
        let (bounds, area, centre) = extent((mask.width, mask.height), |x, y| f64::from(mask.at(x, y)));
        let pixel = |(x, y)| {
            let (a, [r, g, b]) = (mask.at(x, y), picture.at(x, y));
            [byte(a * r), byte(a * g), byte(a * b), byte(a)]
        };
        let pixels = bounds.pixels().map(pixel).collect();
        Target {
            camera: scene.camera_at_frame(view).into_owned(),
            camera_index: view.camera,
            frame: view.frame,
            time: scene.times[view.frame],
            area,
            centre,
            bounds,
            pixel: 1.0,
            pixels,
        }
    }

    /// The picture at half its size, each pixel the mean of four; a last odd column or row is left out.
    pub fn halved(&self) -> Target {
        let mut camera = self.camera.clone();
        (camera.width, camera.height) = ((camera.width / 2).max(1), (camera.height / 2).max(1));
        camera.focal /= 2.0;
        camera.principal /= 2.0;
        let mean = |x: usize, y: usize| -> [u8; 4] {
            let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| self.pixel(2 * x + i, 2 * y + j));
            core::array::from_fn(|c| ((four.iter().map(|p| u16::from(p[c])).sum::<u16>() + 2) / 4) as u8)
        };
        let size = (camera.width, camera.height);
        let (bounds, area, centre) = extent(size, |x, y| f64::from(mean(x, y)[3]) / 255.0);
        let pixels = bounds.pixels().map(|(x, y)| mean(x, y)).collect();
        Target { camera, area, centre, bounds, pixel: 2.0 * self.pixel, pixels, ..*self }
    }

    /// Coverage of the pixel in column `x`, row `y`.
    pub fn coverage(&self, x: usize, y: usize) -> f32 {
        f32::from(self.pixel(x, y)[3]) / 255.0
    }

    /// The mask of the whole picture.
    pub fn mask(&self) -> Mask {
        let (_, coverage) = self.crop(self.whole());
        Mask { width: self.camera.width, height: self.camera.height, coverage }
    }

    /// The whole picture, straight colours, black where the mask is empty.
    pub fn picture(&self) -> Picture {
        let (color, coverage) = self.crop(self.whole());
        let straight = color.iter().zip(coverage).flat_map(|(c, a)| c.map(|c| if a > 0.0 { c / a } else { 0.0 }));
        Picture { width: self.camera.width, height: self.camera.height, rgb: straight.collect() }
    }

    /// The bounds of the whole picture.
    pub fn whole(&self) -> Bounds {
        Bounds { x0: 0, y0: 0, x1: self.camera.width, y1: self.camera.height }
    }

    /// Colour over black and coverage inside `window`, row-major.
    pub fn crop(&self, window: Bounds) -> (Vec<[f32; 3]>, Vec<f32>) {
        let unit = |v: u8| f32::from(v) / 255.0;
        let pixels = window.width() * window.height();
        let (mut color, mut coverage) = (vec![[0.0; 3]; pixels], vec![0.0; pixels]);
        let width = window.width().max(1);
        let rows = color.par_chunks_mut(width).zip(coverage.par_chunks_mut(width)).enumerate();
        rows.with_min_len(ROWS_PER_TASK).for_each(|(row, (color, coverage))| {
            for (x, (color, coverage)) in (window.x0..window.x1).zip(color.iter_mut().zip(coverage)) {
                let [r, g, b, a] = self.pixel(x, window.y0 + row);
                (*color, *coverage) = ([unit(r), unit(g), unit(b)], unit(a));
            }
        });
        (color, coverage)
    }

    fn pixel(&self, x: usize, y: usize) -> [u8; 4] {
        let b = &self.bounds;
        let inside = x >= b.x0 && x < b.x1 && y >= b.y0 && y < b.y1;
        if inside { self.pixels[(y - b.y0) * b.width() + (x - b.x0)] } else { [0; 4] }
    }
}

/// Where a mask is above zero, its area [pixels], and the mean of its pixels [pixels].
fn extent((width, height): (usize, usize), coverage: impl Fn(usize, usize) -> f64) -> (Bounds, f64, [f64; 2]) {
    let mut bounds = Bounds::EMPTY;
    let (mut area, mut sum) = (0.0f64, [0.0f64; 2]);
    for y in 0..height {
        for x in 0..width {
            let a = coverage(x, y);
            if a > 0.0 {
                bounds = bounds.union(Bounds { x0: x, y0: y, x1: x + 1, y1: y + 1 });
                area += a;
                sum[0] += a * (x as f64 + 0.5);
                sum[1] += a * (y as f64 + 0.5);
            }
        }
    }
    (bounds, area, sum.map(|s| s / area.max(f64::MIN_POSITIVE)))
}

/// The camera whose picture is `window` of this camera's picture.
pub fn windowed(camera: &Camera, window: Bounds) -> Camera {
    let mut cropped = camera.clone();
    cropped.width = window.width();
    cropped.height = window.height();
    cropped.principal.x -= window.x0 as f64;
    cropped.principal.y -= window.y0 as f64;
    cropped
}

/// Pictures to train on: everything meant for training except the held-out cameras.
///
/// # Errors
/// A picture or mask that cannot be read.
pub fn training(scene: &Scene, held_out: &[usize]) -> Result<Vec<Target>, SceneError> {
    load(scene, scene.views.iter().filter(|v| v.split == Split::Train && !held_out.contains(&v.camera)))
}

/// Pictures to measure on: the held-out cameras, or what the format sets aside for tests.
///
/// # Errors
/// A picture or mask that cannot be read.
pub fn held_out(scene: &Scene, held_out: &[usize]) -> Result<Vec<Target>, SceneError> {
    let wanted = |v: &&View| match held_out {
        [] => v.split == Split::Test,
        cameras => cameras.contains(&v.camera),
    };
    load(scene, scene.views.iter().filter(wanted))
}

/// The pictures of the first frame.
///
/// # Errors
/// A picture or mask that cannot be read.
pub fn first_frame(scene: &Scene) -> Result<Vec<Target>, SceneError> {
    load(scene, scene.views_at(0).iter())
}

fn load<'a>(scene: &Scene, views: impl Iterator<Item = &'a View>) -> Result<Vec<Target>, SceneError> {
    let views: Vec<&View> = views.collect();
    views
        .par_iter()
        .map(|view| scene.load(view).map(|(picture, mask)| Target::new(scene, view, &picture, &mask)))
        .collect()
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec2, DVec3};

    use super::*;

    fn target() -> Target {
        let camera = Camera {
            width: 7,
            height: 6,
            focal: DVec2::splat(10.0),
            principal: DVec2::new(3.5, 3.0),
            world_from_camera: DMat3::IDENTITY,
            centre: DVec3::new(0.0, 0.0, -2.0),
        };
        let bounds = Bounds { x0: 2, y0: 1, x1: 6, y1: 4 };
        let pixels = (0..12).map(|i| [10 * i, 5 * i, 2 * i, 20 * i + 4]).collect();
        let (area, centre) = (0.0, [0.0; 2]);
        Target { camera, camera_index: 1, frame: 2, time: 0.5, area, centre, bounds, pixel: 1.0, pixels }
    }

    #[test]
    fn halving_keeps_what_a_point_shows_and_where() {
        let full = target();
        let half = full.halved();
        assert_eq!((half.camera.width, half.camera.height, half.pixel), (3, 3, 2.0));
        let point = DVec3::new(0.1, -0.05, 0.3);
        let ((a, _), (b, _)) = (full.camera.project(point).unwrap(), half.camera.project(point).unwrap());
        assert!((a / 2.0 - b).length() < 1e-12);
        assert_eq!(half.bounds, Bounds { x0: 1, y0: 0, x1: 3, y1: 2 });
        // Rows 0 and 1 of the picture, of which row 0 is empty; columns 2 and 3 hold pixels 0 and 1.
        assert_eq!(half.pixel(1, 0), [3, 1, 1, 7]);
        // Rows 2 and 3, columns 4 and 5: pixels 6, 7, 10, 11.
        assert_eq!(half.pixel(2, 1), [85, 43, 17, 174]);
        let sum: f64 = (0..12).map(|i| f64::from(20 * i + 4) / 255.0).sum();
        assert!((half.area - sum / 4.0).abs() < 0.01, "{} against {sum} / 4", half.area);
    }
}
