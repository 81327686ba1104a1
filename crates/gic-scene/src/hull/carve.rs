//! Carving by cubes of space.
//!
//! A cube whose projection meets no mask pixel in some view is empty; one whose projection lies inside the masks of all
//! views is full. Only cubes that straddle an outline are divided into eight, so the cost grows with the surface, not
//! the volume. The number of mask pixels in a rectangle comes from a summed-area table (Crow 1984).

use glam::{DMat3, DVec2, DVec3, IVec3};
use rayon::prelude::*;

use super::{Hull, HullSettings, HullView, occupied_range};
use crate::camera::Camera;
use crate::picture::{Mask, PixelBox};

/// Cells along the side of a block, the largest cube of the hierarchy.
const BLOCK_CELLS: usize = 8;
/// Cells along the longest side of the grids that search for the bounding box.
const SEARCH_RESOLUTION: usize = 32;

impl Hull {
    /// Carves the hull of the object in `views`. `None` when nothing remains: masks are empty, or no point of space
    /// projects into all of them (which wrong camera poses cause).
    pub fn carve(views: &[HullView], settings: &HullSettings) -> Option<Hull> {
        let tables: Vec<MaskTable> = views.iter().map(MaskTable::new).collect();
        let (mut low, mut high) = first_box(views)?;
        // The first box is a guess: grow it while the hull reaches its walls, then shrink it around the hull.
        for _ in 0..12 {
            let (cell, size) = grid_shape(high - low, SEARCH_RESOLUTION);
            let possible = search_grid(&tables, low, cell, size, settings.tolerated_misses);
            let (first, last) = occupied_range(&possible, size)?;
            let extent = high - low;
            let touches = (0..3).any(|axis| first[axis] == 0 || last[axis] + 1 == size[axis] as i32);
            let (new_low, new_high) = (low + first.as_dvec3() * cell, low + (last + IVec3::ONE).as_dvec3() * cell);
            if touches && extent.max_element() < 64.0 * scene_scale(views) {
                (low, high) = (new_low - extent / 2.0, new_high + extent / 2.0);
                continue;
            }
            let shrunk = (new_high - new_low).max_element() / extent.max_element();
            // One cell of air on every side, so that the hull of the next round does not touch the walls.
            (low, high) = (new_low - DVec3::splat(cell), new_high + DVec3::splat(cell));
            if shrunk > 0.7 {
                break;
            }
        }
        let (cell, size) = grid_shape(high - low, settings.resolution);
        let occupied = carve_grid(&tables, low, cell, size, settings.tolerated_misses);
        occupied.contains(&true).then_some(Hull { origin: low, cell, size, occupied })
    }
}

/// The side of a cell, and cells along each axis in whole blocks, for a box with `resolution` cells on its longest
/// side.
fn grid_shape(extent: DVec3, resolution: usize) -> (f64, [usize; 3]) {
    let cell = extent.max_element() / resolution.max(1) as f64;
    let cells = |side: f64| ((side / cell - 1e-6).ceil().max(1.0)) as usize;
    (cell, [cells(extent.x), cells(extent.y), cells(extent.z)])
}

/// The largest distance between cameras, or from the world's origin for a single one: the scale of the scene.
fn scene_scale(views: &[HullView]) -> f64 {
    let first = views[0].camera.centre;
    let spread = views.iter().map(|view| (view.camera.centre - first).length()).fold(0.0, f64::max);
    if spread > 0.0 { spread } else { first.length().max(1.0) }
}

/// A first guess of the object's box: a cube around the point closest to the rays through the masks' centres, as large
/// as the largest mask there.
fn first_box(views: &[HullView]) -> Option<(DVec3, DVec3)> {
    let boxes: Vec<_> = views.iter().filter_map(|view| Some((view.camera, view.mask.bounding_box()?))).collect();
    if boxes.is_empty() {
        return None;
    }
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (camera, b) in &boxes {
        let middle = DVec2::new((b.x0 + b.x1) as f64 / 2.0, (b.y0 + b.y1) as f64 / 2.0);
        let ray = (camera.unproject(middle, 1.0) - camera.centre).normalize_or_zero();
        let across = DMat3::IDENTITY - DMat3::from_cols(ray * ray.x, ray * ray.y, ray * ray.z);
        normal += across;
        right += across * camera.centre;
    }
    // Parallel rays leave the depth open: a trace of the identity picks a point, and the box grows from there.
    let centre = (normal + DMat3::IDENTITY * 1e-9).inverse() * right;
    let radius = |(camera, b): &(&Camera, PixelBox)| {
        let depth = (centre - camera.centre).length();
        let diagonal = DVec2::new((b.x1 - b.x0) as f64, (b.y1 - b.y0) as f64) / camera.focal;
        depth * diagonal.length() / 2.0
    };
    let half = DVec3::splat(2.0 * boxes.iter().map(radius).fold(0.0, f64::max));
    (centre.is_finite() && half.is_finite() && half.x > 0.0).then_some((centre - half, centre + half))
}

/// What a view says about a cube of space.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Containment {
    Outside,
    Mixed,
    Inside,
}

/// A view with the summed-area table of its mask.
pub(super) struct MaskTable<'a> {
    camera: &'a Camera,
    mask: &'a Mask,
    camera_from_world: DMat3,
    /// `sums[row * (width + 1) + column]`: mask pixels above and to the left.
    sums: Vec<u32>,
    /// Whether the object reaches the border of the picture: then what lies outside the picture is unknown, not empty.
    cropped: bool,
}

impl<'a> MaskTable<'a> {
    pub(super) fn new(view: &HullView<'a>) -> MaskTable<'a> {
        let HullView { camera, mask } = *view;
        let stride = mask.width + 1;
        let mut sums = vec![0; stride * (mask.height + 1)];
        for row in 0..mask.height {
            let mut along = 0;
            for column in 0..mask.width {
                along += u32::from(mask.at(column, row) >= 0.5);
                sums[(row + 1) * stride + column + 1] = sums[row * stride + column + 1] + along;
            }
        }
        MaskTable {
            camera,
            mask,
            camera_from_world: camera.world_from_camera.transpose(),
            sums,
            cropped: mask.touches_border(),
        }
    }

    /// Mask pixels in columns `x0..x1`, rows `y0..y1`.
    fn count(&self, x0: usize, y0: usize, x1: usize, y1: usize) -> u32 {
        let at = |x: usize, y: usize| self.sums[y * (self.mask.width + 1) + x];
        at(x1, y1) + at(x0, y0) - at(x0, y1) - at(x1, y0)
    }

    /// Judges all points of the ball around `centre`.
    fn classify_ball(&self, centre: DVec3, radius: f64) -> Containment {
        let c = self.camera_from_world * (centre - self.camera.centre);
        if c.z + radius <= 0.0 {
            return Containment::Outside;
        }
        if c.z - radius < 1e-3 * radius {
            return Containment::Mixed;
        }
        // |x/z - X/Z| <= r sqrt(X^2 + Z^2) / (Z (Z - r)) for every point (x, z) of the ball.
        let scale = radius / (c.z * (c.z - radius));
        let spread = self.camera.focal * scale * DVec2::new(c.x.hypot(c.z), c.y.hypot(c.z));
        let middle = self.camera.focal * DVec2::new(c.x, c.y) / c.z + self.camera.principal;
        // Half a pixel more, because the mask is judged at pixel centres and interpolated between them.
        let (low, high) = (middle - spread - 0.5, middle + spread + 0.5);
        let (width, height) = (self.mask.width as f64, self.mask.height as f64);
        let within = low.x >= 0.0 && low.y >= 0.0 && high.x <= width && high.y <= height;
        if high.x <= 0.0 || high.y <= 0.0 || low.x >= width || low.y >= height {
            return if self.cropped { Containment::Inside } else { Containment::Outside };
        }
        let (x0, y0) = (low.x.max(0.0).floor() as usize, low.y.max(0.0).floor() as usize);
        let (x1, y1) = (high.x.min(width).ceil() as usize, high.y.min(height).ceil() as usize);
        let count = self.count(x0, y0, x1, y1);
        if count == 0 && (within || !self.cropped) {
            Containment::Outside
        } else if within && count as usize == (x1 - x0) * (y1 - y0) {
            Containment::Inside
        } else {
            Containment::Mixed
        }
    }

    /// Judges one point.
    pub(super) fn contains_point(&self, x: DVec3) -> bool {
        let c = self.camera_from_world * (x - self.camera.centre);
        if c.z <= 0.0 {
            return false;
        }
        let pixel = self.camera.focal * DVec2::new(c.x, c.y) / c.z + self.camera.principal;
        let within =
            pixel.cmpge(DVec2::ZERO).all() && pixel.x <= self.mask.width as f64 && pixel.y <= self.mask.height as f64;
        if within { self.mask.sample(pixel.x, pixel.y) >= 0.5 } else { self.cropped }
    }
}

/// The views' common verdict on the cube with lower corner `low` and side `side`.
fn classify_cube(tables: &[MaskTable], low: DVec3, side: f64, tolerated: usize) -> Containment {
    let (centre, radius) = (low + DVec3::splat(side / 2.0), side * 0.5 * 3.0_f64.sqrt());
    let (mut outside, mut all_inside) = (0, true);
    for table in tables {
        match table.classify_ball(centre, radius) {
            Containment::Outside => {
                outside += 1;
                all_inside = false;
                if outside > tolerated {
                    return Containment::Outside;
                }
            }
            Containment::Mixed => all_inside = false,
            Containment::Inside => {}
        }
    }
    if all_inside { Containment::Inside } else { Containment::Mixed }
}

/// Cells of a coarse grid that may hold a part of the hull.
fn search_grid(tables: &[MaskTable], low: DVec3, cell: f64, size: [usize; 3], tolerated: usize) -> Vec<bool> {
    let [nx, ny, nz] = size;
    (0..nx * ny * nz)
        .into_par_iter()
        .map(|i| {
            let corner = low + DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / (nx * ny)) as f64) * cell;
            classify_cube(tables, corner, cell, tolerated) != Containment::Outside
        })
        .collect()
}

/// The cells of a grid whose centres belong to the hull.
pub(super) fn carve_grid(tables: &[MaskTable], low: DVec3, cell: f64, size: [usize; 3], tolerated: usize) -> Vec<bool> {
    let blocks = size.map(|cells| cells.div_ceil(BLOCK_CELLS));
    let carved: Vec<Box<[bool; BLOCK_CELLS * BLOCK_CELLS * BLOCK_CELLS]>> = (0..blocks[0] * blocks[1] * blocks[2])
        .into_par_iter()
        .map(|i| {
            let first = [i % blocks[0], i / blocks[0] % blocks[1], i / (blocks[0] * blocks[1])];
            let corner = low + DVec3::from_array(first.map(|block| (block * BLOCK_CELLS) as f64)) * cell;
            let mut cells = Box::new([false; BLOCK_CELLS * BLOCK_CELLS * BLOCK_CELLS]);
            carve_cube(tables, corner, cell, tolerated, [0; 3], BLOCK_CELLS, &mut cells);
            cells
        })
        .collect();
    let mut occupied = vec![false; size[0] * size[1] * size[2]];
    for (row, cells) in occupied.chunks_mut(size[0]).enumerate() {
        let (y, z) = (row % size[1], row / size[1]);
        for (x, cell) in cells.iter_mut().enumerate() {
            let block = ((z / BLOCK_CELLS) * blocks[1] + y / BLOCK_CELLS) * blocks[0] + x / BLOCK_CELLS;
            *cell = carved[block][((z % BLOCK_CELLS) * BLOCK_CELLS + y % BLOCK_CELLS) * BLOCK_CELLS + x % BLOCK_CELLS];
        }
    }
    occupied
}

/// Carves the cube of `side` cells at cell `first` of the block at `corner`.
fn carve_cube(
    tables: &[MaskTable],
    corner: DVec3,
    cell: f64,
    tolerated: usize,
    first: [usize; 3],
    side: usize,
    cells: &mut [bool; BLOCK_CELLS * BLOCK_CELLS * BLOCK_CELLS],
) {
    let low = corner + DVec3::from_array(first.map(|index| index as f64)) * cell;
    if side == 1 {
        let centre = low + DVec3::splat(cell / 2.0);
        let misses = tables.iter().filter(|table| !table.contains_point(centre)).take(tolerated + 1).count();
        cells[(first[2] * BLOCK_CELLS + first[1]) * BLOCK_CELLS + first[0]] = misses <= tolerated;
        return;
    }
    match classify_cube(tables, low, side as f64 * cell, tolerated) {
        Containment::Outside => {}
        Containment::Inside => {
            for z in first[2]..first[2] + side {
                for y in first[1]..first[1] + side {
                    let start = (z * BLOCK_CELLS + y) * BLOCK_CELLS + first[0];
                    cells[start..start + side].fill(true);
                }
            }
        }
        Containment::Mixed => {
            let half = side / 2;
            for octant in 0..8 {
                let first = [0, 1, 2].map(|axis| first[axis] + if octant >> axis & 1 == 1 { half } else { 0 });
                carve_cube(tables, corner, cell, tolerated, first, half, cells);
            }
        }
    }
}
