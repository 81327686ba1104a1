//! The checks that all formats share, and the scene that comes out of them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use glam::DVec2;
use rayon::prelude::*;

use super::draft::{Draft, DraftCamera, Intrinsics};
use super::{enclosure, ranges, standing};
use crate::camera::Camera;
use crate::error::{MASK_HINT, Problem, SceneError, Severity};
use crate::frames::number_frames;
use crate::network::Network;
use crate::picture;
use crate::scene::Scene;
use crate::settings::{MaskChoice, SceneSettings};
use crate::view::{MaskSource, View};

/// Checks files and sizes, sorts, and builds the scene; lists every problem at once.
pub(crate) fn finish(mut draft: Draft, root: &Path, settings: &SceneSettings) -> Result<Scene, SceneError> {
    standing::merge_repeated(&mut draft);
    let mut problems = std::mem::take(&mut draft.problems);
    // Entries that the reader refused are problems already; that they are missing afterwards is none of its own.
    let complete = problems.is_empty();
    problems.extend(ranges::problems(&draft));
    let outside = enclosure::problems(&draft, root);
    if !outside.is_empty() {
        // Nothing outside the scene is opened, not even to look at its size.
        problems.extend(outside);
        return Err(SceneError::Invalid(problems));
    }
    let headers: Vec<Option<Header>> = {
        let found: Vec<Result<Header, Problem>> =
            draft.views.par_iter().map(|view| header(&view.picture, &draft.list)).collect();
        found.into_iter().map(|result| result.map_err(|problem| problems.push(problem)).ok()).collect()
    };
    let backgrounds = check_backgrounds(&draft, &mut problems);
    choose_masks(&mut draft, &headers, settings, &mut problems);
    let network = settings.matting.as_deref().map(Network::open).transpose()?;
    let cameras = resolve_cameras(&draft, &headers, &backgrounds, &mut problems);
    check_mask_sizes(&draft, &headers, &mut problems);

    let shots: Vec<(usize, f64)> = draft.views.iter().map(|view| (view.camera, view.time)).collect();
    let (times, frames) = number_frames(&shots, draft.cameras.len() < draft.views.len());
    if draft.views.is_empty() {
        if problems.is_empty() {
            problems.push(Problem::NoPictures { path: draft.list.clone() });
        }
        return Err(SceneError::Invalid(problems));
    }
    check_coverage(&draft, &frames, times.len(), complete, &mut problems);

    let mut views: Vec<View> = draft
        .views
        .into_iter()
        .zip(frames)
        .map(|(view, frame)| View {
            camera: view.camera,
            frame,
            time_s: view.time,
            split: view.split,
            picture: view.picture,
            // Without a source there is an error in the list already.
            mask: view.mask.unwrap_or(MaskSource::Alpha),
        })
        .collect();
    views.sort_by_key(|view| (view.frame, view.camera));

    if problems.iter().any(|problem| problem.severity() == Severity::Error) {
        return Err(SceneError::Invalid(problems));
    }
    let frame_rate = settings.frame_rate_hz.or(draft.frame_rate).or_else(|| even_rate(&times));
    let mut scene = Scene {
        root: root.to_owned(),
        format: draft.format,
        camera_names: draft.cameras.iter().map(|camera| camera.name.clone()).collect(),
        backgrounds: draft.cameras.iter().map(|camera| camera.background.clone()).collect(),
        lenses: draft.cameras.into_iter().map(|camera| camera.lens).collect(),
        cameras,
        times,
        frame_rate,
        views,
        delays_s: Vec::new(),
        calibration_errors: Vec::new(),
        calibration_error_deviations: Vec::new(),
        flight: None,
        world: draft.world,
        points: draft.points,
        rest: draft.rest,
        warnings: problems,
        network,
    };
    if let Some(rate) = settings.frame_rate_hz {
        filmed_at(&mut scene, rate);
    }
    Ok(scene)
}

/// Puts the frames `1 / rate` [s] apart; what a view lags behind its frame stays the same share of that.
fn filmed_at(scene: &mut Scene, rate: f64) {
    let stated = even_rate(&scene.times).unwrap_or(rate);
    for view in &mut scene.views {
        let lag = view.time_s - scene.times[view.frame];
        view.time_s = view.frame as f64 / rate + lag * stated / rate;
    }
    scene.times = (0..scene.times.len()).map(|frame| frame as f64 / rate).collect();
}

/// What the header of a picture file says.
struct Header {
    size: (usize, usize),
    has_alpha: bool,
}

fn header(path: &Path, list: &Path) -> Result<Header, Problem> {
    if !path.is_file() {
        return Err(Problem::MissingPicture { path: path.to_owned(), list: list.to_owned() });
    }
    let (size, has_alpha) = picture::header(path)?;
    Ok(Header { size, has_alpha })
}

/// Sizes of the background pictures; a background that is listed but cannot be read is a problem.
fn check_backgrounds(draft: &Draft, problems: &mut Vec<Problem>) -> Vec<Option<(usize, usize)>> {
    let mut check = |path: &PathBuf| header(path, &draft.list).map_err(|problem| problems.push(problem)).ok();
    draft.cameras.iter().map(|camera| camera.background.as_ref().and_then(&mut check).map(|found| found.size)).collect()
}

/// Settles where each mask comes from: what the user chose, a mask file, the alpha channel, the empty background.
fn choose_masks(draft: &mut Draft, headers: &[Option<Header>], settings: &SceneSettings, problems: &mut Vec<Problem>) {
    // Matting fills in only where no view has a mask: among masked pictures, one without is a mistake to report.
    let any_mask = draft
        .views
        .iter()
        .zip(headers)
        .any(|(view, header)| view.mask.is_some() || header.as_ref().is_some_and(|header| header.has_alpha));
    for (view, header) in draft.views.iter_mut().zip(headers) {
        let Some(header) = header else { continue };
        let has_background = draft.cameras[view.camera].background.is_some();
        let chosen = match settings.masks {
            _ if settings.matting.is_some() => Some(MaskSource::Network),
            MaskChoice::Difference => has_background.then_some(MaskSource::Difference),
            MaskChoice::Auto if view.mask.is_some() => view.mask.take(),
            MaskChoice::Auto if header.has_alpha => Some(MaskSource::Alpha),
            MaskChoice::Auto => (has_background && !any_mask).then_some(MaskSource::Difference),
        };
        if chosen.is_none() {
            let hint = if settings.masks == MaskChoice::Difference {
                "matting needs a picture of the empty background of this camera".to_owned()
            } else {
                MASK_HINT.to_owned()
            };
            problems.push(Problem::MissingMask { picture: view.picture.clone(), hint });
        }
        view.mask = chosen;
    }
}

/// Gives each camera the size of its pictures, and reports pictures of another size.
fn resolve_cameras(
    draft: &Draft,
    headers: &[Option<Header>],
    backgrounds: &[Option<(usize, usize)>],
    problems: &mut Vec<Problem>,
) -> Vec<Camera> {
    // The first readable picture of each camera sets its size.
    let mut first: Vec<Option<(usize, (usize, usize))>> = vec![None; draft.cameras.len()];
    for (index, (view, header)) in draft.views.iter().zip(headers).enumerate() {
        if let Some(header) = header {
            first[view.camera].get_or_insert((index, header.size));
        }
    }
    for (view, header) in draft.views.iter().zip(headers) {
        let (Some(header), Some((reference, expected))) = (header, first[view.camera]) else { continue };
        if header.size != expected {
            problems.push(Problem::WrongSize {
                path: view.picture.clone(),
                found: header.size,
                expected,
                reference: draft.views[reference].picture.clone(),
            });
        }
    }
    let mut cameras = Vec::with_capacity(draft.cameras.len());
    for (index, camera) in draft.cameras.iter().enumerate() {
        let Some((reference, size)) = first[index] else { continue };
        let reference = &draft.views[reference].picture;
        if let (Some(found), Some(path)) = (backgrounds[index], &camera.background)
            && found != size
        {
            let (path, reference) = (path.clone(), reference.clone());
            problems.push(Problem::WrongSize { path, found, expected: size, reference });
        }
        match resolve_camera(camera, size) {
            Ok(camera) => cameras.push(camera),
            Err(expected) => problems.push(Problem::WrongSize {
                path: reference.clone(),
                found: size,
                expected,
                reference: draft.list.clone(),
            }),
        }
    }
    cameras
}

/// The pinhole for pictures of `size`; the stated size when the pictures are not that one scaled.
fn resolve_camera(camera: &DraftCamera, (width, height): (usize, usize)) -> Result<Camera, (usize, usize)> {
    let (w, h) = (width as f64, height as f64);
    let (focal, principal) = match camera.intrinsics {
        Intrinsics::HorizontalAngle(angle) => {
            (DVec2::splat(0.5 * w / (0.5 * angle).tan()), DVec2::new(0.5 * w, 0.5 * h))
        }
        Intrinsics::Pixels { focal, principal, size: None } => (focal, principal),
        Intrinsics::Pixels { focal, principal, size: Some(stated) } => {
            // Pictures made smaller after calibration are common: the intrinsics follow if the shape stayed.
            let ratio = DVec2::new(w / stated.0 as f64, h / stated.1 as f64);
            let one_pixel = 1.0 / stated.0.min(stated.1) as f64 + 1.0 / width.min(height) as f64;
            if (ratio.x / ratio.y - 1.0).abs() > one_pixel {
                return Err(stated);
            }
            (focal * ratio, principal * ratio)
        }
    };
    Ok(Camera { width, height, focal, principal, world_from_camera: camera.world_from_camera, centre: camera.centre })
}

/// Reports mask files that are missing, unreadable or of another size than their picture.
fn check_mask_sizes(draft: &Draft, headers: &[Option<Header>], problems: &mut Vec<Problem>) {
    let found: Vec<Option<Problem>> = draft
        .views
        .par_iter()
        .zip(headers)
        .map(|(view, header)| {
            let Some(MaskSource::File(path) | MaskSource::OverWhite(path)) = &view.mask else { return None };
            let expected = header.as_ref()?.size;
            if !path.is_file() {
                let hint = format!("{} does not exist", path.display());
                return Some(Problem::MissingMask { picture: view.picture.clone(), hint });
            }
            match picture::header(path) {
                Err(problem) => Some(problem),
                Ok((found, _)) if found != expected => {
                    let reference = view.picture.clone();
                    Some(Problem::WrongSize { path: path.clone(), found, expected, reference })
                }
                Ok(_) => None,
            }
        })
        .collect();
    problems.extend(found.into_iter().flatten());
}

/// One camera position only, pictures listed twice, cameras that lack frames.
fn check_coverage(draft: &Draft, frames: &[usize], frame_count: usize, complete: bool, problems: &mut Vec<Problem>) {
    let first = &draft.cameras[0];
    let moved = |camera: &DraftCamera| (camera.centre - first.centre).length() > 1e-9;
    if complete && !draft.cameras.iter().any(moved) {
        problems.push(Problem::OneCamera { path: draft.list.clone() });
    }
    let mut seen: BTreeMap<(usize, usize), &Path> = BTreeMap::new();
    for (view, &frame) in draft.views.iter().zip(frames) {
        if let Some(other) = seen.insert((view.camera, frame), &view.picture) {
            problems.push(Problem::Duplicate { path: view.picture.clone(), other: other.to_owned() });
        }
    }
    let synchronised = draft.cameras.len() < draft.views.len();
    let used: BTreeSet<usize> = draft.views.iter().map(|view| view.camera).collect();
    if complete {
        let idle = draft.cameras.iter().enumerate().filter(|(camera, _)| !used.contains(camera));
        problems.extend(idle.map(|(_, camera)| {
            let camera = camera.name.clone();
            Problem::IdleCamera { path: draft.list.clone(), camera }
        }));
    }
    if complete && synchronised {
        for frame in 0..frame_count {
            for (camera, draft_camera) in draft.cameras.iter().enumerate() {
                if used.contains(&camera) && !seen.contains_key(&(camera, frame)) {
                    let camera = draft_camera.name.clone();
                    problems.push(Problem::MissingFrame { path: draft.list.clone(), camera, frame });
                }
            }
        }
    }
}

/// Frames per second of evenly spaced times (within 1 %).
fn even_rate(times: &[f64]) -> Option<f64> {
    let steps = times.len().checked_sub(1).filter(|&steps| steps > 0)?;
    let mean = (times[steps] - times[0]) / steps as f64;
    times.windows(2).all(|pair| ((pair[1] - pair[0]) / mean - 1.0).abs() < 0.01).then(|| 1.0 / mean)
}
