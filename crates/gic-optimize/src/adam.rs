//! Adam (Kingma and Ba 2015) and the decay of learning rates.

use std::ops::Range;

use rayon::prelude::*;

const BETA1: f32 = 0.9;
const BETA2: f32 = 0.999;
/// As 3DGS has it: gradients of single Gaussians are tiny, and must not drown in epsilon.
const EPSILON: f32 = 1e-15;
/// Parameters per parallel task.
const SPAN: usize = 1 << 15;

/// First and second moments of the gradients of a flat list of parameters.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moments {
    /// Moving averages of the gradients.
    pub first: Vec<f32>,
    /// Moving averages of their squares.
    pub second: Vec<f32>,
}

impl Moments {
    /// For `len` parameters before the first step.
    pub fn zeros(len: usize) -> Moments {
        Moments { first: vec![0.0; len], second: vec![0.0; len] }
    }

    /// One step: `step` counts from 1 and corrects the bias of the moments.
    pub fn update(&mut self, parameters: &mut [f32], gradient: &[f32], rate: f64, step: usize) {
        assert!(parameters.len() == gradient.len() && self.first.len() == gradient.len(), "one gradient per parameter");
        let step = Step::new(rate, step);
        let moments = self.first.par_chunks_mut(SPAN).zip(self.second.par_chunks_mut(SPAN));
        let spans = parameters.par_chunks_mut(SPAN).zip(gradient.par_chunks(SPAN)).zip(moments);
        spans.for_each(|((parameters, gradient), (first, second))| step.take(parameters, gradient, first, second));
    }

    /// The same where the gradient has rows of `width` numbers, of which `columns` are the parameters' own.
    pub fn update_columns(
        &mut self,
        parameters: &mut [f32],
        (gradient, width): (&[f32], usize),
        columns: Range<usize>,
        rate: f64,
        step: usize,
    ) {
        let own = columns.len();
        if own == 0 {
            return;
        }
        let rows = parameters.len() / own;
        assert!(gradient.len() == rows * width && self.first.len() == parameters.len(), "one gradient per parameter");
        let step = Step::new(rate, step);
        let moments = self.first.par_chunks_mut(own).zip(self.second.par_chunks_mut(own));
        let rows = parameters.par_chunks_mut(own).zip(gradient.par_chunks(width)).zip(moments);
        rows.with_min_len(SPAN / width).for_each(|((parameters, gradient), (first, second))| {
            step.take(parameters, &gradient[columns.clone()], first, second);
        });
    }

    /// One step of Adam that scales all parameters alike, by the root of the mean second moment: the direction that was
    /// smoothed over neighbours stays smooth.
    pub fn update_alike(&mut self, parameters: &mut [f32], gradient: &[f32], rate: f64, step: usize) {
        assert!(parameters.len() == gradient.len() && self.first.len() == gradient.len(), "one gradient per parameter");
        let correction1 = 1.0 - f64::from(BETA1).powf(step as f64);
        let correction2 = 1.0 - f64::from(BETA2).powf(step as f64);
        for ((m, v), g) in self.first.iter_mut().zip(&mut self.second).zip(gradient) {
            *m = BETA1 * *m + (1.0 - BETA1) * g;
            *v = BETA2 * *v + (1.0 - BETA2) * g * g;
        }
        let mean = self.second.iter().map(|v| f64::from(*v)).sum::<f64>() / self.second.len().max(1) as f64;
        let scale = (rate / correction1 / ((mean / correction2).sqrt() + f64::from(EPSILON))) as f32;
        for (p, m) in parameters.iter_mut().zip(&self.first) {
            *p -= scale * m;
        }
    }

    /// Keeps the rows of `width` numbers listed in `rows`, in that order; `None` makes a row of zeros.
    pub fn select(&mut self, rows: &[Option<usize>], width: usize) {
        for moments in [&mut self.first, &mut self.second] {
            *moments = rows
                .iter()
                .flat_map(|row| (0..width).map(move |i| (row, i)))
                .map(|(row, i)| row.map_or(0.0, |row| moments[row * width + i]))
                .collect();
        }
    }
}

/// What is the same for all parameters in a step.
struct Step {
    /// Rate over the correction of the first moment's bias.
    rate: f32,
    /// Correction of the root of the second moment.
    spread: f32,
}

impl Step {
    fn new(rate: f64, step: usize) -> Step {
        let correction1 = 1.0 - f64::from(BETA1).powf(step as f64);
        let correction2 = 1.0 - f64::from(BETA2).powf(step as f64);
        Step { rate: (rate / correction1) as f32, spread: (1.0 / correction2.sqrt()) as f32 }
    }

    #[inline]
    fn take(&self, parameters: &mut [f32], gradient: &[f32], first: &mut [f32], second: &mut [f32]) {
        for (((p, g), m), v) in parameters.iter_mut().zip(gradient).zip(first).zip(second) {
            *m = BETA1 * *m + (1.0 - BETA1) * g;
            *v = BETA2 * *v + (1.0 - BETA2) * g * g;
            *p -= self.rate * *m / (self.spread * v.sqrt() + EPSILON);
        }
    }
}

/// Adam as published, in double precision, for few unknowns: its epsilon is 1e-8.
#[derive(Clone, Debug)]
pub struct Adam {
    first: Vec<f64>,
    second: Vec<f64>,
    steps: i32,
}

impl Adam {
    const BETA1: f64 = 0.9;
    const BETA2: f64 = 0.999;
    const EPSILON: f64 = 1e-8;

    /// Before the first step of `len` unknowns.
    pub fn new(len: usize) -> Adam {
        Adam { first: vec![0.0; len], second: vec![0.0; len], steps: 0 }
    }

    /// The next step from a gradient and a learning rate per unknown, both shape [n]: to be added to the unknowns.
    pub fn step(&mut self, gradient: &[f64], rates: &[f64]) -> Vec<f64> {
        assert!(gradient.len() == self.first.len() && rates.len() == gradient.len(), "a gradient and a rate each");
        self.steps += 1;
        let (correction1, correction2) = (1.0 - Self::BETA1.powi(self.steps), 1.0 - Self::BETA2.powi(self.steps));
        let moments = self.first.iter_mut().zip(&mut self.second);
        (moments.zip(gradient.iter().zip(rates)))
            .map(|((first, second), (slope, rate))| {
                *first = Self::BETA1 * *first + (1.0 - Self::BETA1) * slope;
                *second = Self::BETA2 * *second + (1.0 - Self::BETA2) * slope * slope;
                let (mean, variance) = (*first / correction1, *second / correction2);
                -rate * mean / (variance.sqrt() + Self::EPSILON)
            })
            .collect()
    }
}

/// Exponential decay from `ends.0` at `fraction` 0 to `ends.1` at 1.
pub fn decayed(ends: (f64, f64), fraction: f64) -> f64 {
    ends.0 * (ends.1 / ends.0).powf(fraction.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_minimum_of_a_bowl() {
        let target = [0.3f32, -1.2, 4.0];
        let mut x = [0.0f32; 3];
        let mut moments = Moments::zeros(3);
        for step in 1..=2000 {
            let gradient: Vec<f32> = x.iter().zip(target).map(|(x, t)| 2.0 * (x - t)).collect();
            moments.update(&mut x, &gradient, decayed((0.1, 0.001), step as f64 / 2000.0), step);
        }
        for (x, t) in x.iter().zip(target) {
            assert!((x - t).abs() < 1e-3, "{x} against {t}");
        }
    }

    #[test]
    fn both_precisions_agree() {
        let gradients: Vec<[f64; 2]> = (0..20).map(|i| [f64::from(i).sin(), 3.0 + f64::from(i).cos()]).collect();
        let (mut single, mut double) = ([0.0f32; 2], [0.0f64; 2]);
        let (mut moments, mut adam) = (Moments::zeros(2), Adam::new(2));
        for (i, gradient) in gradients.iter().enumerate() {
            moments.update(&mut single, &gradient.map(|g| g as f32), 0.01, i + 1);
            double.iter_mut().zip(adam.step(gradient, &[0.01; 2])).for_each(|(x, step)| *x += step);
        }
        for (single, double) in single.iter().zip(double) {
            assert!((f64::from(*single) - double).abs() < 1e-6 && double.abs() > 1e-3, "{single} against {double}");
        }
    }

    #[test]
    fn first_step_has_the_length_of_the_rate() {
        let mut x = [1.0f32, 1.0];
        Moments::zeros(2).update(&mut x, &[5.0, -1e-6], 0.01, 1);
        assert!((x[0] - 0.99).abs() < 1e-6 && (x[1] - 1.01).abs() < 1e-6, "{x:?}");
    }

    #[test]
    fn columns_move_as_a_list_of_their_own() {
        let gradient: Vec<f32> = (0..12).map(|i| (i as f32 * 0.7).sin()).collect();
        let own: Vec<f32> = gradient.chunks_exact(4).flat_map(|row| &row[1..3]).copied().collect();
        let (mut a, mut b) = ([0.5f32; 6], [0.5f32; 6]);
        let (mut of_a, mut of_b) = (Moments::zeros(6), Moments::zeros(6));
        for step in 1..4 {
            of_a.update(&mut a, &own, 0.01, step);
            of_b.update_columns(&mut b, (&gradient, 4), 1..3, 0.01, step);
        }
        assert_eq!((a, of_a), (b, of_b));
        Moments::zeros(0).update_columns(&mut [], (&gradient, 4), 4..4, 0.01, 1);
    }

    #[test]
    fn selecting_rows_keeps_their_history() {
        let mut moments = Moments { first: vec![1.0, 2.0, 3.0, 4.0], second: vec![5.0, 6.0, 7.0, 8.0] };
        moments.select(&[Some(1), None, Some(0)], 2);
        assert_eq!(moments.first, [3.0, 4.0, 0.0, 0.0, 1.0, 2.0]);
        assert_eq!(moments.second, [7.0, 8.0, 0.0, 0.0, 5.0, 6.0]);
    }

    #[test]
    fn decay_meets_both_ends() {
        assert_eq!(decayed((0.1, 0.001), 0.0), 0.1);
        assert!((decayed((0.1, 0.001), 0.5) - 0.01).abs() < 1e-12);
        assert!((decayed((0.1, 0.001), 1.5) - 0.001).abs() < 1e-12);
    }
}
