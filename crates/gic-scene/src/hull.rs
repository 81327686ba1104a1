//! The visual hull: all points of space that project into the object's mask in every view.
//!
//! Carved hierarchically. A cube of space whose projection meets no mask pixel in some view is empty; one whose projection
//! lies inside the masks of all views is full; only cubes that straddle an outline are divided, so that the cost grows with
//! the surface, not the volume. The number of mask pixels in a rectangle comes from a summed-area table.

use glam::{DMat3, DVec2, DVec3, IVec3};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::picture::{Mask, Picture};

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
    /// In how many views a point may lie outside the mask and still belong to the hull: 0 for exact masks of one moment.
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

/// A point on the surface of a hull.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Position [m]: the centre of a cell that touches the outside.
    pub position: DVec3,
    /// Unit normal, pointing outwards.
    pub normal: DVec3,
}

/// Cells along the side of a block, the largest cube of the hierarchy.
const BLOCK: usize = 8;
/// Cells along the longest side of the grids that search for the bounding box.
const SEARCH_RESOLUTION: usize = 32;

impl Hull {
    /// Carves the hull of the object in `views`. `None` when nothing remains: masks are empty, or no point of space
    /// projects into all of them (which wrong camera poses cause).
    pub fn carve(views: &[HullView], settings: &HullSettings) -> Option<Hull> {
        let tables: Vec<ViewTable> = views.iter().map(ViewTable::new).collect();
        let (mut low, mut high) = first_box(views)?;
        // The first box is a guess: grow it while the hull reaches its walls, then shrink it around the hull.
        for _ in 0..12 {
            let (cell, size) = grid_shape(high - low, SEARCH_RESOLUTION);
            let possible = search_grid(&tables, low, cell, size, settings.tolerated_misses);
            let (first, last) = occupied_range(&possible, size)?;
            let extent = high - low;
            let touches = (0..3).any(|axis| first[axis] == 0 || last[axis] + 1 == size[axis] as i32);
            let (new_low, new_high) = (low + first.as_dvec3() * cell, low + (last + IVec3::ONE).as_dvec3() * cell);
            if touches && extent.max_element() < 64.0 * reach(views) {
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

    /// The occupied cells with a free neighbour, with normals from the occupancy around them.
    pub fn surface(&self) -> Vec<SurfacePoint> {
        let neighbours = [IVec3::X, IVec3::NEG_X, IVec3::Y, IVec3::NEG_Y, IVec3::Z, IVec3::NEG_Z];
        let exposed = |&index: &IVec3| neighbours.iter().any(|&step| !self.occupied_at(index + step));
        let cells: Vec<IVec3> = self.occupied_cells().filter(exposed).collect();
        cells
            .into_par_iter()
            .map(|index| SurfacePoint { position: self.centre(index), normal: self.normal(index) })
            .collect()
    }

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
    fn pixel_range(&self, camera: &Camera) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
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

    /// Colours of surface points: the average over the pictures in which a point is in front, weighted by how squarely
    /// the surface faces the camera. Grey (0.5) where no picture shows the point.
    pub fn colours(&self, points: &[SurfacePoint], views: &[(&Camera, &Picture)]) -> Vec<[f32; 3]> {
        points.par_iter().map(|point| self.colour(point, views)).collect()
    }

    fn colour(&self, point: &SurfacePoint, views: &[(&Camera, &Picture)]) -> [f32; 3] {
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        for (camera, picture) in views {
            let towards = (camera.centre - point.position).normalize_or_zero();
            let facing = point.normal.dot(towards).max(0.0);
            // Start outside of the cell's own neighbourhood, so that a rough surface does not hide itself.
            let start = point.position + (point.normal + towards) * self.cell;
            if facing < 0.1 || self.first_hit(start, towards).is_some() {
                continue;
            }
            let Some((pixel, _)) = camera.project(point.position) else { continue };
            let Some(colour) = picture.sample(pixel.x, pixel.y) else { continue };
            let weight = (facing * facing) as f32;
            for channel in 0..3 {
                sum[channel] += weight * colour[channel];
            }
            total += weight;
        }
        if total > 0.0 { sum.map(|value| value / total) } else { [0.5; 3] }
    }

    /// The distance [m] along the unit vector `direction` at which a ray enters the first occupied cell.
    pub fn first_hit(&self, start: DVec3, direction: DVec3) -> Option<f64> {
        self.walk(start, direction, 0.0)
    }

    /// Walks along a ray from cell to cell; returns the distance [m] at which it has run through more than `chord` metres
    /// of occupied cells, or where it meets the first one if `chord` is zero.
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

/// The side of a cell, and cells along each axis in whole blocks, for a box with `resolution` cells on its longest side.
fn grid_shape(extent: DVec3, resolution: usize) -> (f64, [usize; 3]) {
    let cell = extent.max_element() / resolution.max(1) as f64;
    let cells = |side: f64| ((side / cell - 1e-6).ceil().max(1.0)) as usize;
    (cell, [cells(extent.x), cells(extent.y), cells(extent.z)])
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

/// The largest distance between cameras, or from the world's origin for a single one: the scale of the scene.
fn reach(views: &[HullView]) -> f64 {
    let first = views[0].camera.centre;
    let spread = views.iter().map(|view| (view.camera.centre - first).length()).fold(0.0, f64::max);
    if spread > 0.0 { spread } else { first.length().max(1.0) }
}

/// A first guess of the object's box: a cube around the point closest to the rays through the masks' centres, as large as
/// the largest mask there.
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
    let radius = |(camera, b): &(&Camera, crate::picture::PixelBox)| {
        let depth = (centre - camera.centre).length();
        let diagonal = DVec2::new((b.x1 - b.x0) as f64, (b.y1 - b.y0) as f64) / camera.focal;
        depth * diagonal.length() / 2.0
    };
    let half = DVec3::splat(2.0 * boxes.iter().map(radius).fold(0.0, f64::max));
    (centre.is_finite() && half.is_finite() && half.x > 0.0).then_some((centre - half, centre + half))
}

/// What a view says about a cube of space.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Verdict {
    Outside,
    Mixed,
    Inside,
}

/// A view with the summed-area table of its mask.
struct ViewTable<'a> {
    camera: &'a Camera,
    mask: &'a Mask,
    to_camera: DMat3,
    /// `sums[row * (width + 1) + column]`: mask pixels above and to the left.
    sums: Vec<u32>,
    /// Whether the object reaches the border of the picture: then what lies outside the picture is unknown, not empty.
    cropped: bool,
}

impl<'a> ViewTable<'a> {
    fn new(view: &HullView<'a>) -> ViewTable<'a> {
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
        ViewTable { camera, mask, to_camera: camera.rotation.transpose(), sums, cropped: mask.touches_border() }
    }

    /// Mask pixels in columns `x0..x1`, rows `y0..y1`.
    fn count(&self, x0: usize, y0: usize, x1: usize, y1: usize) -> u32 {
        let at = |x: usize, y: usize| self.sums[y * (self.mask.width + 1) + x];
        at(x1, y1) + at(x0, y0) - at(x0, y1) - at(x1, y0)
    }

    /// Judges all points of the ball around `centre`.
    fn judge_ball(&self, centre: DVec3, radius: f64) -> Verdict {
        let c = self.to_camera * (centre - self.camera.centre);
        if c.z + radius <= 0.0 {
            return Verdict::Outside;
        }
        if c.z - radius < 1e-3 * radius {
            return Verdict::Mixed;
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
            return if self.cropped { Verdict::Inside } else { Verdict::Outside };
        }
        let (x0, y0) = (low.x.max(0.0).floor() as usize, low.y.max(0.0).floor() as usize);
        let (x1, y1) = (high.x.min(width).ceil() as usize, high.y.min(height).ceil() as usize);
        let count = self.count(x0, y0, x1, y1);
        if count == 0 && (within || !self.cropped) {
            Verdict::Outside
        } else if within && count as usize == (x1 - x0) * (y1 - y0) {
            Verdict::Inside
        } else {
            Verdict::Mixed
        }
    }

    /// Judges one point.
    fn holds(&self, x: DVec3) -> bool {
        let c = self.to_camera * (x - self.camera.centre);
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
fn judge_cube(tables: &[ViewTable], low: DVec3, side: f64, tolerated: usize) -> Verdict {
    let (centre, radius) = (low + DVec3::splat(side / 2.0), side * 0.5 * 3.0_f64.sqrt());
    let (mut outside, mut all_inside) = (0, true);
    for table in tables {
        match table.judge_ball(centre, radius) {
            Verdict::Outside => {
                outside += 1;
                all_inside = false;
                if outside > tolerated {
                    return Verdict::Outside;
                }
            }
            Verdict::Mixed => all_inside = false,
            Verdict::Inside => {}
        }
    }
    if all_inside { Verdict::Inside } else { Verdict::Mixed }
}

/// Cells of a coarse grid that may hold a part of the hull.
fn search_grid(tables: &[ViewTable], low: DVec3, cell: f64, size: [usize; 3], tolerated: usize) -> Vec<bool> {
    let [nx, ny, nz] = size;
    (0..nx * ny * nz)
        .into_par_iter()
        .map(|i| {
            let corner = low + DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / (nx * ny)) as f64) * cell;
            judge_cube(tables, corner, cell, tolerated) != Verdict::Outside
        })
        .collect()
}

/// The cells of a grid whose centres belong to the hull.
fn carve_grid(tables: &[ViewTable], low: DVec3, cell: f64, size: [usize; 3], tolerated: usize) -> Vec<bool> {
    let blocks = size.map(|cells| cells.div_ceil(BLOCK));
    let carved: Vec<Box<[bool; BLOCK * BLOCK * BLOCK]>> = (0..blocks[0] * blocks[1] * blocks[2])
        .into_par_iter()
        .map(|i| {
            let first = [i % blocks[0], i / blocks[0] % blocks[1], i / (blocks[0] * blocks[1])];
            let corner = low + DVec3::from_array(first.map(|block| (block * BLOCK) as f64)) * cell;
            let mut cells = Box::new([false; BLOCK * BLOCK * BLOCK]);
            carve_cube(tables, corner, cell, tolerated, [0; 3], BLOCK, &mut cells);
            cells
        })
        .collect();
    let mut occupied = vec![false; size[0] * size[1] * size[2]];
    for (row, cells) in occupied.chunks_mut(size[0]).enumerate() {
        let (y, z) = (row % size[1], row / size[1]);
        for (x, cell) in cells.iter_mut().enumerate() {
            let block = ((z / BLOCK) * blocks[1] + y / BLOCK) * blocks[0] + x / BLOCK;
            *cell = carved[block][((z % BLOCK) * BLOCK + y % BLOCK) * BLOCK + x % BLOCK];
        }
    }
    occupied
}

/// Carves the cube of `side` cells at cell `first` of the block at `corner`.
fn carve_cube(
    tables: &[ViewTable],
    corner: DVec3,
    cell: f64,
    tolerated: usize,
    first: [usize; 3],
    side: usize,
    cells: &mut [bool; BLOCK * BLOCK * BLOCK],
) {
    let low = corner + DVec3::from_array(first.map(|index| index as f64)) * cell;
    if side == 1 {
        let centre = low + DVec3::splat(cell / 2.0);
        let misses = tables.iter().filter(|table| !table.holds(centre)).take(tolerated + 1).count();
        cells[(first[2] * BLOCK + first[1]) * BLOCK + first[0]] = misses <= tolerated;
        return;
    }
    match judge_cube(tables, low, side as f64 * cell, tolerated) {
        Verdict::Outside => {}
        Verdict::Inside => {
            for z in first[2]..first[2] + side {
                for y in first[1]..first[1] + side {
                    let start = (z * BLOCK + y) * BLOCK + first[0];
                    cells[start..start + side].fill(true);
                }
            }
        }
        Verdict::Mixed => {
            let half = side / 2;
            for octant in 0..8 {
                let first = [0, 1, 2].map(|axis| first[axis] + if octant >> axis & 1 == 1 { half } else { 0 });
                carve_cube(tables, corner, cell, tolerated, first, half, cells);
            }
        }
    }
}
