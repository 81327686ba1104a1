//! Which tuned numbers move the result: each is halved and doubled, one at a time, on finished runs of several scenes.
//!
//! ```text
//! cargo run --release -p gic --example sensitivity -- [--flight | --identify] [--only PREFIX]...
//!     [--change KEY=VALUE]... -o OUT RUN...
//! ```
//!
//! Every RUN keeps its reconstruction; what follows is made anew with today's numbers, and then, as far as it depends
//! on it, with one number changed. What moved is told against today's numbers: volumes at the first frame and later,
//! overlap with the masks, the share of the surface that pictures tell, parameters (log10 of moduli, viscosities and
//! yield stresses) and velocity, the logarithms of their intervals' half-widths and of the number of rollouts, what is
//! called determined, and the path of the centre of mass. The scatter to compare with is what other seeds move,
//! reconstruction included. A number that moves a scene by more than [`CLEARLY`] scatters is not varied further.
//!
//! `--flight` ends with the body that the free flight settles, for the numbers of filling: a number that moves it is
//! in use, and one that does not may still move the fits that follow. `--identify` keeps the body that refinement left
//! and fits it anew, for those of identification: one that does not move this fit may still move refinement. `--only`
//! takes the numbers whose keys begin with a PREFIX, `--change` a value of its own in place of both, such as one that
//! switches a number's branch off. A line per change is appended to `OUT/effects.jsonl`; what stands there already is
//! not measured again, and several of these programs may share it.

use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use gic::config::Layer;
use gic::pipeline::{Access, Run, Stage};
use gic_twin::Interrupt;
use gic_twin::events::Events;
use gic_twin::simulate::Trajectory;
use serde::{Deserialize, Serialize};
use serde_json::Value;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// The mean volume of the frames after the first, as filling finds it.
const LATER: &str = "later_volume_m3";

/// The key of the seed.
const SEED: &str = "seed";

/// Seeds whose results are the scatter.
const SEEDS: [u64; 3] = [1, 2, 3];

/// A number that moves a result by more than so many scatters is in use.
const CLEARLY: f64 = 2.0;

fn main() -> Result<()> {
    let options = Options::parse()?;
    fs::create_dir_all(&options.out)?;
    let log = options.out.join("effects.jsonl");
    for run in &options.runs {
        let scene = run.file_name().and_then(|n| n.to_str()).ok_or("a run folder has no name")?.to_owned();
        let reference = options.out.join(&scene).join("reference");
        if !reference.exists() {
            copy_reconstruction(run, &reference)?;
        }
        let base = measure(&reference, &[], options.part)?;
        for (key, change) in changes(&options) {
            let part = if key == SEED && options.part == Part::Identify { Part::All } else { options.part };
            let known = effects(&log)?;
            let is_known = known.iter().any(|e| e.scene == scene && e.change == change && e.part == part);
            let is_in_use = moves(&known).get(key.as_str()).is_some_and(|most| most.scatters > CLEARLY);
            if is_known || is_in_use && options.changes.is_empty() {
                continue;
            }
            let scratch = options.out.join(&scene).join(format!("scratch-{}", std::process::id()));
            copy(&reference, &scratch)?;
            if part == Part::Identify {
                keep_refined(&scratch, &change)?;
            }
            let moved = match measure(&scratch, std::slice::from_ref(&change), part) {
                Ok(found) => found.against(&base),
                Err(error) => BTreeMap::from([(format!("error: {error}"), f64::MAX)]),
            };
            fs::remove_dir_all(&scratch)?;
            let effect = Effect { scene: scene.clone(), key, change, part, moved };
            let line = serde_json::to_string(&effect)? + "\n";
            fs::OpenOptions::new().create(true).append(true).open(&log)?.write_all(line.as_bytes())?;
        }
    }
    print!("{}", table(&effects(&log)?));
    Ok(())
}

/// Every change that is measured, by the key of what changes: other seeds first, then those that were asked for, or
/// each number halved and doubled.
fn changes(options: &Options) -> Vec<(String, String)> {
    let Options { part, only, .. } = options;
    let seeds = SEEDS.iter().map(|seed| (SEED.to_owned(), format!("{SEED}={seed}")));
    if !options.changes.is_empty() {
        let key = |change: &String| change.split('=').next().unwrap_or_default().to_owned();
        return seeds.chain(options.changes.iter().map(|change| (key(change), change.clone()))).collect();
    }
    let asked = |key: &str| {
        key.starts_with(part.prefix()) && (only.is_empty() || only.iter().any(|prefix| key.starts_with(prefix)))
    };
    let numbers = numbers().into_iter().filter(|(key, _)| asked(key));
    let varied = numbers.flat_map(|(key, value)| varied(&value).map(move |v| (key.clone(), format!("{key}={v}"))));
    seeds.chain(varied).collect()
}

/// What has been measured.
fn effects(log: &Path) -> Result<Vec<Effect>> {
    match fs::read_to_string(log) {
        Ok(text) => Ok(text.lines().map(serde_json::from_str).collect::<std::result::Result<_, _>>()?),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err(error.into()),
    }
}

/// What of a run is made anew for a number.
#[derive(Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Part {
    /// What follows the reconstruction, up to the body that the free flight settles.
    Flight,
    /// The last fit alone.
    Identify,
    /// All that follows the reconstruction.
    All,
}

impl Part {
    /// What the keys of the numbers that it depends on begin with.
    fn prefix(self) -> &'static str {
        match self {
            Part::Flight => "fill.",
            Part::Identify => "identify.tuning.",
            Part::All => "",
        }
    }
}

/// What the command line asks for.
struct Options {
    runs: Vec<PathBuf>,
    out: PathBuf,
    only: Vec<String>,
    changes: Vec<String>,
    part: Part,
}

impl Options {
    fn parse() -> Result<Self> {
        let mut options =
            Self { runs: Vec::new(), out: PathBuf::new(), only: Vec::new(), changes: Vec::new(), part: Part::All };
        let mut arguments = std::env::args().skip(1);
        while let Some(argument) = arguments.next() {
            match argument.as_str() {
                "--flight" => options.part = Part::Flight,
                "--identify" => options.part = Part::Identify,
                "--only" => options.only.push(arguments.next().ok_or("--only needs a prefix")?),
                "--change" => options.changes.push(arguments.next().ok_or("--change needs KEY=VALUE")?),
                "-o" => options.out = arguments.next().ok_or("-o needs a folder")?.into(),
                _ => options.runs.push(argument.into()),
            }
        }
        if options.runs.is_empty() || options.out.as_os_str().is_empty() {
            return Err("give -o OUT and the folders of finished runs".into());
        }
        if let Some(change) = options.changes.iter().find(|change| !change.starts_with(options.part.prefix())) {
            return Err(format!("--change {change} is none of the numbers that this part depends on").into());
        }
        Ok(options)
    }
}

/// One number changed on one scene.
#[derive(Serialize, Deserialize)]
struct Effect {
    scene: String,
    key: String,
    /// The setting, as `--set` takes it.
    change: String,
    /// What was made anew.
    part: Part,
    /// By how much each result differs from that with today's numbers.
    moved: BTreeMap<String, f64>,
}

/// Every tuned number, by its key, with today's value.
fn numbers() -> Vec<(String, Value)> {
    let mut all = Vec::new();
    let fill = serde_json::to_value(gic_continuum::Tuning::default());
    let identify = serde_json::to_value(gic_identify::Tuning::default());
    leaves("fill.tuning", fill.unwrap_or_default(), &mut all);
    leaves("identify.tuning", identify.unwrap_or_default(), &mut all);
    all
}

fn leaves(key: &str, value: Value, all: &mut Vec<(String, Value)>) {
    match value {
        Value::Object(inner) => {
            inner.into_iter().for_each(|(name, value)| leaves(&format!("{key}.{name}"), value, all))
        }
        value => all.push((key.to_owned(), value)),
    }
}

/// A value halved and doubled, as TOML; counts stay at least 1, switches are turned over.
fn varied(value: &Value) -> impl Iterator<Item = String> + use<> {
    fn scaled(value: &Value, factor: f64) -> String {
        match value {
            Value::Number(n) if n.is_u64() => ((n.as_f64().unwrap_or(0.0) * factor) as u64).max(1).to_string(),
            Value::Number(n) => format!("{:?}", n.as_f64().unwrap_or(0.0) * factor),
            Value::Array(items) => {
                format!("[{}]", items.iter().map(|v| scaled(v, factor)).collect::<Vec<_>>().join(", "))
            }
            Value::Bool(on) => (!on).to_string(),
            other => other.to_string(),
        }
    }
    let mut found = vec![scaled(value, 0.5), scaled(value, 2.0)];
    let today = scaled(value, 1.0);
    found.dedup();
    found.into_iter().filter(move |v| *v != today)
}

/// Results by name: a volume, `mask_iou`, a parameter (log10 where it is a modulus), a component, a path [mm].
struct Results {
    numbers: BTreeMap<String, f64>,
    /// Centre of mass in every frame [m].
    path: Vec<[f64; 3]>,
}

impl Results {
    fn against(&self, base: &Self) -> BTreeMap<String, f64> {
        let mut moved: BTreeMap<String, f64> = self
            .numbers
            .iter()
            .filter_map(|(name, value)| Some((name.clone(), value - base.numbers.get(name)?)))
            .collect();
        for (volume, percent) in [("volume_m3", "volume_percent"), (LATER, "later_volume_percent")] {
            let (change, whole) = (moved.remove(volume), base.numbers.get(volume));
            moved.extend(change.zip(whole).map(|(change, whole)| (percent.to_owned(), 100.0 * change / whole)));
        }
        let apart = |(a, b): (&[f64; 3], &[f64; 3])| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
        let farthest = self.path.iter().zip(&base.path).map(apart).fold(0.0, f64::max);
        moved.insert("path_mm".into(), 1e3 * farthest);
        moved
    }
}

/// A run in `folder` with nothing but the reconstruction of `run`.
fn copy_reconstruction(run: &Path, folder: &Path) -> Result<()> {
    let _ = fs::remove_dir_all(folder);
    copy(&run.join("gaussians"), &folder.join("gaussians"))?;
    fs::create_dir_all(folder.join("stamps"))?;
    for file in ["config.toml", "stamps/reconstruct.json"] {
        fs::copy(run.join(file), folder.join(file))?;
    }
    Ok(())
}

/// Lets the run in `folder` take its refined body for one that was made with a changed number of identification: the
/// number is written into what the stage says of its settings.
fn keep_refined(folder: &Path, change: &str) -> Result<()> {
    let stamp = folder.join("stamps/refine.json");
    let mut recipe: Value = read(&stamp)?;
    let changed: Value = toml::from_str(change)?;
    let tuning: gic_identify::Tuning = serde_json::from_value(changed["identify"]["tuning"].clone())?;
    recipe["settings"]["identify"]["tuning"] = serde_json::to_value(tuning)?;
    Ok(fs::write(stamp, serde_json::to_vec_pretty(&recipe)?)?)
}

/// Makes the stages of the run in `folder` anew that `changes` touch, and reads their results.
fn measure(folder: &Path, changes: &[String], part: Part) -> Result<Results> {
    let layers = vec![Layer::from_assignments(changes.iter().map(String::as_str))?];
    let (events, interrupt) = (Events::default(), Interrupt::default());
    let run = Run::open(folder, Access::GoOn, layers, &events, &interrupt)?;
    if part == Part::Flight {
        settle_in_flight(&run, &interrupt)?;
    } else {
        run.bring_up_to_date(Stage::Predict)?;
    }
    let body = run.body_summary()?;
    let first = body.frames.first().ok_or("no frame was filled")?;
    let later = &body.frames[1..];
    let mean = later.iter().map(|frame| frame.volume_m3).sum::<f64>() / later.len().max(1) as f64;
    let mut numbers = BTreeMap::from([("volume_m3".to_owned(), first.volume_m3), (LATER.to_owned(), mean)]);
    numbers.extend(first.mask_iou.map(|overlap| ("mask_iou".to_owned(), overlap)));
    numbers.extend(body.told_share.map(|share| ("told_share".to_owned(), share)));
    if part == Part::Flight {
        return Ok(Results { numbers, path: Vec::new() });
    }
    let found = run.identified()?;
    for estimate in &found.estimates {
        let is_logarithmic = !matches!(estimate.name.as_str(), "poisson_ratio" | "friction_angle_deg");
        let place = |value: f64| if is_logarithmic { value.log10() } else { value };
        let half_width = 0.5 * (place(estimate.interval_95[1]) - place(estimate.interval_95[0]));
        numbers.insert(estimate.name.clone(), place(estimate.value));
        numbers.insert(format!("log10 of the half-width of {}", estimate.name), half_width.log10());
        numbers.insert(format!("{} is determined", estimate.name), f64::from(estimate.identifiable));
    }
    numbers.insert("log10 of rollouts".into(), (found.rollouts as f64).log10());
    for (axis, value) in ["x", "y", "z"].into_iter().zip(found.velocity_m_s) {
        numbers.insert(format!("velocity_{axis}_m_s"), value);
    }
    for (axis, half) in ["x", "y", "z"].into_iter().zip(found.velocity_interval_95_m_s.into_iter().flatten()) {
        numbers.insert(format!("log10 of the half-width of velocity_{axis}"), half.log10());
    }
    numbers.retain(|_, number| number.is_finite());
    let trajectory: Trajectory = read(&folder.join("prediction/trajectory.json"))?;
    Ok(Results { numbers, path: trajectory.frames.iter().map(|f| f.centre_of_mass_m).collect() })
}

/// Brings the run up to the first body that refinement leaves, which is the one that the free flight settles.
fn settle_in_flight(run: &Run, interrupt: &Interrupt) -> Result<()> {
    let settled = run.folder().join("refined/refine.json");
    if settled.exists() {
        fs::remove_file(&settled)?;
    }
    let result = std::thread::scope(|scope| {
        let working = scope.spawn(|| run.bring_up_to_date(Stage::Refine));
        while !working.is_finished() && !settled.exists() {
            std::thread::sleep(Duration::from_millis(100));
        }
        interrupt.request();
        working.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    });
    match result {
        Err(error) if !settled.exists() => Err(error.into()),
        _ => Ok(()),
    }
}

fn copy(from: &Path, to: &Path) -> Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            copy(&entry.path(), &target)?
        } else {
            fs::copy(entry.path(), target).map(|_| ())?
        }
    }
    Ok(())
}

fn read<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T> {
    Ok(serde_json::from_slice(&fs::read(path)?)?)
}

/// What a number moves most, of all scenes and results.
#[derive(Default)]
struct Most<'a> {
    scatters: f64,
    what: String,
    scenes: BTreeSet<&'a str>,
}

/// By number, what it moves most.
fn moves(effects: &[Effect]) -> BTreeMap<&str, Most<'_>> {
    let mut scatter: BTreeMap<(&str, &str), f64> = BTreeMap::new();
    for effect in effects.iter().filter(|e| e.key == SEED) {
        for (name, value) in &effect.moved {
            let largest = scatter.entry((effect.scene.as_str(), name.as_str())).or_default();
            *largest = largest.max(value.abs());
        }
    }
    let mut rows: BTreeMap<&str, Most> = BTreeMap::new();
    for effect in effects.iter().filter(|e| e.key != SEED) {
        let row = rows.entry(effect.key.as_str()).or_default();
        row.scenes.insert(effect.scene.as_str());
        for (name, value) in &effect.moved {
            let one = scatter.get(&(effect.scene.as_str(), name.as_str())).copied().unwrap_or(0.0);
            let scatters = if *value == 0.0 { 0.0 } else { value.abs() / one.max(f64::MIN_POSITIVE) };
            if scatters > row.scatters {
                row.scatters = scatters;
                row.what = format!("{name} {value:+.3e} on {} ({})", effect.scene, effect.change);
            }
        }
    }
    rows
}

/// A row per number: how far it moves each result at most, in scatters, and how many scenes were looked at.
fn table(effects: &[Effect]) -> String {
    let mut text = String::from("| number | most it moves [scatters] | what | scenes |\n|---|---|---|---|\n");
    for (key, most) in moves(effects) {
        text += &format!("| {key} | {:.1} | {} | {} |\n", most.scatters, most.what, most.scenes.len());
    }
    text
}
