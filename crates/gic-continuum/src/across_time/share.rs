//! How far places move where their neighbours move alike.

use crate::Tuning;

/// Of how far outward each place wants to move and with which weight, how far each does [units], where moves have a
/// prior and those of `neighbours` differ by a standard deviation: a linear system, by Gauss-Seidel's method.
pub(super) fn shared(
    neighbours: &[Vec<usize>],
    wanted: &[(f64, f64)],
    neighbour_deviation: f64,
    tuning: &Tuning,
) -> Vec<f64> {
    let (neighbour, own) = (neighbour_deviation.powi(-2), tuning.across_time.move_deviation.powi(-2));
    let mut moves: Vec<f64> = vec![0.0; wanted.len()];
    for _ in 0..tuning.iterations.most_rounds {
        for i in 0..wanted.len() {
            let (at, weight) = wanted[i];
            let sum: f64 = neighbours[i].iter().map(|k| moves[*k]).sum();
            let total = weight + own + neighbour * neighbours[i].len() as f64;
            moves[i] = (weight * at + neighbour * sum) / total;
        }
    }
    moves
}
