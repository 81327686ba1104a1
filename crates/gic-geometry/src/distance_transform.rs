//! Distances in pictures: steps along columns, then lower envelopes of parabolas along rows (Felzenszwalb and
//! Huttenlocher 2012, "Distance transforms of sampled functions").

/// Distance of each pixel from the nearest of those that are `set` [pixels], row-major, shape [height, width]; about
/// the diagonal where none is.
pub fn distance_transform(set: &[bool], width: usize) -> Vec<f32> {
    let height = set.len() / width;
    let far = (width * width + height * height) as f64;
    let (mut envelope, mut heights) = (Envelope::default(), vec![0.0; width]);
    let mut distances = Vec::with_capacity(set.len());
    for row in steps_along_columns(set, width).chunks_exact(width) {
        for (height, steps) in heights.iter_mut().zip(row) {
            *height = if *steps == NONE { far } else { f64::from(*steps).powi(2) };
        }
        envelope.fit(&heights);
        distances.extend(envelope.values(&heights).map(|square| square.sqrt() as f32));
    }
    distances
}

/// More steps than any picture has rows: nothing is set in the column.
const NONE: u32 = u32::MAX;

/// Steps from each pixel to the nearest in its column that is `set`.
fn steps_along_columns(set: &[bool], width: usize) -> Vec<u32> {
    let mut steps: Vec<u32> = set.iter().map(|is_set| if *is_set { 0 } else { NONE }).collect();
    let height = steps.len() / width;
    let nearer = |here: &mut u32, beside: &u32| *here = (*here).min(beside.saturating_add(1));
    for y in 1..height {
        let (above, rest) = steps[(y - 1) * width..].split_at_mut(width);
        rest[..width].iter_mut().zip(above).for_each(|(here, above)| nearer(here, above));
    }
    for y in (1..height).rev() {
        let (above, below) = steps[(y - 1) * width..].split_at_mut(width);
        above.iter_mut().zip(below).for_each(|(here, below)| nearer(here, below));
    }
    steps
}

/// The least of all parabolas `heights[q] + (p - q)^2`, at each place p.
#[derive(Default)]
struct Envelope {
    /// The lowest parabolas from left to right, and from where each is the lowest.
    lowest: Vec<(usize, f64)>,
}

impl Envelope {
    fn fit(&mut self, heights: &[f64]) {
        self.lowest.clear();
        for (q, height) in heights.iter().enumerate() {
            let from = loop {
                let Some(&(r, since)) = self.lowest.last() else { break f64::NEG_INFINITY };
                let (a, b) = (q as f64, r as f64);
                let meet = (height + a * a - heights[r] - b * b) / (2.0 * (a - b));
                if meet > since {
                    break meet;
                }
                self.lowest.pop();
            };
            self.lowest.push((q, from));
        }
    }

    fn values<'a>(&'a self, heights: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        let mut k = 0;
        (0..heights.len()).map(move |p| {
            while k + 1 < self.lowest.len() && self.lowest[k + 1].1 <= p as f64 {
                k += 1;
            }
            let q = self.lowest[k].0;
            heights[q] + (p as f64 - q as f64).powi(2)
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn distances_agree_with_brute_force(set in prop::collection::vec(prop::bool::weighted(0.05), 23 * 17)) {
            let width = 23;
            prop_assume!(set.contains(&true));
            let (x, y) = (|i: usize| (i % width) as f32, |i: usize| (i / width) as f32);
            for (i, found) in distance_transform(&set, width).into_iter().enumerate() {
                let nearest = (0..set.len()).filter(|k| set[*k]).map(|k| (x(i) - x(k)).hypot(y(i) - y(k)));
                prop_assert!((found - nearest.fold(f32::INFINITY, f32::min)).abs() < 1e-4);
            }
        }
    }
}
