//! Numbers for people: names of quantities, and units in which a number is short.

/// A unit: a value in SI is so many times `size`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    /// As it is written behind a number.
    pub name: &'static str,
    /// Its size in SI.
    pub size: f64,
}

const fn unit(name: &'static str, size: f64) -> Unit {
    Unit { name, size }
}

impl Unit {
    /// For pressures and moduli about as large as a value [Pa].
    pub fn pressure(value: f64) -> Self {
        match value.abs() {
            v if v >= 1e9 => unit("GPa", 1e9),
            v if v >= 1e6 => unit("MPa", 1e6),
            v if v >= 1e3 => unit("kPa", 1e3),
            _ => unit("Pa", 1.0),
        }
    }

    /// For speeds about as large as a value [m/s].
    pub fn speed(value: f64) -> Self {
        if value.abs() >= 0.1 { unit("m/s", 1.0) } else { unit("mm/s", 1e-3) }
    }
}

/// What a key of a twin is called, and the unit for a value of it.
pub fn quantity(key: &str, value: f64) -> (&'static str, Unit) {
    match key {
        "youngs_modulus_pa" => ("Young's modulus", Unit::pressure(value)),
        "shear_modulus_pa" => ("Shear modulus", Unit::pressure(value)),
        "bulk_modulus_pa" => ("Bulk modulus", Unit::pressure(value)),
        "yield_stress_pa" => ("Yield stress", Unit::pressure(value)),
        "poisson_ratio" => ("Poisson's ratio", unit("", 1.0)),
        "friction_angle_deg" => ("Angle of friction", unit("\u{b0}", 1.0)),
        "viscosity_pa_s" => ("Viscosity", unit("Pa s", 1.0)),
        "plastic_viscosity_pa_s" => ("Plastic viscosity", unit("Pa s", 1.0)),
        "retardation_time_s" => ("Retardation time", unit("ms", 1e-3)),
        "density_kg_m3" => ("Density", unit("kg/m\u{b3}", 1.0)),
        _ => ("Parameter", unit("", 1.0)),
    }
}

/// A number with three digits that count, without an exponent where it can do without.
pub fn three_digits(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return if value == 0.0 { "0".into() } else { "-".into() };
    }
    // Rounded first: 9.996 has four digits before rounding and three after.
    let rounded: f64 = format!("{value:.2e}").parse().unwrap_or(value);
    let magnitude = rounded.abs().log10().floor() as i32;
    if (-4..6).contains(&magnitude) {
        let text = format!("{rounded:.*}", (2 - magnitude).max(0) as usize);
        if magnitude > 3 { grouped(&text) } else { text }
    } else {
        format!("{value:.2e}")
    }
}

/// The digits of a whole number in groups of three.
pub fn grouped(text: &str) -> String {
    let (sign, digits) = text.split_at(usize::from(text.starts_with('-')));
    let mut grouped = String::from(sign);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            grouped.push(',');
        }
        grouped.push(digit);
    }
    grouped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let cases = [
            (318.4, "318"),
            (0.3221, "0.322"),
            (-1.5975, "-1.60"),
            (9.996, "10.0"),
            (40384.0, "40,400"),
            (0.0, "0"),
            (1234.0, "1230"),
            (1.5e-7, "1.50e-7"),
            (2.0e9, "2.00e9"),
            (-45678.0, "-45,700"),
        ];
        for (value, text) in cases {
            assert_eq!(three_digits(value), text);
        }
        assert_eq!(three_digits(f64::NAN), "-");
    }

    #[test]
    fn moduli_get_the_unit_that_makes_them_short() {
        let (name, unit) = quantity("youngs_modulus_pa", 318_000.0);
        assert_eq!((name, unit.name, 318_000.0 / unit.size), ("Young's modulus", "kPa", 318.0));
        assert_eq!(quantity("poisson_ratio", 0.3).1.name, "");
    }
}
