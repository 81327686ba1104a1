//! Distances in pictures: lower envelopes of parabolas along columns, then along rows (Felzenszwalb and Huttenlocher
//! 2012, "Distance transforms of sampled functions").

/// Distance of each pixel from the nearest of those that are `set` [pixels], row-major, shape [height, width]; about
/// the diagonal where none is.
pub fn distance_transform(set: &[bool], width: usize) -> Vec<f32> {
    let height = set.len() / width;
    let far = (width * width + height * height) as f64;
    let mut squares: Vec<f64> = set.iter().map(|s| if *s { 0.0 } else { far }).collect();
    for x in 0..width {
        let column: Vec<f64> = (0..height).map(|y| squares[y * width + x]).collect();
        envelope(&column).into_iter().enumerate().for_each(|(y, d)| squares[y * width + x] = d);
    }
    for row in squares.chunks_exact_mut(width) {
        let lowest = envelope(row);
        row.copy_from_slice(&lowest);
    }
    squares.into_iter().map(|d| d.sqrt() as f32).collect()
}

/// At each place the least of all parabolas `heights[q] + (p - q)^2`.
fn envelope(heights: &[f64]) -> Vec<f64> {
    // The lowest parabolas from left to right, and from where each is the lowest.
    let mut lowest: Vec<(usize, f64)> = Vec::new();
    for (q, height) in heights.iter().enumerate() {
        let from = loop {
            let Some(&(r, since)) = lowest.last() else { break f64::NEG_INFINITY };
            let (a, b) = (q as f64, r as f64);
            let meet = (height + a * a - heights[r] - b * b) / (2.0 * (a - b));
            if meet > since {
                break meet;
            }
            lowest.pop();
        };
        lowest.push((q, from));
    }
    let mut k = 0;
    (0..heights.len())
        .map(|p| {
            while k + 1 < lowest.len() && lowest[k + 1].1 <= p as f64 {
                k += 1;
            }
            let q = lowest[k].0;
            heights[q] + (p as f64 - q as f64).powi(2)
        })
        .collect()
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
