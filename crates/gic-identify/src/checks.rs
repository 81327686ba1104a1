//! Does the input belong together, and does the model explain it?

use crate::loss::frame_loss;
use crate::objective::Motion;
use crate::silhouette::{MaskView, Splats, alpha};
use crate::stages::Job;
use crate::velocity::Launch;
use crate::{Input, Target};

/// Overlap below which a camera's first mask is of something else, provided that most cameras overlap well.
const WRONG_OVERLAP: f64 = 0.5;
const GOOD_OVERLAP: f64 = 0.75;

/// Cameras whose mask at time 0 is not of the object that the others see; each gets a warning.
pub(crate) fn wrong_cameras(input: &Input, target: Target, warnings: &mut Vec<String>) -> Vec<usize> {
    if !target.masks() {
        return Vec::new();
    }
    let positions: Vec<[f32; 3]> = input.positions.iter().map(|p| p.as_vec3().to_array()).collect();
    let splats = Splats { opacities: &input.opacities, scales: &input.scales, factor: 1.0 };
    let overlaps: Vec<(usize, f64)> = input.observations[0]
        .views
        .iter()
        .map(|view| {
            let view = MaskView::new(view.camera, &input.cameras[view.camera], &view.mask, 2);
            let rendered = alpha(&positions, splats, &view.camera);
            let (mut both, mut either) = (0.0, 0.0);
            for (a, m) in rendered.iter().zip(&view.mask) {
                both += f64::from(a.min(*m));
                either += f64::from(a.max(*m));
            }
            (view.camera_index, both / f64::max(either, 1e-9))
        })
        .collect();
    let mut sorted: Vec<f64> = overlaps.iter().map(|(_, o)| *o).collect();
    sorted.sort_by(f64::total_cmp);
    let typical = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    if typical < GOOD_OVERLAP {
        if !sorted.is_empty() {
            warnings.push(format!(
                "the particles' outline overlaps the first masks by only {:.0} %: check the reconstruction",
                100.0 * typical
            ));
        }
        return Vec::new();
    }
    let wrong: Vec<(usize, f64)> = overlaps.into_iter().filter(|(_, o)| *o < WRONG_OVERLAP).collect();
    for (camera, overlap) in &wrong {
        warnings.push(format!(
            "camera {camera} is ignored: its first mask overlaps the object by {:.0} %, the others by {:.0} %; it may show another \
             object",
            100.0 * overlap,
            100.0 * typical
        ));
    }
    wrong.into_iter().map(|(camera, _)| camera).collect()
}

/// Warns where the frames after contact are explained much worse than those before: the material or an obstacle is another.
pub(crate) fn explained(job: &Job, launched: &Launch, motion: &Motion) {
    let misfit: Vec<(f64, f64)> = job
        .data
        .moments
        .iter()
        .enumerate()
        .map(|(o, moment)| {
            let splats = motion.splats(o, &job.input.opacities);
            let loss = frame_loss(moment, &job.context, splats, &motion.positions[o], false);
            (loss.chamfer_m, loss.mask_difference.0 / loss.mask_difference.1.max(1e-9))
        })
        .collect();
    let worst =
        |range: &[(f64, f64)]| range.iter().fold((0.0f64, 0.0f64), |worst, m| (worst.0.max(m.0), worst.1.max(m.1)));
    let (free, touched) = misfit.split_at(launched.free.min(misfit.len()));
    let (before, after) = (worst(free), worst(touched));
    if after.1 > 2.5 * before.1 + 0.06 {
        job.warn(format!(
            "the model does not explain the data: after contact {:.0} % of the object's pixels differ, before it {:.0} %; the \
             material or an obstacle may be another",
            100.0 * after.1,
            100.0 * before.1
        ));
    }
    if after.0 > 2.5 * before.0 + 0.5 * job.input.grid_spacing_m {
        job.warn(format!(
            "the model does not explain the data: after contact the surfaces are {:.1} mm apart, before it {:.1} mm; the material or \
             an obstacle may be another",
            1e3 * after.0,
            1e3 * before.0
        ));
    }
}
