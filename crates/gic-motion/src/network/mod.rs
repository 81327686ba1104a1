//! The motion-factorised network (paper section 4.1, A.1).
//!
//! A backbone f_t turns the encoded time into N_m motion bases `(d mu_i, d s_i)(t)`, shared by all points; a second
//! network f_p turns a point's encoded place and time into coefficients `w_i(mu_0, t)`. A point moves by their sum
//! (paper eq. 3): `mu(t) = mu_0 + sum_i w_i d mu_i(t)`, `s(t) = s_0 + sum_i w_i d s_i(t)`.

mod encoding;
mod mlp;
mod nodes;
mod scalar;

use rand::Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::tuning::BASES_OUTPUT_GAIN;
use encoding::{Encoding, encode_backward};
use mlp::{Activations, Mlp};
use nodes::Nodes;
pub use scalar::Scalar;

/// Numbers per basis: displacement (x, y, z) and change of the scale.
const RESIDUALS: usize = 4;
/// Rows are split into at most this many blocks, each with its own gradient: what bounds the memory of the reduction.
/// It does not depend on the number of threads, so neither do the results.
const MAX_BLOCKS: usize = 16;
const MIN_BLOCK_ROWS: usize = 256;

/// Sizes of the network; the defaults are the paper's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Architecture {
    /// Frequencies of the encoding of time, L of appendix A.1.
    pub time_frequencies: usize,
    /// Frequencies of the encoding of positions, L of appendix A.1.
    pub position_frequencies: usize,
    /// Amplitude of each frequency relative to the one below, for time and for positions; 1 is the paper's formula.
    /// Below 1 neighbours in space and time start to move alike, and details of the motion are learned later.
    pub falloff: f64,
    /// Distance of the nodes at which the network is asked, in its units; what lies between is trilinear. 0 asks it at
    /// each point, the paper's way.
    pub node_spacing: f64,
    /// Motion bases, N_m.
    pub bases: usize,
    /// Channels of every hidden layer.
    pub width: usize,
    /// Hidden layers of the motion backbone, shared by all bases.
    pub backbone_layers: usize,
    /// The backbone's hidden layer (from 0) that sees the encoded time again.
    pub skip: usize,
    /// Hidden layers of the coefficient network; with the linear layer that makes the coefficients, the paper's 4 FC
    /// layers.
    pub coefficient_layers: usize,
}

impl Default for Architecture {
    fn default() -> Self {
        Architecture {
            time_frequencies: 10,
            position_frequencies: 10,
            falloff: 0.5,
            node_spacing: 0.0,
            bases: 8,
            width: 256,
            backbone_layers: 8,
            skip: 4,
            coefficient_layers: 3,
        }
    }
}

impl Architecture {
    fn time_encoding(&self) -> Encoding {
        Encoding { frequencies: self.time_frequencies, falloff: self.falloff }
    }

    fn position_encoding(&self) -> Encoding {
        Encoding { frequencies: self.position_frequencies, falloff: self.falloff }
    }
}

/// The network with its parameters, in f32 to train or f64 to check.
///
/// Works in the normalised units of its user: positions within about [-1, 1], time within [0, 1].
#[derive(Clone, Debug)]
pub struct MotionNetwork<T> {
    architecture: Architecture,
    backbone: Mlp,
    coefficients: Mlp,
    /// All weights and biases, flat: backbone, then coefficient network.
    pub parameters: Vec<T>,
}

/// Output of the network at one time.
pub struct Deformation<T> {
    /// Per point the sum over bases of `w_i (d mu_i, d s_i)` of paper eq. 3, shape [n, 4].
    pub residuals: Vec<[T; 4]>,
    bases: Vec<T>,
    time_encoded: Vec<T>,
    time_activations: Activations<T>,
    blocks: Vec<Block<T>>,
    /// The nodes that the network was asked at, if not at the points, and its residuals there.
    nodes: Option<(Nodes<T>, Vec<[T; 4]>)>,
}

struct Block<T> {
    encoded: Vec<T>,
    coefficients: Vec<T>,
    activations: Activations<T>,
}

/// Gradients that one block of rows contributes.
struct BlockGradient<T> {
    /// Of the coefficient network alone.
    parameters: Vec<T>,
    bases: Vec<T>,
    /// Empty if they were not asked for.
    positions: Vec<[T; 3]>,
}

/// Gradient of a loss on [`Deformation::residuals`].
pub struct NetworkGradient<T> {
    /// With respect to [`MotionNetwork::parameters`].
    pub parameters: Vec<T>,
    /// With respect to the canonical positions, through their encoding (or their place between nodes), shape [n, 3].
    pub positions: Vec<[T; 3]>,
}

impl<T: Scalar> MotionNetwork<T> {
    /// A network with all parameters zero.
    pub fn zeros(architecture: Architecture) -> Self {
        let a = architecture;
        let time = a.time_encoding().len();
        let position = 3 * a.position_encoding().len();
        let backbone = Mlp::new(time, a.width, a.backbone_layers, a.bases * RESIDUALS, Some(a.skip), 0);
        let coefficients = Mlp::new(position + time, a.width, a.coefficient_layers, a.bases, None, backbone.end());
        let parameters = vec![T::of(0.0); coefficients.end()];
        MotionNetwork { architecture, backbone, coefficients, parameters }
    }

    /// A network at its random start: hidden layers by fan-in, the motion bases close to no motion.
    pub fn random(architecture: Architecture, rng: &mut impl Rng) -> Self {
        let mut network = Self::zeros(architecture);
        network.backbone.initialise(&mut network.parameters, BASES_OUTPUT_GAIN, rng);
        network.coefficients.initialise(&mut network.parameters, 1.0, rng);
        network
    }

    /// The sizes.
    pub fn architecture(&self) -> Architecture {
        self.architecture
    }

    /// Residuals of points at canonical positions [n, 3] at `time` (both normalised), paper eq. 3 without `mu_0` and
    /// `s_0`.
    pub fn forward(&self, positions: &[[T; 3]], time: T) -> Deformation<T> {
        let encoding = self.architecture.time_encoding();
        let mut time_encoded = vec![T::of(0.0); encoding.len()];
        encoding.encode(time, &mut time_encoded);
        let (bases, time_activations) = self.backbone.forward(&self.parameters, &time_encoded, 1);
        let spacing = self.architecture.node_spacing;
        let nodes = (spacing > 0.0).then(|| Nodes::around(positions, spacing));
        let asked = nodes.as_ref().map_or(positions, |nodes| &nodes.positions);
        let blocks: Vec<(Vec<[T; 4]>, Block<T>)> = asked
            .par_chunks(block_rows(asked.len()))
            .map(|rows| self.forward_block(rows, &time_encoded, &bases))
            .collect();
        let mut residuals = Vec::with_capacity(asked.len());
        let mut kept = Vec::with_capacity(blocks.len());
        for (rows, block) in blocks {
            residuals.extend(rows);
            kept.push(block);
        }
        let (residuals, nodes) = match nodes {
            Some(nodes) => (nodes.spread(&residuals), Some((nodes, residuals))),
            None => (residuals, None),
        };
        Deformation { residuals, bases, time_encoded, time_activations, blocks: kept, nodes }
    }

    fn forward_block(&self, positions: &[[T; 3]], time_encoded: &[T], bases: &[T]) -> (Vec<[T; 4]>, Block<T>) {
        let encoding = self.architecture.position_encoding();
        let len = encoding.len();
        let width = 3 * len + time_encoded.len();
        let mut encoded = vec![T::of(0.0); positions.len() * width];
        for (row, position) in encoded.chunks_exact_mut(width).zip(positions) {
            for axis in 0..3 {
                encoding.encode(position[axis], &mut row[axis * len..(axis + 1) * len]);
            }
            row[3 * len..].copy_from_slice(time_encoded);
        }
        let (coefficients, activations) = self.coefficients.forward(&self.parameters, &encoded, positions.len());
        let residuals = coefficients
            .chunks_exact(self.architecture.bases)
            .map(|row| {
                let mut sum = [T::of(0.0); RESIDUALS];
                for (w, basis) in row.iter().zip(bases.chunks_exact(RESIDUALS)) {
                    for i in 0..RESIDUALS {
                        sum[i] += *w * basis[i];
                    }
                }
                sum
            })
            .collect();
        (residuals, Block { encoded, coefficients, activations })
    }

    /// Gradient of a loss from its derivative with respect to the residuals, shape [n, 4].
    pub fn backward(&self, deformation: &Deformation<T>, d_residuals: &[[T; 4]]) -> NetworkGradient<T> {
        assert_eq!(d_residuals.len(), deformation.residuals.len(), "one derivative per residual");
        let Some((nodes, values)) = &deformation.nodes else {
            return self.backward_asked(deformation, d_residuals, true);
        };
        let (d_values, positions) = nodes.pull_back(values, d_residuals);
        // Nodes stay where they are, so nobody asks for the gradient of their positions.
        NetworkGradient { positions, ..self.backward_asked(deformation, &d_values, false) }
    }

    /// The same with respect to the residuals of the points that the network was asked at, and `of_positions` of
    /// theirs.
    fn backward_asked(
        &self,
        deformation: &Deformation<T>,
        d_residuals: &[[T; 4]],
        of_positions: bool,
    ) -> NetworkGradient<T> {
        let parts: Vec<BlockGradient<T>> = d_residuals
            .par_chunks(block_rows(d_residuals.len()))
            .zip(&deformation.blocks)
            .map(|(d, block)| self.backward_block(block, &deformation.bases, d, of_positions))
            .collect();
        let mut positions = Vec::with_capacity(d_residuals.len());
        let mut d_bases = vec![T::of(0.0); deformation.bases.len()];
        let mut gradient = vec![T::of(0.0); self.parameters.len()];
        for part in &parts {
            positions.extend_from_slice(&part.positions);
            add(&mut d_bases, &part.bases);
        }
        // The blocks are added in their order for every parameter, whatever thread adds them.
        let first = self.backbone.end();
        const PARAMETERS_PER_TASK: usize = 16384;
        gradient[first..].par_chunks_mut(PARAMETERS_PER_TASK).enumerate().for_each(|(i, span)| {
            let start = i * PARAMETERS_PER_TASK;
            for part in &parts {
                add(span, &part.parameters[start..start + span.len()]);
            }
        });
        let time = &deformation.time_encoded;
        self.backbone.backward(&self.parameters, time, &deformation.time_activations, d_bases, &mut gradient, None);
        NetworkGradient { parameters: gradient, positions }
    }

    fn backward_block(&self, block: &Block<T>, bases: &[T], d: &[[T; 4]], of_positions: bool) -> BlockGradient<T> {
        let mut d_bases = vec![T::of(0.0); bases.len()];
        let mut d_coefficients = vec![T::of(0.0); block.coefficients.len()];
        let rows = block
            .coefficients
            .chunks_exact(self.architecture.bases)
            .zip(d_coefficients.chunks_exact_mut(self.architecture.bases));
        for ((w, d_w), d) in rows.zip(d) {
            for (i, basis) in bases.chunks_exact(RESIDUALS).enumerate() {
                for j in 0..RESIDUALS {
                    d_w[i] += basis[j] * d[j];
                    d_bases[i * RESIDUALS + j] += w[i] * d[j];
                }
            }
        }
        // The coefficient network's parameters come after the backbone's, so its gradient needs no room for those.
        let first = self.backbone.end();
        let mut gradient = vec![T::of(0.0); self.parameters.len() - first];
        let mut d_encoded = vec![T::of(0.0); if of_positions { block.encoded.len() } else { 0 }];
        self.coefficients.shifted(first).backward(
            &self.parameters[first..],
            &block.encoded,
            &block.activations,
            d_coefficients,
            &mut gradient,
            of_positions.then_some(&mut d_encoded),
        );
        let (len, width) = (self.architecture.position_encoding().len(), block.encoded.len() / d.len());
        let positions = block
            .encoded
            .chunks_exact(width)
            .zip(d_encoded.chunks_exact(width))
            .map(|(encoded, slope)| {
                core::array::from_fn(|axis| {
                    let span = axis * len..(axis + 1) * len;
                    encode_backward(&encoded[span.clone()], &slope[span])
                })
            })
            .collect();
        BlockGradient { parameters: gradient, bases: d_bases, positions }
    }
}

/// Rows per block for n points.
fn block_rows(n: usize) -> usize {
    n.div_ceil(MAX_BLOCKS).max(MIN_BLOCK_ROWS)
}

fn add<T: Scalar>(sum: &mut [T], other: &[T]) {
    for (s, o) in sum.iter_mut().zip(other) {
        *s += *o;
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn small() -> Architecture {
        Architecture { time_frequencies: 3, position_frequencies: 2, bases: 3, width: 10, ..Architecture::default() }
    }

    /// A network away from its special start, so that no gradient is zero by accident.
    fn network<T: Scalar>(architecture: Architecture, seed: u64) -> MotionNetwork<T> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut network = MotionNetwork::<T>::random(architecture, &mut rng);
        for p in &mut network.parameters {
            *p += T::of(rng.random_range(-0.05..0.05));
        }
        network
    }

    fn points(n: usize, seed: u64) -> Vec<[f64; 3]> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..n).map(|_| core::array::from_fn(|_| rng.random_range(-1.0..1.0))).collect()
    }

    fn loss(network: &MotionNetwork<f64>, points: &[[f64; 3]], weights: &[[f64; 4]]) -> f64 {
        let out = network.forward(points, 0.43).residuals;
        out.iter().flatten().zip(weights.iter().flatten()).map(|(o, w)| o * w).sum()
    }

    #[test]
    fn every_gradient_agrees_with_finite_differences() {
        check_gradients(small());
    }

    #[test]
    fn every_gradient_agrees_with_finite_differences_between_nodes() {
        check_gradients(Architecture { node_spacing: 0.3, ..small() });
    }

    fn check_gradients(architecture: Architecture) {
        let mut network = network::<f64>(architecture, 3);
        let mut points = points(MIN_BLOCK_ROWS + 3, 4);
        let weights: Vec<[f64; 4]> =
            (0..points.len()).map(|i| core::array::from_fn(|j| ((i * 4 + j) as f64 * 0.7).sin())).collect();
        let gradient = network.backward(&network.forward(&points, 0.43), &weights);
        let h = 1e-6;
        for i in 0..network.parameters.len() {
            let kept = network.parameters[i];
            network.parameters[i] = kept + h;
            let above = loss(&network, &points, &weights);
            network.parameters[i] = kept - h;
            let below = loss(&network, &points, &weights);
            network.parameters[i] = kept;
            let expected = (above - below) / (2.0 * h);
            let got = gradient.parameters[i];
            assert!((got - expected).abs() < 1e-6 * (1.0 + expected.abs()), "parameter {i}: {got} against {expected}");
        }
        for i in [0, 1, MIN_BLOCK_ROWS - 1, MIN_BLOCK_ROWS, MIN_BLOCK_ROWS + 2] {
            for axis in 0..3 {
                let kept = points[i][axis];
                points[i][axis] = kept + h;
                let above = loss(&network, &points, &weights);
                points[i][axis] = kept - h;
                let below = loss(&network, &points, &weights);
                points[i][axis] = kept;
                let expected = (above - below) / (2.0 * h);
                let got = gradient.positions[i][axis];
                assert!((got - expected).abs() < 1e-6 * (1.0 + expected.abs()), "point {i} axis {axis}");
            }
        }
    }

    #[test]
    fn single_precision_agrees_with_double() {
        let wide = network::<f64>(Architecture::default(), 5);
        let mut narrow = MotionNetwork::<f32>::zeros(Architecture::default());
        for (n, w) in narrow.parameters.iter_mut().zip(&wide.parameters) {
            *n = *w as f32;
        }
        let points = points(300, 6);
        let narrow_points: Vec<[f32; 3]> = points.iter().map(|p| p.map(|x| x as f32)).collect();
        // The same rounded input for both, because the highest frequency multiplies its rounding error by 512 pi.
        let points: Vec<[f64; 3]> = narrow_points.iter().map(|p| p.map(f64::from)).collect();
        let time = 0.3f32;
        let expected = wide.forward(&points, f64::from(time)).residuals;
        let got = narrow.forward(&narrow_points, time).residuals;
        let largest = expected.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
        for (g, e) in got.iter().flatten().zip(expected.iter().flatten()) {
            assert!((f64::from(*g) - e).abs() < 1e-5 * largest, "{g} against {e}");
        }
    }

    #[test]
    fn sizes_are_the_papers() {
        let network = MotionNetwork::<f32>::zeros(Architecture::default());
        let layer = |inputs: usize, outputs: usize| inputs * outputs + outputs;
        let (time, position) = (21, 63);
        let backbone = layer(time, 256) + 6 * layer(256, 256) + layer(256 + time, 256) + layer(256, 8 * 4);
        let coefficients = layer(position + time, 256) + 2 * layer(256, 256) + layer(256, 8);
        assert_eq!(network.parameters.len(), backbone + coefficients);
    }

    #[test]
    fn no_points_is_no_error() {
        for node_spacing in [0.0, 0.1] {
            let network = network::<f32>(Architecture { node_spacing, ..small() }, 1);
            let out = network.forward(&[], 0.0);
            assert!(out.residuals.is_empty());
            assert!(network.backward(&out, &[]).parameters.iter().all(|g| *g == 0.0));
        }
    }

    #[test]
    fn close_nodes_are_as_good_as_none() {
        let plain = network::<f64>(small(), 6);
        let fine = MotionNetwork { architecture: Architecture { node_spacing: 1e-3, ..small() }, ..plain.clone() };
        let points = points(50, 8);
        let (expected, got) = (plain.forward(&points, 0.6).residuals, fine.forward(&points, 0.6).residuals);
        let largest = expected.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
        for (e, g) in expected.iter().flatten().zip(got.iter().flatten()) {
            assert!((e - g).abs() < 1e-4 * largest, "{g} against {e}");
        }
    }

    #[test]
    fn result_does_not_depend_on_the_number_of_threads() {
        let network = network::<f32>(small(), 2);
        let points: Vec<[f32; 3]> = points(5000, 1).iter().map(|p| p.map(|x| x as f32)).collect();
        let weights: Vec<[f32; 4]> = points.iter().map(|p| [p[0], p[1], p[2], p[0] * p[1]]).collect();
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| network.backward(&network.forward(&points, 0.2), &weights))
        };
        let (one, three) = (run(1), run(3));
        assert_eq!(one.parameters, three.parameters);
        assert_eq!(one.positions, three.positions);
    }
}
