//! The five materials and their parameters.

use serde::{Deserialize, Serialize};

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
}

fn sand_youngs_modulus() -> f64 {
    1.0e6
}

fn sand_poisson_ratio() -> f64 {
    0.3
}
