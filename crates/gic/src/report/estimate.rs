//! The estimate in words and numbers for people.

use gic_view::units::{Unit, quantity, three_digits};
use serde::Serialize;

use super::RunTruth;
use crate::pipeline::{EstimateRecord, IdentifyRecord};

/// Mean overlap of masks from which a twin covers its video well, and below which it does not.
const GOOD_OVERLAP: f64 = 0.9;
const POOR_OVERLAP: f64 = 0.75;

/// The result in a sentence.
#[derive(Serialize)]
pub(super) struct Verdict {
    /// `good`, `fair` or `poor`.
    standing: &'static str,
    text: String,
}

/// A row of the table of estimates.
#[derive(Serialize)]
pub(super) struct EstimateRow {
    name: String,
    key: String,
    value: String,
    interval: String,
    truth: String,
    standing: &'static str,
    is_sure: bool,
}

/// A value in a unit, with three digits.
fn number(value: f64, unit: Unit) -> String {
    let text = three_digits(value / unit.size);
    if unit.name.is_empty() || unit.name == "\u{b0}" {
        format!("{text}{}", unit.name)
    } else {
        format!("{text} {}", unit.name)
    }
}

fn interval([low, high]: [f64; 2], unit: Unit) -> String {
    format!("{} to {}", three_digits(low / unit.size), number(high, unit))
}

/// What the run found, in a sentence; `overlap` is the mean overlap of the masks in each frame.
pub(super) fn verdict(found: &IdentifyRecord, overlap: &[Option<f64>]) -> Verdict {
    let sought = || found.estimates.iter().filter(|e| !e.fixed);
    let in_words = |e: &EstimateRecord| {
        let (name, unit) = quantity(&e.name, e.value);
        // Names of people keep their capitals.
        let is_proper = name.starts_with("Young") || name.starts_with("Poisson");
        let name = if is_proper { name.to_owned() } else { name.to_lowercase() };
        let value = format!("{name} {} (95 % {})", number(e.value, unit), interval(e.interval_95, unit));
        (name, value)
    };
    let sure: Vec<String> = sought().filter(|e| e.identifiable).map(|e| in_words(e).1).collect();
    let unsure: Vec<String> = sought().filter(|e| !e.identifiable).map(|e| in_words(e).0).collect();
    let material = match (sure.is_empty(), unsure.is_empty()) {
        (true, true) => format!("Every parameter of this {} twin was given", found.model),
        (false, true) => format!("This video determines the {} twin: {}", found.model, listed(&sure)),
        (false, false) => {
            format!("This video determines {}, but not {}", listed(&sure), listed(&unsure))
        }
        (true, false) => format!("This video does not determine {}", listed(&unsure)),
    };
    let seen: Vec<(usize, f64)> =
        overlap.iter().enumerate().filter_map(|(frame, iou)| Some((frame, (*iou)?))).collect();
    let mean = seen.iter().map(|(_, iou)| iou).sum::<f64>() / seen.len().max(1) as f64;
    let cover = match seen.iter().min_by(|a, b| a.1.total_cmp(&b.1)) {
        Some((frame, worst)) => format!(
            "; simulated, it overlaps the object in the film to {:.0} % (at worst to {:.0} %, in frame {frame})",
            100.0 * mean,
            100.0 * worst
        ),
        None => String::new(),
    };
    let standing = if mean < POOR_OVERLAP || (sure.is_empty() && !unsure.is_empty()) {
        "poor"
    } else if mean < GOOD_OVERLAP || !unsure.is_empty() {
        "fair"
    } else {
        "good"
    };
    Verdict { standing, text: format!("{material}{cover}.") }
}

/// `a`, `a and b`, `a, b and c`.
fn listed(names: &[String]) -> String {
    match names.split_last() {
        None => String::new(),
        Some((last, [])) => last.clone(),
        Some((last, others)) => format!("{} and {last}", others.join(", ")),
    }
}

/// All parameters, then the velocity, then the cells of the grid where they were sought.
pub(super) fn rows(found: &IdentifyRecord, truth: Option<&RunTruth>) -> Vec<EstimateRow> {
    let told = |value: Option<f64>, unit: Unit| value.map_or(String::new(), |value| number(value, unit));
    let parameter = |e: &EstimateRecord| {
        let (name, unit) = quantity(&e.name, e.value);
        EstimateRow {
            name: if name == "Parameter" { e.name.clone() } else { name.to_owned() },
            key: e.name.clone(),
            value: number(e.value, unit),
            interval: if e.fixed { String::new() } else { interval(e.interval_95, unit) },
            truth: told(truth.and_then(|truth| truth.value(&e.name)), unit),
            standing: match (e.fixed, e.identifiable) {
                (true, _) => "given",
                (false, true) => "determined",
                (false, false) => "not determined by this video",
            },
            is_sure: e.fixed || e.identifiable,
        }
    };
    let m_s = Unit { name: "m/s", size: 1.0 };
    let velocity = found.velocity_components().into_iter().enumerate().map(|(axis, (letter, v, range))| EstimateRow {
        name: format!("Initial velocity {letter}"),
        key: "initial_velocity_m_s".into(),
        value: format!("{v:.3} m/s"),
        interval: range.map_or("not known".into(), |[low, high]| format!("{low:.3} to {high:.3} m/s")),
        truth: truth.map_or(String::new(), |truth| format!("{:.3} {}", truth.velocity_m_s[axis], m_s.name)),
        standing: if range.is_some() { "determined" } else { "" },
        is_sure: true,
    });
    let mm = Unit { name: "mm", size: 1e-3 };
    let cell = found.grid_spacing_interval_95_m.map(|range| EstimateRow {
        name: "Cell of the grid".into(),
        key: "grid_spacing_m".into(),
        value: number(found.grid_spacing_m, mm),
        interval: interval(range, mm),
        truth: String::new(),
        standing: "of the simulation",
        is_sure: true,
    });
    found.estimates.iter().map(parameter).chain(velocity).chain(cell).collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::report) fn found(identifiable: [bool; 2]) -> IdentifyRecord {
        let estimate = |name: &str, value: f64, interval_95, identifiable| EstimateRecord {
            name: name.into(),
            value,
            interval_95,
            identifiable,
            fixed: false,
        };
        IdentifyRecord {
            cameras: Vec::new(),
            gravity_tilt_deg: None,
            gravity_tilt_interval_95_deg: [None; 2],
            model: "elastic".into(),
            estimates: vec![
                estimate("youngs_modulus_pa", 318_000.0, [240_000.0, 421_000.0], identifiable[0]),
                estimate("poisson_ratio", 0.3221, [0.2143, 0.4045], identifiable[1]),
            ],
            velocity_m_s: [0.3015, -1.5975, -0.2196],
            velocity_interval_95_m_s: None,
            angular_velocity_rad_s: [0.0; 3],
            grid_spacing_m: 0.02,
            grid_spacing_interval_95_m: Some([0.0195, 0.0205]),
            ground: None,
            gravity_factor: None,
            gravity_interval_95_factor: None,
            free_frames: 5,
            chamfer_m: Some(0.01),
            mask_l1: 0.0,
            mask_error: 0.07,
            rollouts: 119,
            coarse_rollouts: 27,
            seconds: Vec::new(),
            splat_factor: 1.0,
            warnings: Vec::new(),
            trace: Vec::new(),
        }
    }

    #[test]
    fn the_verdict_is_a_sentence_for_people() {
        let verdict = verdict(&found([true, true]), &[Some(0.98), None, Some(0.9)]);
        assert_eq!(verdict.standing, "good");
        let start = "This video determines the elastic twin: Young's modulus 318 kPa (95 % 240 to 421 kPa) and Poisson's \
                     ratio 0.322 (95 % 0.214 to 0.405); simulated, it overlaps the object in the film to 94 % (at worst to 90 %, in frame 2).";
        assert_eq!(verdict.text, start);
    }

    #[test]
    fn what_the_video_does_not_determine_is_said() {
        let half = verdict(&found([true, false]), &[Some(0.98)]);
        assert_eq!(half.standing, "fair");
        assert!(half.text.contains("but not Poisson's ratio"), "{}", half.text);
        let none = verdict(&found([false, false]), &[Some(0.98)]);
        assert_eq!(none.standing, "poor");
        assert!(
            none.text.starts_with("This video does not determine Young's modulus and Poisson's ratio"),
            "{}",
            none.text
        );
        assert_eq!(verdict(&found([true, true]), &[Some(0.5)]).standing, "poor");
    }

    #[test]
    fn rows_have_names_units_and_the_truth() {
        let truth = RunTruth::of(&[("youngs_modulus_pa", 3e5)], [0.3, -1.6, -0.22]);
        let rows = rows(&found([true, false]), Some(&truth));
        assert_eq!((rows[0].name.as_str(), rows[0].value.as_str()), ("Young's modulus", "318 kPa"));
        assert_eq!((rows[0].interval.as_str(), rows[0].truth.as_str()), ("240 to 421 kPa", "300 kPa"));
        assert_eq!((rows[1].standing, rows[1].truth.as_str()), ("not determined by this video", ""));
        assert_eq!((rows[3].value.as_str(), rows[3].truth.as_str()), ("-1.597 m/s", "-1.600 m/s"));
    }
}
