//! 95 % intervals: Gauss-Newton's covariance with a noise that includes errors of the model and of the reconstruction.
//!
//! Residuals inside a picture, along a camera's frames (the same wrong shape), and across the cameras of a frame (the
//! same wrong simulation) are correlated, so the textbook covariance s^2 H^-1 is far too narrow. It is measured twice:
//!
//! - Cameras see the same, each with its own error: the jackknife (Efron 1982). Without a camera's pictures the fit
//!   moves by (H - H_c)^-1 g_c, where g_c and H_c are their gradient and curvature. Where cameras are few, each pulls
//!   the fit to itself: what its residuals show of its error is but a part of it, and the jackknife sees the rest.
//! - Frames see each something else: without that of the impact little is told at all. Their gradients' scatter M at
//!   the fit gives H^-1 M H^-1, with lags, for neighbouring frames show the same wrong shape.
//!
//! An error that is common to all blocks leaves no scatter: what can be wrong with the shape is therefore among the
//! unknowns, with its prior, and so are the cells of the grid. A few components stand for all ways in which a shape can
//! be wrong. What they explain of the others' effect makes the estimate better without making it certain: the intervals
//! of all other unknowns have the whole of their prior, as if they were not sought, while these adapt. Cells of the
//! grid that the fit held count as one component more.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{DMatrix, DVector};

use crate::solve::normal_equations::Normal;
use crate::solve::residual_block::{ResidualBlock, Weights};
use crate::tuning::NoiseTuning;
use crate::uncertainty::variance::Variance;

/// The curvature of the cost at a fit, given what is known of its unknowns besides.
pub(crate) struct Curvature<'a> {
    blocks: &'a [ResidualBlock],
    weights: &'a Weights,
    /// Of the unknowns, with what is known of them.
    own: DMatrix<f64>,
    /// Inverse of that: the covariance if all residuals were independent.
    inverse: DMatrix<f64>,
    /// What is known of the unknowns: an information matrix.
    known: DMatrix<f64>,
}

impl<'a> Curvature<'a> {
    /// The columns of `blocks` are the unknowns, of which `known` is an information matrix. `None` without blocks, and
    /// where it is not finite.
    pub(crate) fn measure(
        blocks: &'a [ResidualBlock],
        weights: &'a Weights,
        known: DMatrix<f64>,
    ) -> Option<Curvature<'a>> {
        let own = Normal::sum(blocks, weights, blocks.first()?.gradient.len()).hessian + &known;
        let inverse = regularised_inverse(&own)?;
        Some(Curvature { blocks, weights, own, inverse, known })
    }

    /// Along the first `count` unknowns.
    pub(crate) fn hessian(&self, count: usize) -> DMatrix<f64> {
        self.own.view((0, 0), (count, count)).into_owned()
    }

    /// Covariance of the unknowns if all residuals were independent: the textbook's.
    pub(crate) fn into_independent_covariance(self) -> DMatrix<f64> {
        self.inverse
    }

    /// The parts of the unknowns' covariance with their freedom: of what is known besides, by leaving out cameras, and
    /// by the scatter of frames. `None` where a fit without one of the cameras is not finite.
    pub(crate) fn parts(&self, tuning: &NoiseTuning) -> Option<Vec<(DMatrix<f64>, f64)>> {
        let known = &self.inverse * &self.known * &self.inverse;
        let mut parts = vec![(known, tuning.freedom)];
        let moves = self.moves_without_cameras()?;
        if !moves.is_empty() {
            parts.push((jackknife(&moves), freedom(moves.len(), 0)));
        }
        let weight = |block: &ResidualBlock| self.weights.of_errors(block);
        let frames = groups(self.blocks, &weight, self.own.nrows(), &|block| block.observation);
        let lags = frames.len() / tuning.frames_per_lag;
        parts.push((&self.inverse * scatter(&frames, lags) * &self.inverse, freedom(frames.len(), lags)));
        Some(parts)
    }

    /// How far the fit moves without each of the cameras; empty of a single one, without which nothing is left.
    fn moves_without_cameras(&self) -> Option<Vec<DVector<f64>>> {
        let camera_of = |block: &ResidualBlock| block.camera.unwrap_or(usize::MAX);
        let cameras: BTreeSet<usize> = self.blocks.iter().map(camera_of).collect();
        if cameras.len() < 2 {
            return Some(Vec::new());
        }
        let move_without = |camera: usize| {
            let (mut rest, mut pull) = (self.known.clone(), DVector::zeros(self.own.nrows()));
            for block in self.blocks {
                if camera_of(block) == camera {
                    pull += &block.gradient * self.weights.of_errors(block);
                } else {
                    rest += &block.hessian * self.weights.of(block);
                }
            }
            Some(regularised_inverse(&rest)? * pull)
        };
        cameras.into_iter().map(move_without).collect()
    }

    /// Covariance of the unknowns, zero of the `components`, from the whole prior (unit variances) of these, as if they
    /// were not sought: the others follow by -H_oo^-1 H_oc.
    pub(crate) fn prior_covariance(&self, components: &[usize]) -> DMatrix<f64> {
        let unknowns = self.own.nrows();
        let others: Vec<usize> = (0..unknowns).filter(|k| !components.contains(k)).collect();
        let of_others = self.own.select_rows(&others);
        let mut followed = DMatrix::zeros(unknowns, components.len());
        if let Some(inverse) = regularised_inverse(&of_others.select_columns(&others)) {
            let shifts = inverse * of_others.select_columns(components);
            for (i, k) in others.iter().enumerate() {
                followed.set_row(*k, &shifts.row(i));
            }
        }
        &followed * followed.transpose()
    }
}

/// How far the residuals tell a fit from a state that costs `more`, as far as an unknown goes with this `robust`
/// variance, and this one if they were `independent`: the likelihood ratio, in units in which it is chi-squared
/// although they are not (Rotnitzky and Jewell 1990), over its value at the end of a 95 % interval.
pub(crate) fn told(more: f64, robust: Variance, independent: f64) -> f64 {
    2.0 * more * independent / robust.half_width().powi(2)
}

/// The jackknife's covariance from how far the fit moves without each group.
fn jackknife(moves: &[DVector<f64>]) -> DMatrix<f64> {
    let count = moves.len() as f64;
    products(moves, 0) * ((count - 1.0) / count)
}

/// By how many independent groups a scatter of so many is known, of which those up to `lags` apart count together
/// (Priestley 1981, for Bartlett's weights).
fn freedom(groups: usize, lags: usize) -> f64 {
    let count = groups as f64;
    (count - 1.0).min(1.5 * count / (lags + 1) as f64).max(1.0)
}

/// The interval about a value, which reaches so far below and above it, and those about the same unknown's values in
/// other minima, as one.
pub(crate) fn united(value: f64, (below, above): (f64, f64), others: &[f64]) -> (f64, f64) {
    let (low, high) = others.iter().fold((value, value), |(low, high), other| (low.min(*other), high.max(*other)));
    (low - below, high + above)
}

/// The weighted gradients of whole groups of blocks, in the order of the groups' keys.
pub(crate) fn groups(
    blocks: &[ResidualBlock],
    weight: &dyn Fn(&ResidualBlock) -> f64,
    unknowns: usize,
    key: &dyn Fn(&ResidualBlock) -> usize,
) -> Vec<DVector<f64>> {
    let mut groups = BTreeMap::<usize, DVector<f64>>::new();
    for block in blocks {
        let g = block.gradient.rows(0, unknowns) * weight(block);
        *groups.entry(key(block)).or_insert_with(|| DVector::zeros(unknowns)) += g;
    }
    groups.into_values().collect()
}

/// Sum of g_c g_c^T with the usual small-sample factor, with the products of groups up to `lags` apart; zero of one
/// group.
pub(crate) fn scatter(groups: &[DVector<f64>], lags: usize) -> DMatrix<f64> {
    let count = groups.len() as f64;
    let factor = if groups.len() < 2 { 0.0 } else { count / (count - 1.0) };
    products(groups, lags) * factor
}

/// Sum of v_c v_c^T, plus the products of those up to `lags` apart with Bartlett's weights (Newey and West 1987).
fn products(groups: &[DVector<f64>], lags: usize) -> DMatrix<f64> {
    let unknowns = groups.first().map_or(0, |g| g.len());
    let mut sum = DMatrix::zeros(unknowns, unknowns);
    for lag in 0..=lags {
        let weight = 1.0 - lag as f64 / (lags + 1) as f64;
        for (early, late) in groups.iter().zip(&groups[lag..]) {
            let product = early * late.transpose() * weight;
            sum += if lag == 0 { product } else { &product + product.transpose() };
        }
    }
    sum
}

/// Inverse of a positive semi-definite matrix; directions without curvature get a large variance instead of none.
fn regularised_inverse(h: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = h.nrows();
    let scale: Vec<f64> = (0..n).map(|i| h[(i, i)].sqrt()).collect();
    if !scale.iter().all(|s| s.is_finite()) {
        return None;
    }
    let floor = scale.iter().copied().fold(0.0, f64::max) * 1e-6;
    let d = DMatrix::from_diagonal(&DVector::from_iterator(
        n,
        scale.iter().map(|s| 1.0 / s.max(floor).max(f64::MIN_POSITIVE)),
    ));
    let normalised = &d * h * &d + DMatrix::identity(n, n) * 1e-9;
    Some(&d * normalised.try_inverse()? * &d)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::residual_block::Modality;
    use crate::uncertainty::variance::Covariance;
    use rand::{RngExt, SeedableRng};

    fn covariance(blocks: &[ResidualBlock], weights: &Weights, known: DMatrix<f64>) -> Option<Covariance> {
        let parts = Curvature::measure(blocks, weights, known)?.parts(&NoiseTuning::default())?;
        Covariance::sum(&parts)
    }

    #[test]
    fn understated_errors_widen_the_interval() {
        let blocks: Vec<ResidualBlock> = (0..8)
            .map(|frame| {
                let mut block = ResidualBlock::new(Modality::Surface, frame, None, 1);
                block.add(if frame % 2 == 0 { 0.1 } else { -0.1 }, &[1.0], 1.0);
                block.finish()
            })
            .collect();
        let weights = Weights::uniform(1.0, 1.0, 8);
        let variance = |weights: &Weights| covariance(&blocks, weights, DMatrix::zeros(1, 1)).unwrap().matrix[(0, 0)];
        let wider = Weights { error_inflation: vec![3.0; 8], ..weights.clone() };
        assert!((variance(&wider) / variance(&weights) - 9.0).abs() < 1e-9);
    }

    /// Of a quadratic cost with curvature h, what lies outside the robust interval is told from the minimum, and what
    /// lies inside is not.
    #[test]
    fn a_minimum_is_told_apart_where_it_lies_outside_of_the_interval() {
        let (curvature, robust) = (40.0, Variance { value: 1.7, freedom: 4.0 });
        for share in [0.5, 0.9, 1.1] {
            let away = share * robust.half_width();
            let told = told(0.5 * curvature * away * away, robust, 1.0 / curvature);
            assert!((told - share * share).abs() < 1e-12, "{told} at {share}");
        }
        assert_eq!(united(2.0, (0.5, 0.25), &[]), (1.5, 2.25));
        assert_eq!(united(2.0, (0.5, 0.25), &[1.0, 2.2, 3.0]), (0.5, 3.25));
    }

    /// Errors of a shape of which one half of the components is sought: with the whole prior of these the interval
    /// covers the truth although the other half biases the fit, and without it less often.
    #[test]
    fn components_that_nobody_seeks_are_covered() {
        let components = [1, 2, 3];
        let columns = 1 + components.len();
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let mut gauss = move || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
        let (weights, trials) = (Weights::uniform(1e4, 1e4, 5), 300);
        let mut known = DMatrix::identity(columns, columns);
        known[(0, 0)] = 0.0;
        let mut inside = [0, 0];
        for _ in 0..trials {
            // The first unknown is a parameter whose truth is zero, the others are sought components.
            let sought = DMatrix::from_fn(30, columns, |_, _| gauss());
            let omitted = DMatrix::from_fn(30, components.len(), |_, _| gauss());
            let truth = DVector::from_fn(columns, |k, _| if k == 0 { 0.0 } else { gauss() });
            let seen = &sought * &truth + omitted * DVector::from_fn(components.len(), |_, _| gauss());
            let curvature = 1e4 * sought.transpose() * &sought + &known;
            let fit = curvature.try_inverse().unwrap() * (1e4 * sought.transpose() * &seen);
            let off = &sought * &fit - seen;
            let blocks: Vec<ResidualBlock> = (0..5)
                .map(|frame| {
                    let mut block = ResidualBlock::new(Modality::Mask, frame, Some(0), columns);
                    for i in 6 * frame..6 * (frame + 1) {
                        block.add(off[i], sought.row(i).transpose().as_slice(), 1.0);
                    }
                    block.finish()
                })
                .collect();
            let tuning = NoiseTuning::default();
            let curvature = Curvature::measure(&blocks, &weights, known.clone()).unwrap();
            let of_fit = curvature.parts(&tuning).unwrap();
            let of_shape = (curvature.prior_covariance(&components), tuning.freedom);
            let whole = [of_fit.clone(), vec![of_shape]].concat();
            for (count, parts) in inside.iter_mut().zip([whole, of_fit]) {
                let covariance = Covariance::sum(&parts).unwrap();
                *count += usize::from(fit[0].abs() < covariance.variance(0).half_width());
            }
        }
        println!("{inside:?} of {trials}");
        assert!(inside[0] >= trials * 90 / 100 && inside[1] < inside[0], "{inside:?}");
    }

    /// Two cameras or three that err each by itself, and a fit of as many unknowns: each pulls the fit to itself, so
    /// that its residuals show a part of its error only.
    #[test]
    fn few_cameras_are_covered() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let mut gauss = move || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
        let trials = 400;
        for cameras in [2, 3] {
            let (mut inside, mut sandwich) = (0, 0);
            for _ in 0..trials {
                // Unknowns of a common truth, zero, that each camera sees in its own way, known to one besides.
                let seen: Vec<(usize, [f64; 2], f64)> = (0..cameras)
                    .flat_map(|camera| {
                        let (error, way) = (0.1 * gauss(), 0.3 * gauss());
                        let rows: Vec<f64> = (0..12).map(|_| gauss()).collect();
                        rows.into_iter().map(move |b| (camera, [1.0 + way, 0.2 * b], error)).collect::<Vec<_>>()
                    })
                    .collect();
                let known = DMatrix::identity(2, 2);
                let row = |row: &[f64; 2]| DVector::from_column_slice(row);
                let curvature: DMatrix<f64> =
                    seen.iter().map(|(_, a, _)| row(a) * row(a).transpose() * 100.0).sum::<DMatrix<f64>>() + &known;
                let pull: DVector<f64> = seen.iter().map(|(_, a, error)| row(a) * (100.0 * error)).sum();
                let fit = curvature.try_inverse().unwrap() * pull;
                let blocks: Vec<ResidualBlock> = (0..cameras)
                    .map(|camera| {
                        let mut block = ResidualBlock::new(Modality::Mask, 0, Some(camera), 2);
                        for (_, a, error) in seen.iter().filter(|(own, _, _)| *own == camera) {
                            block.add(row(a).dot(&fit) - error, a, 1.0);
                        }
                        block.finish()
                    })
                    .collect();
                let weights = Weights::uniform(100.0, 1.0, 1);
                let variance = covariance(&blocks, &weights, known.clone()).unwrap().variance(0);
                inside += usize::from(fit[0].abs() < variance.half_width());
                let curvature = Curvature::measure(&blocks, &weights, known).unwrap();
                let gradients = groups(&blocks, &|c| weights.of(c), 2, &|c| c.camera.unwrap_or(0));
                let spread = &curvature.inverse * scatter(&gradients, 0) * &curvature.inverse;
                sandwich += usize::from(fit[0].abs() < 1.96 * spread[(0, 0)].sqrt());
            }
            println!("{cameras} cameras: {inside} of {trials}, {sandwich} by the sandwich");
            assert!(inside >= trials * 90 / 100 && sandwich < trials * 85 / 100, "{inside}, {sandwich} of {trials}");
        }
    }

    /// A line y = a + b x seen by 11 "cameras" in 14 "frames" with errors that are common to a camera: the nominal 95 %
    /// interval covers the truth about as often as it says, the textbook one would not.
    #[test]
    fn clustered_errors_are_covered() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let mut gauss = move || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
        let (mut inside, mut textbook, trials) = (0, 0, 400);
        for _ in 0..trials {
            let common: Vec<f64> = (0..11).map(|_| gauss()).collect();
            let mut data = Vec::new();
            for frame in 0..14 {
                for (camera, error) in common.iter().enumerate() {
                    let slope = 1.0 + 0.5 * (frame as f64 / 14.0) * (1.0 + 0.1 * camera as f64);
                    data.push((frame, camera, slope, error + 0.3 * gauss()));
                }
            }
            let (h, g) = data.iter().fold((0.0, 0.0), |(h, g), (_, _, s, e)| (h + s * s, g + s * e));
            let estimate = g / h;
            let blocks: Vec<ResidualBlock> = data
                .iter()
                .map(|(frame, camera, s, e)| {
                    let mut block = ResidualBlock::new(Modality::Mask, *frame, Some(*camera), 1);
                    block.add(s * estimate - e, &[*s], 1.0);
                    block.finish()
                })
                .collect();
            let c = covariance(&blocks, &Weights::uniform(1.0, 1.0, 14), DMatrix::zeros(1, 1)).unwrap();
            inside += usize::from(estimate.abs() < c.variance(0).half_width());
            let noise: f64 = data.iter().map(|(_, _, s, e)| (e - s * estimate).powi(2)).sum::<f64>() / 154.0;
            textbook += usize::from(estimate.abs() < 1.96 * (noise / h).sqrt());
        }
        assert!(inside >= trials * 90 / 100, "{inside} of {trials}");
        assert!(textbook < trials * 80 / 100, "the test has no correlation to find: {textbook}");
    }
}
