//! `suite.html`: one self-contained page of a suite, whose rows can be sorted.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use gic_scene::Scene;
use gic_view::template::{self, Template};
use image::ImageFormat;
use serde::Serialize;

use crate::error::Result;
use crate::evaluation::{Evaluation, ParameterError};
use crate::outcome::TaskOutcome;
use crate::tables::{Coverage, ParameterRow, error_over_half_width, median};
use crate::text::coverage_text;

const TEMPLATES: [Template; 3] = [
    ("suite.html", include_str!("suite.html")),
    ("suite.css", include_str!("suite.css")),
    ("suite.js", include_str!("suite.js")),
];
/// Longest side of a thumbnail [pixels].
const THUMBNAIL_PX: u32 = 112;

/// What the template fills in.
#[derive(Serialize)]
struct SuitePage<'a> {
    tasks: usize,
    failed: usize,
    coverage: String,
    costs: String,
    has_cases: bool,
    methods: Vec<&'a str>,
    rows: Vec<LawRow>,
    scenes: Vec<SceneRow>,
    version: &'static str,
}

#[derive(Serialize)]
struct LawRow {
    case: String,
    model: String,
    parameter: String,
    scenes: usize,
    mean: Cell,
    inside: String,
    sharpness: String,
    others: Vec<String>,
    paper: String,
    /// Whether the mean is above the paper's.
    worse: bool,
}

#[derive(Serialize)]
struct SceneRow {
    /// JPEG in base64; empty where the scene is not there.
    thumbnail: String,
    label: String,
    report: String,
    failure: String,
    model: String,
    errors: Vec<ErrorText>,
    /// Mean error, largest error over half the interval's width, error of the velocity.
    error_cells: [Cell; 3],
    inside: usize,
    intervals: usize,
    /// Overlap with the masks, wall-clock time [s], CPU time [s], memory [MB].
    cost_cells: [Cell; 4],
}

/// A number to sort by, and its text; both empty where there is none.
#[derive(Serialize)]
struct Cell {
    value: String,
    text: String,
}

impl Cell {
    fn number(value: Option<f64>, decimals: usize) -> Self {
        Self::with_text(value, value.map_or(String::new(), |v| format!("{v:.decimals$}")))
    }

    fn with_text(value: Option<f64>, text: String) -> Self {
        Self { value: value.map_or(String::new(), |v| v.to_string()), text }
    }
}

#[derive(Serialize)]
struct ErrorText {
    text: String,
    outside: bool,
    unsure: bool,
}

pub(crate) fn page(rows: &[ParameterRow], coverage: &Coverage, outcomes: &[TaskOutcome]) -> Result<String> {
    let mut methods: Vec<&str> = rows.iter().flat_map(|row| row.others.keys().map(String::as_str)).collect();
    methods.sort_unstable();
    methods.dedup();
    let mut thumbnails = BTreeMap::new();
    let scenes = outcomes.iter().map(|outcome| {
        let scene = &outcome.task.scene_path;
        let picture = thumbnails.entry(scene).or_insert_with(|| thumbnail(scene).unwrap_or_default()).clone();
        scene_row(outcome, picture)
    });
    let page = SuitePage {
        tasks: outcomes.len(),
        failed: outcomes.iter().filter(|outcome| outcome.result.is_err()).count(),
        coverage: coverage_text(coverage),
        costs: costs_text(outcomes),
        has_cases: rows.iter().any(|row| !row.case.is_empty()),
        rows: rows.iter().map(|row| law_row(row, &methods)).collect(),
        methods,
        scenes: scenes.collect(),
        version: gic_twin::VERSION,
    };
    Ok(template::fill(&TEMPLATES, &page)?)
}

fn law_row(row: &ParameterRow, methods: &[&str]) -> LawRow {
    let spread = |figures: Option<[f64; 2]>| figures.map_or(String::new(), |[m, d]| format!("{m:.2} ± {d:.2}"));
    LawRow {
        case: row.case.clone(),
        model: row.model.clone(),
        parameter: row.parameter.clone(),
        scenes: row.scenes,
        mean: Cell::with_text(row.mean, spread(row.mean.zip(row.deviation).map(<[f64; 2]>::from))),
        inside: format!("{} of {}", row.inside, row.intervals),
        sharpness: row.error_over_half_width.map_or(String::new(), |ratio| format!("{ratio:.2}")),
        others: methods.iter().map(|method| spread(row.others.get(*method).copied())).collect(),
        paper: spread(row.paper),
        worse: row.mean.zip(row.paper).is_some_and(|(mean, paper)| mean > paper[0]),
    }
}

fn scene_row(outcome: &TaskOutcome, thumbnail: String) -> SceneRow {
    let found = outcome.result.as_ref().ok();
    let parameters: &[ParameterError] = found.map_or(&[], |e| &e.parameters);
    let errors: Vec<f64> = parameters.iter().map(|p| p.error_x100).collect();
    let cost = outcome.cost.as_ref();
    SceneRow {
        thumbnail,
        label: outcome.task.label(),
        report: found.map_or(String::new(), |_| format!("{}/report.html", address(&outcome.task.folder))),
        failure: outcome.result.as_ref().err().cloned().unwrap_or_default(),
        model: found.map_or(String::new(), |e| e.model.clone()),
        errors: parameters.iter().map(error_text).collect(),
        error_cells: [
            Cell::number((!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64), 2),
            Cell::number(parameters.iter().filter_map(error_over_half_width).reduce(f64::max), 2),
            Cell::number(found.map(|e| e.velocity.error_x100), 2),
        ],
        inside: found.map_or(0, inside),
        intervals: found.map_or(0, |e| e.parameters.len() + 3),
        cost_cells: [
            Cell::number(found.map(|e| e.mask_iou), 4),
            Cell::number(cost.map(|cost| cost.wall_s), 0),
            Cell::number(cost.and_then(|cost| cost.cpu_s), 0),
            Cell::number(cost.and_then(|cost| cost.peak_memory_bytes).map(|bytes| bytes as f64 / 1e6), 0),
        ],
    }
}

/// A folder's name as the address of a link.
fn address(folder: &str) -> String {
    folder.replace('%', "%25").replace('#', "%23").replace('?', "%3F")
}

fn inside(e: &Evaluation) -> usize {
    e.parameters.iter().filter(|p| p.inside).count() + e.velocity.inside
}

fn error_text(p: &ParameterError) -> ErrorText {
    ErrorText { text: format!("{} {:.2}", p.paper_name, p.error_x100), outside: !p.inside, unsure: !p.identifiable }
}

/// Distribution of time and memory, in a sentence; empty where nothing has run.
fn costs_text(outcomes: &[TaskOutcome]) -> String {
    let all = |pick: &dyn Fn(&TaskOutcome) -> Option<f64>| -> Option<[f64; 3]> {
        let values: Vec<f64> = outcomes.iter().filter_map(pick).collect();
        let (least, most) = (values.iter().copied().reduce(f64::min)?, values.iter().copied().reduce(f64::max)?);
        Some([least, median(values)?, most])
    };
    let wall = all(&|o| o.cost.as_ref().map(|cost| cost.wall_s));
    let memory = all(&|o| o.cost.as_ref()?.peak_memory_bytes.map(|bytes| bytes as f64 / 1e6));
    let text = |figures: Option<[f64; 3]>, what: &str, unit: &str| {
        figures.map_or(String::new(), |[least, middle, most]| {
            format!("{what} {least:.0} to {most:.0} {unit}, median {middle:.0}. ")
        })
    };
    text(wall, "A run takes", "s") + &text(memory, "Its peak of memory is", "MB")
}

/// The first picture of a scene, small; `None` where the scene or the picture cannot be read: a table without a picture
/// is better than none.
fn thumbnail(path: &Path) -> Option<String> {
    let scene = Scene::open(path).ok()?;
    let picture = image::open(&scene.views.first()?.picture).ok()?;
    let mut bytes = Cursor::new(Vec::new());
    let small = picture.thumbnail(THUMBNAIL_PX, THUMBNAIL_PX).to_rgb8();
    small.write_to(&mut bytes, ImageFormat::Jpeg).ok()?;
    Some(BASE64_STANDARD.encode(bytes.into_inner()))
}
