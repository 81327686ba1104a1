//! How the body may differ from its reconstruction: a few displacement fields with a Gaussian prior.
//!
//! How far the surface is off where pictures tell of it is measured: by as much as the outlines of all moments miss. It
//! may be too far in or out as a whole, too: by the mean of what the cameras are off, each by itself. A part that no
//! picture tells of (an underside, which meets the ground first) may lie anywhere up to as far in or out as the nearest
//! that one tells is away. The error of the surface along its normal is modelled as a Gaussian process of these
//! standard deviations, correlated over a few particle spacings and the distance to what is told, and among places that
//! face the same way. Of its many directions those count that change what the motion depends on most: volume, centre
//! and second moments of the mass, where the lowest parts are, and how far what no picture tells of is filled (a notch
//! that is filled at the root of an arm makes it much stiffer). For functionals l_i of the surface and the covariance
//! K, the fields K l_i span all of the prior's variation of the functionals. Then come those of what is left that move
//! the surface by as much as matters (Karhunen and Loeve): refinement settles the surface to the motion of a fit, whose
//! errors it takes up in parts that are too thick or too thin, and these have to be undone.
//!
//! `K_ij = sigma_i sigma_j g_ij (1 + n_i . n_j) / 2 + c^2 / n + rho^2 b_i b_j` with Gibbs' correlation
//! `g_ij = (2 l_i l_j / (l_i^2 + l_j^2))^(3/2) exp(-|x_i - x_j|^2 / (l_i^2 + l_j^2))`, where sigma is the standard
//! deviation of a place, l its length of correlation, c the measured error, n the number of cameras, and rho the
//! rounding, which acts on the bluntness b. `l_i^2` is the square of some particle spacings and that of the distance to
//! what is told: the back of a body that no camera sees is too flat as a whole. An orthonormal basis of them becomes
//! unknowns of the joint stage beside the material, with unit variances: what the pictures say about the shape is then
//! used, and what they leave open widens the intervals.

pub(crate) mod anchors;
pub(crate) mod components;

use glam::DVec3;
use nalgebra::DVector;
use rayon::prelude::*;

use crate::Input;
use crate::forward::shape::anchors::{Anchor, anchors, normals};
use crate::forward::shape::components::components;
use crate::tuning::{ShapeTuning, SurfaceTuning};

/// Displacement fields, each of one standard deviation.
#[derive(Clone, Debug, Default)]
pub(crate) struct ShapeModes {
    /// Displacement of each particle [m], shape [modes][n].
    displacements: Vec<Vec<DVec3>>,
    /// Its part along the outward direction, 0 inside the body [m], shape [modes][n].
    outward: Vec<Vec<f32>>,
    /// Its divergence, the relative change of each particle's volume, shape [modes][n].
    divergences: Vec<Vec<f32>>,
    /// Share of the surface that some picture tells; `None` of no surface.
    told_share: Option<f64>,
}

/// What the surface's errors are measured by.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale<'a> {
    /// Distance of the particles [m].
    pub spacing: f64,
    /// How far the surface is off where pictures tell of it, as a standard deviation [m].
    pub error_m: f64,
    /// How far it is too far in or out as a whole, as a standard deviation [m].
    pub common_error_m: f64,
    pub tuning: &'a ShapeTuning,
}

impl Scale<'_> {
    pub(crate) fn of<'a>(input: &Input, tuning: &'a ShapeTuning) -> Scale<'a> {
        let spacing = input.particle_volume_m3.cbrt();
        let common_error_m = input.surface_error_m / (input.camera_count().max(1) as f64).sqrt();
        Scale { spacing, error_m: input.surface_error_m, common_error_m, tuning }
    }
}

impl ShapeModes {
    pub(crate) fn new(input: &Input, tuning: &ShapeTuning, surfaces: &SurfaceTuning) -> ShapeModes {
        let scale = Scale::of(input, tuning);
        let normals = normals(input, (scale.spacing, surfaces));
        let anchors = anchors(input, &normals, scale);
        if anchors.is_empty() {
            return ShapeModes::default();
        }
        let up = -input.gravity_m_s2.normalize_or(-DVec3::Y);
        let components = components(&anchors, up, scale);
        let reach = tuning.anchor_spacing_spacings * scale.spacing;
        let fields: Vec<Vec<(DVec3, f64)>> =
            input.positions.par_iter().map(|p| displacement(&anchors, &components, *p, reach)).collect();
        let along = |k: usize| {
            fields.iter().zip(&normals).map(move |(at, n)| n.map_or(0.0, |n| at[k].0.dot(n) as f32)).collect()
        };
        ShapeModes {
            displacements: (0..components.len()).map(|k| fields.iter().map(|at| at[k].0).collect()).collect(),
            outward: (0..components.len()).map(along).collect(),
            divergences: (0..components.len()).map(|k| fields.iter().map(|at| at[k].1 as f32).collect()).collect(),
            told_share: Some(anchors.iter().filter(|anchor| anchor.is_told).count() as f64 / anchors.len() as f64),
        }
    }

    /// Share of the surface that some picture tells; `None` of no surface.
    pub(crate) fn told_share(&self) -> Option<f64> {
        self.told_share
    }

    /// Number of components.
    pub(crate) fn count(&self) -> usize {
        self.displacements.len()
    }

    /// Adds the displacements for `amounts` (standard deviations; those that are missing are zero).
    pub(crate) fn displace(&self, positions: &mut [DVec3], amounts: &[f64]) {
        for (field, amount) in self.displacements.iter().zip(amounts) {
            if *amount != 0.0 {
                positions.iter_mut().zip(field).for_each(|(p, d)| *p += *d * *amount);
            }
        }
    }

    /// How far each particle moves outward [m], shape [n]; empty where nothing moves.
    pub(crate) fn outward_displacements(&self, amounts: &[f64]) -> Vec<f32> {
        let mut sums = Vec::new();
        for (field, amount) in self.outward.iter().zip(amounts) {
            sums.resize(field.len(), 0.0);
            sums.iter_mut().zip(field).for_each(|(sum, d)| *sum += d * *amount as f32);
        }
        sums
    }

    /// Changes each particle's volume; `factors` has shape [n]. Each stands for the matter around it, which its
    /// neighbours' displacements stretch or squeeze: the density stays, and where the body loses its skin, the skin's
    /// stiffness goes with its mass.
    pub(crate) fn stretch(&self, factors: &mut [f64], amounts: &[f64]) {
        for (i, factor) in factors.iter_mut().enumerate() {
            let change: f64 = self.divergences.iter().zip(amounts).map(|(d, amount)| f64::from(d[i]) * amount).sum();
            *factor *= change.exp();
        }
    }
}

/// Displacement of a point by each component, that of the anchors around it along their normals, and its divergence.
///
/// With weights `w_j = exp(-|x - x_j|^2 / 2 r^2)`, shares `s_j = w_j / sum w` and the mean anchor `m = sum s_j x_j`,
/// the displacement is `u = sum s_j c_j n_j`. From `grad s_j = s_j (x_j - m) / r^2` follows
/// `div u = sum s_j c_j n_j . (x_j - m) / r^2`.
fn displacement(anchors: &[Anchor], components: &[DVector<f64>], at: DVec3, reach: f64) -> Vec<(DVec3, f64)> {
    let exponent = |a: &Anchor| 0.5 * a.position.distance_squared(at) / (reach * reach);
    let least = anchors.iter().map(exponent).fold(f64::INFINITY, f64::min);
    let mut shares: Vec<f64> = anchors.iter().map(|a| (least - exponent(a)).exp()).collect();
    let total: f64 = shares.iter().sum();
    shares.iter_mut().for_each(|share| *share /= total);
    let mean: DVec3 = anchors.iter().zip(&shares).map(|(a, share)| *share * a.position).sum();
    let mut sums = vec![(DVec3::ZERO, 0.0); components.len()];
    for (j, (anchor, share)) in anchors.iter().zip(shares).enumerate() {
        let (way, growth) = (share * anchor.normal, share * anchor.normal.dot(anchor.position - mean) / reach.powi(2));
        for ((displacement, divergence), component) in sums.iter_mut().zip(components) {
            *displacement += way * component[j];
            *divergence += growth * component[j];
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::components::{covariance, functionals};
    use super::*;
    use crate::{Observation, View};

    const SPACING: f64 = 0.01;

    /// A ball of particles, of whose lower half no picture tells.
    fn ball() -> Input {
        body(|p| p.length() < 0.1)
    }

    /// A body of particles, of whose lower half no picture tells.
    fn body(is_inside: impl Fn(DVec3) -> bool) -> Input {
        let range = -12..=12;
        let mut positions = Vec::new();
        for x in range.clone() {
            for y in range.clone() {
                for z in range.clone() {
                    let p = DVec3::new(f64::from(x), f64::from(y), f64::from(z)) * SPACING;
                    if is_inside(p) {
                        positions.push(p);
                    }
                }
            }
        }
        Input {
            doubts: positions.iter().map(|p: &DVec3| f32::from(u8::from(p.y < 0.0))).collect(),
            surface_error_m: 0.2 * SPACING,
            gravity_m_s2: DVec3::new(0.0, -9.8, 0.0),
            ..Input::of_body(positions, SPACING)
        }
    }

    fn anchors_of(input: &Input) -> Vec<Anchor> {
        let tuning = ShapeTuning::default();
        anchors(input, &normals(input, (SPACING, &SurfaceTuning::default())), Scale::of(input, &tuning))
    }

    #[test]
    fn what_no_picture_tells_is_less_certain() {
        let input = ball();
        let anchors = anchors_of(&input);
        for anchor in &anchors {
            assert_eq!(anchor.is_told, anchor.position.y >= 0.0);
            assert_eq!(anchor.deviation == 0.2 * SPACING, anchor.is_told, "{}", anchor.position);
        }
        // By a uniform distribution over the way to the equator, or over .08 m.
        let bottom = anchors.iter().min_by(|a, b| a.position.y.total_cmp(&b.position.y)).unwrap();
        assert!((0.04..0.08).contains(&bottom.deviation), "{}", bottom.deviation);
        let input = Input { doubts: vec![1.0; input.positions.len()], ..input };
        let anchors = anchors_of(&input);
        assert!(anchors.iter().all(|anchor| anchor.deviation.is_finite() && anchor.deviation > 0.2 * SPACING));
    }

    /// Places to both sides of a pole move together where no picture tells, and each by itself where they are told.
    #[test]
    fn what_is_far_from_all_that_is_told_errs_as_a_whole() {
        let input = ball();
        let anchors = anchors_of(&input);
        let tuning = ShapeTuning { rounding_deviation_spacings: 0.0, ..ShapeTuning::default() };
        let covariance = covariance(&anchors, Scale { common_error_m: 0.0, ..Scale::of(&input, &tuning) });
        let beside = |pole: DVec3| {
            let [a, b] = [-0.6, 0.6].map(|x| outermost(&anchors, pole + x * DVec3::X));
            covariance[(a, b)] / (covariance[(a, a)] * covariance[(b, b)]).sqrt()
        };
        let (told, untold) = (beside(DVec3::Y), beside(-DVec3::Y));
        println!("correlation {told:.2} above, {untold:.2} below");
        assert!(told < 0.3 && untold > 0.6);
        let eigenvalues = covariance.symmetric_eigenvalues();
        assert!(eigenvalues.min() > -1e-9 * eigenvalues.max(), "{eigenvalues}");
    }

    /// A reconstruction that is rounded has lost its edges and filled its notches.
    #[test]
    fn edges_are_blunt_and_notches_are_not() {
        let input = body(|p| p.abs().max_element() < 0.105 && p.x.min(p.y) < 0.0);
        let anchors = anchors_of(&input);
        let mean = |is: &dyn Fn(DVec3) -> bool| {
            let chosen: Vec<f64> = anchors.iter().filter(|a| is(a.position)).map(|a| a.bluntness).collect();
            chosen.iter().sum::<f64>() / chosen.len() as f64
        };
        let off_ends = |p: DVec3| p.z.abs() < 0.07;
        let edge = mean(&|p| off_ends(p) && p.x < -0.08 && p.y < -0.08);
        let notch = mean(&|p| off_ends(p) && p.x.abs() < 0.015 && p.y.abs() < 0.015);
        let face = mean(&|p| off_ends(p) && p.x < -0.08 && p.y.abs() < 0.06);
        println!("edge {edge:.2}, face {face:.2}, notch {notch:.2}");
        assert!(edge > 0.15 && notch < -0.08 && face.abs() < 0.04);
    }

    /// Cameras are off each by itself: what two opposite sides have in common is the mean of it.
    #[test]
    fn the_common_error_is_the_mean_of_the_cameras() {
        let view = |camera| View { camera, mask: Vec::new() };
        // Of four cameras that move, each has an index of its own in each of three frames.
        let frame =
            |o: usize| Observation { views: (4 * o..4 * (o + 1)).map(view).collect(), ..Observation::default() };
        let input = Input { observations: (0..3).map(frame).collect(), ..ball() };
        let tuning = ShapeTuning { rounding_deviation_spacings: 0.0, ..ShapeTuning::default() };
        let common = |input: &Input| {
            let anchors = anchors_of(input);
            let (left, right) = (outermost(&anchors, -DVec3::X), outermost(&anchors, DVec3::X));
            covariance(&anchors, Scale::of(input, &tuning))[(left, right)].sqrt()
        };
        assert!((common(&input) / (0.2 * SPACING / 2.0) - 1.0).abs() < 1e-6);
    }

    /// The anchor that lies furthest in a direction.
    fn outermost(anchors: &[Anchor], along: DVec3) -> usize {
        let reach = |i: &usize| anchors[*i].position.dot(along);
        (0..anchors.len()).max_by(|a, b| reach(a).total_cmp(&reach(b))).expect("a body has a surface")
    }

    /// The components carry all of the prior's variance of what the motion depends on, and are independent.
    #[test]
    fn components_carry_the_variance_of_every_functional() {
        let input = ball();
        let anchors = anchors_of(&input);
        let tuning = ShapeTuning::default();
        let scale = Scale::of(&input, &tuning);
        let (covariance, functionals) = (covariance(&anchors, scale), functionals(&anchors, DVec3::Y, scale));
        let components = components(&anchors, DVec3::Y, scale);
        for k in 0..functionals.ncols() {
            let l = functionals.column(k);
            let prior = (&covariance * l).dot(&l);
            let carried: f64 =
                components.iter().map(|c| c.iter().zip(l.iter()).map(|(c, l)| c * l).sum::<f64>().powi(2)).sum();
            assert!((carried / prior - 1.0).abs() < 0.02, "functional {k}: {carried} of {prior}");
        }
    }

    /// No direction is left that moves the surface by what matters; none beyond the functionals' where nothing does.
    #[test]
    fn what_moves_the_surface_by_as_much_as_matters_is_a_component() {
        let input = ball();
        let anchors = anchors_of(&input);
        let count = |least_displacement_spacings: f64| {
            let most_components = usize::MAX;
            let tuning = ShapeTuning { least_displacement_spacings, most_components, ..ShapeTuning::default() };
            let scale = Scale::of(&input, &tuning);
            let components = components(&anchors, DVec3::Y, scale);
            let left = components.iter().fold(covariance(&anchors, scale), |left, c| left - c * c.transpose());
            let largest_m = (left.symmetric_eigenvalues().max().max(0.0) / anchors.len() as f64).sqrt();
            assert!(largest_m <= least_displacement_spacings * SPACING + 1e-6, "{largest_m}");
            components.len()
        };
        let counts = [0.0, ShapeTuning::default().least_displacement_spacings, 0.05, 1.0].map(count);
        println!("{counts:?} of {} anchors", anchors.len());
        assert!(counts.is_sorted_by(|a, b| a > b) && counts[3] <= 15, "{counts:?}");
    }

    /// Those that move the surface most.
    #[test]
    fn no_more_components_are_sought_than_the_budget_allows() {
        let input = ball();
        let anchors = anchors_of(&input);
        let sought = |most_components: usize| {
            let tuning = ShapeTuning { least_displacement_spacings: 0.0, most_components, ..ShapeTuning::default() };
            components(&anchors, DVec3::Y, Scale::of(&input, &tuning))
        };
        let (few, all) = (sought(20), sought(usize::MAX));
        assert!(few.len() == 20 && all.len() > 20, "{} of {}", few.len(), all.len());
        assert_eq!(few, all[..20]);
    }

    #[test]
    fn growth_is_the_flux_through_the_surface() {
        let input = ball();
        let modes = ShapeModes::new(&input, &ShapeTuning::default(), &SurfaceTuning::default());
        let unit = |k: usize| (0..modes.count()).map(|i| f64::from(u8::from(i == k))).collect::<Vec<_>>();
        // Radius of the ball with the particles' volume.
        let volume = input.positions.len() as f64 * SPACING.powi(3);
        let radius = (volume * 0.75 / std::f64::consts::PI).cbrt();
        for k in 0..modes.count() {
            let outward_displacements = modes.outward_displacements(&unit(k));
            let surface: Vec<f64> =
                outward_displacements.iter().filter(|s| **s != 0.0).map(|s| f64::from(*s)).collect();
            let flux = 3.0 / radius * surface.iter().sum::<f64>() / surface.len() as f64;
            let largest = surface.iter().fold(0.0, |m: f64, s| m.max(s.abs()));
            let mut factors = vec![1.0; input.positions.len()];
            modes.stretch(&mut factors, &unit(k));
            let growth = (factors.iter().sum::<f64>() / factors.len() as f64).ln();
            assert!((growth - flux).abs() < 0.2 * 3.0 / radius * largest, "mode {k}: {growth} against {flux}");
        }
        let mut moved = input.positions.clone();
        modes.displace(&mut moved, &[]);
        assert_eq!(moved, input.positions);
        let mut factors = vec![0.7; moved.len()];
        modes.stretch(&mut factors, &[]);
        assert!(factors.iter().all(|factor| *factor == 0.7));
    }
}
