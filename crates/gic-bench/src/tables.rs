//! The paper's table: errors by law and parameter, how many intervals hold the truth, and how wide they are.

use std::collections::BTreeMap;

use gic_metrics::{mean, mean_and_variance};
use serde::Serialize;

use crate::evaluation::{Evaluation, ParameterError};
use crate::others::OtherResult;
use crate::paper::{paper_figures, paper_value};
use crate::plan::Task;

/// A row of the paper's table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParameterRow {
    /// The case of the sweep; empty where there is one.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub case: String,
    /// Model of the material.
    pub model: String,
    /// The parameter, in the paper's words.
    pub parameter: String,
    /// Number of runs that have it.
    pub scenes: usize,
    /// Mean absolute error, times 100; `None` where no run has it.
    pub mean: Option<f64>,
    /// Standard deviation of the absolute error over the runs, times 100.
    pub deviation: Option<f64>,
    /// How many 95 % intervals hold the truth; of the velocity those of its components.
    pub inside: usize,
    /// How many intervals there are.
    pub intervals: usize,
    /// Sharpness: median of the absolute error over half the interval's width.
    pub error_over_half_width: Option<f64>,
    /// Standard deviation of the estimate over seeds, times 100; `None` where no scene has several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed_deviation: Option<f64>,
    /// The paper's mean and standard deviation, where it has them.
    pub paper: Option<[f64; 2]>,
    /// Mean and standard deviation of other methods on the same scenes.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub others: BTreeMap<String, [f64; 2]>,
}

/// How many intervals hold the truth, over all parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Coverage {
    /// Parameters, and those inside their 95 % interval.
    pub parameters: usize,
    /// Those inside their interval.
    pub parameters_inside: usize,
    /// Parameters that are called identifiable.
    pub identifiable: usize,
    /// Those inside their interval.
    pub identifiable_inside: usize,
    /// Components of velocities.
    pub velocity_components: usize,
    /// Those inside their interval.
    pub velocity_components_inside: usize,
    /// Sharpness: median of the absolute error of a parameter over half its interval's width.
    pub error_over_half_width: Option<f64>,
}

impl Coverage {
    /// Over some evaluations.
    pub fn of<'a>(evaluations: impl Iterator<Item = &'a Evaluation>) -> Self {
        let (mut found, mut ratios) = (Self::default(), Vec::new());
        for evaluation in evaluations {
            for parameter in &evaluation.parameters {
                found.parameters += 1;
                found.parameters_inside += usize::from(parameter.inside);
                found.identifiable += usize::from(parameter.identifiable);
                found.identifiable_inside += usize::from(parameter.identifiable && parameter.inside);
                ratios.extend(error_over_half_width(parameter));
            }
            found.velocity_components += 3;
            found.velocity_components_inside += evaluation.velocity.inside;
        }
        Self { error_over_half_width: median(ratios), ..found }
    }
}

/// A parameter's absolute error over half its interval's width, in the paper's unit; `None` for an interval without
/// width.
pub(crate) fn error_over_half_width(parameter: &ParameterError) -> Option<f64> {
    let [low, high] = parameter.interval_95.map(|end| paper_value(&parameter.name, end));
    let ratio = parameter.error_x100 / (50.0 * (high - low));
    (ratio.is_finite() && ratio >= 0.0).then_some(ratio)
}

/// The median; `None` of nothing.
pub(crate) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let (&low, &high) = (values.get(values.len().saturating_sub(1) / 2)?, values.get(values.len() / 2)?);
    Some(0.5 * (low + high))
}

/// What the runs of a row found.
#[derive(Default)]
struct Cell {
    errors: Vec<f64>,
    inside: usize,
    intervals: usize,
    ratios: Vec<f64>,
    /// Estimates times 100, by scene.
    estimates: BTreeMap<String, Vec<f64>>,
    others: BTreeMap<String, Vec<f64>>,
}

impl Cell {
    fn row(self, (case, model, parameter): (String, String, String)) -> ParameterRow {
        let own = (!self.errors.is_empty()).then(|| mean_and_variance(&self.errors));
        let scatter: Vec<f64> =
            self.estimates.values().filter(|of| of.len() > 1).map(|of| sample_variance(of)).collect();
        let others = self.others.into_iter().map(|(method, errors)| {
            let (mean, variance) = mean_and_variance(&errors);
            (method, [mean, variance.sqrt()])
        });
        ParameterRow {
            scenes: self.errors.len(),
            mean: own.map(|(mean, _)| mean),
            deviation: own.map(|(_, variance)| variance.sqrt()),
            inside: self.inside,
            intervals: self.intervals,
            error_over_half_width: median(self.ratios),
            seed_deviation: (!scatter.is_empty()).then(|| mean(scatter.into_iter()).sqrt()),
            paper: paper_figures(&model, &parameter),
            others: others.collect(),
            case,
            model,
            parameter,
        }
    }
}

/// Variance of the numbers that some of them are a sample of.
fn sample_variance(values: &[f64]) -> f64 {
    mean_and_variance(values).1 * values.len() as f64 / (values.len() - 1) as f64
}

/// The paper's table of some runs, beside other methods. Those stand in the rows of every case.
pub fn parameter_rows(runs: &[(&Task, &Evaluation)], others: &[OtherResult]) -> Vec<ParameterRow> {
    let mut cells: BTreeMap<(String, String, String), Cell> = BTreeMap::new();
    let mut cases: Vec<&str> = Vec::new();
    for (task, e) in runs {
        if !cases.contains(&task.case.as_str()) {
            cases.push(&task.case);
        }
        let key = |parameter: &str| (task.case.clone(), e.model.clone(), parameter.to_owned());
        for p in &e.parameters {
            let cell = cells.entry(key(&p.paper_name)).or_default();
            cell.errors.push(p.error_x100);
            cell.inside += usize::from(p.inside);
            cell.intervals += 1;
            cell.ratios.extend(error_over_half_width(p));
            cell.estimates.entry(task.scene.clone()).or_default().push(100.0 * paper_value(&p.name, p.estimate));
        }
        let cell = cells.entry(key("v")).or_default();
        cell.errors.push(e.velocity.error_x100);
        cell.inside += e.velocity.inside;
        cell.intervals += 3;
    }
    for other in others {
        for case in if cases.is_empty() { &[""][..] } else { &cases } {
            for (parameter, error) in &other.errors_x100 {
                let cell = cells.entry(((*case).into(), other.model.clone(), parameter.clone())).or_default();
                cell.others.entry(other.method.clone()).or_default().push(*error);
            }
        }
    }
    let order = |case: &str| cases.iter().position(|known| *known == case);
    let mut rows: Vec<ParameterRow> = cells.into_iter().map(|(key, cell)| cell.row(key)).collect();
    rows.sort_by_key(|row| order(&row.case));
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::tests::evaluation;
    use crate::plan::tests::task;

    fn parameter(estimate: f64, half: f64) -> ParameterError {
        ParameterError {
            name: "poisson_ratio".into(),
            paper_name: "nu".into(),
            estimate,
            interval_95: [estimate - half, estimate + half],
            identifiable: half < 0.1,
            truth: 0.3,
            error_x100: 100.0 * (estimate - 0.3f64).abs(),
            inside: (estimate - 0.3).abs() <= half,
        }
    }

    fn found(parameters: Vec<ParameterError>) -> Evaluation {
        Evaluation { parameters, ..evaluation(&[]) }
    }

    #[test]
    fn rows_hold_errors_coverage_sharpness_and_scatter() {
        let tasks = ["a/seed=0", "a/seed=1", "b/seed=0"].map(task);
        let runs =
            [found(vec![parameter(0.32, 0.04)]), found(vec![parameter(0.34, 0.02)]), found(vec![parameter(0.3, 0.2)])];
        let runs: Vec<_> = tasks.iter().zip(&runs).collect();
        let other = OtherResult {
            method: "GIC".into(),
            scene: "a".into(),
            model: "elastic".into(),
            file: "0-pred.json".into(),
            errors_x100: vec![("nu".into(), 5.0), ("log10(E)".into(), 7.0)],
        };
        let rows = parameter_rows(&runs, &[other]);
        assert_eq!(rows.iter().map(|r| r.parameter.as_str()).collect::<Vec<_>>(), ["log10(E)", "nu", "v"]);
        let nu = &rows[1];
        assert_eq!((nu.scenes, nu.inside, nu.intervals), (3, 2, 3));
        assert!((nu.mean.unwrap() - 2.0).abs() < 1e-9 && (nu.error_over_half_width.unwrap() - 0.5).abs() < 1e-9);
        assert!((nu.seed_deviation.unwrap() - 2f64.sqrt()).abs() < 1e-9);
        assert_eq!((nu.others["GIC"], nu.paper), ([5.0, 0.0], Some([2.52, 2.03])));
        assert_eq!((rows[0].mean, rows[0].others["GIC"][0]), (None, 7.0));
        assert_eq!((rows[2].inside, rows[2].intervals), (9, 9));
    }

    #[test]
    fn coverage_counts_all_intervals() {
        let runs = [found(vec![parameter(0.32, 0.01), parameter(0.31, 0.2)])];
        let coverage = Coverage::of(runs.iter());
        assert_eq!((coverage.parameters, coverage.parameters_inside), (2, 1));
        assert_eq!((coverage.identifiable, coverage.identifiable_inside), (1, 0));
        assert_eq!((coverage.velocity_components, coverage.velocity_components_inside), (3, 3));
        assert_eq!(median(vec![]), None);
        assert_eq!(median(vec![3.0, 1.0, 2.0, 10.0]), Some(2.5));
    }
}
