//! The loss of paper eq. 8: chamfer distance of the surfaces plus L1 of the masks, with its derivative by the
//! particles' positions.

use gic_geometry::Neighbours;
use glam::{DVec3, Vec3};

use crate::Loss;
use crate::forward::drawing::Shown;
use crate::forward::silhouette::{coverage, coverage_backward};
use crate::forward::trajectories::Trajectories;
use crate::observe::mask_view::{MaskView, outline_length, pixel_size};
use crate::observe::video::{ObservedFrame, ObservedVideo};
use crate::solve::surface_residuals::SurfaceComparison;

/// Loss of one frame and d loss / d position, shape [n].
pub(crate) struct FrameLoss {
    pub chamfer_m: f64,
    pub mask_l1: f64,
    /// Sum of |alpha - mask| and of the masks, for a relative figure.
    pub mask_difference: (f64, f64),
    pub gradient: Vec<DVec3>,
}

/// Chamfer distance and mask L1 of one observed frame. The gradient is that for devices as the input says.
pub(crate) fn frame_loss(
    observed: &ObservedFrame,
    comparison: &SurfaceComparison,
    shown: &Shown,
    with_gradient: bool,
) -> FrameLoss {
    let positions = shown.gaussians.positions;
    let mut gradient = if with_gradient { vec![DVec3::ZERO; positions.len()] } else { Vec::new() };
    let chamfer_m = surface_distance_m(observed, comparison, positions, &mut gradient);
    let mut loss = FrameLoss { chamfer_m, mask_l1: 0.0, mask_difference: (0.0, 0.0), gradient };
    let views = observed.views.len().max(1) as f64;
    for view in &observed.views {
        let rendered = drawn(shown, view);
        let share = 1.0 / (rendered.len() as f64 * views);
        let difference = total_difference(&rendered, &view.mask);
        loss.mask_l1 += difference * share;
        loss.mask_difference.0 += difference;
        loss.mask_difference.1 += view.mask.iter().map(|m| f64::from(*m)).sum::<f64>();
        if with_gradient {
            let bar: Vec<f32> = rendered.iter().zip(&view.mask).map(|(a, m)| (a - m).signum() * share as f32).collect();
            coverage_backward(shown.gaussians, &view.camera, &rendered, &bar, &mut loss.gradient);
        }
    }
    loss
}

/// What a view shows of a motion, in [0, 1].
fn drawn(shown: &Shown, view: &MaskView) -> Vec<f32> {
    shown.seen(view.device, &view.camera, coverage)
}

/// Sum of |alpha - mask| [pixels].
fn total_difference(rendered: &[f32], mask: &[f32]) -> f64 {
    rendered.iter().zip(mask).map(|(a, m)| f64::from((a - m).abs())).sum()
}

/// Chamfer distance of one observed frame [m], 0 where no surface is compared. Its derivative is added to `gradient`,
/// shape [n], unless that is empty.
pub(crate) fn surface_distance_m(
    observed: &ObservedFrame,
    comparison: &SurfaceComparison,
    positions: &[[f32; 3]],
    gradient: &mut [DVec3],
) -> f64 {
    let Some(surface) = &observed.surface else { return 0.0 };
    let simulated = comparison.surface_particles(positions, observed.time_s);
    let is_clear = |p: &DVec3| !comparison.in_contact(*p, observed.time_s);
    let wanted: Vec<DVec3> = surface.points.iter().copied().filter(is_clear).collect();
    chamfer(positions, &simulated, &wanted, comparison.margin(), gradient)
}

/// Mean distance of the drawn outlines from the observed ones at the body's distance [m]: the area that differs over
/// the mean length of both, of all views together. 0 where nothing is seen.
pub(crate) fn outline_distance_m(observed: &ObservedFrame, shown: &Shown) -> f64 {
    let positions = shown.gaussians.positions.iter().map(|p| Vec3::from_array(*p).as_dvec3());
    let centre = positions.sum::<DVec3>() / shown.gaussians.positions.len() as f64;
    let (mut area_m2, mut length_m) = (0.0, 0.0);
    for view in &observed.views {
        let Some(pixel_m) = pixel_size(&view.camera, centre) else { continue };
        let rendered = drawn(shown, view);
        area_m2 += total_difference(&rendered, &view.mask) * pixel_m * pixel_m;
        let length = |coverage| outline_length(coverage, view.camera.width, view.camera.height);
        length_m += 0.5 * (length(&rendered) + length(&view.mask)) * pixel_m;
    }
    if length_m > 0.0 { area_m2 / length_m } else { 0.0 }
}

/// Mean unsquared nearest-neighbour distance, both directions added [m].
fn chamfer(positions: &[[f32; 3]], simulated: &[usize], wanted: &[DVec3], cell: f64, gradient: &mut [DVec3]) -> f64 {
    if simulated.is_empty() || wanted.is_empty() {
        return 0.0;
    }
    let point = |i: usize| Vec3::from_array(positions[i]).as_dvec3();
    let points: Vec<DVec3> = simulated.iter().map(|i| point(*i)).collect();
    let (own, other) = (Neighbours::new(&points, cell), Neighbours::new(wanted, cell));
    let mut total = 0.0;
    let mut pull = |i: usize, from: DVec3, share: f64| {
        let offset = point(i) - from;
        let distance = offset.length();
        total += distance * share;
        if !gradient.is_empty() && distance > 1e-9 {
            gradient[i] += offset / distance * share;
        }
    };
    for i in simulated {
        let [(_, k)] = other.nearest::<1>(point(*i));
        pull(*i, wanted[k], 1.0 / simulated.len() as f64);
    }
    for y in wanted {
        let [(_, k)] = own.nearest::<1>(*y);
        pull(simulated[k], *y, 1.0 / wanted.len() as f64);
    }
    total
}

/// Mean loss over the frames of a motion.
pub(crate) fn mean_loss(
    video: &ObservedVideo,
    comparison: &SurfaceComparison,
    opacities: &[f32],
    trajectories: &Trajectories,
) -> Loss {
    let mut loss = Loss::default();
    let (mut distance_m, mut surfaces, mut masks, mut difference, mut covered) = (0.0, 0.0, 0.0f64, 0.0, 0.0f64);
    for (o, observed) in video.frames.iter().enumerate().skip(1) {
        let frame = frame_loss(observed, comparison, &trajectories.shown(o, opacities), false);
        if observed.surface.is_some() {
            distance_m += frame.chamfer_m;
            surfaces += 1.0;
        }
        if !observed.views.is_empty() {
            loss.mask_l1 += frame.mask_l1;
            masks += 1.0;
        }
        difference += frame.mask_difference.0;
        covered += frame.mask_difference.1;
    }
    loss.chamfer_m = (surfaces > 0.0).then(|| distance_m / surfaces);
    loss.mask_l1 /= masks.max(1.0);
    loss.mask_error = difference / covered.max(1e-9);
    loss
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::forward::drawing::Drawing;
    use crate::forward::footprint::IsotropicGaussians;
    use crate::observe::test_camera::test_camera;

    /// Discs of radius r whose centres lie d apart differ by 4 r d, to first order, over an outline of 2 pi r.
    #[test]
    fn a_shifted_discs_outline_is_off_by_the_mean_of_the_shift_along_its_normals() {
        let (spacing, shift) = (0.004f32, 0.012f32);
        let on_ring = |k: i32, i: i32| (i as f32 / (6 * k) as f32 * std::f32::consts::TAU).sin_cos();
        let ring = |k: i32| (0..6 * k).map(move |i| <[f32; 2]>::from(on_ring(k, i)).map(|x| k as f32 * spacing * x));
        let disc: Vec<[f32; 3]> = (1..=30).flat_map(ring).map(|[x, y]| [x, y, 0.0]).collect();
        let shifted: Vec<[f32; 3]> = disc.iter().map(|p| [p[0] + shift, p[1], p[2]]).collect();
        let (opacities, scales) = (vec![0.9; disc.len()], vec![0.6 * spacing; disc.len()]);
        let drawing = Drawing::of_factor(1.0);
        let gaussians =
            |positions| IsotropicGaussians { positions, opacities: &opacities, scales: &scales, factor: 1.0 };
        let camera = test_camera(160, 400.0, DMat3::IDENTITY, DVec3::NEG_Z);
        let view = MaskView::new(0, &camera, &coverage(gaussians(&shifted), &camera), 1);
        let observed = ObservedFrame { simulated_frame: 0, time_s: 0.0, views: vec![view], surface: None };
        let shown = Shown { gaussians: gaussians(&disc), velocities: &[], drawing: &drawing };
        let distance = outline_distance_m(&observed, &shown);
        let expected = f64::from(shift) * std::f64::consts::FRAC_2_PI;
        assert!((distance / expected - 1.0).abs() < 0.05, "{distance} instead of {expected}");
    }
}
