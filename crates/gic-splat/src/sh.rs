//! Real spherical harmonics to degree 3 in the order and with the signs of the 3DGS convention.

use gic_simd::Real;

/// Coefficients of degree 3 and below.
pub const MAX_COEFFICIENTS: usize = 16;

/// The constant basis function Y_0: a Gaussian of colour c in every direction has the coefficient (c - 0.5) / `C0`.
pub const C0: f64 = 0.282_094_791_773_878_14; // 1/2 sqrt(1/pi)
const C1: f64 = 0.488_602_511_902_919_9; // sqrt(3/(4 pi))
const C2_XY: f64 = 1.092_548_430_592_079_2; // 1/2 sqrt(15/pi)
const C2_ZZ: f64 = 0.315_391_565_252_520_05; // 1/4 sqrt(5/pi)
const C2_XX: f64 = 0.546_274_215_296_039_6; // 1/4 sqrt(15/pi)
const C3_33: f64 = 0.590_043_589_926_643_5; // 1/4 sqrt(35/(2 pi))
const C3_XYZ: f64 = 2.890_611_442_640_554; // 1/2 sqrt(105/pi)
const C3_31: f64 = 0.457_045_799_464_465_8; // 1/4 sqrt(21/(2 pi))
const C3_ZZZ: f64 = 0.373_176_332_590_115_4; // 1/4 sqrt(7/pi)
const C3_ZXX: f64 = 1.445_305_721_320_277; // 1/4 sqrt(105/pi)

/// Values of the (degree + 1)^2 basis functions at the unit vector `d`; the rest stays zero.
#[inline]
pub fn basis<R: Real>(degree: usize, d: [R; 3]) -> [R; MAX_COEFFICIENTS] {
    let c = |v: f64| R::splat(v);
    let [x, y, z] = d;
    let mut out = [R::zero(); MAX_COEFFICIENTS];
    out[0] = c(C0);
    if degree >= 1 {
        out[1] = c(-C1) * y;
        out[2] = c(C1) * z;
        out[3] = c(-C1) * x;
    }
    if degree >= 2 {
        let (xx, yy, zz) = (x * x, y * y, z * z);
        out[4] = c(C2_XY) * x * y;
        out[5] = c(-C2_XY) * y * z;
        out[6] = c(C2_ZZ) * (zz + zz - xx - yy);
        out[7] = c(-C2_XY) * x * z;
        out[8] = c(C2_XX) * (xx - yy);
        if degree >= 3 {
            out[9] = c(-C3_33) * y * (c(3.0) * xx - yy);
            out[10] = c(C3_XYZ) * x * y * z;
            out[11] = c(-C3_31) * y * (c(4.0) * zz - xx - yy);
            out[12] = c(C3_ZZZ) * z * (c(2.0) * zz - c(3.0) * (xx + yy));
            out[13] = c(-C3_31) * x * (c(4.0) * zz - xx - yy);
            out[14] = c(C3_ZXX) * z * (xx - yy);
            out[15] = c(-C3_33) * x * (xx - c(3.0) * yy);
        }
    }
    out
}

/// Gradient of `sum_k weights[k] Y_k(d)` with respect to `d`, the polynomials taken as functions of all of space.
#[inline]
pub fn basis_gradient<R: Real>(degree: usize, d: [R; 3], weights: &[R; MAX_COEFFICIENTS]) -> [R; 3] {
    let c = |v: f64| R::splat(v);
    let [x, y, z] = d;
    let w = weights;
    let mut g = [R::zero(); 3];
    if degree >= 1 {
        g = [c(-C1) * w[3], c(-C1) * w[1], c(C1) * w[2]];
    }
    if degree >= 2 {
        let (a, b, e) = (c(C2_XY), c(C2_ZZ), c(C2_XX));
        g[0] += a * (y * w[4] - z * w[7]) - c(2.0) * x * (b * w[6] - e * w[8]);
        g[1] += a * (x * w[4] - z * w[5]) - c(2.0) * y * (b * w[6] + e * w[8]);
        g[2] += c(4.0) * b * z * w[6] - a * (y * w[5] + x * w[7]);
    }
    if degree >= 3 {
        let (xx, yy, zz) = (x * x, y * y, z * z);
        let (p, q, r, s, t) = (c(C3_33), c(C3_XYZ), c(C3_31), c(C3_ZZZ), c(C3_ZXX));
        let (two, three, four, six, eight) = (c(2.0), c(3.0), c(4.0), c(6.0), c(8.0));
        g[0] += -p * six * x * y * w[9] + q * y * z * w[10] + r * two * x * y * w[11]
            - s * six * x * z * w[12]
            - r * (four * zz - three * xx - yy) * w[13]
            + t * two * x * z * w[14]
            - p * three * (xx - yy) * w[15];
        g[1] += -p * three * (xx - yy) * w[9] + q * x * z * w[10]
            - r * (four * zz - xx - three * yy) * w[11]
            - s * six * y * z * w[12]
            + r * two * x * y * w[13]
            - t * two * y * z * w[14]
            + p * six * x * y * w[15];
        g[2] += q * x * y * w[10] - r * eight * y * z * w[11] + s * (six * zz - three * (xx + yy)) * w[12]
            - r * eight * x * z * w[13]
            + t * (xx - yy) * w[14];
    }
    g
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// The basis is orthonormal over the sphere: products integrate to the identity (midpoint rule in height and
    /// azimuth).
    #[test]
    fn basis_is_orthonormal() {
        let (rows, columns) = (400, 32);
        let mut gram = [[0.0; 16]; 16];
        for r in 0..rows {
            let z = -1.0 + (r as f64 + 0.5) * 2.0 / rows as f64;
            for k in 0..columns {
                let phi = (k as f64 + 0.5) * 2.0 * PI / columns as f64;
                let rho = (1.0 - z * z).sqrt();
                let y = basis::<f64>(3, [rho * phi.cos(), rho * phi.sin(), z]);
                for i in 0..16 {
                    for j in 0..16 {
                        gram[i][j] += y[i] * y[j] * 4.0 * PI / (rows * columns) as f64;
                    }
                }
            }
        }
        for i in 0..16 {
            for j in 0..16 {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((gram[i][j] - expected).abs() < 1e-4, "({i}, {j}): {}", gram[i][j]);
            }
        }
    }

    #[test]
    fn gradient_matches_finite_differences() {
        let d = [0.3, -0.7, 0.52];
        for k in 0..16 {
            let mut weights = [0.0; 16];
            weights[k] = 1.0;
            let gradient = basis_gradient::<f64>(3, d, &weights);
            for axis in 0..3 {
                let shifted = |h: f64| {
                    let mut p = d;
                    p[axis] += h;
                    basis::<f64>(3, p)[k]
                };
                let numeric = (shifted(1e-5) - shifted(-1e-5)) / 2e-5;
                assert!((gradient[axis] - numeric).abs() < 1e-8, "Y_{k}, axis {axis}: {} {numeric}", gradient[axis]);
            }
        }
    }

    #[test]
    fn lower_degrees_are_prefixes() {
        let d = [0.6, 0.0, 0.8];
        let full = basis::<f64>(3, d);
        for degree in 0..3 {
            let part = basis::<f64>(degree, d);
            let n = (degree + 1) * (degree + 1);
            assert_eq!(part[..n], full[..n]);
            assert!(part[n..].iter().all(|&v| v == 0.0));
        }
    }
}
