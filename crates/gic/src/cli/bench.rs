//! `gic bench`: a suite of scenes, here or on a cluster.

use std::path::Path;

use gic_bench::engine::{Launch, On, Started};
use gic_bench::forecast::Forecast;
use gic_bench::others::{Method, export_suite};
use gic_bench::plan::{Plan, Task, tasks};
use gic_bench::record::{Cost, Outcome, Record, begin, unfinished};
use gic_bench::sweep::Sweep;
use gic_bench::{BenchError, Evaluation, Truth, collect, find_scenes};
use gic_scene::Scene;
use gic_simd::Level;

use super::Context;
use super::args::{BenchArgs, Command, RunArgs};
use super::flags::Given;
use crate::config::Config;
use crate::eval::evaluate;
use crate::pipeline::{Access, Run, Stage};
use crate::report::history::History;
use crate::{Error, Explanation};

const STAGE: &str = "bench";
/// Threads of a task on a cluster, where the command line does not say: as the published figures were measured.
const CLUSTER_THREADS: usize = 2;

pub(crate) fn run(args: &BenchArgs, context: &Context) -> anyhow::Result<()> {
    // With the way out and the kind of an error, which the program knows of its own errors.
    bench(args, context).map_err(|error| match error.downcast::<BenchError>() {
        Ok(error) => Error::from(error).into(),
        Err(error) => error,
    })
}

fn bench(args: &BenchArgs, context: &Context) -> anyhow::Result<()> {
    let out = args.out.as_deref().unwrap_or(&args.suite);
    if let Some(name) = &args.task {
        return run_task(name, out, context);
    }
    if args.collect {
        return tables(out, args, context);
    }
    if let Some(method) = args.export_suite {
        return export(method, out, args, context);
    }
    let scenes = find_scenes(&args.suite, args.filter.as_deref().unwrap_or_default())?;
    let launch = launch(args, context);
    launch.validate()?;
    let asked = tasks(&scenes, &sweep(args).cases()?, &args.arguments)?;
    asked.iter().try_for_each(check)?;
    // All that engines get is whole paths.
    let out = &std::path::absolute(out)?;
    let plan = Plan::extend(out, &asked)?;
    let waiting = unfinished(&asked, out)?;
    if !waiting.is_empty() {
        let jobs = if launch.on == On::Local { Some(launch.jobs.unwrap_or(1)) } else { launch.jobs };
        let forecast = Forecast::of(&plan, &waiting, out, jobs, launch.threads)?;
        context.print(format!("forecast: {forecast}"))?;
        if args.forecast {
            return Ok(());
        }
        let started = launch.start(&waiting, out, &forecast, &context.events, &context.interrupt)?;
        if started == Started::Submitted {
            return Ok(context.print(format!("submitted; `gic bench --collect {}` makes the tables", out.display()))?);
        }
    }
    tables(out, args, context)
}

fn sweep(args: &BenchArgs) -> Sweep {
    Sweep {
        matrix: args.sweep.matrix.clone(),
        cameras: args.sweep.cameras.clone().unwrap_or_default(),
        repeat: args.sweep.repeat.unwrap_or(1),
        seed: args.sweep.seed,
    }
}

fn launch(args: &BenchArgs, context: &Context) -> Launch {
    let engine = &args.engine;
    let here = || {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        (cores / engine.jobs.unwrap_or(1)).max(1)
    };
    let threads = context.threads.unwrap_or_else(|| if engine.on == On::Local { here() } else { CLUSTER_THREADS });
    Launch {
        on: engine.on,
        program: context.program.clone(),
        threads,
        jobs: engine.jobs,
        memory_gb: engine.memory_gb,
        partition: engine.partition.clone(),
        time: engine.time.clone(),
        wait: engine.wait,
        address: engine.address.clone(),
        python: engine.python.clone(),
    }
}

/// Refuses what `gic run` would refuse, for every case and scene, while nothing runs yet.
fn check(task: &Task) -> anyhow::Result<()> {
    let (args, given) = run_args(task, Path::new(""))?;
    let config = Config::resolve(args.flags().layers(&given)?)?;
    let scene = Scene::open_with(&task.scene_path, &config.scene).map_err(Error::stage("reading a scene"))?;
    Ok(config.validate(&scene)?)
}

/// The command line of a task's `gic run`.
fn run_args(task: &Task, out: &Path) -> anyhow::Result<(RunArgs, Given)> {
    let (cli, given) = super::parse(task.words(out).into_iter().map(Into::into))?;
    match cli.command {
        Command::Run(args) => Ok((args, given)),
        _ => unreachable!("the words are those of `gic run`"),
    }
}

/// Makes the tables of an output folder and prints them.
fn tables(out: &Path, args: &BenchArgs, context: &Context) -> anyhow::Result<()> {
    let found = collect(out, &args.others)?;
    for (task, reason) in &found.failures {
        context.events.warn(STAGE, format!("{task}: {reason}"));
    }
    context.print(found.text.trim_end())?;
    let done = found.tasks - found.failures.len();
    let [tables, page] = ["results.md", "suite.html"].map(|name| out.join(name).display().to_string());
    context.print(format!("{done} of {} tasks have a result; tables in {tables}, page {page}", found.tasks))?;
    Ok(())
}

fn export(method: Method, out: &Path, args: &BenchArgs, context: &Context) -> anyhow::Result<()> {
    let scenes = find_scenes(&args.suite, args.filter.as_deref().unwrap_or_default())?;
    let cameras = args.sweep.cameras.as_deref().map(camera_numbers).transpose()?;
    export_suite(method, &scenes, cameras.as_deref(), out, &context.events, &context.interrupt)?;
    Ok(context.print(format!("{} scenes in {}; run.sh there says how to go on", scenes.len(), out.display()))?)
}

fn camera_numbers(list: &str) -> crate::Result<Vec<usize>> {
    list.split(',').map(|number| number.trim().parse().ok()).collect::<Option<_>>().ok_or_else(|| Error::Usage {
        problem: format!("--cameras {list} is not one list of numbers"),
        hint: Some("an exported suite has one set of cameras, such as 0,4,8".into()),
    })
}

/// Runs one task to its record. A task that fails has a record, too, and is no success.
fn run_task(name: &str, out: &Path, context: &Context) -> anyhow::Result<()> {
    let out = std::path::absolute(out)?;
    let plan = Plan::read(&out)?;
    let task = plan.task(name)?;
    if Record::of(task, &out)?.is_some_and(|record| record.is_finished(task)) {
        context.events.note(STAGE, format!("{} is finished", task.label()));
        return Ok(());
    }
    begin(task, &out)?;
    let found = twin_and_evaluation(task, &out, context);
    let outcome = match &found {
        Ok(evaluation) => Outcome::Evaluation(evaluation.clone()),
        // It goes on when it is started again, or another process is at work on it.
        Err(error) if is_no_end(error) => return found.map(drop),
        Err(error) => Outcome::Failure(failure_text(error)),
    };
    let record = Record {
        gic_version: gic_twin::VERSION.into(),
        arguments: task.arguments.clone(),
        outcome,
        cost: cost(&task.run(&out)),
    };
    record.write(task, &out)?;
    found.map(drop)
}

fn twin_and_evaluation(task: &Task, out: &Path, context: &Context) -> anyhow::Result<Evaluation> {
    // Relative paths in the arguments start where the command was given.
    std::env::set_current_dir(&task.directory)?;
    let (args, given) = run_args(task, out)?;
    let truth = Truth::read(&task.scene_path.join("gt"))?;
    let layers = args.flags().layers(&given)?;
    let run = Run::open(&args.place.out, Access::Make, layers, &context.events, &context.interrupt)?;
    super::run::bring_up_to_date(&run)?;
    drop(run);
    Ok(evaluate(&args.place.out, None, &truth, &context.events, &context.interrupt)?)
}

/// Whether an error is none of the task's own: it was stopped, or another process runs it.
fn is_no_end(error: &anyhow::Error) -> bool {
    let locked = |cause: &(dyn std::error::Error + 'static)| {
        let twin = cause.downcast_ref::<Error>().and_then(|error| match error {
            Error::Twin(twin) => Some(twin),
            _ => None,
        });
        twin.is_some_and(|twin| matches!(twin, gic_twin::TwinError::Locked { .. }))
    };
    Explanation::of(error).is_interrupt || error.chain().any(locked)
}

/// An error with its causes, in a line.
fn failure_text(error: &anyhow::Error) -> String {
    let explanation = Explanation::of(error);
    let parts = std::iter::once(explanation.message).chain(explanation.causes);
    parts.collect::<Vec<_>>().join(": ").split_whitespace().collect::<Vec<_>>().join(" ")
}

/// What the stages of a run took, by its log; nothing where there is none.
fn cost(run: &Path) -> Cost {
    let threads = rayon::current_num_threads();
    let simd = Level::active().to_string();
    let Ok(history) = History::read(&run.join("log.jsonl")) else { return Cost { threads, simd, ..Cost::default() } };
    let stages: Vec<_> = Stage::ALL.iter().filter_map(|stage| history.costs.get(stage.name())).collect();
    Cost {
        wall_s: stages.iter().map(|stage| stage.seconds).sum(),
        cpu_s: stages.iter().map(|stage| stage.cpu_seconds).sum(),
        peak_memory_bytes: stages.iter().filter_map(|stage| stage.peak_memory_bytes).max(),
        threads,
        simd,
    }
}
