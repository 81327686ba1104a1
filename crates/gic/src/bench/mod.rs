//! `gic bench`: every scene of a folder, against the truth, as the paper's table.

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

use gic_scene::{Format, Scene};
use gic_twin::Interrupt;
use gic_twin::atomic;
use gic_twin::events::{Event, Events};
use serde::{Serialize, Serializer};

use crate::error::{Error, Result};
use crate::eval::evaluate;
use gic_bench::states::{self, SceneColumn, StateRow};
use gic_bench::{Evaluation, Truth};
use gic_metrics::mean_and_variance;

const STAGE: &str = "bench";

/// What to run, and how.
#[derive(Clone, Debug)]
pub struct BenchRequest {
    /// Folder of scenes, each with a `gt` folder.
    pub suite: PathBuf,
    /// Folder for the runs and the tables.
    pub out: PathBuf,
    /// Scenes run at the same time.
    pub jobs: usize,
    /// Only scenes whose name contains this.
    pub filter: String,
    /// The program that runs a scene: gic itself.
    pub program: PathBuf,
    /// Further arguments of `gic run`.
    pub arguments: Vec<String>,
}

/// A scene of the suite.
struct SuiteScene {
    name: String,
    scene: PathBuf,
    truth: Truth,
}

/// What became of a scene.
#[derive(Serialize)]
struct SceneOutcome {
    scene: String,
    /// The evaluation, or why there is none.
    #[serde(flatten)]
    result: std::result::Result<Evaluation, SceneFailure>,
}

/// The content of `results.json`.
#[derive(Serialize)]
struct SuiteJson<'a> {
    scenes: &'a [SceneOutcome],
    states: &'a [StateRow],
    table: &'a [ParameterRow],
}

/// Why a scene has no evaluation.
#[derive(Debug, thiserror::Error)]
enum SceneFailure {
    #[error("was not run")]
    NotRun,
    #[error("gic run ended with {status}; see {}", messages.display())]
    Run { status: ExitStatus, messages: PathBuf },
    #[error(transparent)]
    Evaluation(#[from] Error),
}

impl Serialize for SceneFailure {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// A row of the paper's table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParameterRow {
    /// Model of the material.
    pub model: String,
    /// The parameter, in the paper's words.
    pub parameter: String,
    /// Number of scenes.
    pub scenes: usize,
    /// Mean absolute error, times 100.
    pub mean: f64,
    /// Standard deviation of the absolute error over the scenes, times 100.
    pub deviation: f64,
    /// The paper's mean and standard deviation, where it has them.
    pub paper: Option<[f64; 2]>,
}

/// The paper's column "Ours" of its table of parameters: mean and standard deviation of the absolute error, times 100.
const PAPER: &[(&str, &str, [f64; 2])] = &[
    ("newtonian", "log10(mu)", [1.53, 1.31]),
    ("newtonian", "log10(kappa)", [14.8, 19.2]),
    ("newtonian", "v", [0.20, 0.07]),
    ("non-newtonian", "log10(mu)", [13.5, 18.2]),
    ("non-newtonian", "log10(kappa)", [12.9, 16.8]),
    ("non-newtonian", "log10(tau_Y)", [4.80, 3.92]),
    ("non-newtonian", "log10(eta)", [40.7, 24.6]),
    ("non-newtonian", "v", [0.19, 0.09]),
    ("elastic", "log10(E)", [2.43, 3.29]),
    ("elastic", "nu", [2.52, 2.03]),
    ("elastic", "v", [0.82, 0.32]),
    ("plasticine", "log10(E)", [25.6, 29.4]),
    ("plasticine", "log10(tau_Y)", [1.67, 1.21]),
    ("plasticine", "nu", [9.59, 5.00]),
    ("plasticine", "v", [0.22, 0.10]),
    ("sand", "theta_fric", [4.18, 0.52]),
    ("sand", "v", [0.17, 0.05]),
];

/// The tables of a suite.
#[derive(Clone, Debug, PartialEq)]
pub struct Tables {
    /// Errors of the parameters.
    pub parameters: Vec<ParameterRow>,
    /// Observed and future states, as Markdown.
    pub states: String,
}

/// Runs every scene and writes `results.md`, `results.csv` and `results.json`.
///
/// A scene that fails is named in the tables and does not stop the others.
///
/// # Errors
/// No scenes, an unwritable folder, an interrupt.
pub fn bench(request: &BenchRequest, events: &Events, interrupt: &Interrupt) -> Result<Tables> {
    let jobs = find(&request.suite, &request.filter)?;
    atomic::create_folder(&request.out)?;
    let reason = format!("{} scenes, {} at a time", jobs.len(), request.jobs);
    events.send(&Event::StageStarted { stage: STAGE.into(), reason });
    let statuses = run_all(request, &jobs, events, interrupt)?;
    let mut outcomes = Vec::new();
    for (job, status) in jobs.iter().zip(statuses) {
        let result = match status {
            Ok(()) => evaluate(&request.out.join(&job.name), None, &job.truth, &Events::silent(), interrupt)
                .map_err(SceneFailure::from),
            Err(reason) => Err(reason),
        };
        if let Err(reason) = &result {
            events.warn(STAGE, format!("{}: {reason}", job.name));
        }
        outcomes.push(SceneOutcome { scene: job.name.clone(), result });
    }
    let rows = table(outcomes.iter().filter_map(|o| o.result.as_ref().ok()));
    let columns: Vec<SceneColumn> = jobs.iter().zip(&outcomes).map(|(job, outcome)| column(job, outcome)).collect();
    let states = states::rows(&columns);
    let text = markdown(&rows, &outcomes) + &states::markdown(&states, &columns);
    atomic::write(&request.out.join("results.md"), text.as_bytes())?;
    atomic::write(&request.out.join("results.csv"), csv(&outcomes).as_bytes())?;
    let all = SuiteJson { scenes: &outcomes, states: &states, table: &rows };
    atomic::write_json(&request.out.join("results.json"), &all)?;
    Ok(Tables { parameters: rows, states: states::markdown(&states, &columns) })
}

fn column<'a>(job: &'a SuiteScene, outcome: &'a SceneOutcome) -> SceneColumn<'a> {
    let format = Scene::open(&job.scene).map(|scene| scene.format);
    SceneColumn {
        name: &job.name,
        spring_gaus: format.is_ok_and(|format| format == Format::SpringGausSynthetic),
        evaluation: outcome.result.as_ref().ok(),
    }
}

fn find(suite: &Path, filter: &str) -> Result<Vec<SuiteScene>> {
    let entries = std::fs::read_dir(suite).map_err(Error::read(suite))?;
    let mut scenes: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.join("gt/params.json").is_file())
        .collect();
    scenes.sort();
    let jobs: Vec<SuiteScene> = scenes
        .into_iter()
        .map(|scene| (scene.file_name().unwrap_or_default().to_string_lossy().into_owned(), scene))
        .filter(|(name, _)| name.contains(filter))
        .map(|(name, scene)| Ok(SuiteScene { name, truth: Truth::read(&scene.join("gt"))?, scene }))
        .collect::<Result<_>>()?;
    if jobs.is_empty() {
        return Err(Error::Usage {
            problem: format!("{} has no scene with gt/params.json whose name contains \"{filter}\"", suite.display()),
            hint: Some("give the folder that holds the scenes' folders".into()),
        });
    }
    Ok(jobs)
}

/// Runs the scenes in processes of their own, so that each has its own peak of memory and one that dies harms no other.
fn run_all(
    request: &BenchRequest,
    jobs: &[SuiteScene],
    events: &Events,
    interrupt: &Interrupt,
) -> Result<Vec<std::result::Result<(), SceneFailure>>> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = (cores / request.jobs).max(1);
    let mut statuses: Vec<_> = jobs.iter().map(|_| Err(SceneFailure::NotRun)).collect();
    let mut waiting: VecDeque<usize> = (0..jobs.len()).collect();
    let mut running: Vec<(usize, Child)> = Vec::new();
    let mut done = 0;
    while !(waiting.is_empty() && running.is_empty()) {
        while running.len() < request.jobs && !interrupt.requested() {
            let Some(index) = waiting.pop_front() else { break };
            running.push((index, start(request, &jobs[index], threads)?));
        }
        std::thread::sleep(Duration::from_millis(50));
        let mut still = Vec::new();
        for (index, mut child) in running {
            match child.try_wait().map_err(Error::read(&request.program))? {
                None => still.push((index, child)),
                Some(status) => {
                    let out = request.out.join(&jobs[index].name);
                    statuses[index] = if status.success() {
                        Ok(())
                    } else {
                        Err(SceneFailure::Run { status, messages: out.join("messages.txt") })
                    };
                    done += 1;
                    events.step(STAGE, "", done, Some(jobs.len() as u64), &[]);
                    events.note(
                        STAGE,
                        format!("{} {}", jobs[index].name, if status.success() { "done" } else { "FAILED" }),
                    );
                }
            }
        }
        running = still;
        // The runs get the same Ctrl-C; each saves its state and ends.
        if interrupt.requested() && running.is_empty() {
            return Err(Error::Interrupted {
                after: format!("{done} of {} scenes", jobs.len()),
                resume: "run the same command again; scenes go on where they stopped".into(),
            });
        }
    }
    Ok(statuses)
}

fn start(request: &BenchRequest, job: &SuiteScene, threads: usize) -> Result<Child> {
    let out = request.out.join(&job.name);
    atomic::create_folder(&out)?;
    let messages = out.join("messages.txt");
    let file = std::fs::File::create(&messages).map_err(Error::write(&messages))?;
    Command::new(&request.program)
        .arg("run")
        .arg(&job.scene)
        .arg("-o")
        .arg(&out)
        // The model is given to the method, as in the paper; nothing else of the truth is.
        .args(["--material", job.truth.material.model(), "--threads", &threads.to_string()])
        .args(&request.arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(file)
        .spawn()
        .map_err(Error::read(&request.program))
}

fn table<'a>(evaluations: impl Iterator<Item = &'a Evaluation>) -> Vec<ParameterRow> {
    let mut errors: BTreeMap<(String, String), Vec<f64>> = BTreeMap::new();
    for e in evaluations {
        for p in &e.parameters {
            errors.entry((e.model.clone(), p.paper_name.clone())).or_default().push(p.error_x100);
        }
        errors.entry((e.model.clone(), "v".into())).or_default().push(e.velocity.error_x100);
    }
    let row = |((model, parameter), errors): ((String, String), Vec<f64>)| {
        let (mean, variance) = mean_and_variance(&errors);
        let paper = PAPER.iter().find(|(m, p, _)| *m == model && *p == parameter).map(|(_, _, numbers)| *numbers);
        ParameterRow { model, parameter, scenes: errors.len(), mean, deviation: variance.sqrt(), paper }
    };
    errors.into_iter().map(row).collect()
}

fn markdown(rows: &[ParameterRow], outcomes: &[SceneOutcome]) -> String {
    let mut text = String::from(
        "# Mean absolute error x100\n\nModuli, viscosities and yield stresses as log10, nu as is, the friction angle \
         in radians, v in m/s: the units of the paper's table.\n\n\
         | material | parameter | scenes | gic | paper (GIC) |\n|---|---|---|---|---|\n",
    );
    for r in rows {
        let paper = r.paper.map_or("-".into(), |[mean, deviation]| format!("{mean} ± {deviation}"));
        text += &format!(
            "| {} | {} | {} | {:.2} ± {:.2} | {paper} |\n",
            r.model, r.parameter, r.scenes, r.mean, r.deviation
        );
    }
    text += "\n# Scenes\n\n\
             | scene | parameter | estimate | 95 % interval | truth | error x100 | inside | determined |\n\
             |---|---|---|---|---|---|---|---|\n";
    for outcome in outcomes {
        match &outcome.result {
            Err(reason) => text += &format!("| {} | {reason} | | | | | | |\n", outcome.scene),
            Ok(e) => {
                for p in &e.parameters {
                    text += &format!(
                        "| {} | {} | {:.5e} | {:.4e} .. {:.4e} | {:.5e} | {:.2} | {} | {} |\n",
                        outcome.scene,
                        p.name,
                        p.estimate,
                        p.interval_95[0],
                        p.interval_95[1],
                        p.truth,
                        p.error_x100,
                        if p.inside { "yes" } else { "no" },
                        if p.identifiable { "yes" } else { "no" }
                    );
                }
                text += &format!(
                    "| {} | v | | | | {:.2} | {} of 3 | |\n",
                    outcome.scene, e.velocity.error_x100, e.velocity.inside
                );
            }
        }
    }
    text
}

fn csv(outcomes: &[SceneOutcome]) -> String {
    let mut text = String::from("scene,model,parameter,estimate,low_95,high_95,truth,error_x100,inside,identifiable\n");
    for (scene, e) in outcomes.iter().filter_map(|o| Some((&o.scene, o.result.as_ref().ok()?))) {
        for p in &e.parameters {
            text += &format!(
                "{scene},{},{},{},{},{},{},{},{},{}\n",
                e.model,
                p.name,
                p.estimate,
                p.interval_95[0],
                p.interval_95[1],
                p.truth,
                p.error_x100,
                p.inside,
                p.identifiable
            );
        }
        text += &format!("{scene},{},velocity,,,,,{},,\n", e.model, e.velocity.error_x100);
    }
    text
}
