//! What filling starts from: the video with its Gaussians, or the registered scan.

use std::borrow::Cow;

use gic_appearance::place_scan;
use gic_continuum::MaskedView;
use gic_motion::DynamicGaussians;
use gic_scene::{Camera, Mask, Scene};
use glam::DVec3;

use super::Run;
use crate::error::{Error, Result};

/// What the matter is made of: the video with its Gaussians, or the scan, moved to where it lies in the video's first
/// frame.
pub(super) struct FillInput<'a> {
    pub(super) scene: Cow<'a, Scene>,
    pub(super) gaussians: DynamicGaussians,
    /// The camera of each of the scene's views, as it would have seen the body at the frame's time.
    cameras: Vec<Camera>,
}

impl<'a> FillInput<'a> {
    fn new(scene: Cow<'a, Scene>, gaussians: DynamicGaussians) -> Self {
        let cameras = scene.views.iter().map(|view| scene.camera_at_frame(view).into_owned()).collect();
        Self { scene, gaussians, cameras }
    }

    /// The cameras of a frame, in the order of its views.
    pub(super) fn cameras(&self, frame: usize) -> &[Camera] {
        let start = self.scene.views.partition_point(|view| view.frame < frame);
        &self.cameras[start..start + self.scene.views_at(frame).len()]
    }

    /// Leading frames whose views all show the body at one time.
    pub(super) fn frames(&self) -> usize {
        (0..self.scene.times.len()).take_while(|frame| self.scene.is_seen_at_once(*frame)).count()
    }

    /// The masks of a frame, in the order of its views.
    pub(super) fn masks(&self, frame: usize) -> Result<Vec<Mask>> {
        self.scene.load_masks(self.scene.views_at(frame)).map_err(Error::stage("reading masks"))
    }

    /// What the flight shows of the body as it is in the first frame: cameras that see it so, and their masks, where
    /// these are not empty. Of all its frames the last but one differs most from the first and surely touches nothing.
    pub(super) fn late_in_flight(&self) -> Result<Vec<(Camera, Mask)>> {
        let Some(flight) = self.scene.flight.as_ref().filter(|flight| flight.frames() > 2) else {
            return Ok(Vec::new());
        };
        let frame = flight.frames() - 2;
        let cameras = self.cameras(frame).iter().map(|camera| flight.camera_at_start(camera, flight.times[frame]));
        Ok(cameras.zip(self.masks(frame)?).filter(|(_, mask)| mask.area() > 0.0).collect())
    }

    /// Cameras and masks of a frame.
    pub(super) fn masked_views<'b>(
        &'b self,
        frame: usize,
        masks: impl IntoIterator<Item = &'b Mask>,
    ) -> Vec<MaskedView<'b>> {
        let coverage = |mask: &'b Mask| (mask.area() > 0.0).then_some(mask.coverage.as_slice());
        let views = self.cameras(frame).iter().zip(masks);
        views.map(|(camera, mask)| MaskedView { camera, mask: coverage(mask) }).collect()
    }
}

impl Run<'_> {
    /// Photographs of the object at rest, where the scene has them: its shape comes from them, and the video only tells
    /// of motion.
    pub(super) fn scan(&self) -> Option<&Scene> {
        self.video.rest.as_deref()
    }

    pub(super) fn fill_input(&self) -> Result<FillInput<'_>> {
        let gaussians = self.gaussians()?;
        let Some(scan) = self.scan() else { return Ok(FillInput::new(Cow::Borrowed(&self.scene), gaussians)) };
        let similarity = self.registration()?.best.similarity();
        let canonical = place_scan(&gaussians.canonical, &similarity);
        let gaussians = DynamicGaussians { canonical, motion: None };
        let scene = scan.moved(&similarity);
        let cameras =
            far_apart(&scene.cameras, &gaussians.canonical.positions, self.config.fill.tuning.depth.scan_photographs);
        let scene = scene.with_cameras(&cameras).map_err(Error::stage("choosing photographs"))?;
        Ok(FillInput::new(Cow::Owned(scene), gaussians))
    }
}

/// Mean of points [m].
pub(super) fn mean(points: &[[f32; 3]]) -> DVec3 {
    let sum: DVec3 = points.iter().map(|p| DVec3::from_array(p.map(f64::from))).sum();
    sum / points.len() as f64
}

/// Of `cameras`, `count` whose directions from the mean of `points` are far apart: each the farthest from those before.
fn far_apart(cameras: &[Camera], points: &[[f32; 3]], count: usize) -> Vec<usize> {
    let centre = mean(points);
    let directions: Vec<DVec3> = cameras.iter().map(|camera| (camera.centre - centre).normalize_or_zero()).collect();
    let mut chosen: Vec<usize> = Vec::new();
    // Cosine to the nearest chosen direction.
    let mut nearest = vec![-1.0f64; cameras.len()];
    while chosen.len() < count.min(cameras.len()) {
        let free = (0..cameras.len()).filter(|i| !chosen.contains(i));
        let Some(next) = free.min_by(|&a, &b| nearest[a].total_cmp(&nearest[b])) else { break };
        chosen.push(next);
        for (near, direction) in nearest.iter_mut().zip(&directions) {
            *near = near.max(direction.dot(directions[next]));
        }
    }
    chosen.sort_unstable();
    chosen
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec2};

    use super::*;

    #[test]
    fn chosen_cameras_are_far_apart() {
        // Around the point (1, 0, 0): eight close together, and one each in five other directions.
        let mut centres: Vec<DVec3> = (0..8).map(|i| DVec3::new(1.0, 0.01 * f64::from(i), 2.0)).collect();
        centres.extend([
            DVec3::X * 4.0,
            DVec3::X * -3.0,
            DVec3::new(1.0, 5.0, 0.0),
            DVec3::new(1.0, -2.0, 0.0),
            DVec3::new(1.0, 0.0, -1.0),
        ]);
        let camera = |centre: DVec3| Camera {
            width: 4,
            height: 4,
            focal: DVec2::ONE,
            principal: DVec2::ONE,
            world_from_camera: DMat3::IDENTITY,
            centre,
        };
        let cameras: Vec<Camera> = centres.into_iter().map(camera).collect();
        let points = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        assert_eq!(far_apart(&cameras, &points, 6), [0, 8, 9, 10, 11, 12]);
        assert_eq!(far_apart(&cameras, &points, 99).len(), 13);
    }
}
