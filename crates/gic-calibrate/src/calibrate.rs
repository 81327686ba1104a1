//! The way from films of a board to cameras.

use gic_twin::Interrupt;
use gic_twin::events::Events;

use crate::bundle::{Bundle, Freedom};
use crate::error::{CalibrateError, Result};
use crate::lens::Lens;
use crate::output::{Calibrated, known_lenses, write};
use crate::report;
use crate::request::CalibrateRequest;
use crate::sightings::Sightings;
use crate::solution::Solution;
use crate::start::{Known, start};
use crate::tuning::GUIDED_ROUNDS;

/// Name of the stage in events.
const STAGE: &str = "calibrate";

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
