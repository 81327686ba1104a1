//! `gic import` and `gic masks`: from films to a scene with masks.

use std::path::Path;

use gic_film::{Align, ImportRequest, Imported, MasksRequest, ViewReport};

use super::Context;
use super::args::{ImportArgs, MasksArgs};
use crate::Error;
use crate::outputs::Inputs;

pub(crate) fn run(args: &ImportArgs, context: &Context) -> anyhow::Result<()> {
    let inputs = args.films.iter().fold(Inputs::default(), |inputs, film| inputs.file(film));
    if let Some(sheet) = &args.thumbnails {
        if args.films.is_empty() {
            let hint = Some("name them: gic import FILMS --thumbnails FILE.png".into());
            return Err(Error::Usage { problem: "there are no films to draw".into(), hint }.into());
        }
        inputs.allow_file(sheet)?;
        let films = gic_film::open_films(&args.films, args.frame_rate_hz).map_err(Error::from)?;
        gic_film::thumbnails(&films, &context.interrupt).map_err(Error::from)?.save_png(sheet)?;
        for film in &films {
            let seconds = film.times_s.last().copied().unwrap_or_default();
            context.print(format!("{:<16} {} frames, {seconds:.2} s", film.name, film.times_s.len()))?;
        }
        context.print(format!("small pictures with their times [s] in {}", sheet.display()))?;
        return Ok(());
    }
    let scene = args.out.clone();
    inputs.allow_folder(&scene, &["transforms.json", "import.json", "contact.png"])?;
    let request = ImportRequest {
        films: args.films.clone(),
        scene: scene.clone(),
        start_s: args.start,
        frames: args.frames,
        every: args.every,
        frame_rate_hz: args.frame_rate_hz,
        calibration: args.calibration.clone(),
        align: args.align,
    };
    let imported = gic_film::import(&request, &context.events, &context.interrupt).map_err(Error::from)?;
    print_import(&imported, &scene, context)
}

fn print_import(imported: &Imported, scene: &Path, context: &Context) -> anyhow::Result<()> {
    context.print("camera           pixels      frames/s  begins at [s]  never free  taken out")?;
    let count = |pixels: Option<usize>| pixels.map_or("-".to_owned(), |pixels| pixels.to_string());
    for camera in &imported.cameras {
        let rate = camera.frame_rate_hz.map_or("-".to_owned(), |rate| format!("{rate:.2}"));
        context.print(format!(
            "{:<16} {:<10}  {rate:>8}  {:>13.4}  {:>10}  {:>9}",
            camera.name,
            format!("{}x{}", camera.size_px[0], camera.size_px[1]),
            camera.offset_s,
            count(camera.never_free_px),
            count(camera.taken_out_px)
        ))?;
    }
    let clock = match imported.aligned_by {
        Align::Clap => "films aligned by a clap",
        Align::Flash => "films aligned by a flash, to half a frame",
        Align::None | Align::Auto => "films taken to begin together",
    };
    context.print(format!("{} frames of {} cameras; {clock}", imported.frames, imported.cameras.len()))?;
    let next = if imported.is_calibrated {
        format!("look at it with `gic masks {0}` and `gic inspect {0}`", scene.display())
    } else {
        format!(
            "cameras: none yet; calibrate them with `gic calibrate`, then `gic import -o {} --calibration FILE`",
            scene.display()
        )
    };
    context.print(format!("scene in {}, contact sheet in {}", scene.display(), scene.join("contact.png").display()))?;
    context.print(next)?;
    Ok(())
}

pub(crate) fn masks(args: &MasksArgs, context: &Context) -> anyhow::Result<()> {
    let request = MasksRequest {
        scene: args.scene_path.clone(),
        out: args.out.clone(),
        network: args.matting.clone(),
        boxes: args.boxes.clone(),
    };
    let made = gic_film::make_masks(&request, &context.events, &context.interrupt).map_err(Error::from)?;
    let share = |share: Option<f64>| share.map_or("-".to_owned(), |share| format!("{share:.3}"));
    let line = |view: &ViewReport| {
        let doubt = if view.is_doubtful { "  DOUBTFUL" } else { "" };
        format!(
            "{:<28} {:>9.0}  {:>9}  {:>8}  {}{doubt}",
            view.file,
            view.area_px,
            share(view.overlap),
            share(view.overlap_of_others_without),
            view.source
        )
    };
    context.print("mask                         area [px]  with hull  without    from")?;
    for view in &made.views {
        context.print(line(view))?;
    }
    let doubtful = made.views.iter().filter(|view| view.is_doubtful).count();
    context.print(format!("{} masks in {}; {doubtful} doubtful", made.views.len(), made.folder.display()))?;
    if doubtful > 0 {
        let place = made.corrected.display();
        context.print(format!("mend doubtful masks into {place} under the same names, and run the command again"))?;
    }
    Ok(())
}
