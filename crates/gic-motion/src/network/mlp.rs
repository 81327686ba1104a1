//! A fully connected network with ReLU, forward and backward, on matrix products of whole blocks of rows.

use core::ops::Range;

use gemm::Parallelism;
use rand::{Rng, RngExt};

use super::Scalar;

/// Layers of a fully connected network; the numbers live in the caller's flat parameter vector.
///
/// `depth` hidden layers of `width` with ReLU, then one linear layer. The hidden layer `skip` sees the input again
/// beside the previous layer's output. Each layer is `y = x W + b` with W of shape [inputs, outputs], row-major.
#[derive(Clone, Debug)]
pub(super) struct Mlp {
    inputs: usize,
    outputs: usize,
    layers: Vec<Layer>,
}

#[derive(Clone, Debug)]
struct Layer {
    /// Weights that multiply the previous layer's output; none in the first layer.
    hidden: Option<Matrix>,
    /// Weights that multiply the network's input; only in the first and the skip layer.
    input: Option<Matrix>,
    bias: Range<usize>,
}

#[derive(Clone, Debug)]
struct Matrix {
    rows: usize,
    columns: usize,
    range: Range<usize>,
}

/// What the forward pass leaves for the backward pass: the outputs of the hidden layers, each [rows, width].
pub(super) struct Activations<T> {
    hidden: Vec<Vec<T>>,
}

impl Mlp {
    /// Lays the parameters out from `offset` on.
    pub(super) fn new(
        inputs: usize,
        width: usize,
        depth: usize,
        outputs: usize,
        skip: Option<usize>,
        offset: usize,
    ) -> Mlp {
        let mut end = offset;
        let mut take = |len: usize| {
            end += len;
            end - len..end
        };
        let layers = (0..=depth)
            .map(|layer| {
                let columns = if layer == depth { outputs } else { width };
                let mut matrix = |rows| Matrix { rows, columns, range: take(rows * columns) };
                let hidden = (layer > 0).then(|| matrix(width));
                let input = (layer == 0 || skip == Some(layer)).then(|| matrix(inputs));
                Layer { hidden, input, bias: take(columns) }
            })
            .collect();
        Mlp { inputs, outputs, layers }
    }

    /// Where the parameters end.
    pub(super) fn end(&self) -> usize {
        self.layers.last().map_or(0, |layer| layer.bias.end)
    }

    /// The same layers where the flat vector starts `offset` later.
    pub(super) fn shifted(&self, offset: usize) -> Mlp {
        let shift = |range: &Range<usize>| range.start - offset..range.end - offset;
        let matrix = |m: &Matrix| Matrix { range: shift(&m.range), ..m.clone() };
        let layers = self.layers.iter().map(|layer| Layer {
            hidden: layer.hidden.as_ref().map(matrix),
            input: layer.input.as_ref().map(matrix),
            bias: shift(&layer.bias),
        });
        Mlp { inputs: self.inputs, outputs: self.outputs, layers: layers.collect() }
    }

    /// Draws the parameters: uniform by fan-in for ReLU (He), zero biases, and `output_gain` times that in the last
    /// layer.
    pub(super) fn initialise<T: Scalar>(&self, parameters: &mut [T], output_gain: f64, rng: &mut impl Rng) {
        let last = self.layers.len() - 1;
        for (i, layer) in self.layers.iter().enumerate() {
            let fan_in: usize = layer.matrices().map(|m| m.rows).sum();
            let bound = (6.0 / fan_in as f64).sqrt() * if i == last { output_gain } else { 1.0 };
            for matrix in layer.matrices() {
                for p in &mut parameters[matrix.range.clone()] {
                    *p = T::of(rng.random_range(-bound..bound));
                }
            }
            parameters[layer.bias.clone()].fill(T::of(0.0));
        }
    }

    /// Outputs [rows, outputs] for inputs [rows, inputs].
    pub(super) fn forward<T: Scalar>(&self, parameters: &[T], input: &[T], rows: usize) -> (Vec<T>, Activations<T>) {
        debug_assert_eq!(input.len(), rows * self.inputs);
        let mut hidden: Vec<Vec<T>> = Vec::with_capacity(self.layers.len());
        for (i, layer) in self.layers.iter().enumerate() {
            let bias = &parameters[layer.bias.clone()];
            let mut out = Vec::with_capacity(rows * bias.len());
            for _ in 0..rows {
                out.extend_from_slice(bias);
            }
            if let Some(m) = &layer.input {
                product(rows, m, input, &parameters[m.range.clone()], &mut out);
            }
            if let Some(m) = &layer.hidden {
                product(rows, m, &hidden[i - 1], &parameters[m.range.clone()], &mut out);
            }
            if i + 1 < self.layers.len() {
                for v in &mut out {
                    *v = if *v > T::of(0.0) { *v } else { T::of(0.0) };
                }
            }
            hidden.push(out);
        }
        let output = hidden.pop().unwrap_or_default();
        (output, Activations { hidden })
    }

    /// Adds the parameters' gradient to `gradient` (the whole flat vector) and the input's, [rows, inputs], to
    /// `d_input`, if that is wanted: it costs as much as that of the parameters that multiply the input.
    pub(super) fn backward<T: Scalar>(
        &self,
        parameters: &[T],
        input: &[T],
        activations: &Activations<T>,
        d_output: Vec<T>,
        gradient: &mut [T],
        mut d_input: Option<&mut [T]>,
    ) {
        debug_assert_eq!(d_output.len() % self.outputs, 0);
        let rows = d_output.len() / self.outputs;
        let mut slope = d_output;
        for (i, layer) in self.layers.iter().enumerate().rev() {
            let bias = &mut gradient[layer.bias.clone()];
            for row in slope.chunks_exact(bias.len()) {
                for (b, s) in bias.iter_mut().zip(row) {
                    *b += *s;
                }
            }
            if let Some(m) = &layer.input {
                product_of_transposed(rows, m, input, &slope, &mut gradient[m.range.clone()]);
                if let Some(d_input) = &mut d_input {
                    product_with_transposed(rows, m, &slope, &parameters[m.range.clone()], d_input);
                }
            }
            if let Some(m) = &layer.hidden {
                let below = &activations.hidden[i - 1];
                product_of_transposed(rows, m, below, &slope, &mut gradient[m.range.clone()]);
                let mut next = vec![T::of(0.0); rows * m.rows];
                product_with_transposed(rows, m, &slope, &parameters[m.range.clone()], &mut next);
                for (d, h) in next.iter_mut().zip(below) {
                    *d = if *h > T::of(0.0) { *d } else { T::of(0.0) };
                }
                slope = next;
            }
        }
    }
}

impl Layer {
    fn matrices(&self) -> impl Iterator<Item = &Matrix> {
        self.input.iter().chain(&self.hidden)
    }
}

/// `out += x W`: [rows, m.rows] [m.rows, m.columns].
fn product<T: Scalar>(rows: usize, m: &Matrix, x: &[T], w: &[T], out: &mut [T]) {
    accumulate((rows, m.columns, m.rows), (x, [m.rows, 1]), (w, [m.columns, 1]), out);
}

/// `out += x^T y`: [m.rows, rows] [rows, m.columns].
fn product_of_transposed<T: Scalar>(rows: usize, m: &Matrix, x: &[T], y: &[T], out: &mut [T]) {
    accumulate((m.rows, m.columns, rows), (x, [1, m.rows]), (y, [m.columns, 1]), out);
}

/// `out += y W^T`: [rows, m.columns] [m.columns, m.rows].
fn product_with_transposed<T: Scalar>(rows: usize, m: &Matrix, y: &[T], w: &[T], out: &mut [T]) {
    accumulate((rows, m.rows, m.columns), (y, [m.columns, 1]), (w, [1, m.columns]), out);
}

/// `out += lhs rhs` with out [m, n] row-major; each factor comes with its strides between rows and between columns.
fn accumulate<T: Scalar>(
    (m, n, k): (usize, usize, usize),
    (lhs, lhs_strides): (&[T], [usize; 2]),
    (rhs, rhs_strides): (&[T], [usize; 2]),
    out: &mut [T],
) {
    if m == 0 || n == 0 || k == 0 {
        return;
    }
    assert!(out.len() == m * n && lhs.len() == m * k && rhs.len() == k * n);
    // SAFETY: the assertion above, with strides that are those of dense [m, k] and [k, n] matrices or their transposes,
    // keeps every access in bounds; `out` is borrowed exclusively, so it overlaps neither factor.
    unsafe {
        gemm::gemm(
            m,
            n,
            k,
            out.as_mut_ptr(),
            1,
            n as isize,
            true,
            lhs.as_ptr(),
            lhs_strides[1] as isize,
            lhs_strides[0] as isize,
            rhs.as_ptr(),
            rhs_strides[1] as isize,
            rhs_strides[0] as isize,
            T::of(1.0),
            T::of(1.0),
            false,
            false,
            false,
            Parallelism::None,
        );
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn product_agrees_with_three_loops() {
        let (rows, inner, columns) = (5, 7, 3);
        let value = |i: usize| (i as f64 * 0.37).sin();
        let x: Vec<f64> = (0..rows * inner).map(value).collect();
        let w: Vec<f64> = (100..100 + inner * columns).map(value).collect();
        let m = Matrix { rows: inner, columns, range: 0..w.len() };
        let mut out = vec![0.5; rows * columns];
        product(rows, &m, &x, &w, &mut out);
        for r in 0..rows {
            for c in 0..columns {
                let expected = 0.5 + (0..inner).map(|k| x[r * inner + k] * w[k * columns + c]).sum::<f64>();
                assert!((out[r * columns + c] - expected).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        let mlp = Mlp::new(5, 12, 4, 3, Some(2), 2);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut parameters = vec![0.0f64; mlp.end()];
        mlp.initialise(&mut parameters, 1.0, &mut rng);
        parameters.iter_mut().for_each(|p| *p += rng.random_range(-0.1..0.1));
        let rows = 6;
        let mut input: Vec<f64> = (0..rows * 5).map(|_| rng.random_range(-1.0..1.0)).collect();
        let weights: Vec<f64> = (0..rows * 3).map(|_| rng.random_range(-1.0..1.0)).collect();
        let loss = |parameters: &[f64], input: &[f64]| -> f64 {
            mlp.forward(parameters, input, rows).0.iter().zip(&weights).map(|(o, w)| o * w).sum()
        };
        let mut gradient = vec![0.0; parameters.len()];
        let (_, activations) = mlp.forward(&parameters, &input, rows);
        let mut d_input = vec![0.0; input.len()];
        mlp.backward(&parameters, &input, &activations, weights.clone(), &mut gradient, Some(&mut d_input));
        let h = 1e-6;
        for i in 2..parameters.len() {
            let kept = parameters[i];
            parameters[i] = kept + h;
            let above = loss(&parameters, &input);
            parameters[i] = kept - h;
            let below = loss(&parameters, &input);
            parameters[i] = kept;
            assert!((gradient[i] - (above - below) / (2.0 * h)).abs() < 1e-7, "parameter {i}");
        }
        for i in 0..input.len() {
            let kept = input[i];
            input[i] = kept + h;
            let above = loss(&parameters, &input);
            input[i] = kept - h;
            let below = loss(&parameters, &input);
            input[i] = kept;
            assert!((d_input[i] - (above - below) / (2.0 * h)).abs() < 1e-7, "input {i}");
        }
    }
}
