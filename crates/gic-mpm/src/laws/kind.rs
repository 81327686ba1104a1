//! The laws: their names, and the names and ranges of their parameters.

use serde::{Deserialize, Serialize};

/// A constitutive law without values; a material is one with values. Serialised as [`MaterialKind::name`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum MaterialKind {
    /// Neo-Hookean solid.
    Elastic,
    /// Hencky elasticity with von Mises yield.
    Plasticine,
    /// Hencky elasticity with Drucker-Prager yield, no cohesion.
    Sand,
    /// Weakly compressible viscous fluid.
    Newtonian,
    /// Viscoplastic fluid.
    NonNewtonian,
    /// Neo-Hookean solid with damping (Kelvin-Voigt).
    Viscoelastic,
}

/// The range of a parameter; a NaN is in none.
#[derive(Clone, Copy)]
pub(crate) enum Range {
    Positive,
    NotNegative,
    Poisson,
    Angle,
}

impl Range {
    pub(crate) fn holds(self, value: f64) -> bool {
        match self {
            Range::Positive => value > 0.0 && value.is_finite(),
            Range::NotNegative => value >= 0.0 && value.is_finite(),
            Range::Poisson => value > -1.0 && value < 0.5,
            Range::Angle => (0.0..90.0).contains(&value),
        }
    }

    pub(crate) fn describe(self) -> &'static str {
        match self {
            Range::Positive => "positive and finite",
            Range::NotNegative => "zero or positive, and finite",
            Range::Poisson => "above -1 and below 0.5",
            Range::Angle => "at least 0 and below 90 degrees",
        }
    }
}

impl MaterialKind {
    /// Every law, the fewest unknowns of identification first.
    pub const ALL: [MaterialKind; 6] = [
        MaterialKind::Sand,
        MaterialKind::Elastic,
        MaterialKind::Newtonian,
        MaterialKind::Viscoelastic,
        MaterialKind::Plasticine,
        MaterialKind::NonNewtonian,
    ];

    /// Its name in files and flags.
    pub fn name(self) -> &'static str {
        match self {
            MaterialKind::Elastic => "elastic",
            MaterialKind::Plasticine => "plasticine",
            MaterialKind::Sand => "sand",
            MaterialKind::Newtonian => "newtonian",
            MaterialKind::NonNewtonian => "non-newtonian",
            MaterialKind::Viscoelastic => "viscoelastic",
        }
    }

    /// Names of the parameters, with their units, as in files: the order of the material's values.
    pub fn parameter_names(self) -> &'static [&'static str] {
        match self {
            MaterialKind::Elastic => &["youngs_modulus_pa", "poisson_ratio"],
            MaterialKind::Plasticine => &["youngs_modulus_pa", "poisson_ratio", "yield_stress_pa"],
            MaterialKind::Sand => &["friction_angle_deg", "youngs_modulus_pa", "poisson_ratio"],
            MaterialKind::Newtonian => &["viscosity_pa_s", "bulk_modulus_pa"],
            MaterialKind::NonNewtonian => {
                &["shear_modulus_pa", "bulk_modulus_pa", "yield_stress_pa", "plastic_viscosity_pa_s"]
            }
            MaterialKind::Viscoelastic => &["youngs_modulus_pa", "poisson_ratio", "retardation_time_s"],
        }
    }

    /// Values of the last parameters where nothing is said of them: sand flows the same with other elasticity, which is
    /// why the paper takes it as given.
    pub fn presumed(self) -> &'static [f64] {
        match self {
            MaterialKind::Sand => &[1.0e6, 0.3],
            _ => &[],
        }
    }

    /// Ranges of the parameters, in the order of [`MaterialKind::parameter_names`].
    pub(crate) fn ranges(self) -> &'static [Range] {
        use Range::{Angle, NotNegative, Poisson, Positive};
        match self {
            MaterialKind::Elastic => &[Positive, Poisson],
            MaterialKind::Plasticine => &[Positive, Poisson, NotNegative],
            MaterialKind::Sand => &[Angle, Positive, Poisson],
            MaterialKind::Newtonian => &[NotNegative, Positive],
            MaterialKind::NonNewtonian => &[Positive, Positive, NotNegative, NotNegative],
            MaterialKind::Viscoelastic => &[Positive, Poisson, NotNegative],
        }
    }
}
