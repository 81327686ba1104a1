//! What the user chooses.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;
use std::path::PathBuf;

use gic_mpm::MaterialKind;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::result::Stage;
use crate::unknowns::parameter::{Parameter, sought, sought_by_name};
use crate::{IdentifyError, Tuning};

/// The law that is assumed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", expecting = "`auto` or the name of a law")]
pub enum MaterialChoice {
    /// The law that, fitted to the earlier frames, predicts the later ones best.
    Auto,
    /// This one.
    #[serde(untagged)]
    Law(MaterialKind),
}

#[cfg(feature = "cli")]
impl clap::ValueEnum for MaterialChoice {
    fn value_variants<'a>() -> &'a [Self] {
        const CHOICES: [MaterialChoice; MaterialKind::ALL.len() + 1] = {
            let mut choices = [MaterialChoice::Auto; MaterialKind::ALL.len() + 1];
            let mut i = 0;
            while i < MaterialKind::ALL.len() {
                choices[i + 1] = MaterialChoice::Law(MaterialKind::ALL[i]);
                i += 1;
            }
            choices
        };
        &CHOICES
    }

    fn to_possible_value(&self) -> Option<clap::builder::PossibleValue> {
        match self {
            MaterialChoice::Auto => Some(
                clap::builder::PossibleValue::new("auto")
                    .help("The law that, fitted to the earlier frames, predicts the later ones best"),
            ),
            MaterialChoice::Law(kind) => kind.to_possible_value(),
        }
    }
}

/// Which observations take part (the paper's ablation).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Target {
    /// Masks only.
    #[default]
    Masks,
    /// Extracted surfaces only.
    Surfaces,
    /// Surfaces and masks.
    Both,
}

impl Target {
    pub(crate) fn surfaces(self) -> bool {
        self != Target::Masks
    }

    pub(crate) fn masks(self) -> bool {
        self != Target::Surfaces
    }
}

/// How the loss is minimised.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Optimizer {
    /// Levenberg-Marquardt on Jacobians from parallel rollouts.
    #[default]
    LevenbergMarquardt,
    /// The paper's Adam, with its learning rates, on the adjoint.
    Adam,
}

/// Where a fit starts, and where one ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// Values of the material's parameters, in the order of [`crate::sought`].
    pub parameters: Vec<f64>,
    /// Side of a cell of the simulation grid [m], where it is sought; by default that of the input.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grid_spacing_m: Option<f64>,
    /// Whether a ground whose contact is in doubt holds what touches it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub sticks: bool,
}

/// Settings of identification; [`Default`] is right for every scene but for the material, which has to be said.
///
/// `material` to `substeps_per_frame` say what is assumed: whoever makes the [`crate::Input`] reads them. `stages` is
/// the caller's own and in no file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::Args), group(skip), command(next_help_heading = "Identification"))]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// The material's law; auto fits every law to the earlier frames and takes the one that predicts the later ones
    /// best.
    #[cfg_attr(feature = "cli", arg(long, value_enum))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub material: Option<MaterialChoice>,
    /// Density [kg/m^3]: a video shows only the ratio of stress to density.
    #[cfg_attr(
        feature = "cli",
        arg(long = "density", value_name = "KG_M3", default_value_t = Settings::default().density_kg_m3)
    )]
    pub density_kg_m3: f64,
    /// Mass of the object [kg], weighed; its density follows from the filled volume, and moduli are absolute.
    #[cfg_attr(feature = "cli", arg(long, value_name = "KG", conflicts_with = "density_kg_m3"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass_kg: Option<f64>,
    /// Gravity [m/s^2]; by default the scene's, else 9.8 downward.
    #[cfg_attr(feature = "cli", arg(skip))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gravity_m_s2: Option<[f64; 3]>,
    /// A TOML or JSON file with a list `colliders` as in a twin; by default the scene's ground.
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub colliders: Option<PathBuf>,
    /// Side of a cell of the simulation grid [m]; by default it is sought about twice the particle spacing, and is that
    /// on film.
    #[cfg_attr(feature = "cli", arg(long, value_name = "M"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grid_spacing_m: Option<f64>,
    /// Substeps per frame, at least; by default 200 on a grid of 0.02 m, and the more the finer the grid.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub substeps_per_frame: Option<usize>,
    /// Which observations take part.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub target: Target,
    /// How the loss is minimised.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub optimizer: Optimizer,
    /// Gradient steps of Adam in the material stage; the paper takes 100 to 350.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = Settings::default().adam_iterations))]
    pub adam_iterations: usize,
    /// A parameter that is known: poisson_ratio=0.3; may be repeated.
    #[cfg_attr(feature = "cli", arg(id = "fix", long = "fix", value_name = "NAME=VALUE", value_parser = known_value))]
    #[serde(rename = "fix", serialize_with = "as_table", deserialize_with = "from_table")]
    pub fixed: Vec<(String, f64)>,
    /// Where the fit starts; by default a grid is searched.
    #[cfg_attr(feature = "cli", arg(skip))]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub starts: Vec<Start>,
    /// Initial velocity [m/s], where it is known; it is then not estimated.
    #[cfg_attr(feature = "cli", arg(skip))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity_m_s: Option<[f64; 3]>,
    /// Whether an initial rotation may be estimated; it still has to show in the data.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub rotation: bool,
    /// Most steps of a fit. It ends before where nothing is gained: this is a guard.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub iterations: usize,
    /// Frames used, from the first; all by default.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frames: Option<usize>,
    /// The first and the last stage: [`Stage::Search`] to [`Stage::Intervals`] by default, as free flight always comes
    /// first. Without the search `starts` are all starts, and without the material stage they are where such fits have
    /// ended. Without the joint stage the answer is rough, and without [`Stage::Intervals`] that of blurred masks.
    /// Where [`Stage::Velocity`] is the last, only the flight is fitted.
    #[cfg_attr(feature = "cli", arg(skip = Settings::default().stages))]
    #[serde(skip)]
    pub stages: RangeInclusive<Stage>,
    /// Whether a shift and a turn at each observation after contact are free while the material is sought alone: it is
    /// then told by the deformation, which hangs less on a shape that is known in part only.
    #[cfg_attr(feature = "cli", arg(skip))]
    #[serde(skip)]
    pub free_poses: bool,
    /// Every tuned number; a file says only what differs from the default.
    #[cfg_attr(feature = "cli", arg(skip))]
    #[serde(skip_serializing_if = "Tuning::is_default")]
    pub tuning: Tuning,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            material: None,
            density_kg_m3: 1000.0,
            mass_kg: None,
            gravity_m_s2: None,
            colliders: None,
            grid_spacing_m: None,
            substeps_per_frame: None,
            target: Target::default(),
            optimizer: Optimizer::default(),
            adam_iterations: 200,
            fixed: Vec::new(),
            starts: Vec::new(),
            velocity_m_s: None,
            rotation: true,
            iterations: 50,
            frames: None,
            stages: Stage::Search..=Stage::Intervals,
            free_poses: false,
            tuning: Tuning::default(),
        }
    }
}

impl Settings {
    /// The given value of a parameter that is not sought.
    pub(crate) fn fixed_value(&self, parameter: &Parameter) -> Option<f64> {
        self.fixed.iter().find(|(name, _)| name == parameter.name).map(|(_, value)| *value)
    }

    /// Checks every value; `fixed` and `start` against the parameters of the material, where a law is chosen, and of
    /// all laws where they are tried.
    ///
    /// # Errors
    /// [`IdentifyError::Input`] or [`IdentifyError::UnknownParameter`] for the first one that cannot be used.
    pub fn validate(&self) -> Result<(), IdentifyError> {
        self.validate_numbers()?;
        match self.material {
            Some(MaterialChoice::Law(kind)) => self.validate_for(kind),
            Some(MaterialChoice::Auto) if !self.starts.is_empty() => {
                let problem = "has the values of one law, and the law is to be found";
                Err(IdentifyError::input("starts", problem, "name the law, or leave the starts out"))
            }
            Some(MaterialChoice::Auto) => self.validate_for_any(),
            None => Ok(()),
        }
    }

    /// Checks what no law decides.
    pub(crate) fn validate_numbers(&self) -> Result<(), IdentifyError> {
        let positive = [
            ("density_kg_m3", Some(self.density_kg_m3)),
            ("mass_kg", self.mass_kg),
            ("grid_spacing_m", self.grid_spacing_m),
            ("substeps_per_frame", self.substeps_per_frame.map(|substeps| substeps as f64)),
            ("adam_iterations", Some(self.adam_iterations as f64)),
            ("iterations", Some(self.iterations as f64)),
        ];
        for (field, value) in positive {
            if let Some(value) = value.filter(|value| !(*value > 0.0 && value.is_finite())) {
                return Err(IdentifyError::input(field, format!("is {value}"), "it must be above 0"));
            }
        }
        for (field, vector) in [("gravity_m_s2", self.gravity_m_s2), ("velocity_m_s", self.velocity_m_s)] {
            if vector.is_some_and(|vector| vector.iter().any(|x| !x.is_finite())) {
                return Err(IdentifyError::input(field, "is not finite", "give three numbers"));
            }
        }
        if let Some(frames) = self.frames.filter(|frames| *frames < 2) {
            return Err(IdentifyError::input("frames", format!("is {frames}"), "two frames at least show a motion"));
        }
        Ok(())
    }

    /// Checks that each fixed value is one of some law's.
    fn validate_for_any(&self) -> Result<(), IdentifyError> {
        let mut unknown =
            self.fixed.iter().filter(|(name, _)| !MaterialKind::ALL.iter().any(|k| sought_by_name(*k, name).is_ok()));
        if let Some((name, _)) = unknown.next() {
            let known: BTreeSet<&str> = MaterialKind::ALL.iter().flat_map(|k| sought(*k)).map(|p| p.name).collect();
            let known = known.into_iter().collect::<Vec<_>>().join(", ");
            return Err(IdentifyError::UnknownParameter { name: name.clone(), known });
        }
        MaterialKind::ALL.into_iter().try_for_each(|kind| self.among_laws(kind).validate_for(kind))
    }

    /// The same where the law `kind` is one of several that are tried: fixed values of other laws' parameters are left
    /// out.
    pub fn among_laws(&self, kind: MaterialKind) -> Settings {
        let mut settings = self.clone();
        settings.fixed.retain(|(name, _)| sought_by_name(kind, name).is_ok());
        settings
    }

    /// Checks names and values against the parameters of `kind`.
    pub(crate) fn validate_for(&self, kind: MaterialKind) -> Result<(), IdentifyError> {
        for (name, value) in &self.fixed {
            let (low, high) = sought_by_name(kind, name)?.bounds;
            let is_admitted = *value >= low && *value <= high;
            if !is_admitted {
                return Err(IdentifyError::input(
                    name,
                    format!("is fixed to {value}"),
                    format!("give {low} to {high}"),
                ));
            }
        }
        let fits_material = *self.stages.end() > Stage::Velocity;
        if fits_material && !self.stages.contains(&Stage::Search) && self.starts.is_empty() {
            return Err(IdentifyError::input("starts", "is missing", "give one, or begin with the search"));
        }
        for Start { parameters, grid_spacing_m, .. } in &self.starts {
            if parameters.len() != sought(kind).len() {
                let wanted = sought(kind).iter().map(|p| p.name).collect::<Vec<_>>().join(", ");
                let problem = format!("has {} values", parameters.len());
                return Err(IdentifyError::input("starts.parameters", problem, format!("give {wanted}")));
            }
            if let Some(cell_m) = grid_spacing_m.filter(|cell_m| !(*cell_m > 0.0 && cell_m.is_finite())) {
                let problem = format!("is {cell_m}");
                return Err(IdentifyError::input("starts.grid_spacing_m", problem, "it must be above 0"));
            }
        }
        Ok(())
    }

    /// Side of a cell of the simulation grid [m], the given one or else this, and substeps per frame.
    pub fn resolution(&self, grid_spacing_m: f64) -> (f64, usize) {
        let grid_spacing_m = self.grid_spacing_m.unwrap_or(grid_spacing_m);
        let wanted = self.tuning.resolution.substeps_times_spacing_m / grid_spacing_m;
        (grid_spacing_m, self.substeps_per_frame.unwrap_or((wanted * (1.0 - 1e-9)).ceil() as usize))
    }
}

/// Why a value of the flag `--fix` is none.
#[cfg(feature = "cli")]
#[derive(Debug, thiserror::Error)]
enum KnownValueError {
    #[error("write NAME=VALUE, for example poisson_ratio=0.3")]
    NoName,
    #[error("the value is not a number")]
    NoNumber,
}

/// One value of the flag `--fix`.
#[cfg(feature = "cli")]
fn known_value(text: &str) -> Result<(String, f64), KnownValueError> {
    let (name, value) = text.split_once('=').ok_or(KnownValueError::NoName)?;
    let value = value.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    Ok((name.trim().to_owned(), value.ok_or(KnownValueError::NoNumber)?))
}

fn as_table<S: Serializer>(pairs: &[(String, f64)], serializer: S) -> Result<S::Ok, S::Error> {
    pairs.iter().cloned().collect::<BTreeMap<_, _>>().serialize(serializer)
}

fn from_table<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<(String, f64)>, D::Error> {
    Ok(BTreeMap::deserialize(deserializer)?.into_iter().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn substeps_are_those_that_the_document_says() {
        assert_eq!(Settings::default().resolution(0.02), (0.02, 200));
        assert_eq!(Settings::default().resolution(0.01), (0.01, 400));
        let given = Settings { grid_spacing_m: Some(0.04), substeps_per_frame: Some(7), ..Settings::default() };
        assert_eq!(given.resolution(0.02), (0.04, 7));
    }

    #[test]
    fn known_parameters_are_a_table_in_a_file() {
        let settings = Settings { fixed: vec![("poisson_ratio".into(), 0.3)], ..Settings::default() };
        let json = serde_json::to_value(&settings).unwrap();
        assert_eq!(json["fix"]["poisson_ratio"], 0.3);
        assert_eq!(serde_json::from_value::<Settings>(json).unwrap(), settings);
    }

    #[test]
    fn a_material_is_auto_or_a_law() {
        let read = |text: &str| serde_json::from_value::<MaterialChoice>(text.into());
        assert_eq!(read("auto").unwrap(), MaterialChoice::Auto);
        for kind in MaterialKind::ALL {
            assert_eq!(read(kind.name()).unwrap(), MaterialChoice::Law(kind));
            assert_eq!(serde_json::to_value(MaterialChoice::Law(kind)).unwrap(), kind.name());
        }
        assert!(read("jelly").unwrap_err().to_string().contains("the name of a law"));
    }
}
