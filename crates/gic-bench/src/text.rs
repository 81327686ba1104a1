//! The tables of a suite as Markdown, as CSV and for a terminal.

use crate::outcome::TaskOutcome;
use crate::tables::{Coverage, ParameterRow};

/// Columns that some tables do not need.
struct Columns<'a> {
    cases: bool,
    seeds: bool,
    others: Vec<&'a str>,
}

impl<'a> Columns<'a> {
    fn of(rows: &'a [ParameterRow]) -> Self {
        let mut others: Vec<&str> = rows.iter().flat_map(|row| row.others.keys().map(String::as_str)).collect();
        others.sort_unstable();
        others.dedup();
        Self {
            cases: rows.iter().any(|row| !row.case.is_empty()),
            seeds: rows.iter().any(|row| row.seed_deviation.is_some()),
            others,
        }
    }

    fn heads(&self) -> Vec<String> {
        let case = self.cases.then_some("case");
        let seeds = self.seeds.then_some("scatter of seeds");
        let fixed = ["material", "parameter", "scenes", "gic, MAE x100", "inside", "error / half-width"];
        let heads = case.into_iter().chain(fixed).chain(seeds).chain(self.others.iter().copied());
        heads.chain(["paper (GIC)"]).map(String::from).collect()
    }

    fn cells(&self, row: &ParameterRow) -> Vec<String> {
        let spread = |figures: Option<[f64; 2]>| figures.map_or("-".into(), |[m, d]| format!("{m:.2} ± {d:.2}"));
        let number = |value: Option<f64>| value.map_or("-".into(), |v| format!("{v:.2}"));
        let mut cells: Vec<String> = self.cases.then(|| row.case.clone()).into_iter().collect();
        cells.extend([row.model.clone(), row.parameter.clone(), row.scenes.to_string()]);
        cells.push(spread(row.mean.zip(row.deviation).map(<[f64; 2]>::from)));
        cells.push(format!("{} of {}", row.inside, row.intervals));
        cells.push(number(row.error_over_half_width));
        cells.extend(self.seeds.then(|| number(row.seed_deviation)));
        cells.extend(self.others.iter().map(|method| spread(row.others.get(*method).copied())));
        cells.push(spread(row.paper));
        cells
    }
}

fn line(cells: &[String]) -> String {
    format!("| {} |\n", cells.join(" | "))
}

/// How many intervals hold the truth, in a sentence.
pub(crate) fn coverage_text(coverage: &Coverage) -> String {
    if coverage.parameters == 0 {
        return "No run has an interval.".into();
    }
    let share = |inside: usize, of: usize| match of {
        0 => "none of 0".to_owned(),
        of => format!("{inside} of {of} ({:.0} %)", 100.0 * inside as f64 / of as f64),
    };
    let sharpness = coverage.error_over_half_width.map_or(String::new(), |ratio| {
        format!(" The median error of a parameter is {ratio:.2} of half its interval's width.")
    });
    format!(
        "95 % intervals hold the truth of {} parameters, {} of those called identifiable, and {} components of \
         velocities.{sharpness}",
        share(coverage.parameters_inside, coverage.parameters),
        share(coverage.identifiable_inside, coverage.identifiable),
        share(coverage.velocity_components_inside, coverage.velocity_components),
    )
}

/// The table for a terminal.
pub(crate) fn table_text(rows: &[ParameterRow], coverage: &Coverage) -> String {
    let columns = Columns::of(rows);
    let lines: Vec<Vec<String>> =
        std::iter::once(columns.heads()).chain(rows.iter().map(|row| columns.cells(row))).collect();
    let width = |i: usize| lines.iter().map(|line| line[i].chars().count()).max().unwrap_or_default();
    let mut text = String::new();
    for line in &lines {
        let cells: Vec<String> = line.iter().enumerate().map(|(i, cell)| format!("{cell:<0$}", width(i))).collect();
        text += cells.join("  ").trim_end();
        text.push('\n');
    }
    text + "\n" + &coverage_text(coverage) + "\n"
}

pub(crate) fn markdown(rows: &[ParameterRow], coverage: &Coverage, outcomes: &[TaskOutcome]) -> String {
    let columns = Columns::of(rows);
    let heads = columns.heads();
    let mut text = String::from(
        "# Mean absolute error x100\n\nModuli, viscosities and yield stresses as log10, nu as is, the friction angle \
         in radians, v in m/s: the units of the paper's table.\n\n",
    );
    text += &line(&heads);
    text += &format!("|{}\n", "---|".repeat(heads.len()));
    rows.iter().for_each(|row| text += &line(&columns.cells(row)));
    text += &format!("\n{}\n", coverage_text(coverage));
    text += "\n# Scenes\n\n\
             | scene | parameter | estimate | 95 % interval | truth | error x100 | inside | determined |\n\
             |---|---|---|---|---|---|---|---|\n";
    outcomes.iter().for_each(|outcome| text += &scene_lines(outcome));
    text
}

fn scene_lines(outcome: &TaskOutcome) -> String {
    let label = outcome.task.label();
    let e = match &outcome.result {
        Err(reason) => return format!("| {label} | {} | | | | | | |\n", reason.replace(['|', '\n'], " ")),
        Ok(e) => e,
    };
    let yes = |holds: bool| if holds { "yes" } else { "no" };
    let mut text = String::new();
    for p in &e.parameters {
        text += &format!(
            "| {label} | {} | {:.5e} | {:.4e} .. {:.4e} | {:.5e} | {:.2} | {} | {} |\n",
            p.name,
            p.estimate,
            p.interval_95[0],
            p.interval_95[1],
            p.truth,
            p.error_x100,
            yes(p.inside),
            yes(p.identifiable)
        );
    }
    text + &format!("| {label} | v | | | | {:.2} | {} of 3 | |\n", e.velocity.error_x100, e.velocity.inside)
}

pub(crate) fn csv(outcomes: &[TaskOutcome]) -> String {
    let mut text =
        String::from("scene,case,seed,model,parameter,estimate,low_95,high_95,truth,error_x100,inside,identifiable\n");
    for (task, e) in outcomes.iter().filter_map(|o| Some((o.task, o.result.as_ref().ok()?))) {
        let seed = task.seed.map_or(String::new(), |seed| seed.to_string());
        let head = format!("{},{},{seed},{}", quoted(&task.scene), quoted(&task.case), e.model);
        for p in &e.parameters {
            text += &format!(
                "{head},{},{},{},{},{},{},{},{}\n",
                p.name, p.estimate, p.interval_95[0], p.interval_95[1], p.truth, p.error_x100, p.inside, p.identifiable
            );
        }
        text += &format!("{head},velocity,,,,,{},,\n", e.velocity.error_x100);
    }
    text
}

/// A cell that may hold commas.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}
