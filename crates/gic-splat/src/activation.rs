//! The coordinates in which 3DGS trains and stores opacities and colours (Kerbl et al. 2023): logits, and coefficients
//! of the constant spherical harmonic.

use crate::sh::C0;

/// The logit of an opacity in (0, 1).
#[inline]
pub fn logit(opacity: f64) -> f64 {
    (opacity / (1.0 - opacity)).ln()
}

/// The opacity of a logit.
#[inline]
pub fn sigmoid(logit: f32) -> f32 {
    1.0 / (1.0 + (-logit).exp())
}

/// The colour in [0, 1] of a Gaussian whose only harmonic, that of degree 0, has this coefficient.
#[inline]
pub fn color_of_coefficient(coefficient: f32) -> f32 {
    0.5 + C0 as f32 * coefficient
}

/// The degree-0 coefficient of a colour in [0, 1].
#[inline]
pub fn coefficient_of_color(color: f32) -> f32 {
    (color - 0.5) / C0 as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_undoes_the_other() {
        for x in [0.02f32, 0.3, 0.5, 0.97] {
            assert!((sigmoid(logit(f64::from(x)) as f32) - x).abs() < 1e-6);
            assert!((color_of_coefficient(coefficient_of_color(x)) - x).abs() < 1e-6);
        }
        let white = crate::sh::basis::<f64>(0, [0.0, 0.0, 1.0])[0] * f64::from(coefficient_of_color(1.0));
        assert!((white - 0.5).abs() < 1e-6, "half above the mean of 0.5");
    }
}
