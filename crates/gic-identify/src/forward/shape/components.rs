//! The directions of the surface's Gaussian process that are sought: those on which the motion depends most, and what
//! else moves the surface by as much as matters.

use glam::DVec3;
use nalgebra::{DMatrix, DVector, Dyn, SymmetricEigen};

use crate::forward::shape::Scale;
use crate::forward::shape::anchors::Anchor;

/// Prior covariance of the anchors' normal displacements [m^2].
pub(crate) fn covariance(anchors: &[Anchor], scale: Scale) -> DMatrix<f64> {
    let Scale { spacing, common_error_m, tuning, .. } = scale;
    DMatrix::from_fn(anchors.len(), anchors.len(), |i, j| {
        let (a, b) = (&anchors[i], &anchors[j]);
        let parallel = 0.5 * (1.0 + a.normal.dot(b.normal));
        let rounding = (tuning.rounding_deviation_spacings * spacing).powi(2) * a.bluntness * b.bluntness;
        a.deviation * b.deviation * near(a, b) * parallel + common_error_m * common_error_m + rounding
    })
}

/// Correlation of two places by how near they are (Gibbs 1997): positive definite although each has its own length.
fn near(a: &Anchor, b: &Anchor) -> f64 {
    let squares = a.correlation_length.powi(2) + b.correlation_length.powi(2);
    let alike = 2.0 * a.correlation_length * b.correlation_length / squares;
    alike.powf(1.5) * (-a.position.distance_squared(b.position) / squares).exp()
}

/// Values of the components at the anchors [m]: first those of the functionals, then those of what they leave, each
/// time those that vary most first.
pub(crate) fn components(anchors: &[Anchor], up: DVec3, scale: Scale) -> Vec<DVector<f64>> {
    let covariance = covariance(anchors, scale);
    let mut functionals = functionals(anchors, up, scale);
    let fields = &covariance * &functionals;
    // Each functional in units of its own standard deviation.
    for k in 0..functionals.ncols() {
        let scale = functionals.column(k).dot(&fields.column(k)).sqrt().max(f64::MIN_POSITIVE).recip();
        functionals.column_mut(k).scale_mut(scale);
    }
    let fields = &covariance * &functionals;
    let of_functionals = falling((functionals.transpose() * &fields).symmetric_eigen());
    // None that is but rounding.
    let least = 1e-6 * of_functionals.first().map_or(0.0, |(variance, _)| *variance);
    let kept = of_functionals.into_iter().take_while(|(variance, _)| *variance > least);
    let mut components: Vec<DVector<f64>> =
        kept.map(|(variance, direction)| &fields * direction / variance.sqrt()).collect();
    let left = components.iter().fold(covariance, |left, component| left - component * component.transpose());
    let least = (scale.tuning.least_displacement_spacings * scale.spacing).powi(2) * anchors.len() as f64;
    let others = falling(left.symmetric_eigen()).into_iter().take_while(|(variance, _)| *variance > least);
    let room = scale.tuning.most_components.saturating_sub(components.len());
    components.extend(others.take(room).map(|(variance, direction)| direction * variance.sqrt()));
    components
}

/// The eigenvalues with their eigenvectors, the largest first.
fn falling(eigen: SymmetricEigen<f64, Dyn>) -> Vec<(f64, DVector<f64>)> {
    let mut pairs: Vec<(f64, DVector<f64>)> =
        eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()).map(|(v, e)| (*v, e.into_owned())).collect();
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
    pairs
}

/// What the motion depends on, as weights of the anchors' normal displacements: shape [anchors, functionals].
pub(crate) fn functionals(anchors: &[Anchor], up: DVec3, scale: Scale) -> DMatrix<f64> {
    let n = anchors.len();
    let centre = anchors.iter().map(|a| a.position).sum::<DVec3>() / n as f64;
    let lowest = anchors.iter().map(|a| a.position.dot(up)).fold(f64::INFINITY, f64::min);
    let (east, north) = up.any_orthonormal_pair();
    let rows: Vec<Vec<f64>> = anchors
        .iter()
        .map(|anchor| {
            let d = anchor.position - centre;
            let height = anchor.position.dot(up) - lowest;
            let foot = (-height / (scale.tuning.correlation_length_spacings * scale.spacing)).exp();
            let frames = [d.x * d.x, d.y * d.y, d.z * d.z, d.x * d.y, d.y * d.z, d.x * d.z];
            let contact = [foot, foot * d.dot(east), foot * d.dot(north)];
            let untold = f64::from(u8::from(!anchor.is_told));
            [1.0, d.x, d.y, d.z].into_iter().chain(frames).chain(contact).chain([untold, anchor.bluntness]).collect()
        })
        .collect();
    DMatrix::from_fn(n, rows[0].len(), |i, k| rows[i][k])
}
