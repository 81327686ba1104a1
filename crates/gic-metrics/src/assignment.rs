//! The optimal assignment of n rows to n columns: the algorithm of Jonker and Volgenant (1987).
//!
//! Dual prices `v` of the columns are built by column reduction, reduction transfer and two passes of augmenting row
//! reduction, which assign nearly all rows; the rest follow by shortest augmenting paths (Dijkstra on reduced costs).
//! Exact; O(n^3) at worst, about O(n^2.3) for distances of random points.

const NONE: usize = usize::MAX;

/// An optimal assignment.
#[derive(Clone, Debug, PartialEq)]
pub struct Assignment {
    /// The column of each row, shape [n].
    pub columns: Vec<usize>,
    /// Sum of the assigned costs.
    pub cost: f64,
}

/// Assigns every row of a square cost matrix (row-major, shape [n, n]) to a column of its own so that the sum is least.
///
/// # Panics
/// If `costs` does not hold n x n numbers or holds one that is not finite.
pub fn assign(costs: &[f32], n: usize) -> Assignment {
    assert_eq!(costs.len(), n * n, "the cost matrix must be n x n");
    assert!(costs.iter().all(|c| c.is_finite()), "costs must be finite");
    let mut solver =
        Solver { costs, n, prices: vec![0.0; n], column_of: vec![NONE; n], row_of: vec![NONE; n], free: Vec::new() };
    solver.reduce_columns();
    for _ in 0..2 {
        solver.reduce_rows();
    }
    solver.augment();
    let cost = solver.column_of.iter().enumerate().map(|(i, &j)| f64::from(costs[i * n + j])).sum();
    Assignment { columns: solver.column_of, cost }
}

struct Solver<'a> {
    costs: &'a [f32],
    n: usize,
    /// Dual price of each column.
    prices: Vec<f64>,
    column_of: Vec<usize>,
    row_of: Vec<usize>,
    /// Rows not assigned yet.
    free: Vec<usize>,
}

impl Solver<'_> {
    fn row(&self, i: usize) -> &[f32] {
        &self.costs[i * self.n..(i + 1) * self.n]
    }

    /// The price of a column is its least cost; a row that is the least of some column gets one of them. Then a row
    /// that is the least of exactly one column hands the slack to its second best to that column's price (reduction
    /// transfer).
    fn reduce_columns(&mut self) {
        let n = self.n;
        let mut least_row = vec![0usize; n];
        let mut least: Vec<f32> = self.costs[..n].to_vec();
        for i in 1..n {
            for (j, &c) in self.costs[i * n..(i + 1) * n].iter().enumerate() {
                if c < least[j] {
                    (least[j], least_row[j]) = (c, i);
                }
            }
        }
        let mut times_least = vec![0usize; n];
        for j in (0..n).rev() {
            let i = least_row[j];
            self.prices[j] = f64::from(least[j]);
            times_least[i] += 1;
            if times_least[i] == 1 {
                (self.column_of[i], self.row_of[j]) = (j, i);
            }
        }
        for i in 0..n {
            match times_least[i] {
                0 => self.free.push(i),
                1 if n > 1 => {
                    let own = self.column_of[i];
                    let slack = (0..n)
                        .filter(|&j| j != own)
                        .map(|j| f64::from(self.costs[i * n + j]) - self.prices[j])
                        .fold(f64::INFINITY, f64::min);
                    self.prices[own] -= slack;
                }
                _ => {}
            }
        }
    }

    /// Each free row takes its best column and lowers that column's price to its second best, freeing whoever had it.
    fn reduce_rows(&mut self) {
        let mut queue: std::collections::VecDeque<usize> = std::mem::take(&mut self.free).into();
        // Rounding can make two rows take a column from each other for ever by ever smaller steps: bounded by a budget,
        // after which the rest is left to the shortest paths.
        let mut budget = 20 * self.n;
        while let Some(i) = queue.pop_front() {
            let (mut best, mut second) = ((f64::INFINITY, NONE), (f64::INFINITY, NONE));
            for (j, (&c, &price)) in self.row(i).iter().zip(&self.prices).enumerate() {
                let reduced = f64::from(c) - price;
                if reduced < second.0 {
                    if reduced < best.0 {
                        second = best;
                        best = (reduced, j);
                    } else {
                        second = (reduced, j);
                    }
                }
            }
            let strictly = best.0 < second.0;
            let mut column = best.1;
            if strictly {
                if second.1 != NONE {
                    self.prices[column] -= second.0 - best.0;
                }
            } else if self.row_of[column] != NONE && second.1 != NONE {
                column = second.1;
            }
            let displaced = std::mem::replace(&mut self.row_of[column], i);
            self.column_of[i] = column;
            if displaced != NONE {
                self.column_of[displaced] = NONE;
                if strictly && budget > 0 {
                    budget -= 1;
                    queue.push_front(displaced);
                } else {
                    self.free.push(displaced);
                }
            }
        }
    }

    /// Assigns each free row by the shortest alternating path to a free column and updates the prices along it.
    fn augment(&mut self) {
        let n = self.n;
        let mut distance = vec![0.0f64; n];
        let mut previous = vec![NONE; n];
        // Columns: [0, done) are settled below the current minimum, [done, reached) at it, the rest further away.
        let mut columns: Vec<usize> = (0..n).collect();
        for start in std::mem::take(&mut self.free) {
            for (d, (&c, &price)) in distance.iter_mut().zip(self.row(start).iter().zip(&self.prices)) {
                *d = f64::from(c) - price;
            }
            previous.fill(start);
            let (mut settled, mut reached) = (0, 0);
            let mut least = 0.0;
            let mut before_minimum = 0;
            let end = 'search: loop {
                if settled == reached {
                    before_minimum = settled;
                    least = distance[columns[reached]];
                    reached += 1;
                    let unsettled = reached..n;
                    for k in unsettled {
                        let j = columns[k];
                        if distance[j] < least {
                            least = distance[j];
                            reached = settled;
                        }
                        if distance[j] == least {
                            columns.swap(k, reached);
                            reached += 1;
                        }
                    }
                    if let Some(&j) = columns[settled..reached].iter().find(|&&j| self.row_of[j] == NONE) {
                        break 'search j;
                    }
                }
                let via = columns[settled];
                settled += 1;
                let i = self.row_of[via];
                let offset = f64::from(self.costs[i * n + via]) - self.prices[via] - least;
                let further = reached..n;
                for k in further {
                    let j = columns[k];
                    let through = f64::from(self.costs[i * n + j]) - self.prices[j] - offset;
                    if through < distance[j] {
                        distance[j] = through;
                        previous[j] = i;
                        if through <= least {
                            if self.row_of[j] == NONE {
                                break 'search j;
                            }
                            columns.swap(k, reached);
                            reached += 1;
                        }
                    }
                }
            };
            for &j in &columns[..before_minimum] {
                self.prices[j] += distance[j] - least;
            }
            let mut column = end;
            loop {
                let i = previous[column];
                self.row_of[column] = i;
                std::mem::swap(&mut self.column_of[i], &mut column);
                if i == start {
                    break;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The least sum over all permutations (Heap's algorithm).
    fn by_looking_at_all(costs: &[f32], n: usize) -> f64 {
        fn recurse(k: usize, order: &mut [usize], cost: &mut dyn FnMut(&[usize])) {
            if k <= 1 {
                return cost(order);
            }
            for i in 0..k {
                recurse(k - 1, order, cost);
                order.swap(if k.is_multiple_of(2) { i } else { 0 }, k - 1);
            }
        }
        let mut least = f64::INFINITY;
        let mut order: Vec<usize> = (0..n).collect();
        recurse(n, &mut order, &mut |order| {
            let sum: f64 = order.iter().enumerate().map(|(i, &j)| f64::from(costs[i * n + j])).sum();
            least = least.min(sum);
        });
        least
    }

    fn is_permutation(columns: &[usize]) -> bool {
        let mut seen = vec![false; columns.len()];
        columns.iter().all(|&j| j < seen.len() && !std::mem::replace(&mut seen[j], true))
    }

    proptest! {
        #[test]
        fn optimal_on_small_matrices(n in 1usize..8, seed in prop::collection::vec(0u8..12, 49)) {
            // Few distinct values make ties, the hard case, common.
            let costs: Vec<f32> = seed[..n * n].iter().map(|&c| f32::from(c) * 0.37).collect();
            let assignment = assign(&costs, n);
            prop_assert!(is_permutation(&assignment.columns));
            prop_assert!((assignment.cost - by_looking_at_all(&costs, n)).abs() < 1e-5);
        }
    }

    #[test]
    fn known_displacement_of_a_lattice_is_found() {
        // Moving every point by less than half the spacing: the optimum moves each by just that.
        let n = 343;
        let point = |i: usize| [(i % 7) as f32, (i / 7 % 7) as f32, (i / 49) as f32];
        let costs: Vec<f32> = (0..n * n)
            .map(|k| {
                let (a, b) = (point(k / n), point(k % n));
                ((a[0] + 0.3 - b[0]).powi(2) + (a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)).sqrt()
            })
            .collect();
        let assignment = assign(&costs, n);
        assert!(is_permutation(&assignment.columns));
        assert!((assignment.cost / n as f64 - 0.3).abs() < 1e-6, "{}", assignment.cost / n as f64);
    }
}
