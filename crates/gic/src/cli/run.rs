//! `gic run` and its stages.

use std::path::Path;

use super::Context;
use super::args::{ExportArgs, FillArgs, IdentifyArgs, ReconstructArgs, RegisterArgs, ReportArgs, RunArgs};
use super::flags::Flags;
use crate::export::{Export, ExportOptions, ExportSource, export as export_to};
use crate::pipeline::{Access, Run, Stage};

pub(crate) fn run(args: &RunArgs, context: &Context) -> anyhow::Result<()> {
    let run = open(&args.place.out, Access::Make, &args.flags(), context)?;
    finish(&run, context)
}

/// Brings a run up to date and prints its estimate.
pub(crate) fn finish(run: &Run, context: &Context) -> anyhow::Result<()> {
    bring_up_to_date(run)?;
    print_estimate(run, context)
}

/// Runs all stages that a run asks for, and writes its report.
pub(crate) fn bring_up_to_date(run: &Run) -> anyhow::Result<()> {
    let last = if run.config.appearance.enabled { Stage::Appearance } else { Stage::Predict };
    run.bring_up_to_date(last)?;
    Ok(crate::report::write(run, run.events())?)
}

pub(crate) fn report(args: &ReportArgs, context: &Context) -> anyhow::Result<()> {
    let run = open(&args.run, Access::Read, &args.elsewhere.flags(), context)?;
    crate::report::write(&run, &context.events)?;
    context.print(format!("report in {}", args.run.join("report.html").display()))?;
    Ok(())
}

pub(crate) fn reconstruct(args: &ReconstructArgs, context: &Context) -> anyhow::Result<()> {
    let run = open(&args.place.out, Access::Make, &args.flags(), context)?;
    run.bring_up_to_date(Stage::Reconstruct)?;
    context.print(format!("Gaussians in {}", run.folder().join("gaussians").display()))?;
    Ok(())
}

pub(crate) fn register(args: &RegisterArgs, context: &Context) -> anyhow::Result<()> {
    let run = open(&args.run, Access::GoOn, &args.flags(), context)?;
    run.bring_up_to_date(Stage::Register)?;
    let found = run.registration()?;
    context.print(format!("scale {:.6} m per unit of the scan", found.best.scale))?;
    for row in found.best.matrix {
        context.print(row.map(|v| format!("{v:>12.6}")).concat())?;
    }
    for (camera, iou) in found.cameras.iter().zip(&found.best.mask_iou) {
        context.print(format!("overlap with the mask of camera {camera}: {iou:.4}"))?;
    }
    for other in &found.alternatives {
        let least = other.mask_iou.iter().copied().fold(f64::INFINITY, f64::min);
        context.print(format!(
            "alternative: turned {:.0} degrees, loss {:.4} against {:.4}, least overlap {least:.4}",
            other.apart_deg, other.loss, found.best.loss
        ))?;
    }
    context.print(format!("registration in {}", run.folder().join("registration.json").display()))?;
    Ok(())
}

pub(crate) fn fill(args: &FillArgs, context: &Context) -> anyhow::Result<()> {
    let run = open(&args.run, Access::GoOn, &args.flags(), context)?;
    run.bring_up_to_date(Stage::Fill)?;
    let summary = run.fill_summary()?;
    let mean = summary.mask_iou.iter().sum::<f64>() / summary.mask_iou.len().max(1) as f64;
    context.print(format!(
        "{} particles {:.2} mm apart in {}; masks agree to {mean:.4} (mean IoU of {} cameras at the first frame)",
        summary.particles,
        1e3 * summary.particle_spacing_m,
        run.folder().join("continuum.ply").display(),
        summary.mask_iou.len()
    ))?;
    Ok(())
}

pub(crate) fn identify(args: &IdentifyArgs, context: &Context) -> anyhow::Result<()> {
    let run = open(&args.run, Access::GoOn, &args.flags(), context)?;
    run.bring_up_to_date(Stage::Identify)?;
    print_estimate(&run, context)
}

pub(crate) fn export(args: &ExportArgs, context: &Context) -> anyhow::Result<()> {
    let source = ExportSource::open(&args.source)?;
    let path = args.out.clone().unwrap_or_else(|| source.folder().join(args.format.default_file()));
    if args.format == Export::GaussianSequence {
        source.inputs().allow_folder(&path, &["frame_"])?;
    }
    for file in args.format.files(&path) {
        source.inputs().allow_file(&file)?;
    }
    let options = ExportOptions { format: args.format, up: args.up.map(Into::into), approximate: args.approximate };
    let written = export_to(source, options, &path)?;
    context.print(format!("{written} in {}", path.display()))?;
    Ok(())
}

fn open<'a>(folder: &Path, access: Access, flags: &Flags, context: &'a Context) -> anyhow::Result<Run<'a>> {
    Ok(Run::open(folder, access, flags.layers(&context.given)?, &context.events, &context.interrupt)?)
}

fn print_estimate(run: &Run, context: &Context) -> anyhow::Result<()> {
    let found = run.identified()?;
    context.print(format!("{:<28} {:>12}  {:>25}", found.model, "estimate", "95 % interval"))?;
    for e in &found.estimates {
        let verdict = match (e.fixed, e.identifiable) {
            (true, _) => "  given",
            (false, true) => "",
            (false, false) => "  NOT DETERMINED by this video",
        };
        let interval = format!("{:.4e} .. {:.4e}", e.interval_95[0], e.interval_95[1]);
        context.print(format!("{:<28} {:>12.5e}  {interval:>25}{verdict}", e.name, e.value))?;
    }
    for (letter, v, interval) in found.velocity_components() {
        let interval = interval.map_or("not known".into(), |[low, high]| format!("{low:.4} .. {high:.4}"));
        context.print(format!("{:<28} {v:>12.4}  {interval:>25}", format!("initial_velocity_{letter}_m_s")))?;
    }
    context.print(format!("{} rollouts ({} more on a coarse grid)", found.rollouts, found.coarse_rollouts))?;
    context.print(format!("twin in {}", run.folder().join("twin.json").display()))?;
    Ok(())
}
