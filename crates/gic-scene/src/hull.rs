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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A camera at `centre` that looks at `target`.
    fn camera(centre: DVec3, target: DVec3, size: usize, focal: f64) -> Camera {
        let forward = (target - centre).normalize();
        let right = forward.cross(DVec3::new(0.1, 1.0, 0.2)).normalize();
        Camera {
            width: size,
            height: size,
            focal: DVec2::splat(focal),
            principal: DVec2::splat(size as f64 / 2.0),
            rotation: DMat3::from_cols(right, forward.cross(right), forward),
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
        let outward =
            surface.iter().filter(|point| point.normal.dot((point.position - ball).normalize()) > 0.7).count();
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
        let right = cameras[0].rotation.x_axis;
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
            let tables: Vec<ViewTable> = views.iter().map(ViewTable::new).collect();
            // A grid that reaches behind the cameras.
            let (low, cell, size) = (DVec3::splat(-1.2), 0.1, [24, 22, 20]);
            let carved = carve_grid(&tables, low, cell, size, tolerated);
            for (i, &occupied) in carved.iter().enumerate() {
                let index = DVec3::new((i % 24) as f64, (i / 24 % 22) as f64, (i / (24 * 22)) as f64);
                let centre = low + (index + 0.5) * cell;
                let misses = tables.iter().filter(|table| !table.holds(centre)).count();
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
}
