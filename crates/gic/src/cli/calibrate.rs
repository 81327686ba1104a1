//! `gic calibrate`: cameras from films of a printed board, and the board itself.

use gic_calibrate::{CalibrateRequest, CalibratedCamera, Motion, PrintRequest};

use super::Context;
use super::args::CalibrateArgs;
use crate::Error;
use crate::outputs::Inputs;

pub(crate) fn run(args: &CalibrateArgs, context: &Context) -> anyhow::Result<()> {
    if let Some(file) = &args.print {
        return print(args, file, context);
    }
    if args.films.is_empty() {
        return Err(Error::Usage {
            problem: "no films are given".into(),
            hint: Some("name the films of the board, or a folder of them; --print makes the board".into()),
        }
        .into());
    }
    let inputs = args.films.iter().chain(&args.lenses).fold(Inputs::default(), |inputs, film| inputs.file(film));
    inputs.allow_folder(&args.out, &["calibration.json", "intrinsics.json", "report.html", "residuals"])?;
    let request = CalibrateRequest {
        films: args.films.clone(),
        board: args.board,
        // A missing size is refused with its way out.
        tag_size_m: args.tag_size_m.unwrap_or(f64::NAN),
        motion: if args.moving || args.intrinsics { Motion::Moving } else { Motion::Still },
        intrinsics_only: args.intrinsics,
        lenses: args.lenses.clone(),
        pixel_aspect: args.pixel_aspect,
        board_on: args.board_on.into(),
        frame_rate_hz: args.frame_rate_hz,
        out: args.out.clone(),
    };
    let calibrated = gic_calibrate::calibrate(&request, &context.events, &context.interrupt).map_err(Error::from)?;
    context.print("camera           tags  discarded  rms [px]  focal length [px]   k1                  centre [m]")?;
    for camera in &calibrated.cameras {
        context.print(line(camera))?;
    }
    let place = args.out.display();
    if args.intrinsics {
        context.print(format!("lenses in {place}/intrinsics.json, for `gic calibrate --lenses`"))?;
    } else {
        context.print(format!("floor: the board's plane, within {:.1} mm", 1000.0 * calibrated.ground_sd_m))?;
        context.print(format!("cameras in {place}/calibration.json, for `gic import --calibration`"))?;
    }
    context.print(format!("what is left over: {place}/report.html"))?;
    Ok(())
}

fn line(camera: &CalibratedCamera) -> String {
    let [name, tags, discarded, rms, focal, k1, centre, sd] = camera.cells();
    format!("{name:<16} {tags:>4}  {discarded:>9}  {rms:>8}  {focal:<18}  {k1:<18}  {centre} ± {sd}")
}

fn print(args: &CalibrateArgs, file: &std::path::Path, context: &Context) -> anyhow::Result<()> {
    Inputs::default().allow_file(file)?;
    let request = PrintRequest {
        board: args.board,
        tag_size_m: args.tag_size_m,
        paper: args.paper.into(),
        pages: args.pages,
        file: file.to_owned(),
    };
    let side_m = gic_calibrate::print_board(&request).map_err(Error::from)?;
    context.print(format!("board {} with tags of {:.1} mm in {}", args.board, 1000.0 * side_m, file.display()))?;
    context.print("print it at 100 %, check its 100 mm line, glue or tape it flat")?;
    Ok(())
}
