//! What `gic inspect` reports: everything that was read, whether cameras and masks agree, and a contact sheet.

use std::borrow::Cow;
use std::fmt;
use std::path::PathBuf;

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use serde::Serialize;

use crate::camera::Camera;
use crate::error::{Problem, SceneError};
use crate::flight::{CalibrationError, FreeFlight, Seek};
use crate::hull::{Hull, HullSettings, HullView};
use crate::picture::{Mask, Picture};
use crate::scene::Scene;
use crate::sheet;
use crate::view::{MaskSource, Split};

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

/// The motion of the object before it touches anything, by its outlines alone.
#[derive(Clone, Debug, Serialize)]
pub struct FlightReport {
    /// Number of frames.
    pub frames: usize,
    /// Velocity at the first of them [m/s].
    pub velocity_m_s: [f64; 3],
    /// Acceleration [m/s^2]: gravity, if lengths are metres and the frame rate is right.
    pub acceleration_m_s2: [f64; 3],
    /// Angular velocity [rad/s].
    pub angular_velocity_rad_s: [f64; 3],
    /// By how much the pictures of each camera are later than those of the first one [frames]; empty where the scene's
    /// times explain the outlines.
    pub delays_frames: Vec<f64>,
    /// What is wrong with the calibration of each camera; empty where the stated one explains the outlines.
    pub calibration_errors: Vec<CalibrationErrorReport>,
    /// How far outlines are from touching common tangents, root mean square in pixels.
    pub miss_px: f64,
}

/// By what a camera differs from what the scene states, each with its standard deviation.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct CalibrationErrorReport {
    /// Angle by which it is turned [degrees].
    pub turn_deg: [f64; 2],
    /// Distance by which it is moved [m].
    pub shift_m: [f64; 2],
    /// By how much its focal length is longer [per cent].
    pub focal_percent: [f64; 2],
    /// Coefficient of radial distortion that remained.
    pub radial: [f64; 2],
}

impl CalibrationErrorReport {
    fn new((error, deviation): (&CalibrationError, &CalibrationError)) -> CalibrationErrorReport {
        let degrees = |turn: DVec3| turn.length().to_degrees();
        CalibrationErrorReport {
            turn_deg: [degrees(error.turn_rad), degrees(deviation.turn_rad)],
            shift_m: [error.shift_m.length(), deviation.shift_m.length()],
            focal_percent: [error.focal, deviation.focal].map(|share| 100.0 * share),
            radial: [error.radial, deviation.radial],
        }
    }
}

impl fmt::Display for CalibrationErrorReport {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let [turn, shift, focal, radial] = [self.turn_deg, self.shift_m, self.focal_percent, self.radial];
        write!(
            f,
            "turned by {:.2} +- {:.2} degrees, moved by {:.1} +- {:.1} mm, ",
            turn[0],
            turn[1],
            1e3 * shift[0],
            1e3 * shift[1]
        )?;
        write!(
            f,
            "focal length {:+.2} +- {:.2} %, distortion {:+.3} +- {:.3}",
            focal[0], focal[1], radial[0], radial[1]
        )
    }
}

/// Of the unit of length, the frame rate and gravity, each one by the other two: `|a| = g rate^2 / (unit rate_0^2)`.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct FallReport {
    /// Gravity [m/s^2] that the others are measured with.
    pub gravity_m_s2: f64,
    /// Length of the scene's unit [m] at the stated frame rate.
    pub unit_m: f64,
    /// Frames a second where the scene's unit is a metre; `None` of frames that are not evenly spaced.
    pub frame_rate_hz: Option<f64>,
}

impl FallReport {
    /// `None` of a body that does not fall: whose acceleration is not a tenth of what gravity would be if lengths were
    /// metres, nor the way that things fall.
    fn of(scene: &Scene, flight: &FreeFlight, up: DVec3) -> Option<FallReport> {
        let gravity_m_s2 = scene.world.gravity.map_or(STANDARD_GRAVITY_M_S2, DVec3::length);
        let falls = -flight.acceleration.dot(up);
        let unit_m = gravity_m_s2 / falls;
        let is_fall = falls > 0.9 * flight.acceleration.length() && unit_m < MOST_UNIT_M;
        is_fall.then(|| FallReport {
            gravity_m_s2,
            unit_m,
            frame_rate_hz: scene.frame_rate.map(|rate| rate * unit_m.sqrt()),
        })
    }
}

impl FlightReport {
    /// The cameras that do not take their pictures at the times of the first one.
    fn lags(&self) -> Option<String> {
        let lag = |(camera, delay): (usize, &f64)| format!("{camera} by {delay:+.2} frames");
        let late = self.delays_frames.iter().enumerate().filter(|(_, delay)| **delay != 0.0);
        let lags: Vec<String> = late.map(lag).collect();
        (!lags.is_empty()).then(|| format!("cameras lag behind the first one: {}", lags.join(", ")))
    }

    /// The cameras that are not as the scene states.
    fn errors(&self, names: &[String]) -> Vec<String> {
        let error =
            |(name, error): (&String, &CalibrationErrorReport)| format!("camera {name} is not as stated: {error}");
        names.iter().zip(&self.calibration_errors).map(error).collect()
    }

    /// What the flight shows to be otherwise than the scene states, a sentence each; `names` are the cameras'.
    fn corrections(&self, names: &[String]) -> Vec<String> {
        let mut found: Vec<String> = self.lags().into_iter().chain(self.errors(names)).collect();
        if !found.is_empty() {
            found.push(format!("with that, outlines of the flight agree to {:.2} pixels", self.miss_px));
        }
        found
    }
}

/// Where knowledge about up and the ground comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GroundSource {
    /// The format fixes it.
    Format,
    /// A guess: the cameras' mean up, the lowest point of the hull over the frames.
    Guess,
}

/// Gravity where the scene does not state any [m/s^2].
const STANDARD_GRAVITY_M_S2: f64 = 9.8;
/// A scene whose unit would be longer than this shows something that rolls or floats, not a fall [m].
const MOST_UNIT_M: f64 = 10.0;
/// Most views of a static scene or moving camera to carve with.
const MAX_HULL_VIEWS: usize = 40;
/// Below this overlap of silhouette and mask a camera is looked into.
const MIN_GOOD_IOU: f64 = 0.9;
const HULL_SETTINGS: HullSettings = HullSettings { resolution: 96, tolerated_misses: 0 };
const COARSE_HULL_SETTINGS: HullSettings = HullSettings { resolution: 48, tolerated_misses: 0 };

impl Scene {
    /// What the free flight showed to be otherwise than the scene states, a sentence each; empty where nothing is.
    pub fn corrections(&self) -> Vec<String> {
        self.flight.iter().flat_map(|flight| flight_report(self, flight).corrections(&self.camera_names)).collect()
    }
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

fn flight_report(scene: &Scene, flight: &FreeFlight) -> FlightReport {
    FlightReport {
        frames: flight.frames(),
        velocity_m_s: flight.velocity.to_array(),
        acceleration_m_s2: flight.acceleration.to_array(),
        angular_velocity_rad_s: flight.angular_velocity.to_array(),
        delays_frames: scene.delays_s.iter().map(|delay| delay / flight.frame_seconds()).collect(),
        calibration_errors: (scene.calibration_errors.iter().zip(&scene.calibration_error_deviations))
            .map(CalibrationErrorReport::new)
            .collect(),
        miss_px: flight.miss_px,
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

/// The mean of the cameras' up directions, for people hold cameras upright; where the object falls about that way, the
/// way against its fall.
fn guessed_up(scene: &Scene) -> Option<(DVec3, GroundSource)> {
    let sum: DVec3 = scene.cameras.iter().map(|camera| -camera.world_from_camera.y_axis).sum();
    let upright = sum.try_normalize()?;
    let against_fall = scene.flight.as_ref().and_then(|flight| (-flight.acceleration).try_normalize());
    let up = against_fall.filter(|up| up.dot(upright) > std::f64::consts::FRAC_1_SQRT_2).unwrap_or(upright);
    Some((up, GroundSource::Guess))
}

type Ground = ([f64; 3], [f64; 3], GroundSource);

/// The format's ground, checked against the hull, or a guess: the lowest the object gets.
fn find_ground(
    scene: &Scene,
    masks: &[Option<Mask>],
    frames: &[usize],
    first: Option<&Hull>,
    up: Option<(DVec3, GroundSource)>,
    warnings: &mut Vec<String>,
) -> Option<Ground> {
    let (up, _) = up?;
    let first = first?;
    if let Some(ground) = scene.world.ground {
        let (low, high) = first.bounds();
        let size = (high - low).max_element();
        let depth = -first.surface().iter().map(|point| ground.height(point.position)).fold(f64::INFINITY, f64::min);
        if depth > 0.1 * size {
            warnings.push(format!(
                "the object starts {depth:.3} m below the ground plane: check the ground, or the unit of length"
            ));
        }
        return Some((ground.point.to_array(), ground.normal.to_array(), GroundSource::Format));
    }
    let mut lowest = f64::INFINITY;
    for &frame in frames {
        let start = scene.views.partition_point(|view| view.frame < frame);
        let seen: Vec<(Cow<Camera>, &Mask)> = scene
            .views_at(frame)
            .iter()
            .enumerate()
            .filter_map(|(offset, view)| {
                let mask = masks[start + offset].as_ref().filter(|mask| mask.bounding_box().is_some())?;
                Some((scene.camera_at_frame(view), mask))
            })
            .collect();
        let views: Vec<HullView> = seen.iter().map(|(camera, mask)| HullView { camera, mask }).collect();
        let hull = if frame == 0 { Some(first.clone()) } else { Hull::carve(&views, &COARSE_HULL_SETTINGS) };
        let heights = hull.iter().flat_map(Hull::points).map(|x| up.dot(x)).fold(f64::INFINITY, f64::min);
        lowest = lowest.min(heights);
    }
    let (low, high) = first.bounds();
    let middle = (low + high) / 2.0;
    let point = middle + up * (lowest - up.dot(middle));
    lowest.is_finite().then(|| (point.to_array(), up.to_array(), GroundSource::Guess))
}

/// What undoes a common mistake in reading a camera.
type Repair = fn(&Camera) -> Camera;

/// Warnings about cameras that do not agree: all of them flipped in one way, one of them wrong, one mask too large.
fn diagnose(views: &[HullView], names: &[&str], overlaps: &[f64]) -> Vec<String> {
    let worst = overlaps.iter().copied().fold(1.0, f64::min);
    if worst >= MIN_GOOD_IOU || views.len() < 2 {
        return Vec::new();
    }
    let now = mean(overlaps);
    // All cameras misread in one way?
    let mistakes: [(&str, Repair); 3] = [
        ("negate the 2nd and 3rd column of the camera-to-world matrices (OpenGL against OpenCV axes)", flip_yz),
        ("the matrices are world-to-camera: invert them", invert),
        ("the pictures are upside down, or the 2nd column of the matrices is negated", flip_y),
    ];
    let tried = mistakes.map(|(advice, repair)| {
        let cameras: Vec<Camera> = views.iter().map(|view| repair(view.camera)).collect();
        let repaired: Vec<HullView> =
            cameras.iter().zip(views).map(|(camera, view)| HullView { camera, mask: view.mask }).collect();
        (mean_overlap(&repaired), advice)
    });
    let best = tried.into_iter().fold((0.0, ""), |best, tried| if tried.0 > best.0 { tried } else { best });
    if best.0 > MIN_GOOD_IOU - 0.05 && best.0 > now + 0.05 {
        return vec![format!(
            "the cameras' axes look flipped: silhouettes and masks overlap by {now:.2}, but by {:.2} after \
             this change: {}",
            best.0, best.1
        )];
    }
    // One camera wrong? Without it, the others agree.
    if views.len() >= 4 {
        let without: Vec<f64> = (0..views.len())
            .into_par_iter()
            .map(|index| {
                let others: Vec<HullView> =
                    views.iter().enumerate().filter(|(i, _)| *i != index).map(|(_, view)| *view).collect();
                mean_overlap(&others)
            })
            .collect();
        let outlier = (0..views.len()).max_by(|&a, &b| without[a].total_cmp(&without[b])).unwrap_or(0);
        if without[outlier] > now + 0.03 && without[outlier] > MIN_GOOD_IOU - 0.05 {
            return vec![format!(
                "camera {} disagrees with the others: without it, silhouettes and masks overlap by {:.2} \
                 instead of {now:.2}; \
                 check its pose (a flipped axis?) and its masks",
                names[outlier], without[outlier]
            )];
        }
    }
    let low = names.iter().zip(overlaps).filter(|(_, overlap)| **overlap < MIN_GOOD_IOU);
    let listed: Vec<String> = low.map(|(name, overlap)| format!("{name} ({overlap:.2})")).collect();
    vec![format!(
        "the hull's silhouettes and the masks overlap poorly for {} of {} cameras: {}; check poses, \
         intrinsics and masks",
        listed.len(),
        views.len(),
        listed.join(", ")
    )]
}

/// Mean overlap of silhouettes and masks of a coarse hull; 0 when nothing remains.
fn mean_overlap(views: &[HullView]) -> f64 {
    let Some(hull) = Hull::carve(views, &COARSE_HULL_SETTINGS) else { return 0.0 };
    mean(&views.par_iter().map(|view| hull.reprojection_iou(view)).collect::<Vec<f64>>())
}

fn flip_yz(camera: &Camera) -> Camera {
    Camera {
        world_from_camera: camera.world_from_camera * DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)),
        ..camera.clone()
    }
}

fn flip_y(camera: &Camera) -> Camera {
    Camera {
        world_from_camera: camera.world_from_camera * DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0)),
        ..camera.clone()
    }
}

/// The camera if its OpenGL camera-to-world matrix was in truth world-to-camera.
fn invert(camera: &Camera) -> Camera {
    let axes = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    let to_camera = (camera.world_from_camera * axes).transpose();
    Camera { world_from_camera: to_camera * axes, centre: -(to_camera * camera.centre), ..camera.clone() }
}

impl fmt::Display for Inspection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unit = if self.metric { "m" } else { "units" };
        writeln!(f, "{}", self.root.display())?;
        writeln!(f, "  format      {}", self.format)?;
        let rate = self.frame_rate_hz.map_or(String::new(), |rate| format!(", {rate:.2} frames/s"));
        writeln!(
            f,
            "  content     {} cameras, {} frames ({:.3} to {:.3} s{rate}), {} pictures",
            self.camera_count, self.frame_count, self.time_range_s[0], self.time_range_s[1], self.view_count
        )?;
        let [train, validation, test] = self.split_counts;
        if validation + test > 0 {
            writeln!(f, "  splits      {train} train, {validation} validation, {test} test")?;
        }
        if self.rest_views > 0 {
            writeln!(f, "  at rest     {} photographs, in a world frame of their own", self.rest_views)?;
        }
        let sources: Vec<String> = self.mask_sources.iter().map(|(word, count)| format!("{word} ({count})")).collect();
        writeln!(f, "  masks       {}", sources.join(", "))?;
        if let Some((up, source)) = self.up {
            writeln!(f, "  up          {}{}", vector(up), guess(source))?;
        }
        if let Some((point, normal, source)) = self.ground {
            writeln!(f, "  ground      through {} {unit}, normal {}{}", vector(point), vector(normal), guess(source))?;
        }
        match &self.hull {
            Some(hull) => {
                writeln!(f, "  hull        {} to {} {unit}", vector(hull.low_m), vector(hull.high_m))?;
                writeln!(
                    f,
                    "              size {} {unit}, volume {:.3e} {unit}^3, overlap with the masks {:.3}",
                    vector(hull.size_m),
                    hull.volume_m3,
                    hull.mean_iou
                )?;
            }
            None => writeln!(f, "  hull        none: no point of space projects into all masks")?,
        }
        if let Some(flight) = &self.flight {
            writeln!(
                f,
                "  flight      {} frames, outlines agree to {:.2} pixels: velocity {} {unit}/s, acceleration {} {unit}/s^2,",
                flight.frames,
                flight.miss_px,
                vector(flight.velocity_m_s),
                vector(flight.acceleration_m_s2)
            )?;
            writeln!(f, "              angular velocity {} rad/s", vector(flight.angular_velocity_rad_s))?;
        }
        if let Some(fall) = &self.fall {
            let rate = fall
                .frame_rate_hz
                .map_or(String::new(), |rate| format!("; if lengths are metres, the film has {rate:.1} frames/s"));
            let (gravity, unit) = (fall.gravity_m_s2, fall.unit_m);
            writeln!(
                f,
                "  free fall   with gravity {gravity:.2} m/s^2 and these times, a length of 1 is {unit:.3} m{rate}"
            )?;
        }
        self.write_cameras(f)?;
        for warning in &self.warnings {
            writeln!(f, "  warning: {warning}")?;
        }
        Ok(())
    }
}

impl Inspection {
    /// One line a camera; one line in all for moving cameras.
    fn write_cameras(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const MAX_CAMERA_LINES: usize = 24;
        if self.cameras.len() > MAX_CAMERA_LINES {
            let coverage = mean(&self.cameras.iter().map(|camera| camera.coverage).collect::<Vec<_>>());
            let sizes = self.cameras.iter().map(|camera| camera.size);
            let (least, most) = (sizes.clone().min().unwrap_or_default(), sizes.max().unwrap_or_default());
            let size = if least == most { pixels(least) } else { format!("{} to {}", pixels(least), pixels(most)) };
            return writeln!(f, "  cameras     {size}, masks cover {:.1} % on average", 100.0 * coverage);
        }
        writeln!(f, "  camera      pixels     pictures  covered  overlap with the hull")?;
        for camera in &self.cameras {
            let overlap = camera.reprojection_iou.map_or("-".to_owned(), |overlap| format!("{overlap:.3}"));
            let (name, size) = (&camera.name, pixels(camera.size));
            writeln!(f, "  {name:<10}  {size:<9}  {:>8}  {:>5.1} %  {overlap}", camera.views, 100.0 * camera.coverage)?;
        }
        Ok(())
    }
}

fn pixels(size: [usize; 2]) -> String {
    format!("{}x{}", size[0], size[1])
}

fn vector(v: [f64; 3]) -> String {
    // Adding zero turns -0 into 0.
    format!("({:.3}, {:.3}, {:.3})", v[0] + 0.0, v[1] + 0.0, v[2] + 0.0)
}

fn guess(source: GroundSource) -> &'static str {
    match source {
        GroundSource::Format => "",
        GroundSource::Guess => " (a guess)",
    }
}
