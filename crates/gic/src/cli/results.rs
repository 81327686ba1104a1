//! `gic inspect`, `gic eval`, `gic demo`: looking at input and output.

use std::path::Path;

use gic_twin::atomic;
use pipeline::{Access, Run};

use super::Context;
use super::args::{DemoArgs, EvalArgs, InspectArgs};
use super::flags::Flags;
use crate::eval::evaluate;
use crate::outputs::Inputs;
use crate::{demo, pipeline};
use gic_bench::Truth;

pub(crate) fn inspect(args: &InspectArgs, context: &Context) -> anyhow::Result<()> {
    let config = crate::config::Config::resolve(args.flags().layers(&context.given)?)?;
    let scene = pipeline::open_scene(&config)?;
    args.sheet.iter().try_for_each(|sheet| Inputs::default().scene(&scene.root).allow_file(sheet))?;
    let inspection = gic_scene::inspect(&scene)?;
    if args.json {
        context.print(gic_twin::json::text_indented(&inspection)?)?;
    } else {
        context.print(inspection.to_string().trim_end())?;
    }
    if let Some(path) = &args.sheet {
        inspection.contact_sheet.save_png(path)?;
        context.print(format!("contact sheet in {}", path.display()))?;
    }
    Ok(())
}

pub(crate) fn eval(args: &EvalArgs, context: &Context) -> anyhow::Result<()> {
    evaluate_run(&args.run, args.elsewhere.scene.as_deref(), &args.truth, context)
}

fn evaluate_run(run: &Path, scene: Option<&Path>, truth: &Path, context: &Context) -> anyhow::Result<()> {
    let truth = Truth::read(truth).map_err(crate::Error::from)?;
    let evaluation = evaluate(run, scene, &truth, &context.events, &context.interrupt)?;
    let file = run.join("eval.json");
    atomic::write_json(&file, &evaluation)?;
    context.print(evaluation.table().trim_end())?;
    context.events.note("eval", format!("also as {}", file.display()));
    Ok(())
}

pub(crate) fn demo(args: &DemoArgs, context: &Context) -> anyhow::Result<()> {
    let scene = args.out.join("scene");
    demo::unpack(&scene)?;
    let flags = Flags { scene_path: Some(&scene), ..Flags::default() };
    let mut layers = flags.layers(&context.given)?;
    layers.push(crate::config::Layer::from_assignments(["identify.material=elastic"])?);
    let run = Run::open(&args.out.join("run"), Access::Make, layers, &context.events, &context.interrupt)?;
    super::run::finish(&run, context)?;
    context.print("\nAgainst the truth, which nothing above has seen:")?;
    evaluate_run(run.folder(), None, &scene.join("gt"), context)?;
    context.print(format!("report: {}", run.folder().join("report.html").display()))?;
    Ok(())
}
