//! What the colours of particles mean.

use std::path::Path;

use gic_mpm::Material;
use gic_twin::simulate::{FrameSummary, Trajectory};
use gic_twin::twin::Twin;

use super::simulated_motion::FrameParticles;
use crate::units::{Unit, three_digits};

/// Value of the degree-0 harmonic: colour = 0.5 + this * coefficient.
const SH0: f32 = 0.282_094_8;

/// Colour of matter without colours of its own, RGB in [0, 1].
pub(crate) const PLAIN_RGB: [f32; 3] = [0.80, 0.58, 0.42];

/// Strain of a solid, and rate of shear of a fluid [1/s], whose stress is still drawn red where nothing is larger:
/// below lies the rounding of a body in free flight. Derived: no eye sees a body bend by a thousandth.
const LEAST_STRAIN: f64 = 1e-3;
const LEAST_SHEAR_RATE_HZ: f64 = 1.0;
/// The same for speeds [m/s]. Derived: a centimetre a second is hardly seen on a body at hand.
const LEAST_SPEED_M_S: f64 = 0.01;

/// RGB in [0, 1] as bytes.
pub(crate) fn byte_color(rgb: [f32; 3]) -> [u8; 3] {
    rgb.map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8)
}

/// Meaning of the colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Coloring {
    /// Von Mises stress, from blue to red.
    Stress,
    /// Speed, from blue to red.
    Speed,
    /// One colour for all.
    Plain,
    /// As the video showed the object.
    Appearance,
}

/// From a particle's value to its colour.
pub(crate) struct ColorScale {
    coloring: Coloring,
    /// The value that is drawn red.
    max_value: f64,
}

impl ColorScale {
    /// Red is the largest value of a typical frame: the median of the frames' maxima, so that one short impact does not
    /// leave all else blue; but never less than what the material shows at a strain that no eye sees.
    pub(crate) fn new(coloring: Coloring, trajectory: &Trajectory) -> Self {
        let largest = |frame: &FrameSummary| match coloring {
            Coloring::Stress => frame.largest_von_mises_pa,
            Coloring::Speed => frame.largest_speed_m_s,
            Coloring::Plain | Coloring::Appearance => 1.0,
        };
        let mut maxima: Vec<f64> = trajectory.frames.iter().map(largest).collect();
        maxima.sort_by(f64::total_cmp);
        let least = match coloring {
            Coloring::Stress => least_stress_pa(&trajectory.twin),
            Coloring::Speed => LEAST_SPEED_M_S,
            Coloring::Plain | Coloring::Appearance => 1.0,
        };
        // Half of the frames may show a flight; then red is typical of those with contact.
        let first = maxima.partition_point(|&value| value <= least);
        let typical = maxima[first..].get((maxima.len() - first) / 2).copied();
        Self { coloring, max_value: typical.unwrap_or(least).max(least) }
    }

    /// The value that is drawn red: [Pa] or [m/s].
    pub(crate) fn max_value(&self) -> f64 {
        self.max_value
    }

    /// Red is the von Mises stress given [Pa].
    pub(super) fn stress(most_pa: f64) -> Self {
        Self { coloring: Coloring::Stress, max_value: if most_pa > 0.0 { most_pa } else { 1.0 } }
    }

    /// What the colours measure, and in which unit the scale is short; `None` where they measure nothing.
    pub(super) fn title(&self) -> Option<(&'static str, Unit)> {
        match self.coloring {
            Coloring::Stress => Some(("von Mises stress", Unit::pressure(self.max_value))),
            Coloring::Speed => Some(("speed", Unit::speed(self.max_value))),
            Coloring::Plain | Coloring::Appearance => None,
        }
    }

    pub(crate) fn legend(&self) -> String {
        match self.coloring {
            Coloring::Plain | Coloring::Appearance => "colour: plain".into(),
            Coloring::Stress | Coloring::Speed => self.title().map_or(String::new(), |(title, unit)| {
                let most = three_digits(self.max_value / unit.size);
                format!("colour: {title}, blue 0 to red {most} {} and more", unit.name)
            }),
        }
    }

    /// The particles' colours, RGB in [0, 1].
    pub(crate) fn colors(&self, particles: &FrameParticles) -> Vec<[f32; 3]> {
        let along = |values: &[f32]| values.iter().map(|&v| blue_to_red(v / self.max_value as f32)).collect();
        match self.coloring {
            Coloring::Stress => along(&particles.von_mises_pa),
            Coloring::Speed => along(&particles.speeds),
            Coloring::Plain | Coloring::Appearance => vec![PLAIN_RGB; particles.positions.len()],
        }
    }

    /// The particles' colours as coefficients of the degree-0 harmonic.
    pub(crate) fn harmonics(&self, particles: &FrameParticles) -> Vec<[f32; 3]> {
        self.colors(particles).into_iter().map(|color| color.map(|c| (c - 0.5) / SH0)).collect()
    }
}

/// The smallest von Mises stress [Pa] that is worth red: what a strain or a rate that no eye sees does to the stiffest
/// of the bodies.
pub(crate) fn least_stress_pa(twin: &serde_json::Value) -> f64 {
    let companions = twin.get("companions").and_then(|list| list.as_array()).into_iter().flatten();
    let twins = std::iter::once(twin).chain(companions.filter_map(|companion| companion.get("twin")));
    let materials = twins.filter_map(|twin| Twin::material_of(Path::new("twin"), twin.get("material")?).ok());
    let least = |material: Material| match (material, material.elastic_moduli()) {
        (_, Some([youngs_modulus_pa, _])) => LEAST_STRAIN * youngs_modulus_pa,
        (Material::Newtonian { viscosity_pa_s, .. }, None) => LEAST_SHEAR_RATE_HZ * viscosity_pa_s,
        _ => 1.0,
    };
    materials.map(least).reduce(f64::max).unwrap_or(1.0)
}

/// Blue, light blue, yellow, red for 0 to 1; what is no number is grey.
pub(super) fn blue_to_red(t: f32) -> [f32; 3] {
    const STOPS: [[f32; 3]; 4] = [[0.16, 0.27, 0.66], [0.35, 0.70, 0.90], [0.98, 0.86, 0.38], [0.84, 0.15, 0.16]];
    if t.is_nan() {
        return [0.5; 3];
    }
    let at = t.clamp(0.0, 1.0) * (STOPS.len() - 1) as f32;
    let lower = (at as usize).min(STOPS.len() - 2);
    let share = at - lower as f32;
    std::array::from_fn(|c| STOPS[lower][c] + share * (STOPS[lower + 1][c] - STOPS[lower][c]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_noise_of_a_flight_is_not_red() {
        let twin =
            serde_json::json!({"material": {"model": "elastic", "youngs_modulus_pa": 1e5, "poisson_ratio": 0.3}});
        assert_eq!(least_stress_pa(&twin), 100.0);
        let stiffer =
            serde_json::json!({"material": {"model": "elastic", "youngs_modulus_pa": 3e5, "poisson_ratio": 0.3}});
        let pair =
            serde_json::json!({"material": twin["material"], "companions": [{"shift_m": [0, 1, 0], "twin": stiffer}]});
        assert_eq!(least_stress_pa(&pair), 300.0);
        let honey =
            serde_json::json!({"material": {"model": "newtonian", "viscosity_pa_s": 5.0, "bulk_modulus_pa": 1e5}});
        assert_eq!(least_stress_pa(&honey), 5.0);
    }

    #[test]
    fn colours_run_from_blue_to_red_and_stay_in_range() {
        assert_eq!(blue_to_red(-1.0), blue_to_red(0.0));
        assert_eq!(blue_to_red(7.0), blue_to_red(1.0));
        assert!(blue_to_red(0.0)[2] > blue_to_red(0.0)[0] && blue_to_red(1.0)[0] > blue_to_red(1.0)[2]);
        assert_eq!(blue_to_red(f32::NAN), [0.5; 3]);
    }
}
