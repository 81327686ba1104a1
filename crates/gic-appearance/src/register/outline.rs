//! A cheap score of a starting rotation: points of the scan as bits on coarse outlines of the masks.

use gic_motion::pictures::{Bounds, Target, windowed};
use gic_scene::Camera;
use glam::{DMat3, DVec2, DVec3};

use super::placement::Placement;
use crate::tuning::{ALIGNMENT_ROUNDS, CELLS_ACROSS_MASK, OUTLINE_MARGIN};

/// A mask as bits.
pub(crate) struct Outline {
    camera: Camera,
    covered: Vec<bool>,
    shape: Moments,
}

/// Number and mean of the cells that are set.
#[derive(Clone, Copy, Default)]
struct Moments {
    count: f64,
    mean: DVec2,
}

impl Moments {
    fn of(bits: &[bool], width: usize) -> Moments {
        let (mut count, mut sum) = (0.0, DVec2::ZERO);
        for (i, _) in bits.iter().enumerate().filter(|(_, bit)| **bit) {
            count += 1.0;
            sum += DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        }
        Moments { count, mean: sum / f64::max(count, 1.0) }
    }
}

impl Outline {
    pub(crate) fn new(target: &Target) -> Outline {
        let cell = (target.area.sqrt() / CELLS_ACROSS_MASK).round().max(1.0) as usize;
        let b = target.bounds;
        let margin = |size: usize| (OUTLINE_MARGIN * size as f64) as usize + 1;
        let window = Bounds {
            x0: b.x0.saturating_sub(margin(b.width())),
            y0: b.y0.saturating_sub(margin(b.height())),
            x1: (b.x1 + margin(b.width())).min(target.camera.width),
            y1: (b.y1 + margin(b.height())).min(target.camera.height),
        };
        let mut camera = windowed(&target.camera, window);
        camera.focal /= cell as f64;
        camera.principal /= cell as f64;
        (camera.width, camera.height) = (window.width().div_ceil(cell), window.height().div_ceil(cell));
        let mut covered = vec![false; camera.width * camera.height];
        // A cell is set where anything of the object is in it, as the points set them.
        for y in b.y0..b.y1 {
            for x in b.x0..b.x1 {
                let (column, row) = ((x - window.x0) / cell, (y - window.y0) / cell);
                covered[row * camera.width + column] |= target.coverage(x, y) >= 0.5;
            }
        }
        let shape = Moments::of(&covered, camera.width);
        Outline { camera, covered, shape }
    }

    /// The cells that hold a point.
    fn draw(&self, points: &[DVec3], placement: &Placement) -> Vec<bool> {
        let mut drawn = vec![false; self.covered.len()];
        let turn = self.camera.world_from_camera.transpose();
        let to_camera = turn * DMat3::from_quat(placement.rotation) * placement.scale;
        let offset = turn * (placement.place - self.camera.centre);
        for x in points {
            let c = to_camera * *x + offset;
            let pixel = self.camera.focal * DVec2::new(c.x, c.y) / c.z + self.camera.principal;
            let inside = c.z > 0.0
                && pixel.x >= 0.0
                && pixel.y >= 0.0
                && pixel.x < self.camera.width as f64
                && pixel.y < self.camera.height as f64;
            if inside {
                drawn[pixel.y as usize * self.camera.width + pixel.x as usize] = true;
            }
        }
        drawn
    }

    fn overlap(&self, drawn: &[bool]) -> f64 {
        let both = self.covered.iter().zip(drawn).filter(|(a, b)| **a && **b).count();
        let either = self.covered.iter().zip(drawn).filter(|(a, b)| **a || **b).count();
        both as f64 / either.max(1) as f64
    }
}

/// Moves and grows a placement, its rotation given, until the outlines lie on the masks'; returns the mean overlap.
///
/// `points` are relative to the placement's pivot, in units of the scan.
pub(crate) fn align_outlines(points: &[DVec3], outlines: &[Outline], start: Placement) -> (Placement, f64) {
    let mut placement = start;
    for round in 0.. {
        let drawn: Vec<Vec<bool>> = outlines.iter().map(|outline| outline.draw(points, &placement)).collect();
        if round == ALIGNMENT_ROUNDS {
            let sum: f64 = outlines.iter().zip(&drawn).map(|(outline, drawn)| outline.overlap(drawn)).sum();
            return (placement, sum / outlines.len() as f64);
        }
        let shapes: Vec<Moments> =
            outlines.iter().zip(&drawn).map(|(o, drawn)| Moments::of(drawn, o.camera.width)).collect();
        placement.place += shift(outlines, &shapes, placement.place);
        let growth = |(o, s): (&Outline, &Moments)| 0.5 * (o.shape.count / s.count.max(1.0)).ln();
        placement.scale *= (outlines.iter().zip(&shapes).map(growth).sum::<f64>() / outlines.len() as f64).exp();
    }
    unreachable!("the rounds end")
}

/// The shift [m] of what lies at `place` that brings the outlines' centres onto the masks', by least squares.
fn shift(outlines: &[Outline], shapes: &[Moments], place: DVec3) -> DVec3 {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (outline, shape) in outlines.iter().zip(shapes).filter(|(_, shape)| shape.count > 0.0) {
        let axes = outline.camera.world_from_camera;
        let c = outline.camera.to_camera(place);
        // Metres across at the object's distance, so that all cameras count alike.
        let miss = (outline.shape.mean - shape.mean) * c.z / outline.camera.focal;
        for (axis, miss, slope) in [(axes.x_axis, miss.x, c.x / c.z), (axes.y_axis, miss.y, c.y / c.z)] {
            let row = axis - slope * axes.z_axis;
            normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
            right += row * miss;
        }
    }
    let shift = normal.inverse() * right;
    if shift.is_finite() { shift } else { DVec3::ZERO }
}
