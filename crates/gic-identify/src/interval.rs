//! 95 % intervals: Gauss-Newton's covariance with a noise that includes errors of the model and of the reconstruction.
//!
//! Residuals inside a picture, along a camera's frames (the same wrong shape), and across the cameras of a frame (the same wrong
//! simulation) are correlated, so the textbook covariance s^2 H^-1 is far too narrow. The sandwich H^-1 M H^-1 takes M from the
//! scatter of whole clusters' gradients at the optimum, clustered both ways: by camera and by frame. An error that is common to all
//! clusters leaves no scatter; the size of the continuum, which no residual reveals once the Gaussians are fitted to the outline,
//! therefore enters as a nuisance with its own prior.

use nalgebra::{DMatrix, DVector};

use crate::normal::{Cluster, Modality, Normal, Weights};

/// Student's t at 97.5 % for the ten-odd clusters of a typical scene.
const T_975: f64 = 2.2;

/// Frames are correlated over this share of their number.
const FRAMES_PER_LAG: usize = 4;

/// Covariance of the first `unknowns` columns, given what is `known` of them besides (an information matrix, or an empty one).
///
/// `nuisances` is the covariance of the next columns of the clusters, which were held fixed.
pub(crate) fn covariance(
    clusters: &[Cluster],
    weights: Weights,
    unknowns: usize,
    known: &DMatrix<f64>,
    nuisances: &DMatrix<f64>,
) -> Option<DMatrix<f64>> {
    let columns = clusters.first()?.gradient.len();
    let total = Normal::sum(clusters, weights, columns);
    let inverse = regularised_inverse(&with_known(&total.hessian, unknowns, known))?;
    let mut middle = if known.is_empty() { DMatrix::zeros(unknowns, unknowns) } else { known.clone() };
    middle += scatter(&groups(clusters, weights, unknowns, &|c| c.camera.unwrap_or(usize::MAX)), 0);
    let frames = groups(clusters, weights, unknowns, &|c| c.observation);
    middle += scatter(&frames, frames.len() / FRAMES_PER_LAG);
    let shifts = &inverse * total.hessian.view((0, unknowns), (unknowns, nuisances.nrows()));
    Some(&inverse * middle * &inverse + &shifts * nuisances * shifts.transpose())
}

/// How far the first `unknowns` columns move per unit of column `other`, which was held fixed: -H^-1 J^T W J_other.
pub(crate) fn response(
    clusters: &[Cluster],
    weights: Weights,
    unknowns: usize,
    known: &DMatrix<f64>,
    other: usize,
) -> Option<Vec<f64>> {
    let total = Normal::sum(clusters, weights, clusters.first()?.gradient.len());
    let inverse = regularised_inverse(&with_known(&total.hessian, unknowns, known))?;
    let cross: DVector<f64> = total.hessian.view((0, other), (unknowns, 1)).column(0).into_owned();
    Some((inverse * -cross).iter().copied().collect())
}

fn with_known(hessian: &DMatrix<f64>, unknowns: usize, known: &DMatrix<f64>) -> DMatrix<f64> {
    let own = hessian.view((0, 0), (unknowns, unknowns)).into_owned();
    if known.is_empty() { own } else { own + known }
}

/// Half-width of the 95 % interval for a variance.
pub(crate) fn half_width(variance: f64) -> f64 {
    T_975 * variance.max(0.0).sqrt()
}

/// The gradients of whole groups of clusters, in the order of the groups' keys.
fn groups(
    clusters: &[Cluster],
    weights: Weights,
    unknowns: usize,
    key: &dyn Fn(&Cluster) -> usize,
) -> Vec<DVector<f64>> {
    let mut groups = std::collections::BTreeMap::<usize, DVector<f64>>::new();
    for cluster in clusters {
        let g = cluster.gradient.rows(0, unknowns) * weights.of(cluster.modality);
        *groups.entry(key(cluster)).or_insert_with(|| DVector::zeros(unknowns)) += g;
    }
    groups.into_values().collect()
}

/// Sum of g_c g_c^T with the usual small-sample factor, plus the products of groups up to `lags` apart with Bartlett's weights
/// (Newey and West): neighbouring frames show the same wrong shape.
fn scatter(groups: &[DVector<f64>], lags: usize) -> DMatrix<f64> {
    let unknowns = groups.first().map_or(0, |g| g.len());
    let mut sum = DMatrix::zeros(unknowns, unknowns);
    if groups.len() < 2 {
        return sum;
    }
    for lag in 0..=lags {
        let weight = 1.0 - lag as f64 / (lags + 1) as f64;
        for (early, late) in groups.iter().zip(&groups[lag..]) {
            let product = early * late.transpose() * weight;
            sum += if lag == 0 { product } else { &product + product.transpose() };
        }
    }
    let count = groups.len() as f64;
    sum * (count / (count - 1.0))
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

/// Weights that make each modality's residuals count by their effective noise: the scatter of whole clusters' gradients over the
/// curvature, averaged over the unknowns. Derived from the data, so that nothing is tuned per scene.
pub(crate) fn effective_weights(clusters: &[Cluster], unknowns: usize, floors: Weights) -> Weights {
    let weight = |modality: Modality| {
        let mut ratios = Vec::new();
        for k in 0..unknowns {
            let (mut scatter, mut curvature) = (0.0, 0.0);
            for cluster in clusters.iter().filter(|c| c.modality == modality) {
                scatter += cluster.gradient[k].powi(2);
                curvature += cluster.hessian[(k, k)];
            }
            if curvature > 0.0 {
                ratios.push(scatter / curvature);
            }
        }
        let noise = ratios.iter().sum::<f64>() / ratios.len().max(1) as f64;
        1.0 / noise.max(1.0 / floors.of(modality))
    };
    Weights { mask: weight(Modality::Mask), surface: weight(Modality::Surface) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    /// A line y = a + b x seen by 11 "cameras" in 14 "frames" with errors that are common to a camera: the nominal 95 % interval
    /// covers the truth about as often as it says, the textbook one would not.
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
            let clusters: Vec<Cluster> = data
                .iter()
                .map(|(frame, camera, s, e)| {
                    let mut cluster = Cluster::new(Modality::Mask, *frame, Some(*camera), 2);
                    cluster.add(s * estimate - e, &[*s, 0.0], 1.0);
                    cluster.finish()
                })
                .collect();
            let c = covariance(
                &clusters,
                Weights { mask: 1.0, surface: 1.0 },
                1,
                &DMatrix::zeros(0, 0),
                &DMatrix::zeros(0, 0),
            )
            .unwrap();
            inside += usize::from(estimate.abs() < half_width(c[(0, 0)]));
            let noise: f64 = data.iter().map(|(_, _, s, e)| (e - s * estimate).powi(2)).sum::<f64>() / 154.0;
            textbook += usize::from(estimate.abs() < 1.96 * (noise / h).sqrt());
        }
        assert!(inside >= trials * 90 / 100, "{inside} of {trials}");
        assert!(textbook < trials * 80 / 100, "the test has no correlation to find: {textbook}");
    }
}
