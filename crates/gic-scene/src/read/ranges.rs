//! The ranges in which every number of a scene must lie, whatever format it comes from. NaN lies in none.

use std::ops::RangeInclusive;

use super::draft::{Draft, DraftCamera, Intrinsics};
use crate::error::Problem;
use crate::lens::Lens;

/// Sides of a picture [pixels].
const SIDE_PX: RangeInclusive<f64> = 1.0..=65_535.0;
/// Focal lengths [pixels].
const FOCAL_PX: RangeInclusive<f64> = 0.1..=1e7;
/// Principal points [pixels].
const PRINCIPAL_PX: RangeInclusive<f64> = -1e7..=1e7;
/// Coordinates of cameras and points, in the unit of the scene.
const COORDINATE: RangeInclusive<f64> = -1e6..=1e6;
/// Times [s].
const TIME_S: RangeInclusive<f64> = -1e9..=1e9;
/// Coefficients of lenses.
const COEFFICIENT: RangeInclusive<f64> = -1e6..=1e6;
/// Frames a second.
pub(super) const FRAME_RATE_HZ: RangeInclusive<f64> = 1e-3..=1e6;

/// Numbers of a draft that lie outside their range, the first of each camera, view and point.
pub(super) fn problems(draft: &Draft) -> Vec<Problem> {
    let cameras = draft.cameras.iter().filter_map(|camera| {
        let numbers = camera_numbers(camera).into_iter();
        wrong(draft, &camera.name, numbers)
    });
    let views = draft.views.iter().filter_map(|view| {
        let name = view.picture.display().to_string();
        wrong(draft, &name, std::iter::once(("time [s]", view.time, TIME_S)))
    });
    let points = draft.points.iter().enumerate().filter_map(|(index, point)| {
        let coordinates = point.position.to_array().into_iter();
        wrong(draft, &format!("point {index}"), coordinates.map(|x| ("coordinate", x, COORDINATE)))
    });
    cameras.chain(views).chain(points).collect()
}

type Number = (&'static str, f64, RangeInclusive<f64>);

fn wrong(draft: &Draft, entry: &str, mut numbers: impl Iterator<Item = Number>) -> Option<Problem> {
    let (field, value, range) = numbers.find(|(_, value, range)| !range.contains(value))?;
    let (low, high) = (*range.start(), *range.end());
    Some(Problem::OutOfRange { path: draft.list.clone(), entry: entry.to_owned(), field, value, low, high })
}

fn camera_numbers(camera: &DraftCamera) -> Vec<Number> {
    let mut numbers = Vec::new();
    if let Intrinsics::Pixels { focal, principal, size } = camera.intrinsics {
        numbers.extend(focal.to_array().map(|f| ("focal length [pixels]", f, FOCAL_PX)));
        numbers.extend(principal.to_array().map(|c| ("principal point [pixels]", c, PRINCIPAL_PX)));
        let sides = size.into_iter().flat_map(|(width, height)| [width, height]);
        numbers.extend(sides.map(|side| ("side of the picture [pixels]", side as f64, SIDE_PX)));
    }
    numbers.extend(camera.centre.to_array().map(|x| ("coordinate of the camera", x, COORDINATE)));
    let coefficients = match &camera.lens {
        None => Vec::new(),
        Some(Lens::Perspective { k, p }) => k.iter().chain(p).copied().collect(),
        Some(Lens::Fisheye { k }) => k.to_vec(),
        Some(Lens::FieldOfView { omega }) => vec![*omega],
        // Found and not read.
        Some(Lens::Mended { .. }) => Vec::new(),
    };
    numbers.extend(coefficients.into_iter().map(|c| ("lens coefficient", c, COEFFICIENT)));
    numbers
}
