//! `report.html`: one file that opens offline, with everything that a run found.

mod views;

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use gic_twin::atomic;
use gic_twin::events::{Event, Events};
use gic_view::html::escape;
use gic_view::report::{Series, chart, short_number};

use crate::error::{Error, Result};
use crate::pipeline::{IdentifyRecord, Run, Selection, Stage};

const STAGE: &str = "report";

/// Writes the report of a finished run.
///
/// # Errors
/// Missing results, pictures that cannot be read, an unwritable folder.
pub fn write(run: &Run, events: &Events) -> Result<()> {
    let found = run.identified()?;
    let history = history(&run.folder().join("log.jsonl"))?;
    let mut page = head(&found.model);
    page += &estimates(&found);
    page += &run.selection_if_any()?.map_or_else(String::new, |selection| ranking(&selection));
    page += &views::views(run, &found, events)?;
    page += &format!("<h2>Curves</h2><div class=\"charts\">{}</div>", curves(&found, &history));
    page += &costs(&history, &found);
    page += &settings(run)?;
    page += "</body></html>\n";
    let path = run.folder().join("report.html");
    atomic::write(&path, page.as_bytes())?;
    events.note(STAGE, format!("open {} in a browser", path.display()));
    Ok(())
}

fn head(model: &str) -> String {
    format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">\
         <title>gic: {0} twin</title><style>{1}</style></head>\
         <body><h1>Digital twin: {0}</h1>",
        escape(model),
        include_str!("style.css")
    )
}

fn estimates(found: &IdentifyRecord) -> String {
    let mut text = String::from(
        "<h2>Estimate</h2>\
         <table><tr><th>parameter</th><th>estimate</th><th>95 % interval</th><th>on a finer grid</th><th></th></tr>",
    );
    for e in &found.estimates {
        let verdict = match (e.fixed, e.identifiable) {
            (true, _) => "given",
            (false, true) => "determined",
            (false, false) => "<b>not determined by this video</b>",
        };
        let shift = e
            .resolution_shift
            .map_or("-".into(), |shift| format!("{}{}", if shift < 0.0 { "" } else { "+" }, short_number(shift)));
        let _ = write!(
            text,
            "<tr><td>{}</td><td>{:.5e}</td><td>{:.4e} .. {:.4e}</td><td>{shift}</td><td>{verdict}</td></tr>",
            escape(&e.name),
            e.value,
            e.interval_95[0],
            e.interval_95[1]
        );
    }
    for (letter, v, interval) in found.velocity_components() {
        let interval = interval.map_or("not known".into(), |[low, high]| format!("{low:.4} .. {high:.4}"));
        let _ = write!(
            text,
            "<tr><td>initial velocity {letter} [m/s]</td><td>{v:.4}</td><td>{interval}</td><td></td><td></td></tr>"
        );
    }
    let [x, y, z] = found.angular_velocity_rad_s;
    let _ = write!(
        text,
        "</table><p>Initial angular velocity ({x:.3}, {y:.3}, {z:.3}) rad/s. \
         Mean distance of surfaces {:.2} mm; masks differ in {:.2} % \
         of the object's pixels; nothing is touched in the first {} frames.</p>",
        1e3 * found.chamfer_m,
        100.0 * found.mask_error,
        found.free_frames
    );
    for warning in &found.warnings {
        let _ = write!(text, "<p class=\"warning\">{}</p>", escape(warning));
    }
    text
}

/// The laws, by how they predict frames that they were not fitted to.
fn ranking(selection: &Selection) -> String {
    let mut text = format!(
        "<h2>Law</h2><p>Each law was fitted to the first {} frames and predicted the others. \
         The run goes on with <b>{}</b>; {}.</p>\
         <table><tr><th>law</th><th>differing pixels, fitted</th><th>predicted</th><th></th></tr>",
        selection.fitted_frames,
        escape(&selection.chosen),
        escape(&selection.certainty())
    );
    for law in &selection.laws {
        let percent = |share: f64| if share.is_finite() { format!("{:.2} %", 100.0 * share) } else { "-".into() };
        let standing = if law.model == selection.chosen {
            "chosen"
        } else if !law.in_full {
            "far off after a rough fit"
        } else {
            ""
        };
        let remark = law.failure.as_deref().unwrap_or(standing);
        let _ = write!(
            text,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            escape(&law.model),
            percent(law.fit_error.unwrap_or(f64::NAN)),
            percent(law.prediction_error()),
            escape(remark)
        );
    }
    text + "</table>"
}

/// Values of steps by phase and number, ascending in number within a phase.
type Steps = BTreeMap<(String, u64), BTreeMap<String, f64>>;

/// What the log says about the last time that each stage ran.
#[derive(Default)]
struct History {
    /// Per stage.
    steps: BTreeMap<String, Steps>,
    /// Per stage: wall-clock seconds, CPU seconds, peak memory [bytes].
    costs: BTreeMap<String, (f64, Option<f64>, Option<u64>)>,
}

fn history(path: &Path) -> Result<History> {
    let text = std::fs::read_to_string(path).map_err(Error::read(path))?;
    let mut history = History::default();
    // A line that was cut off by a crash says nothing.
    for event in text.lines().filter_map(|line| serde_json::from_str::<Event>(line).ok()) {
        match event {
            Event::Step { stage, phase, step, values, .. } => {
                history.steps.entry(stage).or_default().insert((phase, step), values);
            }
            Event::StageStarted { stage, reason } if reason.starts_with("runs again") => {
                history.steps.remove(&stage);
            }
            Event::StageDone { stage, seconds, cpu_seconds, peak_memory_bytes } => {
                history.costs.insert(stage, (seconds, cpu_seconds, peak_memory_bytes));
            }
            _ => (),
        }
    }
    Ok(history)
}

fn curves(found: &IdentifyRecord, history: &History) -> String {
    let mut text = String::new();
    if let Some(steps) = history.steps.get("reconstruct") {
        for (key, caption, logarithmic) in [
            ("loss", "reconstruction: loss over steps", true),
            ("psnr_db", "reconstruction: PSNR [dB] over steps", false),
            ("held_out_psnr_db", "reconstruction: PSNR [dB] of held-out views", false),
        ] {
            let mut points: Vec<(f64, f64)> =
                steps.iter().filter_map(|((_, step), values)| Some((*step as f64, *values.get(key)?))).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            text += &chart(caption, &[Series { name: key.into(), points }], logarithmic);
        }
    }
    let mut stages: Vec<&str> = Vec::new();
    for step in &found.trace {
        if !stages.contains(&step.stage.as_str()) {
            stages.push(&step.stage);
        }
    }
    for stage in stages {
        let steps = || found.trace.iter().enumerate().filter(move |(_, s)| s.stage == stage);
        let points = steps().map(|(i, s)| (i as f64, s.objective)).collect();
        text += &chart(
            &format!("identification, {stage}: objective over steps"),
            &[Series { name: stage.into(), points }],
            true,
        );
    }
    for (i, e) in found.estimates.iter().enumerate() {
        let points = found.trace.iter().enumerate().filter_map(|(n, s)| Some((n as f64, *s.values.get(i)?))).collect();
        let logarithmic = e.name != "poisson_ratio" && e.name != "friction_angle_deg";
        text += &chart(&format!("{} over steps", e.name), &[Series { name: e.name.clone(), points }], logarithmic);
    }
    let axis = |i: usize| found.trace.iter().enumerate().map(move |(n, s)| (n as f64, s.velocity_m_s[i])).collect();
    let velocity: Vec<Series> =
        ["x", "y", "z"].iter().enumerate().map(|(i, name)| Series { name: (*name).into(), points: axis(i) }).collect();
    text + &chart("initial velocity [m/s] over steps", &velocity, false)
}

fn costs(history: &History, found: &IdentifyRecord) -> String {
    let mut text = String::from(
        "<h2>Times and memory</h2>\
         <table><tr><th>stage</th><th>seconds</th><th>CPU seconds</th><th>peak memory [MiB]</th></tr>",
    );
    for stage in Stage::ALL.map(Stage::name) {
        if let Some((seconds, cpu, memory)) = history.costs.get(stage) {
            let cpu = cpu.map_or("-".into(), |s| format!("{s:.1}"));
            let memory = memory.map_or("-".into(), |bytes| format!("{}", bytes >> 20));
            let _ = write!(text, "<tr><td>{stage}</td><td>{seconds:.1}</td><td>{cpu}</td><td>{memory}</td></tr>");
        }
    }
    let parts: Vec<String> = found.seconds.iter().map(|(stage, s)| format!("{stage} {s:.1} s")).collect();
    let _ = write!(
        text,
        "</table><p>Identification: {}; {} rollouts, and {} on a coarse grid.</p>",
        escape(&parts.join(", ")),
        found.rollouts,
        found.coarse_rollouts
    );
    text
}

fn settings(run: &Run) -> Result<String> {
    let path = run.folder().join("config.toml");
    let text = std::fs::read_to_string(&path).map_err(Error::read(&path))?;
    Ok(format!(
        "<h2>Settings</h2><details><summary>config.toml</summary><pre>{}</pre></details><p>gic {}</p>",
        escape(&text),
        gic_twin::VERSION
    ))
}
