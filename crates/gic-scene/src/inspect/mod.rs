//! What `gic inspect` reports: everything that was read, whether cameras and masks agree, and a contact sheet.

mod disagreement;
mod flight;
mod ground;
mod text;

use std::borrow::Cow;
use std::path::PathBuf;

use rayon::prelude::*;
use serde::Serialize;

use self::disagreement::diagnose;
use self::flight::flight_report;
pub use self::flight::{CalibrationErrorReport, FallReport, FlightReport};
pub use self::ground::GroundSource;
use self::ground::{find_ground, guessed_up};
use crate::camera::Camera;
use crate::error::{Problem, SceneError};
use crate::flight::Seek;
use crate::hull::{Hull, HullSettings, HullView};
use crate::picture::{Mask, Picture};
use crate::scene::Scene;
use crate::sheet;
use crate::view::{MaskSource, Split};

/// Most views of a static scene or moving camera to carve with.
const MAX_HULL_VIEWS: usize = 40;
const HULL_SETTINGS: HullSettings = HullSettings { resolution: 96, tolerated_misses: 0 };
const COARSE_HULL_SETTINGS: HullSettings = HullSettings { resolution: 48, tolerated_misses: 0 };

/// Everything worth knowing about a scene before working with it. Lengths in metres where [`Inspection::metric`] says
/// so.
#[derive(Clone, Debug, Serialize)]
pub struct Inspection {
    /// The folder.
    pub root: PathBuf,
    /// The format, in words.
    pub format: String,
    /// Whether lengths are metres.
    pub metric: bool,
    /// Number of cameras.
    pub camera_count: usize,
    /// Number of pictures.
    pub view_count: usize,
    /// Number of distinct times.
    pub frame_count: usize,
    /// Time of the first and last frame [s].
    pub time_range_s: [f64; 2],
    /// Frames per second, where evenly spaced.
    pub frame_rate_hz: Option<f64>,
    /// Number of pictures for training, validation and testing.
    pub split_counts: [usize; 3],
    /// Where the masks come from, in words, with counts.
    pub mask_sources: Vec<(String, usize)>,
    /// Each camera; for moving cameras, each picture.
    pub cameras: Vec<CameraReport>,
    /// The visual hull; `None` when no point of space projects into all masks.
    pub hull: Option<HullReport>,
    /// The unit vector that points up, and whether it is a guess.
    pub up: Option<([f64; 3], GroundSource)>,
    /// The ground: a point [m], the unit normal, and where this comes from.
    pub ground: Option<([f64; 3], [f64; 3], GroundSource)>,
    /// The motion of the first frames in which the object keeps its shape; `None` where its outlines show none.
    pub flight: Option<FlightReport>,
    /// What the free fall says of lengths and times; `None` where nothing is seen to fall.
    pub fall: Option<FallReport>,
    /// Number of photographs of the object at rest, in a world frame of their own.
    pub rest_views: usize,
    /// Everything that looks wrong, worst first.
    pub warnings: Vec<String>,
    /// Small pictures of cameras (rows) at frames (columns) with the masks' outlines.
    #[serde(skip)]
    pub contact_sheet: Picture,
}

/// What was read of one camera.
#[derive(Clone, Debug, Serialize)]
pub struct CameraReport {
    /// The camera's name.
    pub name: String,
    /// Width and height of its pictures in pixels.
    pub size: [usize; 2],
    /// Number of pictures.
    pub views: usize,
    /// Mean fraction of the picture that the mask covers.
    pub coverage: f64,
    /// Overlap of the hull's silhouette with the mask; `None` where the hull was carved without this camera.
    pub reprojection_iou: Option<f64>,
}

/// The visual hull at the first frame.
#[derive(Clone, Debug, Serialize)]
pub struct HullReport {
    /// Lower corner of the bounding box [m].
    pub low_m: [f64; 3],
    /// Upper corner of the bounding box [m].
    pub high_m: [f64; 3],
    /// Sides of the bounding box [m].
    pub size_m: [f64; 3],
    /// Volume [m^3]; never less than the object's.
    pub volume_m3: f64,
    /// Mean overlap of the silhouettes with the masks.
    pub mean_iou: f64,
}

/// What is kept of a view after its pixels were read.
struct ViewCheck {
    area: Result<f64, SceneError>,
    mask: Option<Mask>,
    tile: Option<Picture>,
}

/// Reads every picture and mask of a scene once, and reports.
///
/// # Errors
/// [`SceneError::Invalid`] lists files that cannot be decoded and frames without any mask; empty masks of single views
/// become warnings.
pub fn inspect(scene: &Scene) -> Result<Inspection, SceneError> {
    let corrected = scene.corrected(None, scene.times.len(), Seek { delays: true, errors: true });
    // Where a mask cannot be read, all that cannot are listed below.
    let scene = corrected.as_ref().unwrap_or(scene);
    let layout = sheet::layout(scene);
    let (hull_views, moving) = choose_hull_views(scene);
    let ground_frames = if moving { Vec::new() } else { sheet::evenly_spaced(scene.times.len(), 3) };
    let on_sheet: Vec<usize> = layout.iter().flatten().flatten().copied().collect();
    let checked: Vec<ViewCheck> = (0..scene.views.len())
        .into_par_iter()
        .map(|index| {
            let keep = hull_views.contains(&index) || ground_frames.contains(&scene.views[index].frame);
            check_view(scene, index, on_sheet.contains(&index), keep)
        })
        .collect();
    let (areas, (masks, tiles)): (Vec<_>, (Vec<_>, Vec<_>)) =
        checked.into_iter().map(|view| (view.area, (view.mask, view.tile))).unzip();
    let problems = scene.mask_area_problems(&areas);
    if problems.iter().any(|problem| problem.severity() == crate::Severity::Error) {
        return Err(SceneError::Invalid(problems));
    }
    let mut warnings: Vec<String> = Vec::new();

    let seen: Vec<(Cow<Camera>, &Mask)> = hull_views
        .iter()
        .filter_map(|&index| {
            let mask = masks[index].as_ref().filter(|mask| mask.bounding_box().is_some())?;
            Some((scene.camera_at_frame(&scene.views[index]), mask))
        })
        .collect();
    let views: Vec<HullView> = seen.iter().map(|(camera, mask)| HullView { camera, mask }).collect();
    // The object moves between the pictures of a moving camera: let a tenth of them disagree.
    let settings =
        if moving { HullSettings { tolerated_misses: views.len() / 10, ..HULL_SETTINGS } } else { HULL_SETTINGS };
    let hull = Hull::carve(&views, &settings);
    let overlaps: Vec<f64> = match &hull {
        Some(hull) => views.par_iter().map(|view| hull.reprojection_iou(view)).collect(),
        None => vec![0.0; views.len()],
    };
    if !moving {
        let names: Vec<&str> =
            hull_views.iter().map(|&index| scene.camera_names[scene.views[index].camera].as_str()).collect();
        warnings.extend(diagnose(&views, &names, &overlaps));
    }
    let cameras = camera_reports(scene, &areas, &hull_views, &overlaps);
    let full: Vec<&str> =
        cameras.iter().filter(|camera| camera.coverage > 0.98).map(|camera| camera.name.as_str()).collect();
    if !full.is_empty() {
        warnings.push(format!(
            "the masks of {} of {} cameras cover whole pictures ({}): an alpha channel that is opaque \
             everywhere is no mask",
            full.len(),
            cameras.len(),
            full[..full.len().min(5)].join(", ")
        ));
    }
    let up = scene.world.up.map(|up| (up, GroundSource::Format)).or_else(|| guessed_up(scene));
    let fall = scene.flight.as_ref().zip(up).and_then(|(flight, (up, _))| FallReport::of(scene, flight, up));
    let ground = find_ground(scene, &masks, &ground_frames, hull.as_ref(), up, &mut warnings);
    let flight = scene.flight.as_ref().map(|flight| flight_report(scene, flight));
    warnings.extend(flight.iter().flat_map(|flight| flight.corrections(&scene.camera_names)));
    warnings.extend(scene.warnings.iter().chain(&problems).map(Problem::to_string));

    let place = |view: &Option<usize>| view.and_then(|view| tiles[view].clone());
    let rows: Vec<Vec<Option<Picture>>> = layout.iter().map(|row| row.iter().map(place).collect()).collect();

    Ok(Inspection {
        root: scene.root.clone(),
        format: scene.format.to_string(),
        metric: scene.world.metric,
        camera_count: scene.cameras.len(),
        view_count: scene.views.len(),
        frame_count: scene.times.len(),
        time_range_s: [scene.times[0], scene.times[scene.times.len() - 1]],
        frame_rate_hz: scene.frame_rate,
        split_counts: [Split::Train, Split::Validation, Split::Test]
            .map(|split| scene.views.iter().filter(|view| view.split == split).count()),
        mask_sources: count_sources(scene),
        cameras,
        hull: hull.as_ref().map(|hull| hull_report(hull, &overlaps)),
        up: up.map(|(up, source)| (up.to_array(), source)),
        ground,
        fall,
        flight,
        rest_views: scene.rest.as_ref().map_or(0, |rest| rest.views.len()),
        warnings,
        contact_sheet: sheet::assemble(&rows),
    })
}

fn check_view(scene: &Scene, index: usize, on_sheet: bool, keep: bool) -> ViewCheck {
    match scene.load(&scene.views[index]) {
        Ok((picture, mask)) => ViewCheck {
            area: Ok(mask.area()),
            tile: on_sheet.then(|| sheet::tile(&picture, &mask)),
            mask: keep.then_some(mask),
        },
        Err(error) => ViewCheck { area: Err(error), mask: None, tile: None },
    }
}

/// Indices of the views to carve with, and whether they show a moving object at different times.
fn choose_hull_views(scene: &Scene) -> (Vec<usize>, bool) {
    if scene.has_fixed_cameras() {
        return ((0..scene.views_at(0).len()).collect(), false);
    }
    (sheet::evenly_spaced(scene.views.len(), MAX_HULL_VIEWS), !scene.is_static())
}

fn hull_report(hull: &Hull, overlaps: &[f64]) -> HullReport {
    let (low, high) = hull.bounds();
    HullReport {
        low_m: low.to_array(),
        high_m: high.to_array(),
        size_m: (high - low).to_array(),
        volume_m3: hull.volume(),
        mean_iou: mean(overlaps),
    }
}

fn camera_reports(
    scene: &Scene,
    areas: &[Result<f64, SceneError>],
    hull_views: &[usize],
    overlaps: &[f64],
) -> Vec<CameraReport> {
    let mut reports: Vec<CameraReport> = scene
        .cameras
        .iter()
        .zip(&scene.camera_names)
        .map(|(camera, name)| CameraReport {
            name: name.clone(),
            size: [camera.width, camera.height],
            views: 0,
            coverage: 0.0,
            reprojection_iou: None,
        })
        .collect();
    for (view, area) in scene.views.iter().zip(areas) {
        let report = &mut reports[view.camera];
        report.views += 1;
        report.coverage += area.as_ref().map_or(0.0, |area| area / (report.size[0] * report.size[1]) as f64);
    }
    for report in &mut reports {
        report.coverage /= report.views.max(1) as f64;
    }
    // Views with empty masks take no part in carving.
    let carved = hull_views.iter().filter(|&&index| areas[index].as_ref().is_ok_and(|&area| area > 0.0));
    for (&index, &overlap) in carved.zip(overlaps) {
        reports[scene.views[index].camera].reprojection_iou = Some(overlap);
    }
    reports
}

fn count_sources(scene: &Scene) -> Vec<(String, usize)> {
    let kind = |mask: &MaskSource| match mask {
        MaskSource::Alpha => 0,
        MaskSource::File(_) => 1,
        MaskSource::OverWhite(_) => 2,
        MaskSource::Difference => 3,
        MaskSource::Network => 4,
    };
    let words = [
        "alpha channel",
        "mask file",
        "picture over white",
        "made from the empty background",
        "made by the matting network",
    ];
    let counts = words
        .iter()
        .enumerate()
        .map(|(i, word)| ((*word).to_owned(), scene.views.iter().filter(|view| kind(&view.mask) == i).count()));
    counts.filter(|(_, count)| *count > 0).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}
