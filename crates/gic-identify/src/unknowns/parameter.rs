//! The unknowns: material parameters in coordinates in which a search is well behaved.

use std::f64::consts::LN_10;

use gic_mpm::{Material, MaterialKind};

use crate::IdentifyError;
use crate::tuning::AdamTuning;

/// How a physical value maps onto its search coordinate.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Transform {
    /// Coordinate = log10 of the value.
    Log10,
    /// The value is Poisson's ratio nu, the coordinate log10 of the bulk over the shear modulus, (2 + 2 nu) / (3 - 6
    /// nu). With log10 of Young's modulus beside it both valleys are almost straight: that of what bends, along which
    /// Young's modulus is one, and that of what yields at once and is squeezed, along which the bulk modulus is one.
    ModulusRatio,
    /// Coordinate = value / `unit`.
    Linear { unit: f64 },
}

/// One material parameter: its name in `twin.json`, its search coordinate and its limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Key in `twin.json`, with its unit.
    pub name: &'static str,
    /// Smallest and largest value that is searched.
    pub bounds: (f64, f64),
    /// Smallest and largest value of the starts that are tried when none is given.
    pub starts: (f64, f64),
    /// Widest half-width of the 95 % interval, in units of `error_unit`, that still counts as identified.
    pub widest: f64,
    /// Values of the grid of starts.
    pub(crate) grid: usize,
    transform: Transform,
}

// Ranges of the parameters. Bounds lie beyond any material that is filmed (Budget). Starts span what moves visibly
// within a second: softer matter is a puddle, stiffer matter rigid (Fitted on: the nine scenes of `tuning.rs`, which
// lie inside). The grid has about three values per decade of what has local minima, and one of what has none (Budget).
// The widest interval that counts as identified is a factor of two, .1 of Poisson's ratio, or 5 degrees to each side
// (Derived: what changes how a body moves visibly).

const fn positive(name: &'static str, bounds: (f64, f64), starts: (f64, f64), grid: usize) -> Parameter {
    Parameter { name, bounds, starts, widest: 0.3, grid, transform: Transform::Log10 }
}

const YOUNG: Parameter = positive("youngs_modulus_pa", (1.0e3, 3.0e7), (1.0e4, 3.0e6), 7);
const NU: Parameter = Parameter {
    name: "poisson_ratio",
    // At 0.5 the bulk modulus is infinite.
    bounds: (0.005, 0.485),
    starts: (0.1, 0.35),
    widest: 0.1,
    grid: 1,
    transform: Transform::ModulusRatio,
};
const YIELD: Parameter = positive("yield_stress_pa", (1.0e1, 1.0e6), (3.0e2, 3.0e4), 4);
const FRICTION: Parameter = Parameter {
    name: "friction_angle_deg",
    bounds: (1.0, 75.0),
    starts: (15.0, 45.0),
    widest: 5.0,
    grid: 6,
    transform: Transform::Linear { unit: 20.0 },
};
const VISCOSITY: Parameter = positive("viscosity_pa_s", (1.0e-1, 2.0e3), (1.0e1, 3.0e2), 4);
const FLUID_BULK: Parameter = positive("bulk_modulus_pa", (1.0e3, 1.0e7), (1.0e4, 3.0e5), 3);
const SHEAR: Parameter = positive("shear_modulus_pa", (1.0e2, 1.0e7), (3.0e3, 3.0e5), 3);
// The damping ratio is half the product of angular frequency and time (Derived): two milliseconds are some hundredths
// for a soft body in a bounce of a tenth of a second, some tenths for a rubber ball in one of a hundredth. Sought as it
// is and not as its logarithm: a body without damping is as far from one millisecond as that is from two.
const RETARDATION: Parameter = Parameter {
    name: "retardation_time_s",
    bounds: (1.0e-6, 5.0e-2),
    starts: (0.0, 4.0e-3),
    widest: 1.0e-3,
    grid: 2,
    transform: Transform::Linear { unit: 2.0e-3 },
};
const PLASTIC_VISCOSITY: Parameter = positive("plastic_viscosity_pa_s", (1.0e-1, 1.0e3), (1.0, 1.0e2), 2);

/// The parameters of a law that are sought, in the order of every vector in this crate: the leading ones of
/// [`MaterialKind::parameter_names`]. The rest is [`MaterialKind::presumed`].
pub fn sought(kind: MaterialKind) -> &'static [Parameter] {
    match kind {
        MaterialKind::Elastic => &[YOUNG, NU],
        MaterialKind::Plasticine => &[YOUNG, NU, YIELD],
        MaterialKind::Sand => &[FRICTION],
        MaterialKind::Newtonian => &[VISCOSITY, FLUID_BULK],
        MaterialKind::Viscoelastic => &[YOUNG, NU, RETARDATION],
        MaterialKind::NonNewtonian => &[SHEAR, FLUID_BULK, YIELD, PLASTIC_VISCOSITY],
    }
}

/// The sought parameter of that name.
///
/// # Errors
/// Names the parameters that are sought where it is none of them.
pub(crate) fn sought_by_name(kind: MaterialKind, name: &str) -> Result<&'static Parameter, IdentifyError> {
    sought(kind).iter().find(|p| p.name == name).ok_or_else(|| IdentifyError::UnknownParameter {
        name: name.to_owned(),
        known: sought(kind).iter().map(|p| p.name).collect::<Vec<_>>().join(", "),
    })
}

/// The material with these values of the [`sought`] parameters.
///
/// # Panics
/// Where their number is wrong.
pub fn material_of(kind: MaterialKind, values: &[f64]) -> Material {
    Material::assemble(kind, &[values, kind.presumed()].concat()).expect("one value for each sought parameter")
}

/// Values of a material's [`sought`] parameters.
pub fn sought_values(material: &Material) -> Vec<f64> {
    let mut values = material.parameters();
    values.truncate(sought(material.kind()).len());
    values
}

impl Parameter {
    /// Search coordinate of a physical value.
    pub fn coordinate(&self, value: f64) -> f64 {
        let value = value.clamp(self.bounds.0, self.bounds.1);
        match self.transform {
            Transform::Log10 => value.log10(),
            Transform::ModulusRatio => (2.0 * (1.0 + value) / (3.0 * (1.0 - 2.0 * value))).log10(),
            Transform::Linear { unit } => value / unit,
        }
    }

    /// Physical value of a search coordinate.
    pub fn value(&self, coordinate: f64) -> f64 {
        match self.transform {
            Transform::Log10 => 10f64.powf(coordinate),
            Transform::ModulusRatio => {
                let ratio = 10f64.powf(coordinate);
                (3.0 * ratio - 2.0) / (6.0 * ratio + 2.0)
            }
            Transform::Linear { unit } => coordinate * unit,
        }
    }

    /// Limits of the search coordinate.
    pub(crate) fn limits(&self) -> (f64, f64) {
        (self.coordinate(self.bounds.0), self.coordinate(self.bounds.1))
    }

    /// What changes the motion visibly, in the search coordinate: a factor of three, of 2.5 in the ratio of the
    /// moduli, or the unit of an angle or a time.
    pub(crate) fn unit(&self) -> f64 {
        match self.transform {
            Transform::Log10 => 0.5,
            Transform::ModulusRatio => 0.4,
            Transform::Linear { .. } => 1.0,
        }
    }

    /// Mean of what is left of a Gaussian that is cut at the bounds. All are in the search coordinate; every value is
    /// as likely before, in the unit of [`Parameter::error`]. By Simpson's rule over what is within eight deviations.
    pub(crate) fn mean_within_bounds(&self, centre: f64, deviation: f64) -> f64 {
        const INTERVALS: u32 = 256;
        let (low, high) = self.limits();
        let reach = 8.0 * deviation;
        let [from, to] = [low.max(centre - reach), high.min(centre + reach)].map(|end| self.even(end));
        let (mut moment, mut total) = (0.0, 0.0);
        for k in 0..=INTERVALS {
            let at = from + (to - from) * f64::from(k) / f64::from(INTERVALS);
            let rule = if k == 0 || k == INTERVALS { 1.0 } else { f64::from(2 + 2 * (k % 2)) };
            let weight = rule * (-0.5 * ((self.coordinate_of_even(at) - centre) / deviation).powi(2)).exp();
            moment += weight * at;
            total += weight;
        }
        self.coordinate_of_even(moment / total)
    }

    /// Mean and standard deviation of the search coordinate where every value within the bounds is as likely, in the
    /// unit of [`Parameter::error`]. By the midpoint rule.
    pub(crate) fn before_any_video(&self) -> (f64, f64) {
        const INTERVALS: u32 = 256;
        let (low, high) = self.limits();
        let (low, high) = (self.even(low), self.even(high));
        let share = |k: u32| (f64::from(k) + 0.5) / f64::from(INTERVALS);
        let values = (0..INTERVALS).map(|k| self.coordinate_of_even(low + share(k) * (high - low)));
        let (sum, squares) = values.fold((0.0, 0.0), |(sum, squares), at| (sum + at, squares + at * at));
        let mean = sum / f64::from(INTERVALS);
        (mean, (squares / f64::from(INTERVALS) - mean * mean).sqrt())
    }

    /// A search coordinate in the unit of [`Parameter::error`], up to a factor.
    fn even(&self, coordinate: f64) -> f64 {
        if self.transform == Transform::ModulusRatio { self.value(coordinate) } else { coordinate }
    }

    /// The inverse of [`Parameter::even`].
    fn coordinate_of_even(&self, even: f64) -> f64 {
        if self.transform == Transform::ModulusRatio { self.coordinate(even) } else { even }
    }

    /// Learning rate of the paper's Adam, in the search coordinate.
    pub(crate) fn adam_rate(&self, tuning: &AdamTuning) -> f64 {
        match (self.transform, self.name) {
            (Transform::Log10, "plastic_viscosity_pa_s") => tuning.plastic_viscosity_rate,
            (Transform::Log10, _) => tuning.rate,
            (Transform::Linear { .. }, "retardation_time_s") => tuning.rate,
            // What a change of nu changes, at a quarter.
            (Transform::ModulusRatio, _) => tuning.poisson_ratio_rate * 24.0 / (5.0 * LN_10),
            (Transform::Linear { unit }, _) => tuning.friction_angle_rate_deg / unit,
        }
    }

    /// Difference of two values in the paper's unit of error: decades, or the value itself for nu, degrees for the
    /// angle and seconds for a time.
    pub fn error(&self, estimate: f64, truth: f64) -> f64 {
        match self.transform {
            Transform::Log10 => (estimate / truth).log10(),
            _ => estimate - truth,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_is_sought_leads_the_laws_parameters() {
        for kind in MaterialKind::ALL {
            let names: Vec<&str> = sought(kind).iter().map(|p| p.name).collect();
            assert!(kind.parameter_names().starts_with(&names), "{names:?}");
        }
    }

    #[test]
    fn before_any_video_every_value_of_the_range_is_as_likely() {
        for p in sought(MaterialKind::Elastic) {
            let (mean, deviation) = p.before_any_video();
            if p.transform == Transform::ModulusRatio {
                // A standard deviation to both sides holds two thirds, about.
                let share = (p.value(mean + deviation) - p.value(mean - deviation)) / (p.bounds.1 - p.bounds.0);
                assert!((0.6..0.8).contains(&share), "{share}");
            } else {
                let (low, high) = p.limits();
                assert!((mean - f64::midpoint(low, high)).abs() < 1e-9);
                assert!((deviation / ((high - low) / 12f64.sqrt()) - 1.0).abs() < 1e-4);
            }
        }
    }

    proptest! {
        #[test]
        fn coordinates_invert_and_stay_in_bounds(kind in 0..MaterialKind::ALL.len(), u in 0.0f64..1.0, wild in -1e3f64..1e3) {
            for p in sought(MaterialKind::ALL[kind]) {
                let value = p.bounds.0 * (p.bounds.1 / p.bounds.0).powf(u);
                prop_assert!((p.value(p.coordinate(value)) / value - 1.0).abs() < 1e-9);
                let (low, high) = p.limits();
                let clamped = p.value(wild.clamp(low, high));
                prop_assert!(clamped >= p.bounds.0 * (1.0 - 1e-9) && clamped <= p.bounds.1 * (1.0 + 1e-9));
            }
        }

        #[test]
        fn materials_round_trip_through_their_values(kind in 0..MaterialKind::ALL.len(), u in 0.1f64..0.9) {
            let kind = MaterialKind::ALL[kind];
            let values: Vec<f64> =
                sought(kind).iter().map(|p| p.bounds.0 * (p.bounds.1 / p.bounds.0).powf(u)).collect();
            let material = material_of(kind, &values);
            prop_assert_eq!(sought_values(&material), values);
            prop_assert_eq!(material.kind(), kind);
        }
    }

    #[test]
    fn what_is_left_of_a_gaussian_has_its_mean_where_it_is_known_to_be() {
        // At a limit: sqrt(2 / pi) deviations from it. Uncut: its centre. Nothing is known: the middle of the range.
        let (low, high) = YOUNG.limits();
        let at_limit = YOUNG.mean_within_bounds(low, 0.1) - low;
        assert!((at_limit - 0.079_788_456).abs() < 1e-6, "{at_limit}");
        assert!((YOUNG.mean_within_bounds(5.0, 0.1) - 5.0).abs() < 1e-9);
        assert!((YOUNG.mean_within_bounds(low, 1e3) - f64::midpoint(low, high)).abs() < 1e-3);
        for at in [NU.bounds.0, 0.1, NU.bounds.1] {
            let middle = NU.value(NU.mean_within_bounds(NU.coordinate(at), 1e3));
            assert!((middle - 0.245).abs() < 1e-3, "{middle}");
        }
    }

    #[test]
    fn an_unknown_name_lists_the_known_ones() {
        let message = sought_by_name(MaterialKind::Sand, "youngs_modulus").unwrap_err().to_string();
        assert!(message.contains("friction_angle_deg"), "{message}");
    }
}
