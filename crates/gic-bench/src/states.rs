//! Observed and predicted states of every scene, beside the paper's rows for the Spring-Gaus set.

use serde::Serialize;

use crate::evaluation::{Evaluation, FrameError, mean_of};
use gic_metrics::mean;

/// The Spring-Gaus set's objects, in the order of the paper's columns.
const OBJECTS: [&str; 7] = ["torus", "cross", "cream", "apple", "paste", "chess", "banana"];

/// A figure of the paper: whether of observed frames, the figure, the method, and its values by object and in the mean.
type PaperRow = (bool, Figure, &'static str, [f64; 8]);

/// The paper's tables "Future State Simulation" and "Dynamic Reconstruction" on the Spring-Gaus synthetic set.
// One of the distances happens to be 3.14.
#[allow(clippy::approx_constant)]
const PAPER: &[PaperRow] = &[
    (true, Figure::Chamfer, "Spring-Gaus", [0.17, 0.48, 0.36, 0.38, 0.19, 1.80, 2.60, 0.85]),
    (true, Figure::Chamfer, "PAC-NeRF", [4.92, 1.10, 0.77, 1.11, 3.14, 0.96, 2.77, 2.11]),
    (true, Figure::Chamfer, "GIC (paper)", [0.13, 0.13, 0.14, 0.15, 0.17, 0.41, 0.03, 0.17]),
    (true, Figure::EarthMovers, "Spring-Gaus", [0.040, 0.037, 0.031, 0.033, 0.022, 0.063, 0.052, 0.040]),
    (true, Figure::EarthMovers, "PAC-NeRF", [0.056, 0.052, 0.041, 0.045, 0.054, 0.052, 0.062, 0.052]),
    (true, Figure::EarthMovers, "GIC (paper)", [0.020, 0.020, 0.019, 0.020, 0.025, 0.036, 0.011, 0.022]),
    (false, Figure::Chamfer, "Spring-Gaus", [2.38, 1.57, 2.22, 1.87, 7.03, 2.59, 18.48, 5.16]),
    (false, Figure::Chamfer, "PAC-NeRF", [2.47, 3.87, 2.21, 4.69, 37.7, 8.2, 66.43, 17.94]),
    (false, Figure::Chamfer, "GIC (paper)", [0.75, 1.09, 0.94, 0.22, 2.79, 0.77, 0.12, 0.95]),
    (false, Figure::EarthMovers, "Spring-Gaus", [0.087, 0.051, 0.094, 0.076, 0.126, 0.095, 0.135, 0.095]),
    (false, Figure::EarthMovers, "PAC-NeRF", [0.055, 0.111, 0.083, 0.108, 0.192, 0.155, 0.234, 0.134]),
    (false, Figure::EarthMovers, "GIC (paper)", [0.034, 0.058, 0.050, 0.030, 0.096, 0.059, 0.017, 0.049]),
    (false, Figure::Psnr, "Spring-Gaus", [16.83, 16.93, 15.42, 21.55, 14.71, 16.08, 17.89, 17.06]),
    (false, Figure::Psnr, "PAC-NeRF", [17.46, 14.15, 15.37, 19.94, 12.32, 15.08, 16.04, 15.77]),
    (false, Figure::Psnr, "GIC (paper)", [20.24, 30.51, 19.15, 26.89, 16.31, 18.44, 29.29, 22.98]),
    (false, Figure::Ssim, "Spring-Gaus", [0.919, 0.940, 0.862, 0.902, 0.872, 0.881, 0.904, 0.897]),
    (false, Figure::Ssim, "PAC-NeRF", [0.913, 0.906, 0.858, 0.878, 0.819, 0.848, 0.886, 0.870]),
    (false, Figure::Ssim, "GIC (paper)", [0.942, 0.939, 0.909, 0.948, 0.894, 0.912, 0.964, 0.930]),
];

/// What is measured of a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Figure {
    /// Chamfer distance [1e3 mm^2].
    Chamfer,
    /// Earth mover's distance [m].
    EarthMovers,
    /// PSNR of whole pictures [dB].
    Psnr,
    /// SSIM of whole pictures.
    Ssim,
}

impl Figure {
    const ALL: [Self; 4] = [Self::Chamfer, Self::EarthMovers, Self::Psnr, Self::Ssim];

    fn name(self) -> &'static str {
        match self {
            Self::Chamfer => "CD [1e3 mm^2]",
            Self::EarthMovers => "EMD [m]",
            Self::Psnr => "PSNR [dB]",
            Self::Ssim => "SSIM",
        }
    }

    fn decimals(self) -> usize {
        if matches!(self, Self::EarthMovers | Self::Ssim) { 3 } else { 2 }
    }

    fn of(self, frame: &FrameError) -> Option<f64> {
        match self {
            Self::Chamfer => frame.prediction.map(|v| v[0]),
            Self::EarthMovers => frame.prediction.map(|v| v[1]),
            Self::Psnr => frame.pictures.map(|p| p.psnr_db),
            Self::Ssim => frame.pictures.map(|p| p.ssim),
        }
    }
}

/// One figure of the twin's states, for every scene: the mean over the frames that were fitted to, or over those that
/// were predicted.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StateRow {
    /// Frames that were fitted to; otherwise those that were predicted.
    pub observed: bool,
    /// What is measured.
    pub figure: Figure,
    /// Who: gic, or a row of the paper.
    pub method: String,
    /// For every scene, where there is a value.
    pub scenes: Vec<Option<f64>>,
    /// Mean over the scenes that have a value; of a row of the paper, over its seven objects.
    pub mean: Option<f64>,
}

/// A scene's name, whether it is of the Spring-Gaus synthetic set, and its evaluation.
pub(crate) struct SceneColumn<'a> {
    pub(crate) name: &'a str,
    pub(crate) spring_gaus: bool,
    pub(crate) evaluation: Option<&'a Evaluation>,
}

/// All rows: the paper's only where the suite has scenes of the Spring-Gaus synthetic set.
pub(crate) fn rows(columns: &[SceneColumn]) -> Vec<StateRow> {
    let mut rows = Vec::new();
    for observed in [true, false] {
        for figure in Figure::ALL {
            let scenes: Vec<Option<f64>> = columns.iter().map(|column| measured(column, observed, figure)).collect();
            if scenes.iter().all(Option::is_none) {
                continue;
            }
            let known: Vec<f64> = scenes.iter().flatten().copied().collect();
            let mean = Some(mean(known.into_iter()));
            rows.push(StateRow { observed, figure, method: "gic".into(), scenes, mean });
            if columns.iter().any(|column| column.spring_gaus) {
                let of = PAPER.iter().filter(|(o, f, ..)| (*o, *f) == (observed, figure));
                rows.extend(of.map(|row| published(row, columns)));
            }
        }
    }
    rows
}

fn measured(column: &SceneColumn, observed: bool, figure: Figure) -> Option<f64> {
    let frames: Vec<&FrameError> = column.evaluation?.frames.iter().filter(|f| f.observed == observed).collect();
    mean_of(&frames, &|frame| figure.of(frame))
}

fn published((observed, figure, method, values): &PaperRow, columns: &[SceneColumn]) -> StateRow {
    let value = |column: &SceneColumn| {
        let object = column.name.rsplit('_').next()?;
        let at = OBJECTS.iter().position(|known| *known == object).filter(|_| column.spring_gaus)?;
        Some(values[at])
    };
    StateRow {
        observed: *observed,
        figure: *figure,
        method: (*method).into(),
        scenes: columns.iter().map(value).collect(),
        mean: Some(values[OBJECTS.len()]),
    }
}

/// The two tables.
pub(crate) fn markdown(rows: &[StateRow], columns: &[SceneColumn]) -> String {
    let mut text = String::new();
    for (observed, title) in [(true, "Observed frames"), (false, "Future frames")] {
        let part: Vec<&StateRow> = rows.iter().filter(|row| row.observed == observed).collect();
        if part.is_empty() {
            continue;
        }
        let names: Vec<&str> = columns.iter().map(|column| column.name).collect();
        text += &format!(
            "\n# {title}\n\n| | | {} | mean |\n|---|---|{}---|\n",
            names.join(" | "),
            "---|".repeat(names.len())
        );
        for row in part {
            let decimals = row.figure.decimals();
            let cell = |value: Option<f64>| value.map_or("-".into(), |v| format!("{v:.decimals$}"));
            let cells: Vec<String> = row.scenes.iter().map(|v| cell(*v)).collect();
            text +=
                &format!("| {} | {} | {} | {} |\n", row.figure.name(), row.method, cells.join(" | "), cell(row.mean));
        }
        text += "\nThe simulated twin against the truth: CD and EMD of particles, PSNR and SSIM of whole pictures over \
                 black. gic's mean is over the scenes with a value, the paper's over its seven objects.\n";
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::tests::evaluation;

    #[test]
    fn states_stand_beside_the_papers_rows() {
        let (torus, plush) = (evaluation(&[(true, 0.2), (true, 0.4), (false, 1.0)]), evaluation(&[(true, 0.6)]));
        let column = |name, spring_gaus, evaluation| SceneColumn { name, spring_gaus, evaluation };
        let columns = [
            column("sg_torus", true, Some(&torus)),
            column("sg_plush", false, Some(&plush)),
            column("sg_cross", true, None),
        ];
        let rows = rows(&columns);
        let find = |observed, figure, method: &str| {
            rows.iter().find(|r| (r.observed, r.figure) == (observed, figure) && r.method == method).unwrap()
        };
        let observed = find(true, Figure::Chamfer, "gic");
        assert_eq!(observed.scenes[2], None, "a scene that failed has no value");
        assert!((observed.scenes[0].unwrap() - 0.3).abs() < 1e-12 && (observed.mean.unwrap() - 0.45).abs() < 1e-12);
        let future = find(false, Figure::EarthMovers, "gic");
        assert_eq!(future.scenes, [Some(0.1), None, None]);
        assert_eq!(find(false, Figure::Psnr, "GIC (paper)").scenes, [Some(20.24), None, Some(30.51)]);
        assert_eq!(find(true, Figure::Chamfer, "PAC-NeRF").mean, Some(2.11));
        let text = markdown(&rows, &columns);
        assert!(text.contains("| SSIM | gic | 0.900 | - | - | 0.900 |"), "{text}");
        // A suite of another set has no rows of the paper.
        assert!(super::rows(&columns[1..2]).iter().all(|row| row.method == "gic"));
    }

    #[test]
    fn the_papers_means_are_those_of_its_objects() {
        for (observed, figure, method, values) in PAPER {
            // The paper prints .870 as the mean of these, which is .873.
            if (*figure, *method) == (Figure::Ssim, "PAC-NeRF") {
                continue;
            }
            let mean = values[..7].iter().sum::<f64>() / 7.0;
            let rounding = 0.6 * 0.1f64.powi(figure.decimals() as i32);
            assert!((mean - values[7]).abs() < rounding, "{observed} {figure:?} {method}: {mean}");
        }
    }
}
