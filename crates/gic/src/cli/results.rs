//! `gic inspect`, `gic eval`, `gic bench`, `gic demo`: looking at input and output.

use std::path::Path;

use gic_twin::atomic;
use pipeline::{Access, Run};

use super::Context;
use super::args::{BenchArgs, DemoArgs, EvalArgs, InspectArgs};
use super::flags::Flags;
use crate::eval::evaluate;
use crate::outputs::Inputs;
use crate::{bench, demo, pipeline};
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
    let evaluation = evaluate(run, scene, &Truth::read(truth)?, &context.events, &context.interrupt)?;
    let file = run.join("eval.json");
    atomic::write_json(&file, &evaluation)?;
    context.print(evaluation.table().trim_end())?;
    context.events.note("eval", format!("also as {}", file.display()));
    Ok(())
}

pub(crate) fn bench(args: &BenchArgs, context: &Context) -> anyhow::Result<()> {
    let request = bench::BenchRequest {
        suite: args.suite.clone(),
        out: args.out.clone(),
        jobs: args.jobs,
        filter: args.filter.clone().unwrap_or_default(),
        program: context.program.clone(),
        arguments: args.arguments.clone(),
    };
    let tables = bench::bench(&request, &context.events, &context.interrupt)?;
    context.print(format!(
        "{:<14} {:<14} {:>6} {:>17} {:>17}",
        "material", "parameter", "scenes", "gic, MAE x100", "paper"
    ))?;
    for r in &tables.parameters {
        let paper = r.paper.map_or("-".into(), |[mean, deviation]| format!("{mean:.2} +- {deviation:.2}"));
        let ours = format!("{:.2} +- {:.2}", r.mean, r.deviation);
        context.print(format!("{:<14} {:<14} {:>6} {ours:>17} {paper:>17}", r.model, r.parameter, r.scenes))?;
    }
    context.print(tables.states.trim_end())?;
    context.print(format!("tables in {}", args.out.join("results.md").display()))?;
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
