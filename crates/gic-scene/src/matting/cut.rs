//! Minimum cuts of pictures (Boykov and Kolmogorov 2004, "An experimental comparison of min-cut/max-flow algorithms"):
//! two trees grow from source and sink, flow goes along each path on which they meet, and branches that it cuts off
//! look for another parent.

use std::collections::VecDeque;

use super::tuning::BORDER_COST;

/// Units of flow in a unit of energy: costs are rounded to whole ones, so that the end is certain.
const UNITS: f32 = 1024.0;
/// Largest capacity of a pixel. Derived: a path of any length stays within 32 bits.
const MAX_CAPACITY: f32 = 1e6;

/// Directions to neighbours: right, left, down, up; a direction and its opposite differ in the last bit.
const DIRECTIONS: usize = 4;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Tree {
    None,
    Source,
    Sink,
}

/// Where a pixel of a tree hangs.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Parent {
    None,
    Terminal,
    Pixel(u8),
}

/// A grid of pixels with what can still flow between them.
pub(super) struct Grid {
    width: usize,
    /// Residual capacities towards each neighbour; 0 where there is none.
    flow: Vec<[i32; DIRECTIONS]>,
    /// Residual capacity from the source, or, negative, to the sink.
    terminal: Vec<i32>,
    tree: Vec<Tree>,
    parent: Vec<Parent>,
    /// Number of steps to the terminal, true at the time of `seen`.
    distance: Vec<u32>,
    seen: Vec<u32>,
    now: u32,
    active: VecDeque<usize>,
    orphans: VecDeque<usize>,
}

impl Grid {
    /// The energy of labels: a pixel costs `pulls` [1] less when it is inside, neighbours with different labels cost
    /// more the more their colours are alike.
    pub(super) fn new(width: usize, pulls: &[f32], image: &[[f32; 3]], noise: &[f32; 3]) -> Grid {
        let count = pulls.len();
        let steps = [(0, 1), (2, width)];
        let pairs = |(_, step): (usize, usize)| {
            (0..count.saturating_sub(step)).filter(move |i| step > 1 || i % width + 1 < width)
        };
        let contrast = |i: usize, j: usize| (0..3).map(|c| (image[i][c] - image[j][c]).powi(2)).sum::<f32>();
        let sum: f64 = steps.iter().flat_map(|s| pairs(*s).map(|i| f64::from(contrast(i, i + s.1)))).sum();
        let of_noise = 2.0 * noise.iter().map(|sigma| sigma * sigma).sum::<f32>();
        let usual = ((sum / (2 * count).max(1) as f64) as f32).max(of_noise);
        let mut flow = vec![[0; DIRECTIONS]; count];
        for (direction, step) in steps {
            for i in pairs((direction, step)) {
                let capacity = (UNITS * BORDER_COST * (-contrast(i, i + step) / (2.0 * usual)).exp()) as i32;
                flow[i][direction] = capacity;
                flow[i + step][direction + 1] = capacity;
            }
        }
        let terminal: Vec<i32> =
            pulls.iter().map(|pull| (UNITS * pull).clamp(-MAX_CAPACITY, MAX_CAPACITY) as i32).collect();
        Grid {
            width,
            flow,
            terminal,
            tree: vec![Tree::None; count],
            parent: vec![Parent::None; count],
            distance: vec![0; count],
            seen: vec![0; count],
            now: 0,
            active: VecDeque::new(),
            orphans: VecDeque::new(),
        }
    }

    /// The pixels that are inside where the energy is least.
    pub(super) fn cut(mut self) -> Vec<bool> {
        for i in 0..self.terminal.len() {
            if self.terminal[i] != 0 {
                self.tree[i] = if self.terminal[i] > 0 { Tree::Source } else { Tree::Sink };
                self.parent[i] = Parent::Terminal;
                self.distance[i] = 1;
                self.active.push_back(i);
            }
        }
        while let Some(&pixel) = self.active.front() {
            let meeting = if self.tree[pixel] == Tree::None { None } else { self.grow(pixel) };
            match meeting {
                None => {
                    self.active.pop_front();
                }
                Some((from, direction)) => {
                    self.now += 1;
                    self.augment(from, direction);
                    while let Some(orphan) = self.orphans.pop_front() {
                        self.adopt(orphan);
                    }
                }
            }
        }
        self.tree.into_iter().map(|tree| tree == Tree::Source).collect()
    }

    fn neighbour(&self, pixel: usize, direction: usize) -> usize {
        match direction {
            0 => pixel + 1,
            1 => pixel - 1,
            2 => pixel + self.width,
            _ => pixel - self.width,
        }
    }

    /// Whether there is a neighbour in a direction.
    fn has_neighbour(&self, pixel: usize, direction: usize) -> bool {
        match direction {
            0 => pixel % self.width + 1 < self.width,
            1 => !pixel.is_multiple_of(self.width),
            2 => pixel + self.width < self.flow.len(),
            _ => pixel >= self.width,
        }
    }

    /// What can flow between a pixel and its neighbour, away from the source.
    fn outward(&self, tree: Tree, pixel: usize, direction: usize) -> i32 {
        match tree {
            Tree::Source => self.flow[pixel][direction],
            _ => self.flow[self.neighbour(pixel, direction)][direction ^ 1],
        }
    }

    /// Takes free neighbours into the pixel's tree; returns where the trees meet, from the source's side.
    fn grow(&mut self, pixel: usize) -> Option<(usize, usize)> {
        let tree = self.tree[pixel];
        for direction in 0..DIRECTIONS {
            if !self.has_neighbour(pixel, direction) || self.outward(tree, pixel, direction) == 0 {
                continue;
            }
            let other = self.neighbour(pixel, direction);
            if self.tree[other] == Tree::None {
                self.tree[other] = tree;
                self.hang(other, direction ^ 1, pixel);
                self.active.push_back(other);
            } else if self.tree[other] != tree {
                let meeting = if tree == Tree::Source { (pixel, direction) } else { (other, direction ^ 1) };
                return Some(meeting);
            } else if self.seen[other] <= self.seen[pixel] && self.distance[other] > self.distance[pixel] + 1 {
                self.hang(other, direction ^ 1, pixel);
            }
        }
        None
    }

    fn hang(&mut self, pixel: usize, direction: usize, parent: usize) {
        self.parent[pixel] = Parent::Pixel(direction as u8);
        self.distance[pixel] = self.distance[parent] + 1;
        self.seen[pixel] = self.seen[parent];
    }

    /// Sends as much as can flow along the path over `from` and its neighbour.
    fn augment(&mut self, from: usize, direction: usize) {
        let to = self.neighbour(from, direction);
        let mut amount = self.flow[from][direction];
        for start in [from, to] {
            let mut pixel = start;
            while let Parent::Pixel(up) = self.parent[pixel] {
                amount = amount.min(self.inward(pixel, usize::from(up)));
                pixel = self.neighbour(pixel, usize::from(up));
            }
            amount = amount.min(self.terminal[pixel].abs());
        }
        self.push(from, direction, amount);
        for start in [from, to] {
            let mut pixel = start;
            while let Parent::Pixel(up) = self.parent[pixel] {
                let up = usize::from(up);
                let above = self.neighbour(pixel, up);
                match self.tree[pixel] {
                    Tree::Source => self.push(above, up ^ 1, amount),
                    _ => self.push(pixel, up, amount),
                }
                if self.inward(pixel, up) == 0 {
                    self.orphan(pixel);
                }
                pixel = above;
            }
            self.terminal[pixel] -= self.terminal[pixel].signum() * amount;
            if self.terminal[pixel] == 0 {
                self.orphan(pixel);
            }
        }
    }

    fn push(&mut self, pixel: usize, direction: usize, amount: i32) {
        let other = self.neighbour(pixel, direction);
        self.flow[pixel][direction] -= amount;
        self.flow[other][direction ^ 1] += amount;
    }

    /// What can flow between a pixel and its parent in the direction of the flow.
    fn inward(&self, pixel: usize, up: usize) -> i32 {
        self.outward(self.tree[pixel], self.neighbour(pixel, up), up ^ 1)
    }

    fn orphan(&mut self, pixel: usize) {
        self.parent[pixel] = Parent::None;
        self.orphans.push_back(pixel);
    }

    /// Finds the nearest parent that still hangs on the terminal, or sets the pixel free.
    fn adopt(&mut self, pixel: usize) {
        let tree = self.tree[pixel];
        let mut best: Option<(u32, usize)> = None;
        for direction in 0..DIRECTIONS {
            if !self.has_neighbour(pixel, direction) {
                continue;
            }
            let other = self.neighbour(pixel, direction);
            if self.tree[other] != tree || self.inward(pixel, direction) == 0 {
                continue;
            }
            if let Some(distance) = self.origin(other)
                && best.is_none_or(|(least, _)| distance < least)
            {
                best = Some((distance, direction));
            }
        }
        if let Some((distance, direction)) = best {
            self.parent[pixel] = Parent::Pixel(direction as u8);
            self.distance[pixel] = distance + 1;
            self.seen[pixel] = self.now;
            return;
        }
        for direction in 0..DIRECTIONS {
            if !self.has_neighbour(pixel, direction) {
                continue;
            }
            let other = self.neighbour(pixel, direction);
            if self.tree[other] != tree {
                continue;
            }
            if self.inward(pixel, direction) > 0 {
                self.active.push_back(other);
            }
            if self.parent[other] == Parent::Pixel((direction ^ 1) as u8) {
                self.orphan(other);
            }
        }
        self.tree[pixel] = Tree::None;
    }

    /// Steps from a pixel to its terminal; `None` where the way up ends at an orphan.
    fn origin(&mut self, pixel: usize) -> Option<u32> {
        let (mut at, mut steps) = (pixel, 0);
        let distance = loop {
            if self.seen[at] == self.now {
                break steps + self.distance[at];
            }
            steps += 1;
            match self.parent[at] {
                Parent::None => return None,
                Parent::Terminal => {
                    self.seen[at] = self.now;
                    self.distance[at] = 1;
                    break steps;
                }
                Parent::Pixel(up) => at = self.neighbour(at, usize::from(up)),
            }
        };
        // What was learnt on the way spares others the way.
        let (mut at, mut left) = (pixel, distance);
        while self.seen[at] != self.now {
            self.seen[at] = self.now;
            self.distance[at] = left;
            left -= 1;
            let Parent::Pixel(up) = self.parent[at] else { break };
            at = self.neighbour(at, usize::from(up));
        }
        Some(distance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The energy that [`Grid::new`] states, in its units.
    fn energy(grid: &Grid, labels: &[bool]) -> i64 {
        let mut sum = 0;
        for (i, inside) in labels.iter().enumerate() {
            sum -= i64::from(*inside) * i64::from(grid.terminal[i]);
            for direction in [0, 2] {
                if grid.has_neighbour(i, direction) && labels[grid.neighbour(i, direction)] != *inside {
                    sum += i64::from(grid.flow[i][direction]);
                }
            }
        }
        sum
    }

    /// All labels of small pictures are tried.
    #[test]
    fn no_other_labels_have_less_energy() {
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1 << 24) as f32
        };
        for (width, height) in [(4, 4), (3, 5), (1, 6), (6, 1), (5, 3)] {
            for _ in 0..20 {
                let count = width * height;
                let pulls: Vec<f32> = (0..count).map(|_| 12.0 * (random() - 0.5)).collect();
                let image: Vec<[f32; 3]> = (0..count).map(|_| [random(), random(), random()]).collect();
                let [grid, cut] = [(); 2].map(|()| Grid::new(width, &pulls, &image, &[0.1; 3]));
                let labels = |bits: u32| (0..count).map(|i| bits >> i & 1 == 1).collect::<Vec<_>>();
                let least = (0..1_u32 << count).map(|bits| energy(&grid, &labels(bits))).min();
                assert_eq!(Some(energy(&grid, &cut.cut())), least, "{width}x{height}");
            }
        }
    }
}
