//! The base motion's part in the colours: how light changes on what moves.
//!
//! The paper's colours do not change. But light falls differently on an object that turns, bends or comes near the
//! ground, and colours that are the same at all times then pull the Gaussians out of place. Each frame multiplies them
//! by a smooth field.

use super::{BaseMotion, Pose};
use crate::gaussians::parameters::{ParameterGradient, Parameters, rest_per_gaussian};

/// Value of the degree-0 harmonic: colour = 0.5 + this * coefficient.
const SH0: f32 = gic_splat::sh::C0 as f32;

impl BaseMotion {
    /// Multiplies the colours of Gaussians, whose spherical harmonics are `sh` [n, k, 3] and whose canonical places are
    /// `positions`, by one plus the pose's shade.
    pub(crate) fn shade(&self, pose: &Pose, positions: &[[f32; 3]], sh: &mut [[f32; 3]]) {
        if sh.is_empty() {
            return;
        }
        for (&x, sh) in positions.iter().zip(sh.chunks_exact_mut(sh.len() / positions.len())) {
            let shade = self.lattice.value(&pose.shade, x);
            for c in 0..3 {
                let gain = 1.0 + shade[c];
                sh.iter_mut().for_each(|sh| sh[c] *= gain);
                sh[0][c] += 0.5 * shade[c] / SH0;
            }
        }
    }

    /// Turns the gradient with respect to shaded colours in `gradient` into that of the colours themselves, adds the
    /// positions' part, and returns that of the pose's shade.
    pub(crate) fn shade_back(&self, pose: &Pose, p: &Parameters, gradient: &mut ParameterGradient) -> Vec<[f32; 3]> {
        let sh_rest = rest_per_gaussian(p.sh_degree);
        let mut d_shade = vec![[0.0; 3]; pose.shade.len()];
        for (i, &x) in p.positions.iter().enumerate() {
            let shade = self.lattice.value(&pose.shade, x);
            let sh = &mut gradient.sh[i * (sh_rest + 1)..(i + 1) * (sh_rest + 1)];
            let mut d = [0.0; 3];
            for c in 0..3 {
                d[c] = sh[0][c] * (p.sh_dc[i][c] + 0.5 / SH0);
                sh[0][c] *= 1.0 + shade[c];
                for (slope, detail) in sh[1..].iter_mut().zip(&p.sh_rest[i * sh_rest..(i + 1) * sh_rest]) {
                    d[c] += slope[c] * detail[c];
                    slope[c] *= 1.0 + shade[c];
                }
            }
            self.lattice.pull_back(&pose.shade, x, d, &mut d_shade, &mut gradient.positions[i]);
        }
        d_shade
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::Lattice;

    #[test]
    fn colours_are_multiplied_and_every_gradient_agrees_with_finite_differences() {
        let wave = |i: usize, k: f32| (i as f32 * k + 0.3).sin();
        let n = 5;
        let mut p = Parameters {
            positions: (0..n).map(|i| core::array::from_fn(|k| 0.5 * wave(3 * i + k, 0.7))).collect(),
            sh_dc: (0..n).map(|i| core::array::from_fn(|k| wave(3 * i + k, 1.3))).collect(),
            sh_rest: (0..3 * n).map(|i| core::array::from_fn(|k| wave(3 * i + k, 2.1))).collect(),
            log_scales: vec![0.0; n],
            rotations: Vec::new(),
            opacity_logits: vec![0.0; n],
            sh_degree: 1,
        };
        let motion = BaseMotion::still(DVec3::ZERO, vec![0.0], Lattice::around(&p.positions));
        let mut pose = motion.pose(0);
        pose.shade =
            (0..motion.lattice.nodes()).map(|i| core::array::from_fn(|k| 0.4 * wave(3 * i + k, 0.9))).collect();
        let slopes: Vec<[f32; 3]> = (0..4 * n).map(|i| core::array::from_fn(|k| wave(3 * i + k, 0.43))).collect();

        let drawn = |p: &Parameters, pose: &Pose| {
            let mut sh = p.gaussians(None).sh;
            motion.shade(pose, &p.positions, &mut sh);
            sh
        };
        let plain = p.gaussians(None).sh;
        for (i, sh) in drawn(&p, &pose).chunks_exact(4).enumerate() {
            let gain = 1.0 + motion.lattice.value(&pose.shade, p.positions[i])[1];
            assert!((0.5 + SH0 * sh[0][1] - gain * (0.5 + SH0 * plain[4 * i][1])).abs() < 1e-6);
        }
        let loss = |p: &Parameters, pose: &Pose| -> f64 {
            let sh = drawn(p, pose);
            sh.iter().flatten().zip(slopes.iter().flatten()).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
        };
        let mut gradient = ParameterGradient::zeros(&p);
        gradient.sh.clone_from(&slopes);
        let d_shade = motion.shade_back(&pose, &p, &mut gradient);

        let h = 1e-3f32;
        let agree = |got: f32, above: f64, below: f64| {
            let expected = (above - below) / (2.0 * f64::from(h));
            assert!((f64::from(got) - expected).abs() < 5e-3 * (1.0 + expected.abs()), "{got} against {expected}");
        };
        for i in (0..d_shade.len()).filter(|&i| d_shade[i] != [0.0; 3]).step_by(3) {
            let mut at = |step: f32| {
                pose.shade[i][2] += step;
                let value = loss(&p, &pose);
                pose.shade[i][2] -= step;
                value
            };
            agree(d_shade[i][2], at(h), at(-h));
        }
        for i in 0..n {
            let mut at = |field: fn(&mut Parameters, usize) -> &mut f32, step: f32| {
                *field(&mut p, i) += step;
                let value = loss(&p, &pose);
                *field(&mut p, i) -= step;
                value
            };
            let position: fn(&mut Parameters, usize) -> &mut f32 = |p, i| &mut p.positions[i][1];
            let feature: fn(&mut Parameters, usize) -> &mut f32 = |p, i| &mut p.sh_dc[i][0];
            let detail: fn(&mut Parameters, usize) -> &mut f32 = |p, i| &mut p.sh_rest[3 * i + 1][2];
            agree(gradient.positions[i][1], at(position, h), at(position, -h));
            agree(gradient.sh[4 * i][0], at(feature, h), at(feature, -h));
            agree(gradient.sh[4 * i + 2][2], at(detail, h), at(detail, -h));
        }
    }
}
