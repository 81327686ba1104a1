//! The materials and their parameters.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::laws::kind::MaterialKind;
use crate::laws::law::Coefficients;

/// A constitutive law and its parameters in SI units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "model", rename_all = "kebab-case")]
pub enum Material {
    /// Neo-Hookean solid.
    Elastic {
        /// Young's modulus E [Pa].
        youngs_modulus_pa: f64,
        /// Poisson's ratio nu, in (-1, 0.5).
        poisson_ratio: f64,
    },
    /// Hencky elasticity with a von Mises return map; yields at |deviatoric Hencky strain| = yield stress / (2 mu).
    Plasticine {
        /// Young's modulus E [Pa].
        youngs_modulus_pa: f64,
        /// Poisson's ratio nu, in (-1, 0.5).
        poisson_ratio: f64,
        /// Yield stress tau_Y [Pa].
        yield_stress_pa: f64,
    },
    /// Hencky elasticity with a Drucker-Prager return map, no cohesion.
    Sand {
        /// Friction angle [degrees].
        friction_angle_deg: f64,
        /// Young's modulus E [Pa].
        #[serde(default = "sand_youngs_modulus")]
        youngs_modulus_pa: f64,
        /// Poisson's ratio nu, in (-1, 0.5).
        #[serde(default = "sand_poisson_ratio")]
        poisson_ratio: f64,
    },
    /// Weakly compressible viscous fluid.
    Newtonian {
        /// Dynamic viscosity mu [Pa s].
        viscosity_pa_s: f64,
        /// Bulk modulus kappa [Pa].
        bulk_modulus_pa: f64,
    },
    /// Viscoplastic (Herschel-Bulkley with exponent 1, Yue et al. 2015).
    NonNewtonian {
        /// Shear modulus mu [Pa].
        shear_modulus_pa: f64,
        /// Bulk modulus kappa [Pa].
        bulk_modulus_pa: f64,
        /// Yield stress tau_Y [Pa]; yields at |deviatoric stress| = sqrt(2/3) tau_Y.
        yield_stress_pa: f64,
        /// Plastic viscosity eta [Pa s].
        plastic_viscosity_pa_s: f64,
    },
    /// Neo-Hookean solid whose moduli are delayed (Kelvin-Voigt): it loses energy when it deforms.
    Viscoelastic {
        /// Young's modulus E [Pa].
        youngs_modulus_pa: f64,
        /// Poisson's ratio nu, in (-1, 0.5).
        poisson_ratio: f64,
        /// Retardation time t_r [s]: viscosity over modulus, the same in shear and compression.
        retardation_time_s: f64,
    },
}

fn sand_youngs_modulus() -> f64 {
    MaterialKind::Sand.presumed()[0]
}

fn sand_poisson_ratio() -> f64 {
    MaterialKind::Sand.presumed()[1]
}

/// What is wrong with a material's parameters.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MaterialError {
    /// The material has no parameter of that name.
    #[error("material {model} has no parameter `{name}`; it has {}", known.join(", "))]
    UnknownParameter {
        /// The material.
        model: &'static str,
        /// The name asked for.
        name: String,
        /// The names that it has.
        known: &'static [&'static str],
    },
    /// A parameter is out of range, or not a number.
    #[error("material {model}: {name} = {value} is out of range; it must be {must_be}")]
    OutOfRange {
        /// The material.
        model: &'static str,
        /// The parameter.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        must_be: &'static str,
    },
    /// A list of values does not have one value per parameter.
    #[error("material {model} has {} parameters ({}), got {count} values", known.len(), known.join(", "))]
    WrongCount {
        /// The material.
        model: &'static str,
        /// The names that it has.
        known: &'static [&'static str],
        /// How many values were given.
        count: usize,
    },
}

impl Material {
    /// The material with these parameters, in the order of [`MaterialKind::parameter_names`], whatever their values;
    /// `None` where their number is wrong.
    pub fn assemble(kind: MaterialKind, values: &[f64]) -> Option<Material> {
        match (kind, values) {
            (MaterialKind::Elastic, &[youngs_modulus_pa, poisson_ratio]) => {
                Some(Material::Elastic { youngs_modulus_pa, poisson_ratio })
            }
            (MaterialKind::Plasticine, &[youngs_modulus_pa, poisson_ratio, yield_stress_pa]) => {
                Some(Material::Plasticine { youngs_modulus_pa, poisson_ratio, yield_stress_pa })
            }
            (MaterialKind::Sand, &[friction_angle_deg, youngs_modulus_pa, poisson_ratio]) => {
                Some(Material::Sand { friction_angle_deg, youngs_modulus_pa, poisson_ratio })
            }
            (MaterialKind::Newtonian, &[viscosity_pa_s, bulk_modulus_pa]) => {
                Some(Material::Newtonian { viscosity_pa_s, bulk_modulus_pa })
            }
            (
                MaterialKind::NonNewtonian,
                &[shear_modulus_pa, bulk_modulus_pa, yield_stress_pa, plastic_viscosity_pa_s],
            ) => Some(Material::NonNewtonian {
                shear_modulus_pa,
                bulk_modulus_pa,
                yield_stress_pa,
                plastic_viscosity_pa_s,
            }),
            (MaterialKind::Viscoelastic, &[youngs_modulus_pa, poisson_ratio, retardation_time_s]) => {
                Some(Material::Viscoelastic { youngs_modulus_pa, poisson_ratio, retardation_time_s })
            }
            _ => None,
        }
    }

    /// As [`Material::assemble`], with values that are in range.
    ///
    /// # Errors
    /// When the count is wrong or a value is out of range.
    pub fn new(kind: MaterialKind, values: &[f64]) -> Result<Material, MaterialError> {
        let wrong_count =
            || MaterialError::WrongCount { model: kind.name(), known: kind.parameter_names(), count: values.len() };
        let material = Material::assemble(kind, values).ok_or_else(wrong_count)?;
        material.validate()?;
        Ok(material)
    }

    /// Which law it is.
    pub fn kind(&self) -> MaterialKind {
        match self {
            Material::Elastic { .. } => MaterialKind::Elastic,
            Material::Plasticine { .. } => MaterialKind::Plasticine,
            Material::Sand { .. } => MaterialKind::Sand,
            Material::Newtonian { .. } => MaterialKind::Newtonian,
            Material::NonNewtonian { .. } => MaterialKind::NonNewtonian,
            Material::Viscoelastic { .. } => MaterialKind::Viscoelastic,
        }
    }

    /// The name of the law, see [`MaterialKind::name`].
    pub fn model(&self) -> &'static str {
        self.kind().name()
    }

    /// Names of the parameters, in the order of [`Material::parameters`].
    pub fn parameter_names(&self) -> &'static [&'static str] {
        self.kind().parameter_names()
    }

    /// The parameters in SI units (angles in degrees), in the order of [`Material::parameter_names`].
    pub fn parameters(&self) -> Vec<f64> {
        match *self {
            Material::Elastic { youngs_modulus_pa, poisson_ratio } => vec![youngs_modulus_pa, poisson_ratio],
            Material::Plasticine { youngs_modulus_pa, poisson_ratio, yield_stress_pa } => {
                vec![youngs_modulus_pa, poisson_ratio, yield_stress_pa]
            }
            Material::Sand { friction_angle_deg, youngs_modulus_pa, poisson_ratio } => {
                vec![friction_angle_deg, youngs_modulus_pa, poisson_ratio]
            }
            Material::Newtonian { viscosity_pa_s, bulk_modulus_pa } => vec![viscosity_pa_s, bulk_modulus_pa],
            Material::NonNewtonian { shear_modulus_pa, bulk_modulus_pa, yield_stress_pa, plastic_viscosity_pa_s } => {
                vec![shear_modulus_pa, bulk_modulus_pa, yield_stress_pa, plastic_viscosity_pa_s]
            }
            Material::Viscoelastic { youngs_modulus_pa, poisson_ratio, retardation_time_s } => {
                vec![youngs_modulus_pa, poisson_ratio, retardation_time_s]
            }
        }
    }

    /// The same law with other parameters, in the order of [`Material::parameter_names`].
    ///
    /// # Errors
    /// When the count is wrong or a value is out of range.
    pub fn with_parameters(&self, values: &[f64]) -> Result<Material, MaterialError> {
        Material::new(self.kind(), values)
    }

    /// The same material with one parameter changed.
    ///
    /// # Errors
    /// When the material has no such parameter or the value is out of range.
    pub fn with(&self, name: &str, value: f64) -> Result<Material, MaterialError> {
        let (model, names) = (self.model(), self.parameter_names());
        let index = names.iter().position(|known| *known == name).ok_or_else(|| MaterialError::UnknownParameter {
            model,
            name: name.to_owned(),
            known: names,
        })?;
        let mut values = self.parameters();
        values[index] = value;
        self.with_parameters(&values)
    }

    /// Checks that every parameter is in its range.
    ///
    /// # Errors
    /// Names the first that is not.
    pub fn validate(&self) -> Result<(), MaterialError> {
        let (model, kind) = (self.model(), self.kind());
        for ((&name, range), value) in kind.parameter_names().iter().zip(kind.ranges()).zip(self.parameters()) {
            if !range.holds(value) {
                return Err(MaterialError::OutOfRange { model, name, value, must_be: range.describe() });
            }
        }
        Ok(())
    }

    /// Speed of the fastest elastic wave in the material at rest [m/s], for the bound on the time step.
    ///
    /// Solids: `sqrt((lambda + 2 mu) / density)`. The fluid's pressure `kappa (J - J^-6)` has the tangent `7 kappa` at
    /// rest.
    pub fn wave_speed_m_s(&self, density_kg_m3: f64) -> f64 {
        let [mu, lambda, ..] = self.coefficients().0;
        let modulus = match *self {
            Material::Newtonian { bulk_modulus_pa, .. } => 7.0 * bulk_modulus_pa,
            _ => lambda + 2.0 * mu,
        };
        (modulus / density_kg_m3).sqrt()
    }

    /// Young's modulus [Pa] and Poisson's ratio of small elastic strains; `None` for the Newtonian fluid, which bears
    /// no shear at rest.
    pub fn elastic_moduli(&self) -> Option<[f64; 2]> {
        match *self {
            Material::Newtonian { .. } => None,
            Material::Elastic { youngs_modulus_pa, poisson_ratio }
            | Material::Plasticine { youngs_modulus_pa, poisson_ratio, .. }
            | Material::Sand { youngs_modulus_pa, poisson_ratio, .. }
            | Material::Viscoelastic { youngs_modulus_pa, poisson_ratio, .. } => {
                Some([youngs_modulus_pa, poisson_ratio])
            }
            Material::NonNewtonian { shear_modulus_pa: mu, bulk_modulus_pa: kappa, .. } => {
                Some([9.0 * kappa * mu / (3.0 * kappa + mu), (3.0 * kappa - 2.0 * mu) / (2.0 * (3.0 * kappa + mu))])
            }
        }
    }

    /// The von Mises value of the Kirchhoff stress [Pa] at which the material begins to flow; `None` where that does
    /// not depend on it alone. The plastic laws bound the norm of the stress deviator, whose von Mises value is
    /// sqrt(3/2) times it.
    pub fn yield_von_mises_pa(&self) -> Option<f64> {
        match *self {
            Material::Plasticine { yield_stress_pa, .. } => Some(1.5f64.sqrt() * yield_stress_pa),
            Material::NonNewtonian { yield_stress_pa, .. } => Some(yield_stress_pa),
            _ => None,
        }
    }

    /// Diffusivity of momentum by an explicit viscous stress [m^2/s], for the bound on the time step: the largest power
    /// that any velocity gradient C loses, over the density and |C|^2. Zero where no law is viscous: the viscoplastic
    /// flow rule is implicit.
    pub fn viscous_diffusivity_m2_s(&self, density_kg_m3: f64) -> f64 {
        match *self {
            Material::Newtonian { viscosity_pa_s, .. } => viscosity_pa_s / density_kg_m3,
            Material::Viscoelastic { youngs_modulus_pa, poisson_ratio, retardation_time_s } => {
                let [mu, lambda] = lame(youngs_modulus_pa, poisson_ratio);
                // In shear, or swelling evenly.
                retardation_time_s * (2.0 * mu).max(2.0 * mu + 3.0 * lambda) / density_kg_m3
            }
            _ => 0.0,
        }
    }

    /// The numbers that the law's kernel sees.
    pub(crate) fn coefficients(&self) -> Coefficients {
        Coefficients(match *self {
            Material::Elastic { youngs_modulus_pa, poisson_ratio } => {
                let [mu, lambda] = lame(youngs_modulus_pa, poisson_ratio);
                [mu, lambda, 0.0, 0.0]
            }
            Material::Plasticine { youngs_modulus_pa, poisson_ratio, yield_stress_pa } => {
                let [mu, lambda] = lame(youngs_modulus_pa, poisson_ratio);
                [mu, lambda, yield_stress_pa, 0.0]
            }
            Material::Sand { friction_angle_deg, youngs_modulus_pa, poisson_ratio } => {
                let [mu, lambda] = lame(youngs_modulus_pa, poisson_ratio);
                [mu, lambda, cone_slope(friction_angle_deg), 0.0]
            }
            Material::Newtonian { viscosity_pa_s, bulk_modulus_pa } => {
                [viscosity_pa_s, bulk_modulus_pa - 2.0 / 3.0 * viscosity_pa_s, 0.0, 0.0]
            }
            Material::NonNewtonian { shear_modulus_pa, bulk_modulus_pa, yield_stress_pa, plastic_viscosity_pa_s } => {
                let lambda = bulk_modulus_pa - 2.0 / 3.0 * shear_modulus_pa;
                [shear_modulus_pa, lambda, yield_stress_pa, plastic_viscosity_pa_s]
            }
            Material::Viscoelastic { youngs_modulus_pa, poisson_ratio, retardation_time_s } => {
                let [mu, lambda] = lame(youngs_modulus_pa, poisson_ratio);
                [mu, lambda, retardation_time_s, 0.0]
            }
        })
    }

    /// From the derivative of a loss with respect to the coefficients to that with respect to the parameters.
    pub(crate) fn parameter_gradient(&self, coefficients_bar: &Coefficients) -> Vec<f64> {
        let [mu_bar, lambda_bar, third_bar, fourth_bar] = coefficients_bar.0;
        match *self {
            Material::Elastic { youngs_modulus_pa, poisson_ratio } => {
                lame_gradient(youngs_modulus_pa, poisson_ratio, mu_bar, lambda_bar).to_vec()
            }
            Material::Plasticine { youngs_modulus_pa, poisson_ratio, .. }
            | Material::Viscoelastic { youngs_modulus_pa, poisson_ratio, .. } => {
                let [e, nu] = lame_gradient(youngs_modulus_pa, poisson_ratio, mu_bar, lambda_bar);
                vec![e, nu, third_bar]
            }
            Material::Sand { friction_angle_deg, youngs_modulus_pa, poisson_ratio } => {
                let [e, nu] = lame_gradient(youngs_modulus_pa, poisson_ratio, mu_bar, lambda_bar);
                vec![cone_slope_derivative(friction_angle_deg) * third_bar, e, nu]
            }
            Material::Newtonian { .. } => vec![mu_bar - 2.0 / 3.0 * lambda_bar, lambda_bar],
            Material::NonNewtonian { .. } => {
                vec![mu_bar - 2.0 / 3.0 * lambda_bar, lambda_bar, third_bar, fourth_bar]
            }
        }
    }
}

/// Lame's mu and lambda [Pa] from Young's modulus [Pa] and Poisson's ratio.
fn lame(e: f64, nu: f64) -> [f64; 2] {
    [e / (2.0 * (1.0 + nu)), e * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))]
}

/// The derivative with respect to (E, nu) from that with respect to (mu, lambda).
fn lame_gradient(e: f64, nu: f64, mu_bar: f64, lambda_bar: f64) -> [f64; 2] {
    let [mu, lambda] = lame(e, nu);
    let volumetric = (1.0 + nu) * (1.0 - 2.0 * nu);
    let lambda_nu = e * (1.0 + 2.0 * nu * nu) / (volumetric * volumetric);
    [(mu_bar * mu + lambda_bar * lambda) / e, -mu_bar * mu / (1.0 + nu) + lambda_bar * lambda_nu]
}

/// The slope alpha of the Drucker-Prager cone, `sqrt(2/3) 2 sin(angle) / (3 - sin(angle))`.
fn cone_slope(friction_angle_deg: f64) -> f64 {
    let sin = friction_angle_deg.to_radians().sin();
    (2.0_f64 / 3.0).sqrt() * 2.0 * sin / (3.0 - sin)
}

/// The derivative of [`cone_slope`] per degree.
fn cone_slope_derivative(friction_angle_deg: f64) -> f64 {
    let (sin, cos) = friction_angle_deg.to_radians().sin_cos();
    (2.0_f64 / 3.0).sqrt() * 6.0 * cos / (3.0 - sin).powi(2) * 1.0_f64.to_radians()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one_of_each() -> [Material; 6] {
        [
            Material::Elastic { youngs_modulus_pa: 3.0e5, poisson_ratio: 0.3 },
            Material::Plasticine { youngs_modulus_pa: 1.0e6, poisson_ratio: -0.2, yield_stress_pa: 5.0e3 },
            Material::Sand { friction_angle_deg: 35.0, youngs_modulus_pa: 1.0e6, poisson_ratio: 0.45 },
            Material::Newtonian { viscosity_pa_s: 200.0, bulk_modulus_pa: 1.0e5 },
            Material::NonNewtonian {
                shear_modulus_pa: 1.0e4,
                bulk_modulus_pa: 1.0e5,
                yield_stress_pa: 1.0e3,
                plastic_viscosity_pa_s: 10.0,
            },
            Material::Viscoelastic { youngs_modulus_pa: 2.0e5, poisson_ratio: 0.4, retardation_time_s: 1.0e-3 },
        ]
    }

    #[test]
    fn elastic_moduli_are_those_of_the_coefficients() {
        for material in one_of_each() {
            let [mu, lambda, ..] = material.coefficients().0;
            match material.elastic_moduli() {
                Some([young, nu]) => {
                    assert!((lame(young, nu)[0] / mu - 1.0).abs() < 1e-12);
                    assert!((lame(young, nu)[1] / lambda - 1.0).abs() < 1e-12);
                }
                None => assert_eq!(material.model(), "newtonian"),
            }
        }
    }

    #[test]
    fn kinds_name_what_is_serialised() {
        for kind in MaterialKind::ALL {
            let names = kind.parameter_names();
            let material = Material::assemble(kind, &vec![0.25; names.len()]).unwrap();
            assert_eq!((material.kind(), names.len()), (kind, kind.ranges().len()));
            let serialised = serde_json::to_value(material).unwrap();
            let object = serialised.as_object().unwrap();
            assert_eq!((&object["model"], object.len()), (&serde_json::to_value(kind).unwrap(), names.len() + 1));
            assert!(names.iter().all(|name| object[*name] == 0.25), "{serialised}");
            assert_eq!(object["model"], kind.name());
        }
    }

    #[test]
    fn parameters_and_names_round_trip() {
        for material in one_of_each() {
            assert_eq!(material.parameters().len(), material.parameter_names().len());
            assert_eq!(material.with_parameters(&material.parameters()), Ok(material));
            for (name, value) in material.parameter_names().iter().zip(material.parameters()) {
                let changed = material.with(name, 0.9 * value).unwrap();
                assert_ne!(changed, material);
                assert_eq!(changed.with(name, value), Ok(material));
            }
        }
    }

    #[test]
    fn parameter_gradient_is_the_derivative_of_the_coefficients() {
        for (material, coefficient) in one_of_each().into_iter().flat_map(|m| (0..4).map(move |c| (m, c))) {
            let mut bars = [0.0; 4];
            bars[coefficient] = 1.0;
            let gradient = material.parameter_gradient(&Coefficients(bars));
            for i in 0..gradient.len() {
                let value = |relative_step: f64| {
                    let mut values = material.parameters();
                    values[i] *= 1.0 + relative_step;
                    material.with_parameters(&values).unwrap().coefficients().0[coefficient]
                };
                let central = (value(1e-5) - value(-1e-5)) / (2e-5 * material.parameters()[i]);
                assert!(
                    (gradient[i] - central).abs() <= 1e-7 * central.abs(),
                    "{material:?} {i}: {} {central}",
                    gradient[i]
                );
            }
        }
    }

    #[test]
    fn lame_parameters_match_the_published_fixture() {
        let material = Material::Elastic { youngs_modulus_pa: 3.0e5, poisson_ratio: 0.3 };
        let [mu, lambda, ..] = material.coefficients().0;
        assert!((mu - 115384.61538461538).abs() < 1e-6 && (lambda - 173076.92307692306).abs() < 1e-6);
        let sand = Material::Sand { friction_angle_deg: 35.0, youngs_modulus_pa: 1.0e6, poisson_ratio: 0.3 };
        assert!((sand.coefficients().0[2] - 0.386019330011002).abs() < 1e-12);
    }

    #[test]
    fn absurd_parameters_are_named() {
        let elastic = one_of_each()[0];
        for (name, value) in [
            ("poisson_ratio", 0.5),
            ("poisson_ratio", -1.0),
            ("poisson_ratio", f64::NAN),
            ("youngs_modulus_pa", 0.0),
            ("youngs_modulus_pa", -1.0),
            ("youngs_modulus_pa", f64::INFINITY),
            ("youngs_modulus_pa", f64::NAN),
        ] {
            let error = elastic.with(name, value).unwrap_err();
            assert!(matches!(error, MaterialError::OutOfRange { name: n, .. } if n == name), "{error}");
        }
        let error = elastic.with("yield_stress_pa", 1.0).unwrap_err();
        assert!(error.to_string().contains("youngs_modulus_pa, poisson_ratio"), "{error}");
        assert!(matches!(elastic.with_parameters(&[1.0]), Err(MaterialError::WrongCount { count: 1, .. })));
        for angle in [-1.0, 90.0, f64::NAN] {
            assert!(one_of_each()[2].with("friction_angle_deg", angle).is_err());
        }
        assert!(one_of_each()[1].with("yield_stress_pa", -1.0).is_err());
    }
}
