//! Rays through the cells of a hull (Amanatides and Woo 1987), and the silhouettes that follow from them.

use std::ops::Range;

use glam::{DVec2, DVec3, IVec3};
use rayon::prelude::*;

use super::{Hull, HullView};
use crate::camera::Camera;

impl Hull {
    /// Which pixels of a camera see the hull, row-major: the ray through the pixel's centre runs through at least one
    /// cell's length of it. (A ray that clips less than that passes the object: cells stick out by half their size.)
    pub fn silhouette(&self, camera: &Camera) -> Vec<bool> {
        let mut seen = vec![false; camera.width * camera.height];
        let (columns, rows) = self.pixel_range(camera);
        seen.par_chunks_mut(camera.width).enumerate().for_each(|(row, seen)| {
            if !rows.contains(&row) {
                return;
            }
            for column in columns.clone() {
                let pixel = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
                let direction = (camera.unproject(pixel, 1.0) - camera.centre).normalize();
                seen[column] = self.walk(camera.centre, direction, self.cell).is_some();
            }
        });
        seen
    }

    /// Columns and rows of a camera's picture that can see the grid.
    fn pixel_range(&self, camera: &Camera) -> (Range<usize>, Range<usize>) {
        let (low, high) = self.bounds();
        let (mut first, mut last) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for corner in 0..8 {
            let pick = |axis: usize| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] };
            match camera.project(DVec3::new(pick(0), pick(1), pick(2))) {
                Some((pixel, _)) => (first, last) = (first.min(pixel), last.max(pixel)),
                // The box reaches behind the camera: any pixel may see it.
                None => return (0..camera.width, 0..camera.height),
            }
        }
        let cut = |first: f64, last: f64, size: usize| {
            let size_f = size as f64;
            (first.clamp(0.0, size_f).floor() as usize)..(last.clamp(0.0, size_f).ceil() as usize).min(size)
        };
        (cut(first.x, last.x, camera.width), cut(first.y, last.y, camera.height))
    }

    /// Intersection over union of the hull's silhouette with a mask, in pixels; 1 where both are empty.
    pub fn reprojection_iou(&self, view: &HullView) -> f64 {
        let seen = self.silhouette(view.camera);
        let (mut both, mut either) = (0_usize, 0_usize);
        for (&seen, &coverage) in seen.iter().zip(&view.mask.coverage) {
            let masked = coverage >= 0.5;
            both += usize::from(seen && masked);
            either += usize::from(seen || masked);
        }
        if either == 0 { 1.0 } else { both as f64 / either as f64 }
    }

    /// The distance [m] along the unit vector `direction` at which a ray enters the first occupied cell.
    pub fn first_hit(&self, start: DVec3, direction: DVec3) -> Option<f64> {
        self.walk(start, direction, 0.0)
    }

    /// Walks along a ray from cell to cell; returns the distance [m] at which it has run through more than `chord`
    /// metres of occupied cells, or where it meets the first one if `chord` is zero.
    fn walk(&self, start: DVec3, direction: DVec3, mut chord: f64) -> Option<f64> {
        let upper = DVec3::new(self.size[0] as f64, self.size[1] as f64, self.size[2] as f64);
        let origin = (start - self.origin) / self.cell;
        let step = direction / self.cell;
        let (enter, leave) = slab(origin, step, upper)?;
        let entry = (origin + step * enter).clamp(DVec3::ZERO, upper - DVec3::splat(1e-9));
        let mut index = entry.floor().as_ivec3();
        let sign = IVec3::new(sign_of(step.x), sign_of(step.y), sign_of(step.z));
        let to_wall = |axis: usize, index: IVec3| {
            let wall = f64::from(index[axis] + i32::from(sign[axis] > 0));
            if sign[axis] == 0 { f64::INFINITY } else { (wall - origin[axis]) / step[axis] }
        };
        let mut next = DVec3::new(to_wall(0, index), to_wall(1, index), to_wall(2, index));
        let mut distance = enter;
        while distance <= leave {
            let axis = next.min_position();
            if self.occupied_at(index) {
                chord -= next[axis] - distance;
                if chord <= 0.0 {
                    return Some(distance);
                }
            }
            distance = next[axis];
            index[axis] += sign[axis];
            if index[axis] < 0 || index[axis] >= self.size[axis] as i32 {
                return None;
            }
            next[axis] = to_wall(axis, index);
        }
        None
    }
}

fn sign_of(value: f64) -> i32 {
    i32::from(value > 0.0) - i32::from(value < 0.0)
}

/// Where a ray is inside the box from 0 to `upper`: from, to, in lengths of `step`, from 0 on.
fn slab(origin: DVec3, step: DVec3, upper: DVec3) -> Option<(f64, f64)> {
    let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
    for axis in 0..3 {
        if step[axis] == 0.0 {
            if !(0.0..=upper[axis]).contains(&origin[axis]) {
                return None;
            }
            continue;
        }
        let (a, b) = (-origin[axis] / step[axis], (upper[axis] - origin[axis]) / step[axis]);
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    (enter <= leave).then_some((enter, leave))
}
