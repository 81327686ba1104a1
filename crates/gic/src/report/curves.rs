//! Curves: how the twin covers the film, and how it was found.

use gic_view::report::{Chart, Series};
use gic_view::units::quantity;
use serde::Serialize;

use super::RunTruth;
use super::history::History;
use crate::error::Result;
use crate::pipeline::{IdentifyRecord, StepRecord};

/// Charts that belong together.
#[derive(Serialize)]
pub(super) struct Group {
    title: &'static str,
    text: &'static str,
    /// HTML.
    charts: Vec<String>,
}

/// How well the twin covers the masks over time, apart for what was fitted and what was predicted.
pub(super) fn overlap(overlap: &[Option<f64>], fitted: usize) -> Chart {
    let line = |name: &str, range: std::ops::Range<usize>| {
        let points = range.filter_map(|frame| Some((frame as f64, 100.0 * overlap[frame]?)));
        Series::whole(name, points.collect())
    };
    let fitted = fitted.min(overlap.len());
    let mut series = vec![line("fitted frames", 0..fitted)];
    if fitted < overlap.len() {
        series.push(line("predicted frames", fitted..overlap.len()));
    }
    Chart {
        title: "Overlap of the twin with the object in the film".into(),
        unit: "%".into(),
        x_title: "frame".into(),
        series,
        note: "Intersection over union of the masks, mean of the cameras.".into(),
        ..Chart::default()
    }
}

/// All other charts.
///
/// # Errors
/// None but those of the templates.
pub(super) fn groups(found: &IdentifyRecord, history: &History, truth: Option<&RunTruth>) -> Result<Vec<Group>> {
    let groups = [
        Group {
            title: "Reconstruction",
            text: "Gaussians are trained on the film: at rest first (warm-up), then moving, over a window that grows from \
                   the first frame to the whole video. Loss and likeness jump where frames join.",
            charts: drawn(&reconstruction(history))?,
        },
        Group {
            title: "Identification: the objective",
            text: "Each stage has an objective of its own: their values do not compare. The search tries starts, one a \
                   point; the material stage fits from several of them in turn and at last to sharper masks, and the \
                   line breaks where the next fit begins; the joint stage weighs the pictures anew half-way, which \
                   lifts the objective and is no failure.",
            charts: drawn(&objectives(found))?,
        },
        Group {
            title: "Identification: the unknowns",
            text: "Values over the steps of all stages; a line breaks where a stage or a start begins, and the last piece \
                   leads to the result.",
            charts: drawn(&unknowns(found, truth))?,
        },
    ];
    Ok(groups.into_iter().filter(|group| !group.charts.is_empty()).collect())
}

fn drawn(charts: &[Chart]) -> Result<Vec<String>> {
    let drawn = charts.iter().map(|chart| Ok(chart.html()?)).collect::<Result<Vec<String>>>()?;
    Ok(drawn.into_iter().filter(|html| !html.is_empty()).collect())
}

fn reconstruction(history: &History) -> Vec<Chart> {
    let Some(steps) = history.steps.get("reconstruct") else { return Vec::new() };
    let kinds = [
        ("loss", "Loss", "", true),
        ("psnr_db", "Likeness of the trained pictures (PSNR)", "dB", false),
        ("held_out_psnr_db", "Likeness of the held-out cameras' pictures (PSNR)", "dB", false),
    ];
    let chart = |(key, title, unit, logarithmic): (&str, &str, &str, bool)| {
        let mut series: Vec<Series> = Vec::new();
        // Tracking counts steps of its own.
        for (phase, step, values) in steps.iter().filter(|(phase, ..)| phase != "tracking") {
            let Some(&value) = values.get(key) else { continue };
            if series.last().is_none_or(|line| line.name != *phase) {
                series.push(Series::whole(phase.clone(), Vec::new()));
            }
            series.last_mut().into_iter().for_each(|line| line.pieces[0].push((*step as f64, value)));
        }
        let (title, unit, x_title) = (title.into(), unit.into(), "step".into());
        Chart { title, unit, x_title, series, logarithmic, ..Chart::default() }
    };
    kinds.into_iter().map(chart).collect()
}

/// The steps of the trace in pieces within which the objective is one and the same and falls.
fn descents(trace: &[StepRecord]) -> Vec<Vec<(usize, &StepRecord)>> {
    let mut pieces: Vec<Vec<(usize, &StepRecord)>> = Vec::new();
    for (index, step) in trace.iter().enumerate() {
        let goes_on =
            |last: &StepRecord| last.stage == step.stage && step.objective <= last.objective && step.stage != "search";
        match pieces.last_mut().filter(|piece| piece.last().is_some_and(|(_, last)| goes_on(last))) {
            Some(piece) => piece.push((index, step)),
            None => pieces.push(vec![(index, step)]),
        }
    }
    pieces
}

fn objectives(found: &IdentifyRecord) -> Vec<Chart> {
    let pieces = descents(&found.trace);
    let mut stages: Vec<&str> = found.trace.iter().map(|step| step.stage.as_str()).collect();
    stages.dedup();
    let chart = |stage: &str| {
        let own = pieces.iter().filter(|piece| piece[0].1.stage == stage);
        let points = |piece: &Vec<(usize, &StepRecord)>| piece.iter().map(|(i, s)| (*i as f64, s.objective)).collect();
        Chart {
            title: format!("Objective of the {stage} stage"),
            x_title: if stage == "search" { "start" } else { "step" }.into(),
            series: vec![Series { name: stage.into(), pieces: own.map(points).collect() }],
            logarithmic: true,
            ..Chart::default()
        }
    };
    stages.into_iter().map(chart).collect()
}

fn unknowns(found: &IdentifyRecord, truth: Option<&RunTruth>) -> Vec<Chart> {
    let pieces = descents(&found.trace);
    let lines = |value: &dyn Fn(&StepRecord) -> Option<f64>| -> Vec<Vec<(f64, f64)>> {
        let points = |piece: &Vec<(usize, &StepRecord)>| {
            piece.iter().filter_map(|(i, step)| Some((*i as f64, value(step)?))).collect()
        };
        pieces.iter().map(points).collect()
    };
    let sought = found.estimates.iter().enumerate().filter(|(_, e)| !e.fixed);
    let parameter = |(place, e): (usize, &crate::pipeline::EstimateRecord)| {
        let (name, unit) = quantity(&e.name, e.value);
        let value = |step: &StepRecord| step.values.get(place).map(|value| value / unit.size);
        Chart {
            title: name.into(),
            unit: unit.name.into(),
            x_title: "step".into(),
            series: vec![Series { name: name.into(), pieces: lines(&value) }],
            logarithmic: e.name != "poisson_ratio" && e.name != "friction_angle_deg",
            marked: truth.and_then(|truth| truth.value(&e.name)).map(|value| (value / unit.size, "truth".into())),
            ..Chart::default()
        }
    };
    let axis = |(axis, name): (usize, &str)| Series {
        name: name.into(),
        pieces: lines(&|step: &StepRecord| Some(step.velocity_m_s[axis])),
    };
    let velocity = Chart {
        title: "Initial velocity".into(),
        unit: "m/s".into(),
        x_title: "step".into(),
        series: ["x", "y", "z"].into_iter().enumerate().map(axis).collect(),
        ..Chart::default()
    };
    sought.map(parameter).chain([velocity]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(stage: &str, objective: f64) -> StepRecord {
        let (values, velocity_m_s) = (vec![1.0], [0.0; 3]);
        StepRecord { stage: stage.into(), iteration: 0, objective, values, velocity_m_s, rollouts: 0 }
    }

    #[test]
    fn a_line_breaks_where_the_objective_changes() {
        let trace = [
            step("search", 9.0),
            step("search", 8.0),
            step("material", 100.0),
            step("material", 50.0),
            step("material", 90.0),
            step("material", 40.0),
            step("joint", 3.0),
            step("joint", 2.0),
            step("joint", 6.0),
        ];
        let sizes: Vec<usize> = descents(&trace).iter().map(Vec::len).collect();
        assert_eq!(sizes, [1, 1, 2, 2, 2, 1]);
    }

    #[test]
    fn frames_are_apart_by_whether_they_were_fitted() {
        let chart = overlap(&[Some(0.9), None, Some(0.8), Some(0.7)], 2);
        assert_eq!(chart.series[0].pieces, [[(0.0, 90.0)]]);
        assert_eq!(chart.series[1].pieces, [[(2.0, 80.0), (3.0, 70.0)]]);
    }
}
