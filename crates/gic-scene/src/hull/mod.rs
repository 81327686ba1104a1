//! The visual hull (Laurentini 1994): all points of space that project into the object's mask in every view.
//!
//! [`Hull::carve`] makes it, `ray_walk` follows rays through its cells, `colour` takes colours from the pictures.

mod carve;
mod colour;
mod ray_walk;
#[cfg(test)]
mod tests;

use gic_geometry::SurfacePoint;
use glam::{DVec3, IVec3};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::picture::Mask;

/// One view to carve with.
#[derive(Clone, Copy, Debug)]
pub struct HullView<'a> {
    /// The camera; its size is the mask's.
    pub camera: &'a Camera,
    /// The object's mask.
    pub mask: &'a Mask,
}

/// Settings for carving.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HullSettings {
    /// Cells along the longest side of the hull's bounding box.
    pub resolution: usize,
    /// In how many views a point may lie outside the mask and still belong to the hull: 0 for exact masks of one
    /// moment.
    pub tolerated_misses: usize,
}

impl Default for HullSettings {
    fn default() -> HullSettings {
        HullSettings { resolution: 64, tolerated_misses: 0 }
    }
}

/// A carved grid of cubic cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Hull {
    /// The lower corner of the grid [m].
    pub origin: DVec3,
    /// The side of a cell [m].
    pub cell: f64,
    /// Cells along x, y, z.
    pub size: [usize; 3],
    /// Whether the centre of the cell belongs to the hull; x runs fastest, then y, then z.
    pub occupied: Vec<bool>,
}

impl Hull {
    /// Number of occupied cells.
    pub fn count(&self) -> usize {
        self.occupied.iter().filter(|&&o| o).count()
    }

    /// Volume [m^3].
    pub fn volume(&self) -> f64 {
        self.count() as f64 * self.cell.powi(3)
    }

    /// The lower and upper corner [m] of the box around the occupied cells.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let (first, last) = occupied_range(&self.occupied, self.size).unwrap_or((IVec3::ZERO, IVec3::NEG_ONE));
        (self.origin + first.as_dvec3() * self.cell, self.origin + (last + IVec3::ONE).as_dvec3() * self.cell)
    }

    /// Whether a point [m] lies in an occupied cell.
    pub fn contains(&self, x: DVec3) -> bool {
        let index = ((x - self.origin) / self.cell).floor();
        index.is_finite() && self.occupied_at(index.as_ivec3())
    }

    /// The centres [m] of the occupied cells, x fastest.
    pub fn points(&self) -> Vec<DVec3> {
        self.occupied_cells().map(|index| self.centre(index)).collect()
    }

    /// The centres of the occupied cells with a free neighbour, with normals from the occupancy around them.
    pub fn surface(&self) -> Vec<SurfacePoint> {
        let neighbours = [IVec3::X, IVec3::NEG_X, IVec3::Y, IVec3::NEG_Y, IVec3::Z, IVec3::NEG_Z];
        let exposed = |&index: &IVec3| neighbours.iter().any(|&step| !self.occupied_at(index + step));
        let cells: Vec<IVec3> = self.occupied_cells().filter(exposed).collect();
        cells
            .into_par_iter()
            .map(|index| SurfacePoint { position: self.centre(index), normal: self.normal(index) })
            .collect()
    }

    fn occupied_cells(&self) -> impl Iterator<Item = IVec3> + '_ {
        let [nx, ny, _] = self.size;
        let cells = self.occupied.iter().enumerate().filter(|&(_, &occupied)| occupied);
        cells.map(move |(i, _)| IVec3::new((i % nx) as i32, (i / nx % ny) as i32, (i / (nx * ny)) as i32))
    }

    fn centre(&self, index: IVec3) -> DVec3 {
        self.origin + (index.as_dvec3() + DVec3::splat(0.5)) * self.cell
    }

    fn occupied_at(&self, index: IVec3) -> bool {
        let [nx, ny, nz] = self.size;
        let inside = index.cmpge(IVec3::ZERO).all() && index.cmplt(IVec3::new(nx as i32, ny as i32, nz as i32)).all();
        inside && self.occupied[(index.z as usize * ny + index.y as usize) * nx + index.x as usize]
    }

    /// The direction away from the occupied cells within two cells around `index`.
    fn normal(&self, index: IVec3) -> DVec3 {
        let mut sum = DVec3::ZERO;
        for z in -2..=2 {
            for y in -2..=2 {
                for x in -2..=2 {
                    let step = IVec3::new(x, y, z);
                    if self.occupied_at(index + step) {
                        sum -= step.as_dvec3();
                    }
                }
            }
        }
        sum.normalize_or(DVec3::Y)
    }
}

/// First and last index of occupied cells along each axis.
fn occupied_range(occupied: &[bool], size: [usize; 3]) -> Option<(IVec3, IVec3)> {
    let (mut first, mut last) = (IVec3::MAX, IVec3::MIN);
    for (row, cells) in occupied.chunks(size[0]).enumerate() {
        let Some(start) = cells.iter().position(|&o| o) else { continue };
        let end = cells.iter().rposition(|&o| o).unwrap_or(start);
        let (y, z) = ((row % size[1]) as i32, (row / size[1]) as i32);
        first = first.min(IVec3::new(start as i32, y, z));
        last = last.max(IVec3::new(end as i32, y, z));
    }
    (first.x <= last.x).then_some((first, last))
}
