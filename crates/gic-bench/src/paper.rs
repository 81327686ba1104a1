//! Parameters in the units of the paper's table, and its figures.

/// A parameter's value on the scale of the paper's table.
pub fn paper_value(name: &str, value: f64) -> f64 {
    match name {
        "poisson_ratio" => value,
        "friction_angle_deg" => value.to_radians(),
        _ => value.log10(),
    }
}

/// What the paper's table calls a parameter.
pub fn paper_name(model: &str, name: &str) -> &'static str {
    match (model, name) {
        (_, "youngs_modulus_pa") => "log10(E)",
        (_, "poisson_ratio") => "nu",
        (_, "yield_stress_pa") => "log10(tau_Y)",
        (_, "friction_angle_deg") => "theta_fric",
        (_, "viscosity_pa_s" | "shear_modulus_pa") => "log10(mu)",
        (_, "bulk_modulus_pa") => "log10(kappa)",
        (_, "retardation_time_s") => "t_r",
        _ => "log10(eta)",
    }
}

/// The paper's column "Ours" of its table of parameters: mean and standard deviation of the absolute error, times 100.
const PAPER: &[(&str, &str, [f64; 2])] = &[
    ("newtonian", "log10(mu)", [1.53, 1.31]),
    ("newtonian", "log10(kappa)", [14.8, 19.2]),
    ("newtonian", "v", [0.20, 0.07]),
    ("non-newtonian", "log10(mu)", [13.5, 18.2]),
    ("non-newtonian", "log10(kappa)", [12.9, 16.8]),
    ("non-newtonian", "log10(tau_Y)", [4.80, 3.92]),
    ("non-newtonian", "log10(eta)", [40.7, 24.6]),
    ("non-newtonian", "v", [0.19, 0.09]),
    ("elastic", "log10(E)", [2.43, 3.29]),
    ("elastic", "nu", [2.52, 2.03]),
    ("elastic", "v", [0.82, 0.32]),
    ("plasticine", "log10(E)", [25.6, 29.4]),
    ("plasticine", "log10(tau_Y)", [1.67, 1.21]),
    ("plasticine", "nu", [9.59, 5.00]),
    ("plasticine", "v", [0.22, 0.10]),
    ("sand", "theta_fric", [4.18, 0.52]),
    ("sand", "v", [0.17, 0.05]),
];

/// The paper's mean and standard deviation of the absolute error, times 100, where it has them.
pub(crate) fn paper_figures(model: &str, parameter: &str) -> Option<[f64; 2]> {
    PAPER.iter().find(|(m, p, _)| (*m, *p) == (model, parameter)).map(|(_, _, figures)| *figures)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_in_the_papers_units() {
        let error = |name: &str, a: f64, b: f64| 100.0 * (paper_value(name, a) - paper_value(name, b)).abs();
        assert!((error("youngs_modulus_pa", 1.1e5, 1.0e5) - 4.139).abs() < 1e-3);
        assert!((error("poisson_ratio", 0.31, 0.30) - 1.0).abs() < 1e-9);
        assert!((error("friction_angle_deg", 32.4, 30.0) - 4.189).abs() < 1e-3);
    }
}
