//! Whether pictures, cameras and particles belong together.

use gic_scene::touches_border;

use crate::forward::footprint::IsotropicGaussians;
use crate::forward::silhouette::coverage;
use crate::tuning::VerdictTuning;
use crate::{Input, Target};

/// Cameras whose mask at time 0 is not of the object that the others see; each gets a warning.
pub(crate) fn wrong_cameras(
    input: &Input,
    target: Target,
    tuning: &VerdictTuning,
    warnings: &mut Vec<String>,
) -> Vec<usize> {
    if !target.masks() {
        return Vec::new();
    }
    let positions: Vec<[f32; 3]> = input.positions.iter().map(|p| p.as_vec3().to_array()).collect();
    let (opacities, scales) = (&input.opacities, &input.scales);
    let gaussians = IsotropicGaussians { positions: &positions, opacities, scales, factor: 1.0 };
    let overlaps: Vec<(usize, f64)> = input.observations[0]
        .views
        .iter()
        .map(|view| {
            let rendered = coverage(gaussians, &input.cameras[view.camera]);
            let (mut both, mut either) = (0.0, 0.0);
            for (a, m) in rendered.iter().zip(&view.mask) {
                both += f64::from(a.min(*m));
                either += f64::from(a.max(*m));
            }
            (view.camera, both / f64::max(either, 1e-9))
        })
        .collect();
    let mut sorted: Vec<f64> = overlaps.iter().map(|(_, o)| *o).collect();
    sorted.sort_by(f64::total_cmp);
    let typical = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    if typical < tuning.wrong_overlap {
        if !sorted.is_empty() {
            warnings.push(format!(
                "the particles' outline overlaps the first masks by only {:.0} %: check the reconstruction",
                100.0 * typical
            ));
        }
        return Vec::new();
    }
    let wrong: Vec<(usize, f64)> = overlaps.into_iter().filter(|(_, o)| *o < tuning.wrong_overlap).collect();
    for (camera, overlap) in &wrong {
        warnings.push(format!(
            "camera {camera} is ignored: its first mask overlaps the object by {:.0} %, the others by {:.0} %; \
             it may show another object",
            100.0 * overlap,
            100.0 * typical
        ));
    }
    wrong.into_iter().map(|(camera, _)| camera).collect()
}

/// Warns where the object reaches the border of pictures: what lies outside of them is unknown, not empty, and is not
/// compared.
pub(crate) fn cut_views(input: &Input, target: Target, warnings: &mut Vec<String>) {
    if !target.masks() {
        return;
    }
    let cut: Vec<(usize, usize)> = (input.observations.iter().enumerate())
        .flat_map(|(frame, observation)| observation.views.iter().map(move |view| (frame, view)))
        .filter(|(_, view)| touches_border(&view.mask, input.cameras[view.camera].width))
        .map(|(frame, view)| (frame, view.camera))
        .collect();
    let Some((first, _)) = cut.first() else { return };
    let cameras: std::collections::BTreeSet<String> = cut.iter().map(|(_, camera)| camera.to_string()).collect();
    warnings.push(format!(
        "the object leaves the picture from frame {first} on ({} pictures, cameras {}): \
         what lies outside is not compared",
        cut.len(),
        cameras.into_iter().collect::<Vec<_>>().join(", ")
    ));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observe::test_camera::test_camera;
    use crate::{Observation, View};
    use gic_scene::Camera;
    use glam::{DMat3, DVec3};

    const SIZE: usize = 40;

    /// A cube of particles in front of five equal cameras a little to the side of each other, with the masks that it
    /// draws.
    fn cube() -> Input {
        let grid = |i: usize, step: usize| (i / step % 8) as f64 - 3.5;
        let positions: Vec<DVec3> =
            (0..512).map(|i| DVec3::new(grid(i, 1), grid(i, 8), grid(i, 64)) * 0.02 + DVec3::Z).collect();
        let camera = |k: i32| test_camera(SIZE, 100.0, DMat3::IDENTITY, DVec3::new(0.02 * f64::from(k), 0.0, 0.0));
        let cameras: Vec<Camera> = (0..5).map(camera).collect();
        let opacities = vec![0.95; positions.len()];
        let mut input = Input { opacities, cameras, ..Input::of_body(positions, 0.02) };
        let frame =
            |time_s: f64| Observation { time_s, surface: Vec::new(), surface_doubts: Vec::new(), views: masks(&input) };
        input.observations = vec![frame(0.0), frame(1.0 / 24.0)];
        input
    }

    fn masks(input: &Input) -> Vec<View> {
        let positions: Vec<[f32; 3]> = input.positions.iter().map(|p| p.as_vec3().to_array()).collect();
        let (opacities, scales) = (&input.opacities, &input.scales);
        let gaussians = IsotropicGaussians { positions: &positions, opacities, scales, factor: 1.0 };
        let draw = |camera: &Camera| coverage(gaussians, camera).iter().map(|a| a.clamp(0.0, 1.0)).collect();
        input.cameras.iter().enumerate().map(|(camera, c)| View { camera, mask: draw(c) }).collect()
    }

    fn warned(input: &Input, check: impl Fn(&Input, &mut Vec<String>)) -> Vec<String> {
        let mut warnings = Vec::new();
        check(input, &mut warnings);
        warnings
    }

    #[test]
    fn the_mask_of_another_object_is_ignored_and_named() {
        let mut input = cube();
        let check = |input: &Input, warnings: &mut Vec<String>| {
            let excluded = wrong_cameras(input, Target::Both, &VerdictTuning::default(), warnings);
            assert_eq!(excluded.is_empty(), warnings.is_empty());
        };
        assert_eq!(warned(&input, check), Vec::<String>::new());
        let other = &mut input.observations[0].views[3].mask;
        other.iter_mut().enumerate().for_each(|(i, m)| *m = f32::from(i / SIZE < 12 && i % SIZE < 12));
        assert_eq!(wrong_cameras(&input, Target::Both, &VerdictTuning::default(), &mut Vec::new()), [3]);
        let said = warned(&input, check);
        assert!(said.len() == 1 && said[0].contains("camera 3 is ignored"), "{said:?}");
        // One wrong camera is an outlier; where most are wrong nothing says which.
        for view in &mut input.observations[0].views {
            view.mask.fill(0.0);
        }
        let mut warnings = Vec::new();
        assert!(wrong_cameras(&input, Target::Both, &VerdictTuning::default(), &mut warnings).is_empty());
        assert!(warnings[0].contains("check the reconstruction"), "{warnings:?}");
    }

    #[test]
    fn an_object_that_leaves_the_picture_is_said_to() {
        let mut input = cube();
        let check = |input: &Input, warnings: &mut Vec<String>| cut_views(input, Target::Both, warnings);
        assert_eq!(warned(&input, check), Vec::<String>::new());
        input.observations[1].views[2].mask[5 * SIZE] = 0.9;
        let said = warned(&input, check);
        assert!(said[0].contains("from frame 1 on (1 pictures, cameras 2)"), "{said:?}");
    }
}
