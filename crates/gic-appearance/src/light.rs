//! Light from everywhere, as a Lambertian surface feels it: `E(n) = sum_k e_k p_k(n)`, with p_k the nine polynomials of
//! degree 2 and below in the unit normal (Ramamoorthi and Hanrahan 2001).

use serde::{Deserialize, Serialize};

/// Terms of an irradiance: all polynomials of degree 2 on the sphere.
pub const IRRADIANCE_TERMS: usize = 9;

/// How bright a white surface is, by its normal: a polynomial of degree 2 in the normal per colour, which holds 99 % of
/// what any distant light does to a Lambertian surface (Ramamoorthi and Hanrahan 2001). Constant in time and space.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Light {
    /// Coefficients of 1, x, y, z, xy, yz, zx, x^2 - y^2, z^2 - (x^2 + y^2) / 2, in RGB.
    pub coefficients: [[f32; 3]; IRRADIANCE_TERMS],
}

impl Default for Light {
    /// The same from everywhere.
    fn default() -> Self {
        let mut coefficients = [[0.0; 3]; IRRADIANCE_TERMS];
        coefficients[0] = [1.0; 3];
        Light { coefficients }
    }
}

/// The polynomials at a normal; a normal shorter than 1 (below the surface) feels light from more sides.
pub(crate) fn terms([x, y, z]: [f32; 3]) -> [f32; IRRADIANCE_TERMS] {
    [1.0, x, y, z, x * y, y * z, z * x, x * x - y * y, z * z - 0.5 * (x * x + y * y)]
}

impl Light {
    /// Brightness in RGB at a normal.
    pub fn at(&self, normal: [f32; 3]) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for (term, coefficient) in terms(normal).iter().zip(&self.coefficients) {
            for c in 0..3 {
                sum[c] += term * coefficient[c];
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_the_same_from_everywhere() {
        for normal in [[0.0; 3], [1.0, 0.0, 0.0], [0.6, -0.8, 0.0]] {
            assert_eq!(Light::default().at(normal), [1.0; 3]);
        }
    }

    #[test]
    fn beyond_the_first_the_terms_have_no_mean() {
        // Six directions of an octahedron and eight of a cube integrate polynomials of degree 4 with these weights.
        let mut mean = [0.0f64; IRRADIANCE_TERMS];
        let mut add = |normal: [f32; 3], weight: f64| {
            for (sum, term) in mean.iter_mut().zip(terms(normal)) {
                *sum += weight * f64::from(term);
            }
        };
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let mut normal = [0.0; 3];
                normal[axis] = sign;
                add(normal, 1.0 / 15.0);
            }
        }
        for corner in 0..8 {
            let side = |bit: i32| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 } / 3.0f32.sqrt();
            add([side(0), side(1), side(2)], 3.0 / 40.0);
        }
        assert!((mean[0] - 1.0).abs() < 1e-6, "{mean:?}");
        assert!(mean[1..].iter().all(|m| m.abs() < 1e-6), "{mean:?}");
    }
}
