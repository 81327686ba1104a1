//! A k-d tree over points in space (Bentley 1975): exact nearest neighbours.
//!
//! Of points at equal distances the answer is the same on every machine, which lattices of particles need.

/// Ranges of at most this many points are searched one by one.
const LEAF: usize = 8;

/// Points ordered so that the middle of every range splits it along an axis; the tree is implicit in the ranges.
#[derive(Clone, Debug)]
pub struct KdTree {
    points: Vec<[f32; 3]>,
    /// Index of each point in the slice that the tree was built from.
    indices: Vec<u32>,
    /// The axis that the point splits its range along; meaningless inside leaves.
    axes: Vec<u8>,
}

impl KdTree {
    /// Builds the tree over points [m], shape [n, 3]; O(n log n). At most 2^32 points; coordinates must not be NaN.
    pub fn new(points: &[[f32; 3]]) -> KdTree {
        assert!(points.len() <= u32::MAX as usize, "a k-d tree holds at most 2^32 points");
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        let mut axes = vec![0u8; points.len()];
        split(points, &mut order, &mut axes);
        KdTree { points: order.iter().map(|&i| points[i as usize]).collect(), indices: order, axes }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Index (in the slice that the tree was built from) of the point nearest to `query` [m] and the squared distance
    /// to it [m^2]; `None` if the tree is empty or the query is NaN.
    #[inline]
    pub fn nearest(&self, query: [f32; 3]) -> Option<(usize, f32)> {
        let mut best = (usize::MAX, f32::INFINITY);
        self.search(query, 0, self.points.len(), &mut best);
        (best.0 < self.indices.len()).then(|| (self.indices[best.0] as usize, best.1))
    }

    fn search(&self, query: [f32; 3], low: usize, high: usize, best: &mut (usize, f32)) {
        if high - low <= LEAF {
            for i in low..high {
                self.visit(query, i, best);
            }
            return;
        }
        let middle = low + (high - low) / 2;
        let axis = self.axes[middle] as usize;
        let beyond = query[axis] - self.points[middle][axis];
        let (near, far) =
            if beyond < 0.0 { ((low, middle), (middle + 1, high)) } else { ((middle + 1, high), (low, middle)) };
        self.search(query, near.0, near.1, best);
        if beyond * beyond < best.1 {
            self.visit(query, middle, best);
            self.search(query, far.0, far.1, best);
        }
    }

    #[inline]
    fn visit(&self, query: [f32; 3], i: usize, best: &mut (usize, f32)) {
        let distance = squared_distance(query, self.points[i]);
        if distance < best.1 {
            *best = (i, distance);
        }
    }
}

/// Squared distance of two points [m^2].
#[inline]
pub fn squared_distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}

/// Orders a range so that its middle splits it along the axis where it is widest, then both halves.
fn split(points: &[[f32; 3]], order: &mut [u32], axes: &mut [u8]) {
    if order.len() <= LEAF {
        return;
    }
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for &i in order.iter() {
        for axis in 0..3 {
            low[axis] = low[axis].min(points[i as usize][axis]);
            high[axis] = high[axis].max(points[i as usize][axis]);
        }
    }
    let width = |axis: usize| high[axis] - low[axis];
    let axis = if width(0) >= width(1) && width(0) >= width(2) {
        0
    } else if width(1) >= width(2) {
        1
    } else {
        2
    };
    let middle = order.len() / 2;
    // Equal coordinates are ordered by index, so that the tree is the same on every machine.
    order.select_nth_unstable_by(middle, |&a, &b| {
        points[a as usize][axis].total_cmp(&points[b as usize][axis]).then(a.cmp(&b))
    });
    axes[middle] = axis as u8;
    let (left, right) = order.split_at_mut(middle);
    let (left_axes, right_axes) = axes.split_at_mut(middle);
    split(points, left, left_axes);
    split(points, &mut right[1..], &mut right_axes[1..]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn nearest_agrees_with_looking_at_all(
            // Coordinates on a coarse lattice make ties and equal points common.
            points in prop::collection::vec(prop::array::uniform3(-8i8..8), 1..200),
            query in prop::array::uniform3(-10.0f32..10.0),
        ) {
            let points: Vec<[f32; 3]> = points.iter().map(|p| p.map(f32::from)).collect();
            let tree = KdTree::new(&points);
            let (index, distance) = tree.nearest(query).unwrap();
            let least = points.iter().map(|&p| squared_distance(query, p)).fold(f32::INFINITY, f32::min);
            prop_assert_eq!(distance, least);
            prop_assert_eq!(squared_distance(query, points[index]), least);
        }
    }

    #[test]
    fn nothing_is_near_in_an_empty_tree() {
        assert_eq!(KdTree::new(&[]).nearest([0.0; 3]), None);
        assert_eq!(KdTree::new(&[[0.0; 3]]).nearest([f32::NAN; 3]), None);
    }
}
