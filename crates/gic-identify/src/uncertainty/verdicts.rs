//! Whether the body is known, whether the model explains the video, and which estimates lie at the edge of what is
//! admitted. Each verdict is a warning.

use crate::forward::trajectories::Trajectories;
use crate::observe::video::{ObservedFrame, ObservedVideo};
use crate::solve::loss::{outline_distance_m, surface_distance_m};
use crate::solve::surface_residuals::SurfaceComparison;
use crate::unknowns::coordinates::Coordinates;
use crate::unknowns::state::{State, Unknown};

/// Warns where pictures tell less of the surface than they leave open: then the intervals, which take a guess for right
/// to within its distance from what is told, cannot be believed, either.
pub(crate) fn guessed(told_share: Option<f64>) -> Option<String> {
    let told = told_share.filter(|told| *told < 1.0 - *told)?;
    Some(format!(
        "no picture tells where {:.0} % of the surface lies, so that the body is a guess and nothing is determined: more \
         cameras, or a body that tumbles, show more of it",
        100.0 * (1.0 - told)
    ))
}

/// Warns where the frames after contact, from the observation `free` on, are explained worse than those before by more
/// than `resolved_m`, the finest that the model resolves: the material, an obstacle or the body's shape is another.
pub(crate) fn unexplained(
    (video, comparison): (&ObservedVideo, &SurfaceComparison),
    (trajectories, opacities): (&Trajectories, &[f32]),
    free: usize,
    resolved_m: f64,
) -> Vec<String> {
    let of_frames = |distance_m: &dyn Fn(usize, &ObservedFrame) -> f64| -> Vec<f64> {
        video.frames.iter().enumerate().map(|(o, observed)| distance_m(o, observed)).collect()
    };
    let outlines_m = of_frames(&|o, observed| outline_distance_m(observed, &trajectories.shown(o, opacities)));
    let surfaces_m = of_frames(&|o, observed| {
        let positions = trajectories.gaussians(o, opacities).positions;
        // The mean of both directions, which the chamfer distance adds.
        0.5 * surface_distance_m(observed, comparison, positions, &mut [])
    });
    let worst_mm = |frames_m: &[f64]| 1e3 * frames_m.iter().copied().fold(0.0, f64::max);
    let unexplained = |name: &str, frames_m: Vec<f64>| {
        let (flying_m, touched_m) = frames_m.split_at(free.min(frames_m.len()));
        let (before, after, resolved) = (worst_mm(flying_m), worst_mm(touched_m), 1e3 * resolved_m);
        (after > before + resolved).then(|| {
            format!(
                "the model does not explain the data: after contact the {name} are {after:.1} mm apart, before it \
                 {before:.1} mm, and the model resolves {resolved:.1} mm; the material or an obstacle may be another"
            )
        })
    };
    let warnings = [unexplained("outlines", outlines_m), unexplained("surfaces", surfaces_m)];
    warnings.into_iter().flatten().collect()
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

#[cfg(test)]
mod tests {
    use super::guessed;

    #[test]
    fn a_body_that_is_mostly_a_guess_determines_nothing() {
        let warning = guessed(Some(0.36)).expect("less than half is told");
        assert!(warning.contains("64 %"), "{warning}");
        assert_eq!((guessed(Some(0.5)), guessed(None)), (None, None));
    }
}
