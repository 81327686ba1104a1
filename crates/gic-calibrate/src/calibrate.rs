//! The way from films of a board to cameras.

use std::path::PathBuf;

use gic_twin::Interrupt;
use gic_twin::events::Events;

use crate::board::Board;
use crate::bundle::{Bundle, Freedom};
use crate::error::{CalibrateError, Result};
use crate::lens::Lens;
use crate::output::{Calibrated, known_lenses, write};
use crate::report;
use crate::rig::Rig;
use crate::sightings::Sightings;
use crate::start::{Known, start};
use crate::tuning::GUIDED_ROUNDS;

/// Name of the stage in events.
const STAGE: &str = "calibrate";

/// What the board does while it is filmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// It lies still, and all cameras see it at once.
    Still,
    /// It is shown in several places, to all cameras at the same moments.
    Moving,
}

/// What the board lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoardOn {
    /// The floor; a moving board lies there at its end.
    Floor,
    /// Nothing that matters: the world has no up and no ground.
    Nothing,
}

/// What to calibrate.
#[derive(Clone, Debug)]
pub struct CalibrateRequest {
    /// Films, folders of numbered pictures, or a folder of them, one a camera.
    pub films: Vec<PathBuf>,
    /// The board.
    pub board: Board,
    /// Side of a tag's black square [m].
    pub tag_size_m: f64,
    /// Whether the board moves.
    pub motion: Motion,
    /// Lenses alone, each camera for itself.
    pub intrinsics_only: bool,
    /// Known lenses: a file that this wrote earlier.
    pub lenses: Option<PathBuf>,
    /// fy / fx: 1 for square pixels.
    pub pixel_aspect: f64,
    /// What the board lies on.
    pub board_on: BoardOn,
    /// Frames per second of numbered pictures.
    pub frame_rate_hz: Option<f64>,
    /// Folder for the results.
    pub out: PathBuf,
}

/// Calibrates cameras; writes `calibration.json` (or `intrinsics.json`), `report.html` and `residuals/CAMERA.png`.
///
/// The world is the board's frame: x to the right and y up on the first page that is seen, z out of the paper towards
/// the cameras, origin in the page's middle, lengths in metres by the tags' size. Where the board moves, it is that of
/// the last moment.
///
/// # Errors
/// [`CalibrateError::Usage`] for a request that cannot be met, [`CalibrateError::Pictures`] for pictures that do not
/// tell the cameras, with their names.
pub fn calibrate(request: &CalibrateRequest, events: &Events, interrupt: &Interrupt) -> Result<Calibrated> {
    if !(request.tag_size_m > 0.0 && request.tag_size_m.is_finite()) {
        return Err(CalibrateError::usage(
            "the tags' size is missing",
            "measure the side of a tag's black square and give it with --tag-size-m; it sets the scale of the world",
        ));
    }
    let mut sightings = Sightings::read(request, interrupt)?;
    events.note(STAGE, format!("{} tags in {} pictures", tags(&sightings), sightings.views.len()));
    let lenses = request.lenses.as_deref().map(|file| known_lenses(file, &sightings)).transpose()?;
    let calibrated = if request.intrinsics_only {
        let mut all = Calibrated::default();
        for camera in 0..sightings.names.len() {
            let mut alone = sightings.of_camera(camera);
            let bundle_of = solve(&mut alone, request, None, interrupt)?;
            all.cameras.extend(Calibrated::of(&bundle_of, &alone, request).cameras);
            report::draw(&bundle_of, &alone, &request.out)?;
        }
        all
    } else {
        let solution = solve(&mut sightings, request, lenses.as_deref(), interrupt)?;
        report::draw(&solution, &sightings, &request.out)?;
        Calibrated::of(&solution, &sightings, request)
    };
    write(&calibrated, request)?;
    report::write_page(&calibrated, request)?;
    calibrated.warnings().into_iter().for_each(|warning| events.warn(STAGE, warning));
    Ok(calibrated)
}

fn tags(sightings: &Sightings) -> usize {
    sightings.views.iter().map(|view| view.tags.len()).sum()
}

/// An adjusted bundle, without the sightings that it borrows.
pub(crate) struct Solution {
    /// Where everything is.
    pub(crate) rig: Rig,
    /// Per corner: number of the view, where it is seen, seen minus predicted [pixels], whether it counts.
    pub(crate) corners: Vec<CornerReport>,
    /// Per camera.
    pub(crate) deviations: Vec<CameraCovariance>,
}

/// A corner, and how far off it is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CornerReport {
    pub(crate) view: usize,
    pub(crate) seen: [f64; 2],
    pub(crate) residual: [f64; 2],
    pub(crate) is_kept: bool,
}

/// What a camera's part of the covariance says.
#[derive(Clone, Debug, Default)]
pub(crate) struct CameraCovariance {
    /// Of the lens's unknowns, shape [8, 8]; `None` for a known lens.
    pub(crate) lens: Option<nalgebra::DMatrix<f64>>,
    /// Of the centre [m], shape [3, 3].
    pub(crate) centre: Option<nalgebra::DMatrix<f64>>,
}

/// Start, adjustment, and searches for more tags until none is found.
fn solve(
    sightings: &mut Sightings,
    request: &CalibrateRequest,
    lenses: Option<&[Lens]>,
    interrupt: &Interrupt,
) -> Result<Solution> {
    let reference = sightings.moments - 1;
    let (names, sizes) = (sightings.names.clone(), sightings.sizes.clone());
    let known = Known {
        names: &names,
        sizes: &sizes,
        lenses,
        board: request.board,
        side_m: request.tag_size_m,
        moments: sightings.moments,
        reference,
    };
    let freedom = Freedom { lenses: lenses.is_none(), reference, pixel_aspect: request.pixel_aspect };
    let mut rig = start(&mut sightings.views, &known)?;
    for round in 0.. {
        interrupt.check("some pictures")?;
        let mut bundle = Bundle::new(rig, &sightings.views, &sizes, freedom);
        bundle.adjust();
        let solution = Solution::of(bundle);
        // Tags that other programs print turned are found by detection alone.
        if round == GUIDED_ROUNDS || sightings.search(&solution.rig, request.board.border()) == 0 {
            return Ok(solution);
        }
        rig = solution.rig;
    }
    unreachable!("the rounds end")
}

impl Solution {
    fn of(bundle: Bundle) -> Solution {
        let corner = |n: usize| CornerReport {
            view: bundle.corners[n].view,
            seen: bundle.corners[n].seen.into(),
            residual: bundle.residual(n).into(),
            is_kept: bundle.corners[n].is_kept,
        };
        let corners = (0..bundle.corners.len()).map(corner).collect();
        let covariance = bundle.covariance();
        let part = |first: usize, count: usize| {
            covariance.as_ref().map(|all| all.view((first, first), (count, count)).into_owned())
        };
        let deviations = (0..bundle.rig.lenses.len())
            .map(|camera| CameraCovariance {
                lens: bundle.lens_at(camera).and_then(|first| part(first, crate::lens::LENS_UNKNOWNS)),
                centre: part(bundle.camera_at(camera) + 3, 3),
            })
            .collect();
        Solution { corners, deviations, rig: bundle.rig }
    }
}
