//! Points near a point, by a dense list of cells: all within a radius, or the K nearest.
//!
//! A place is where the list keeps a point: the points of a cell, and those of cells along z, follow each other.

use std::ops::Range;

use glam::{DVec3, IVec3};

/// Points [m] in cells of a uniform grid over their bounding box.
#[derive(Clone, Debug)]
pub struct Neighbours {
    points: Vec<DVec3>,
    /// Index of each point in the slice that was given.
    ids: Vec<u32>,
    starts: Vec<u32>,
    low: DVec3,
    size: IVec3,
    cell: f64,
}

/// Never more cells than this, so that a stray point cannot exhaust memory: the cell grows instead.
const MOST_CELLS: f64 = 2.0e6;

impl Neighbours {
    /// Sorts the points into cells of side `cell` [m].
    pub fn new(points: &[DVec3], cell: f64) -> Neighbours {
        // Points that are no numbers are near to nothing, whichever cell they are in.
        let known = || points.iter().copied().filter(|p| p.is_finite());
        let low = known().reduce(DVec3::min).unwrap_or(DVec3::ZERO);
        let extent = known().reduce(DVec3::max).unwrap_or(DVec3::ZERO) - low;
        let mut cell = cell;
        while ((extent / cell).floor() + 1.0).element_product() > MOST_CELLS {
            cell *= 2.0;
        }
        let size = ((extent / cell).floor() + 1.0).as_ivec3();
        let mut list = Neighbours { points: Vec::new(), ids: Vec::new(), starts: Vec::new(), low, size, cell };
        let keys: Vec<usize> = points.iter().map(|p| list.key(list.cell_of(*p).clamp(IVec3::ZERO, size - 1))).collect();
        list.starts = vec![0; size.element_product() as usize + 1];
        for key in &keys {
            list.starts[key + 1] += 1;
        }
        for i in 1..list.starts.len() {
            list.starts[i] += list.starts[i - 1];
        }
        let mut next = list.starts.clone();
        list.ids = vec![0; points.len()];
        for (i, key) in keys.iter().enumerate() {
            list.ids[next[*key] as usize] = i as u32;
            next[*key] += 1;
        }
        list.points = list.ids.iter().map(|i| points[*i as usize]).collect();
        list
    }

    /// Number of points.
    #[inline]
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there are no points.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The point at a place of the list [m].
    #[inline]
    pub fn point(&self, place: usize) -> DVec3 {
        self.points[place]
    }

    /// Index of the point at a place of the list in the slice that was given.
    #[inline]
    pub fn id(&self, place: usize) -> usize {
        self.ids[place] as usize
    }

    /// The cells that have points.
    #[inline]
    pub fn occupied(&self) -> impl Iterator<Item = usize> {
        (0..self.starts.len() - 1).filter(|cell| self.starts[*cell] < self.starts[cell + 1])
    }

    /// The corner of a cell at which its coordinates are lowest [m].
    #[inline]
    pub fn corner(&self, cell: usize) -> DVec3 {
        self.low + self.cell * self.index(cell).as_dvec3()
    }

    fn index(&self, cell: usize) -> IVec3 {
        let key = cell as i32;
        IVec3::new(key / self.size.z / self.size.y, key / self.size.z % self.size.y, key % self.size.z)
    }

    /// Places of a cell's points.
    #[inline]
    pub fn in_cell(&self, cell: usize) -> Range<usize> {
        self.starts[cell] as usize..self.starts[cell + 1] as usize
    }

    /// Places of the points in a cell and those around it, as runs: cells along z follow each other.
    #[inline]
    pub fn around(&self, cell: usize) -> [Range<usize>; 9] {
        let centre = self.index(cell);
        let (low, high) = ((centre.z - 1).max(0), (centre.z + 1).min(self.size.z - 1));
        std::array::from_fn(|k| {
            let (x, y) = (centre.x + k as i32 / 3 - 1, centre.y + k as i32 % 3 - 1);
            if x < 0 || y < 0 || x >= self.size.x || y >= self.size.y {
                return 0..0;
            }
            let (first, last) = (self.key(IVec3::new(x, y, low)), self.key(IVec3::new(x, y, high)));
            self.starts[first] as usize..self.starts[last + 1] as usize
        })
    }

    fn cell_of(&self, p: DVec3) -> IVec3 {
        // Rounding down by a cast, which is an instruction where `floor` may be a call.
        let scaled = (p - self.low) / self.cell;
        let towards_zero = scaled.as_ivec3();
        let above = towards_zero.as_dvec3().cmpgt(scaled);
        towards_zero.saturating_sub(IVec3::select(above, IVec3::ONE, IVec3::ZERO))
    }

    fn key(&self, c: IVec3) -> usize {
        ((c.x * self.size.y + c.y) * self.size.z + c.z) as usize
    }

    /// The `K` nearest points as (distance squared, index), nearest first; fewer points give infinite distances.
    #[inline]
    pub fn nearest<const K: usize>(&self, p: DVec3) -> [(f64, usize); K] {
        let mut best = [(f64::INFINITY, usize::MAX); K];
        if self.points.is_empty() {
            return best;
        }
        let centre = self.cell_of(p);
        let reach = (centre - self.size + 1).abs().max(centre.abs()).max_element();
        for ring in 0..=reach {
            // All cells at this Chebyshev distance are at least (ring - 1) cells and the way to the own cell's border
            // away.
            let border = f64::from(ring - 1) * self.cell + self.to_border(p, centre);
            if border > 0.0 && border * border > best[K - 1].0 {
                break;
            }
            self.visit_ring(centre, ring, |i| {
                let d = self.points[i].distance_squared(p);
                if d < best[K - 1].0 {
                    best[K - 1] = (d, self.ids[i] as usize);
                    let mut k = K - 1;
                    while k > 0 && best[k].0 < best[k - 1].0 {
                        best.swap(k, k - 1);
                        k -= 1;
                    }
                }
            });
        }
        best
    }

    /// Distance from `p` to the nearest face of its own cell.
    fn to_border(&self, p: DVec3, c: IVec3) -> f64 {
        let inside = (p - self.low) - c.as_dvec3() * self.cell;
        inside.min(DVec3::splat(self.cell) - inside).min_element().max(0.0)
    }

    fn visit_ring(&self, centre: IVec3, ring: i32, mut visit: impl FnMut(usize)) {
        let low = (centre - ring).max(IVec3::ZERO);
        let high = (centre + ring).min(self.size - 1);
        for x in low.x..=high.x {
            for y in low.y..=high.y {
                let on_face = (x - centre.x).abs() == ring || (y - centre.y).abs() == ring;
                let mut z = low.z;
                while z <= high.z {
                    if on_face || (z - centre.z).abs() == ring {
                        let key = self.key(IVec3::new(x, y, z));
                        (self.starts[key]..self.starts[key + 1]).for_each(|i| visit(i as usize));
                        z += 1;
                    } else {
                        // Inside the ring: jump to its far face.
                        z = z.max(centre.z + ring);
                    }
                }
            }
        }
    }

    /// Calls `visit` with every point within `radius` of `p`, as (distance squared, index, position).
    #[inline]
    pub fn within(&self, p: DVec3, radius: f64, mut visit: impl FnMut(f64, usize, DVec3)) {
        if self.points.is_empty() {
            return;
        }
        let low = self.cell_of(p - radius).max(IVec3::ZERO);
        let high = self.cell_of(p + radius).min(self.size - 1);
        for x in low.x..=high.x {
            for y in low.y..=high.y {
                if low.z > high.z {
                    continue;
                }
                // Cells along z follow each other.
                let (first, last) = (self.key(IVec3::new(x, y, low.z)), self.key(IVec3::new(x, y, high.z)));
                let run = self.starts[first] as usize..self.starts[last + 1] as usize;
                for (q, id) in self.points[run.clone()].iter().zip(&self.ids[run]) {
                    let d = q.distance_squared(p);
                    if d <= radius * radius {
                        visit(d, *id as usize, *q);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = DVec3> {
        (-1.0f64..1.0, -1.0f64..1.0, -1.0f64..1.0).prop_map(|(x, y, z)| DVec3::new(x, y, z))
    }

    proptest! {
        #[test]
        fn nearest_and_within_agree_with_brute_force(
            points in prop::collection::vec(point(), 1..60), query in point(), far in 0.5f64..4.0, cell in 0.05f64..0.7
        ) {
            let list = Neighbours::new(&points, cell);
            let query = query * far;
            let mut distances: Vec<f64> = points.iter().map(|p| p.distance_squared(query)).collect();
            let inside = distances.iter().filter(|d| **d <= 0.25).count();
            distances.sort_by(f64::total_cmp);
            let found = list.nearest::<3>(query);
            for (k, (d, _)) in found.iter().enumerate() {
                prop_assert_eq!(*d, distances.get(k).copied().unwrap_or(f64::INFINITY));
            }
            let mut count = 0;
            list.within(query, 0.5, |_, i, p| { assert_eq!(points[i], p); count += 1; });
            prop_assert_eq!(count, inside);
        }
    }
}
