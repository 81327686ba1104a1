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
