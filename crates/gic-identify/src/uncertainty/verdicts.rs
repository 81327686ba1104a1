//! Whether the model explains the video, and which estimates lie at the edge of what is admitted. Each verdict is a
//! warning.

use crate::forward::trajectories::Trajectories;
use crate::observe::video::{ObservedFrame, ObservedVideo};
use crate::solve::loss::{frame_loss, outline_distance_m};
use crate::solve::surface_residuals::SurfaceComparison;
use crate::unknowns::coordinates::Coordinates;
use crate::unknowns::state::{State, Unknown};

/// Warns where the frames after contact, from the observation `free` on, are explained worse than those before by more
/// than `resolved_m`, the finest that the model resolves: the material, an obstacle or the body's shape is another.
pub(crate) fn unexplained(
    (video, comparison): (&ObservedVideo, &SurfaceComparison),
    (trajectories, opacities): (&Trajectories, &[f32]),
    free: usize,
    resolved_m: f64,
) -> Vec<String> {
    let misfit = |(o, observed): (usize, &ObservedFrame)| {
        let gaussians = trajectories.gaussians(o, opacities);
        let both_ways_m = frame_loss(observed, comparison, gaussians, false).chamfer_m;
        [outline_distance_m(observed, gaussians), 0.5 * both_ways_m]
    };
    let misfits: Vec<_> = video.frames.iter().enumerate().map(misfit).collect();
    let (flying, touched) = misfits.split_at(free.min(misfits.len()));
    let worst_m = |frames: &[[f64; 2]], kind: usize| frames.iter().map(|misfit| misfit[kind]).fold(0.0, f64::max);
    let of_kind = |(kind, name): (usize, &str)| {
        let (before, after) = (worst_m(flying, kind), worst_m(touched, kind));
        (after > before + resolved_m).then(|| {
            format!(
                "the model does not explain the data: after contact the {name} are {:.1} mm apart, before it {:.1} mm, \
                 and the model resolves {:.1} mm; the material or an obstacle may be another",
                1e3 * after,
                1e3 * before,
                1e3 * resolved_m
            )
        })
    };
    ["outlines", "surfaces"].into_iter().enumerate().filter_map(of_kind).collect()
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
