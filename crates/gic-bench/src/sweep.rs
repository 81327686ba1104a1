//! Several settings and seeds for each scene.

use std::str::FromStr;

use crate::error::{BenchError, Result};

/// A setting and its alternatives: `KEY=VALUE,VALUE`, or with semicolons where values hold commas.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Variation {
    key: String,
    values: Vec<String>,
}

/// What is wrong with the text of a [`Variation`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("must be KEY=VALUE,VALUE, with a key of config.toml; or KEY=VALUE;VALUE where values hold commas")]
pub struct VariationError;

impl FromStr for Variation {
    type Err = VariationError;

    fn from_str(text: &str) -> std::result::Result<Self, VariationError> {
        let (key, values) = text.split_once('=').ok_or(VariationError)?;
        let values = alternatives(values, if values.contains(';') { ';' } else { ',' });
        if key.is_empty() || values.is_empty() {
            return Err(VariationError);
        }
        Ok(Self { key: key.into(), values })
    }
}

fn alternatives(text: &str, separator: char) -> Vec<String> {
    text.split(separator).map(str::trim).filter(|value| !value.is_empty()).map(String::from).collect()
}

/// All that is varied over a suite.
#[derive(Clone, Debug, Default)]
pub struct Sweep {
    /// Settings.
    pub matrix: Vec<Variation>,
    /// Sets of cameras, such as `0,4,8;all`; empty where nothing is said of them.
    pub cameras: String,
    /// How often each is run, with a seed of its own; 0 counts as 1.
    pub repeat: usize,
    /// The first seed.
    pub seed: Option<u64>,
}

/// One way of running every scene.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Case {
    /// What sets it apart from the others, but for the seed; empty where it is the only one.
    pub name: String,
    /// The seed, where one is given.
    pub seed: Option<u64>,
    /// Folder below the scene's; empty where there is one case with one seed.
    pub folder: String,
    /// Arguments of `gic run`.
    pub arguments: Vec<String>,
}

/// The choices of one variation: what the case is called by each, and its arguments.
type Choices = Vec<(String, Vec<String>)>;

impl Sweep {
    /// Every combination, in the order of the command line; the seed changes fastest.
    ///
    /// # Errors
    /// Two cases that would share a folder.
    pub fn cases(&self) -> Result<Vec<Case>> {
        let mut cases = vec![Case::default()];
        for choices in self.matrix.iter().map(setting_choices).chain([camera_choices(&self.cameras)]) {
            cases = combined(&cases, &choices);
        }
        let seeds: Vec<Option<u64>> = match (self.repeat, self.seed) {
            (0 | 1, seed) => vec![seed],
            (count, seed) => (0..count as u64).map(|i| Some(seed.unwrap_or_default() + i)).collect(),
        };
        let repeated = seeds.len() > 1;
        let cases: Vec<Case> =
            cases.iter().flat_map(|case| seeds.iter().map(|seed| with_seed(case, *seed, repeated))).collect();
        let shared = cases.iter().enumerate().find(|(i, case)| cases[..*i].iter().any(|c| c.folder == case.folder));
        match shared {
            Some((_, case)) => Err(BenchError::usage(
                format!("two cases of the sweep would be written into \"{}\"", case.folder),
                "give each alternative once, and paths that differ in more than their signs",
            )),
            None => Ok(cases),
        }
    }
}

fn setting_choices(variation: &Variation) -> Choices {
    let choice = |value: &String| {
        let text = format!("{}={value}", variation.key);
        (text.clone(), vec!["--set".to_owned(), text])
    };
    variation.values.iter().map(choice).collect()
}

fn camera_choices(cameras: &str) -> Choices {
    let choice = |set: String| {
        let arguments = if set == "all" { Vec::new() } else { vec!["--cameras".to_owned(), set.clone()] };
        (format!("cameras={set}"), arguments)
    };
    alternatives(cameras, ';').into_iter().map(choice).collect()
}

/// Each case with each choice; a single choice does not show in the names.
fn combined(cases: &[Case], choices: &Choices) -> Vec<Case> {
    if choices.is_empty() {
        return cases.to_vec();
    }
    let with = |case: &Case, (text, arguments): &(String, Vec<String>)| {
        let mut case = case.clone();
        if choices.len() > 1 {
            case.name = joined(&case.name, " ", text);
            case.folder = joined(&case.folder, "+", &file_name(text));
        }
        case.arguments.extend(arguments.iter().cloned());
        case
    };
    cases.iter().flat_map(|case| choices.iter().map(|choice| with(case, choice)).collect::<Vec<_>>()).collect()
}

fn with_seed(case: &Case, seed: Option<u64>, repeated: bool) -> Case {
    let mut case = Case { seed, ..case.clone() };
    if let Some(seed) = seed {
        case.arguments.extend(["--seed".to_owned(), seed.to_string()]);
        if repeated {
            case.folder = joined(&case.folder, "+", &format!("seed={seed}"));
        }
    }
    case
}

fn joined(before: &str, between: &str, next: &str) -> String {
    if before.is_empty() { next.to_owned() } else { format!("{before}{between}{next}") }
}

/// A text as the name of a folder that every file system takes.
fn file_name(text: &str) -> String {
    text.chars().map(|c| if c.is_ascii_alphanumeric() || "._=,-".contains(c) { c } else { '_' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_combination_has_a_name_and_its_arguments() {
        let sweep = Sweep {
            matrix: vec!["identify.target=masks,surfaces".parse().unwrap(), "fill.levels=3".parse().unwrap()],
            cameras: "0,4,8;all".into(),
            repeat: 2,
            seed: Some(7),
        };
        let cases = sweep.cases().unwrap();
        assert_eq!(cases.len(), 8);
        let first = &cases[0];
        assert_eq!(first.name, "identify.target=masks cameras=0,4,8");
        assert_eq!(first.folder, "identify.target=masks+cameras=0,4,8+seed=7");
        let wanted = ["--set", "identify.target=masks", "--set", "fill.levels=3", "--cameras", "0,4,8", "--seed", "7"];
        assert_eq!(first.arguments, wanted);
        assert_eq!((cases[3].name.as_str(), cases[3].seed), ("identify.target=masks cameras=all", Some(8)));
        assert!(!cases[3].arguments.contains(&"--cameras".to_owned()));
    }

    #[test]
    fn one_case_has_no_name() {
        assert_eq!(Sweep::default().cases().unwrap(), [Case::default()]);
        let seeded = Sweep { seed: Some(3), ..Sweep::default() }.cases().unwrap();
        assert_eq!((seeded.len(), seeded[0].folder.as_str()), (1, ""));
        assert_eq!(seeded[0].arguments, ["--seed", "3"]);
    }

    #[test]
    fn values_may_hold_commas_and_folders_do_not_clash() {
        let vectors: Variation = "identify.gravity_m_s2=[0,-9.8,0];[0,-1,0]".parse().unwrap();
        assert_eq!(vectors.values, ["[0,-9.8,0]", "[0,-1,0]"]);
        assert!("levels".parse::<Variation>().is_err() && "levels=".parse::<Variation>().is_err());
        let clash = Sweep { matrix: vec!["scene.set=a/b,a b".parse().unwrap()], ..Sweep::default() };
        assert!(clash.cases().unwrap_err().to_string().contains("a_b"));
    }
}
