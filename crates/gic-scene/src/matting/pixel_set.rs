//! Sets of pixels: neighbours, growth, components.

use gic_geometry::distance_transform;

/// A set of pixels.
pub(super) struct PixelSet {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) inside: Vec<bool>,
}

impl PixelSet {
    /// Calls `visit(column, row, inside)` for all pixels at most `radius` columns and rows away.
    pub(super) fn near(&self, x: usize, y: usize, radius: usize, mut visit: impl FnMut(usize, usize, bool)) {
        for row in y.saturating_sub(radius)..(y + radius + 1).min(self.height) {
            for column in x.saturating_sub(radius)..(x + radius + 1).min(self.width) {
                visit(column, row, self.inside[row * self.width + column]);
            }
        }
    }

    /// The region grown by one pixel in all eight directions.
    pub(super) fn dilated(&self) -> PixelSet {
        self.spread(true)
    }

    /// The region shrunk by one pixel in all eight directions; beyond the picture it goes on.
    pub(super) fn eroded(&self) -> PixelSet {
        self.spread(false)
    }

    /// Every pixel with a `value` pixel among its eight neighbours takes `value`.
    fn spread(&self, value: bool) -> PixelSet {
        let mut inside = self.inside.clone();
        for y in 0..self.height {
            for x in 0..self.width {
                let mut found = false;
                self.near(x, y, 1, |_, _, inside| found |= inside == value);
                if found {
                    inside[y * self.width + x] = value;
                }
            }
        }
        PixelSet { inside, ..*self }
    }

    /// Closes gaps of up to `2 * radius` pixels.
    pub(super) fn close(&mut self, radius: usize) {
        let mut closed = PixelSet { inside: self.inside.clone(), ..*self };
        (0..radius).for_each(|_| closed = closed.dilated());
        (0..radius).for_each(|_| closed = closed.eroded());
        self.inside = closed.inside;
    }

    /// Keeps the connected component, diagonal neighbours included, that is the outline of the largest body: with the
    /// largest sum of distances to its outline. What moved a little beside the object shows as thin lines.
    pub(super) fn keep_largest(&mut self) {
        let outside: Vec<bool> = self.inside.iter().map(|inside| !inside).collect();
        let depth = distance_transform(&outside, self.width);
        let volume = |component: &Vec<usize>| component.iter().map(|&i| f64::from(depth[i])).sum::<f64>();
        let components = self.components(true, true);
        let largest = components.into_iter().max_by(|a, b| volume(a).total_cmp(&volume(b))).unwrap_or_default();
        self.inside.fill(false);
        largest.into_iter().for_each(|i| self.inside[i] = true);
    }

    /// Fills enclosed holes smaller than `fraction` of the region: texture that matched the background, not openings.
    pub(super) fn fill_holes(&mut self, fraction: f64) {
        let limit = fraction * self.inside.iter().filter(|&&inside| inside).count() as f64;
        for hole in self.components(false, false).into_iter().filter(|hole| hole.len() as f64 <= limit) {
            hole.into_iter().for_each(|i| self.inside[i] = true);
        }
    }

    /// The connected components of pixels equal to `value`, in reading order of their first pixel.
    fn components(&self, value: bool, diagonal: bool) -> Vec<Vec<usize>> {
        let mut seen = vec![false; self.inside.len()];
        let mut components = Vec::new();
        for first in 0..self.inside.len() {
            if seen[first] || self.inside[first] != value {
                continue;
            }
            seen[first] = true;
            let mut component = vec![first];
            let mut next = 0;
            while next < component.len() {
                let (x, y) = (component[next] % self.width, component[next] / self.width);
                next += 1;
                self.near(x, y, 1, |column, row, inside| {
                    let i = row * self.width + column;
                    if inside == value && !seen[i] && (diagonal || column == x || row == y) {
                        seen[i] = true;
                        component.push(i);
                    }
                });
            }
            components.push(component);
        }
        components
    }
}
