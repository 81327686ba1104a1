//! The albedo of what pictures hardly see: Adam moves every number at the same rate, so what a pixel or two say of a
//! Gaussian inside or below the body would be noise, in black and white specks.
//!
//! Each Gaussian's albedo is known from the pixels that it covers, c of them in all pictures (its alpha times the
//! transmittance in front of it, summed), and from its neighbours, which count as p pixels:
//!
//! ```text
//! a = (c a_trained + p mean(a of its neighbours)) / (c + p)
//! ```

use gic_geometry::Neighbours;
use glam::DVec3;

use crate::tuning::{HIDDEN_SWEEPS, NEIGHBOUR_PIXELS};

/// Neighbours of a Gaussian.
const NEIGHBOURS: usize = 8;

/// Solves for the albedo of all Gaussians, shape [n, 3], by sweeps over all of them. `pixels` [pixels] and `positions`
/// [m] have the shapes [n] and [n, 3].
pub(crate) fn share_albedo(albedo: &mut Vec<[f32; 3]>, pixels: &[f64], positions: &[[f32; 3]]) {
    let Some(neighbours) = neighbours_of(positions) else { return };
    let trained = albedo.clone();
    for _ in 0..HIDDEN_SWEEPS {
        let shared = |i: usize| -> [f32; 3] {
            core::array::from_fn(|c| {
                let mean = neighbours[i].iter().map(|&j| f64::from(albedo[j][c])).sum::<f64>() / NEIGHBOURS as f64;
                let sum = pixels[i] * f64::from(trained[i][c]) + NEIGHBOUR_PIXELS * mean;
                (sum / (pixels[i] + NEIGHBOUR_PIXELS)) as f32
            })
        };
        *albedo = (0..trained.len()).map(shared).collect();
    }
}

/// The nearest others of each point; `None` of too few points.
fn neighbours_of(positions: &[[f32; 3]]) -> Option<Vec<[usize; NEIGHBOURS]>> {
    if positions.len() <= NEIGHBOURS {
        return None;
    }
    let points: Vec<DVec3> = positions.iter().map(|p| DVec3::from(p.map(f64::from))).collect();
    let (low, high) = points.iter().fold((points[0], points[0]), |(low, high), p| (low.min(*p), high.max(*p)));
    let longest = (high - low).max_element().max(f64::MIN_POSITIVE);
    let grid = Neighbours::new(&points, longest / (points.len() as f64).cbrt());
    let others = |i: usize| {
        let near = grid.nearest::<{ NEIGHBOURS + 1 }>(points[i]).map(|(_, id)| id);
        // Itself is among them, unless more than eight lie in the same place.
        let own = near.iter().position(|&id| id == i).unwrap_or(NEIGHBOURS);
        core::array::from_fn(|k| near[if k < own { k } else { k + 1 }])
    };
    Some((0..points.len()).map(others).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line of Gaussians that pictures see at its ends only.
    #[test]
    fn what_is_hidden_takes_the_albedo_of_what_is_near() {
        let n = 40;
        let positions: Vec<[f32; 3]> = (0..n).map(|i| [i as f32, 0.0, 0.0]).collect();
        let end = |i: usize| if i < n / 2 { 0.2 } else { 0.8 };
        let is_seen = |i: usize| !(10..30).contains(&i);
        let mut albedo: Vec<[f32; 3]> =
            (0..n).map(|i| if is_seen(i) { [end(i); 3] } else { [(i % 2) as f32 * 2.0; 3] }).collect();
        let pixels: Vec<f64> = (0..n).map(|i| if is_seen(i) { 1e3 } else { 0.0 }).collect();
        share_albedo(&mut albedo, &pixels, &positions);
        for i in 0..n {
            let [value, ..] = albedo[i];
            if is_seen(i) {
                assert!((value - end(i)).abs() < 0.01, "{i}: {value}");
            } else {
                assert!((0.19..=0.81).contains(&value), "{i}: {value}");
            }
        }
        let hidden: Vec<f32> = albedo[10..30].iter().map(|a| a[0]).collect();
        assert!(hidden.windows(2).all(|pair| pair[1] >= pair[0] - 1e-3), "{hidden:?}");
    }
}
