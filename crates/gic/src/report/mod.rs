//! `report.html`: one file that opens offline, with everything that a run found.

mod curves;
mod estimate;
pub(crate) mod history;
mod pictures;
mod truth;

use gic_files::FileError;
use gic_twin::atomic;
use gic_twin::events::Events;
use gic_view::page::{VIEWER_TEMPLATES, Viewer};
use gic_view::render::SimulatedMotion;
use gic_view::template::{self, Template};
use serde::Serialize;

use crate::error::Result;
use crate::pipeline::{CameraRecord, IdentifyRecord, Run, Selection, Stage};
use estimate::EstimateRow;
use history::History;
use pictures::Pictures;
use truth::RunTruth;

const STAGE: &str = "report";
const TEMPLATES: [Template; 3] = [
    ("report.html", include_str!("report.html")),
    ("report.css", include_str!("report.css")),
    ("report.js", include_str!("report.js")),
];

/// What the template fills in.
#[derive(Serialize)]
struct Report {
    model: String,
    verdict: estimate::Verdict,
    warnings: Vec<String>,
    rows: Vec<EstimateRow>,
    has_truth: bool,
    remarks: Vec<String>,
    selection: Option<Ranking>,
    /// Numbers of fitted frames and of all.
    fitted_frames: usize,
    frames: usize,
    has_colors: bool,
    cameras: Vec<String>,
    /// The video and the twin's pictures: JSON.
    video: String,
    overlays: String,
    viewer: Viewer,
    overlap: String,
    curves: Vec<curves::Group>,
    costs: Vec<CostRow>,
    parts: Vec<String>,
    config: String,
    version: &'static str,
}

/// What a stage took.
#[derive(Serialize)]
struct CostRow {
    stage: &'static str,
    seconds: String,
    cpu_seconds: String,
    peak_memory_mib: String,
}

/// The laws, by how they predict frames that they were not fitted to.
#[derive(Serialize)]
struct Ranking {
    fitted_frames: usize,
    chosen: String,
    certainty: String,
    laws: Vec<LawRow>,
}

#[derive(Serialize)]
struct LawRow {
    model: String,
    fitted: String,
    predicted: String,
    remark: String,
}

/// Writes the report of a finished run.
///
/// # Errors
/// Missing results, pictures that cannot be read, an unwritable folder, an interrupt.
pub fn write(run: &Run, events: &Events) -> Result<()> {
    let found = run.identified()?;
    let path = run.folder().join("report.html");
    let templates = [&TEMPLATES[..], &VIEWER_TEMPLATES[..]].concat();
    let page = template::fill(&templates, &report(run, &found, events)?)?;
    atomic::write(&path, page.as_bytes())?;
    events.note(STAGE, format!("open {} in a browser", path.display()));
    Ok(())
}

fn report(run: &Run, found: &IdentifyRecord, events: &Events) -> Result<Report> {
    let history = History::read(&run.folder().join("log.jsonl"))?;
    let truth = truth::of_run(run, found, events)?;
    let pictures = Pictures::draw(run, found, events)?;
    let motion = SimulatedMotion::open(run.folder())?;
    let config = run.folder().join("config.toml");
    let of_body = run.body_summary()?.remarks();
    Ok(Report {
        model: found.model.clone(),
        verdict: estimate::verdict(found, &pictures.overlap),
        warnings: found.warnings.iter().cloned().chain(history.warnings(&found.warnings)).map(sentence).collect(),
        rows: estimate::rows(found, truth.as_ref()),
        has_truth: truth.is_some(),
        remarks: (remarks(found).into_iter())
            .chain(of_body.into_iter().chain(run.video().corrections()).map(sentence))
            .collect(),
        selection: run.selection_if_any()?.map(|selection| ranking(&selection)),
        fitted_frames: run.fitted_frames(),
        frames: run.video().times.len(),
        has_colors: pictures.has_colors,
        cameras: run.video().camera_names.clone(),
        video: template::script_json(&pictures.video)?,
        overlays: template::script_json(&pictures.overlays)?,
        viewer: Viewer::of(&motion, STAGE, events, run.interrupt())?,
        overlap: curves::overlap(&pictures.overlap, run.fitted_frames()).html()?,
        curves: curves::groups(found, &history, truth.as_ref())?,
        costs: costs(&history),
        parts: found.seconds.iter().map(|(part, s)| format!("{part} {s:.1} s")).collect(),
        config: std::fs::read_to_string(&config).map_err(FileError::read(&config))?,
        version: gic_twin::VERSION,
    })
}

/// A message as a sentence.
fn sentence(text: String) -> String {
    let mut letters = text.trim_end_matches('.').chars();
    letters.next().map_or(text.clone(), |first| format!("{}{}.", first.to_uppercase(), letters.as_str()))
}

/// By how much the cameras differ from what the free flight shows of them, at most; `None` where none was in doubt.
fn cameras_as_found(cameras: &[CameraRecord]) -> Option<String> {
    let largest = |of: &dyn Fn(&CameraRecord) -> f64| cameras.iter().map(of).fold(0.0, f64::max);
    let length = |v: [f64; 3]| v[0].hypot(v[1]).hypot(v[2]);
    (!cameras.is_empty()).then(|| {
        format!(
            "The whole video turns cameras by up to {:.2} degrees more than the free flight shows, moves them by up to \
             {:.1} mm, changes their focal lengths by up to {:.2} % and their delays by up to {:.1} ms.",
            largest(&|camera| length(camera.turn_rad).to_degrees()),
            1e3 * largest(&|camera| length(camera.shift_m)),
            1e2 * largest(&|camera| camera.log_focal.abs()),
            1e3 * largest(&|camera| camera.delay_s.abs())
        )
    })
}

/// What else identification found, a sentence each.
fn remarks(found: &IdentifyRecord) -> Vec<String> {
    let mut remarks = Vec::new();
    let [x, y, z] = found.angular_velocity_rad_s;
    if [x, y, z] != [0.0; 3] {
        remarks.push(format!("It begins to turn at ({x:.3}, {y:.3}, {z:.3}) rad/s."));
    }
    if let Some(ground) = &found.ground {
        if ground.height_m != 0.0 {
            let half = ground.height_interval_95_m.map(|half| format!(" (95 % within {:.1} mm)", 1e3 * half));
            remarks.push(format!(
                "The ground lies {:.1} mm {} than it was taken to be{}.",
                1e3 * ground.height_m.abs(),
                if ground.height_m < 0.0 { "lower" } else { "higher" },
                half.unwrap_or_default()
            ));
        }
        if ground.tilt_deg != [0.0; 2] {
            let [x, y] = ground.tilt_deg;
            let half = ground.tilt_interval_95_deg.iter().flatten().copied().fold(0.0, f64::max);
            remarks.push(format!("The ground is tilted by {:.1} degrees (95 % within {half:.1}).", x.hypot(y)));
        }
        if ground.sticks {
            remarks.push("The ground holds what touches it.".into());
        } else if ground.friction_factor != 1.0 {
            let factor = ground.friction_interval_95_factor.map_or(String::new(), |half| {
                let (low, high) = (ground.friction_factor / half, ground.friction_factor * half);
                format!(" (95 % from {low:.2} to {high:.2})")
            });
            remarks.push(format!(
                "The ground lets go of what touches it; its friction is {:.2} times what was assumed{factor}.",
                ground.friction_factor
            ));
        }
    }
    if let Some(half) = found.gravity_interval_95_factor {
        let (factor, percent) = (found.gravity_factor.unwrap_or(1.0), |factor: f64| 100.0 * (factor - 1.0));
        remarks.push(format!(
            "Lengths as the cameras see them are {:.1} % too {} (95 % within {:.1} %), as the fall shows.",
            percent(factor).abs(),
            if factor < 1.0 { "short" } else { "long" },
            percent(half)
        ));
    }
    if let Some([x, y]) = found.gravity_tilt_deg {
        let half = found.gravity_tilt_interval_95_deg.iter().flatten().copied().fold(0.0, f64::max);
        remarks.push(format!(
            "Gravity is {:.2} degrees off what was taken to be down (95 % within {half:.2}), as the flight shows.",
            x.hypot(y)
        ));
    }
    remarks.extend(cameras_as_found(&found.cameras));
    remarks.push(format!("Nothing is touched in the first {} frames.", found.free_frames));
    if let Some(distance_m) = found.chamfer_m {
        let distance_mm = 1e3 * distance_m;
        remarks.push(format!("The simulated surface lies {distance_mm:.1} mm from the observed one on average."));
    }
    remarks.push(format!("Masks differ in {:.1} % of the object's pixels.", 100.0 * found.mask_error));
    remarks
        .push(format!("{} rollouts were simulated, and {} on a coarse grid.", found.rollouts, found.coarse_rollouts));
    remarks
}

fn ranking(selection: &Selection) -> Ranking {
    let percent = |share: f64| if share.is_finite() { format!("{:.2} %", 100.0 * share) } else { "-".into() };
    let law = |law: &crate::pipeline::LawRecord| {
        let standing = match (law.model == selection.chosen, law.in_full) {
            (true, _) => "chosen",
            (false, true) => "",
            (false, false) => "far off after a rough fit",
        };
        LawRow {
            model: law.model.clone(),
            fitted: percent(law.fit_error.unwrap_or(f64::NAN)),
            predicted: percent(law.prediction_error()),
            remark: law.failure.clone().unwrap_or_else(|| standing.into()),
        }
    };
    Ranking {
        fitted_frames: selection.fitted_frames,
        chosen: selection.chosen.clone(),
        certainty: selection.certainty(),
        laws: selection.laws.iter().map(law).collect(),
    }
}

fn costs(history: &History) -> Vec<CostRow> {
    let row = |stage: Stage| {
        let cost = history.costs.get(stage.name())?;
        Some(CostRow {
            stage: stage.name(),
            seconds: format!("{:.1}", cost.seconds),
            cpu_seconds: cost.cpu_seconds.map_or("-".into(), |s| format!("{s:.1}")),
            peak_memory_mib: cost.peak_memory_bytes.map_or("-".into(), |bytes| (bytes >> 20).to_string()),
        })
    };
    Stage::ALL.into_iter().filter_map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(fitted_frames: usize, has_truth: bool) -> String {
        let found = estimate::tests::found([true, false]);
        let truth = RunTruth::of(&[("youngs_modulus_pa", 3e5)], [0.3, -1.6, -0.22]);
        let overlap = [Some(0.98), Some(0.9), Some(0.8)];
        let cost = CostRow {
            stage: "fill",
            seconds: "17.5".into(),
            cpu_seconds: "17.9".into(),
            peak_memory_mib: "195".into(),
        };
        let report = Report {
            model: "elastic".into(),
            verdict: estimate::verdict(&found, &overlap),
            warnings: vec![sentence("a <b> of the run".into())],
            rows: estimate::rows(&found, has_truth.then_some(&truth)),
            has_truth,
            remarks: remarks(&found),
            selection: None,
            fitted_frames,
            frames: 3,
            has_colors: true,
            cameras: vec!["left".into(), "right".into()],
            video: "null".into(),
            overlays: "[]".into(),
            viewer: Viewer::default(),
            overlap: curves::overlap(&overlap, fitted_frames).html().unwrap(),
            curves: curves::groups(&found, &History::default(), None).unwrap(),
            costs: vec![cost],
            parts: vec!["joint 1.0 s".into()],
            config: "[scene]\nname = \"</pre>\"".into(),
            version: "0",
        };
        template::fill(&[&TEMPLATES[..], &VIEWER_TEMPLATES[..]].concat(), &report).unwrap()
    }

    #[test]
    fn the_page_holds_what_was_found() {
        let page = page(2, true);
        for part in [
            "This video determines Young&#x27;s modulus 318 kPa (95 % 240 to 421 kPa), but not Poisson&#x27;s ratio",
            "A &lt;b&gt; of the run.",
            "The first 2 frames were fitted; the last 1 are <b>predictions</b>.",
            "<td>318 kPa</td><td>240 to 421 kPa</td><td>300 kPa</td>",
            "not determined by this video",
            "camera right",
            "<td>fill</td><td>17.5</td><td>17.9</td><td>195</td>",
            "Overlap of the twin with the object in the film",
            "predicted frames",
            "id=\"viewer-data\"",
            "&lt;&#x2f;pre&gt;",
        ] {
            assert!(page.contains(part), "`{part}` is missing");
        }
        assert!(!page.contains("http://") && !page.contains("https://"), "the page must need no network");
        assert!(!page.contains("{{") && !page.contains("{%"), "everything is filled in");
    }

    #[test]
    fn what_is_not_there_is_not_shown() {
        let page = page(3, false);
        assert!(page.contains("All 3 frames were fitted.") && !page.contains("predicted frames"));
        assert!(!page.contains("<th>truth</th>") && !page.contains("<h3>Law</h3>"));
    }
}
