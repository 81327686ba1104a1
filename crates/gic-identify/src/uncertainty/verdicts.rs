//! Whether the model explains the video, and which estimates lie at the edge of what is admitted. Each verdict is a
//! warning.

use crate::forward::trajectories::Trajectories;
use crate::observe::video::ObservedVideo;
use crate::solve::loss::frame_loss;
use crate::solve::surface_residuals::SurfaceComparison;
use crate::tuning::VerdictTuning;
use crate::unknowns::coordinates::Coordinates;
use crate::unknowns::state::{State, Unknown};

/// Warns where the frames after contact, from the observation `free` on, are explained much worse than those before:
/// the material, an obstacle or the body's shape is another. Surfaces may differ by `nearly_m` besides.
pub(crate) fn unexplained(
    (video, comparison): (&ObservedVideo, &SurfaceComparison),
    (trajectories, opacities): (&Trajectories, &[f32]),
    free: usize,
    nearly_m: f64,
    tuning: &VerdictTuning,
) -> Vec<String> {
    let misfit: Vec<(f64, f64)> = video
        .frames
        .iter()
        .enumerate()
        .map(|(o, observed)| {
            let loss = frame_loss(observed, comparison, trajectories.gaussians(o, opacities), false);
            (loss.chamfer_m, loss.mask_difference.0 / loss.mask_difference.1.max(1e-9))
        })
        .collect();
    let worst =
        |range: &[(f64, f64)]| range.iter().fold((0.0f64, 0.0f64), |worst, m| (worst.0.max(m.0), worst.1.max(m.1)));
    let (flying, touched) = misfit.split_at(free.min(misfit.len()));
    let (before, after) = (worst(flying), worst(touched));
    let unexplained = |what: String| {
        format!("the model does not explain the data: after contact {what}; the material or an obstacle may be another")
    };
    let mut warnings = Vec::new();
    let masks_explained = after.1 <= tuning.most_misfit_ratio * before.1 + tuning.mask_misfit;
    if !masks_explained {
        let (after, before) = (100.0 * after.1, 100.0 * before.1);
        warnings.push(unexplained(format!("{after:.0} % of the object's pixels differ, before it {before:.0} %")));
    }
    let surfaces_explained = after.0 <= tuning.most_misfit_ratio * before.0 + nearly_m;
    if !surfaces_explained {
        let (after, before) = (1e3 * after.0, 1e3 * before.0);
        warnings.push(unexplained(format!("the surfaces are {after:.1} mm apart, before it {before:.1} mm")));
    }
    warnings
}

/// Warns of parameters that were found at the edge of what is admitted: a soft solid taken for a fluid, say, ends as
/// one that cannot be squeezed.
pub(crate) fn at_limits(coordinates: &Coordinates, unknowns: &[Unknown], state: &State) -> Vec<String> {
    let at_limit = unknowns.iter().filter_map(|unknown| match *unknown {
        Unknown::Material(i) => {
            let (parameter, at) = (&coordinates.parameters[i], state.material[i]);
            coordinates.is_at_limit(i, at).then_some((parameter, at))
        }
        _ => None,
    });
    at_limit
        .map(|(parameter, coordinate)| {
            format!(
                "{} ends at {:.4e}, the edge of its range: \
                 either the video does not determine it, or the material or an obstacle is another",
                parameter.name,
                parameter.value(coordinate)
            )
        })
        .collect()
}
