//! Intervals and checks at the estimate, and everything into one result.

use std::sync::atomic::Ordering;

use glam::DVec3;
use nalgebra::DMatrix;

use crate::checkpoint::Event;
use crate::forward::flight::{Flight, placed, volume_factors};
use crate::forward::simulation::Simulation;
use crate::result::{Estimate, Identification, Loss, Stage};
use crate::solve::levenberg::{Known, Tangents};
use crate::solve::loss::mean_loss;
use crate::solve::objective::{Forward, Level, Motion, Problem};
use crate::stages::Job;
use crate::stages::velocity::Launch;
use crate::uncertainty::checks;
use crate::uncertainty::interval::{self, half_width};
use crate::unknowns::state::{State, Unknown};
use crate::{IdentifyError, MaterialKind, Parameter};

impl Job<'_> {
    fn material(&self, state: &State) -> gic_mpm::Material {
        let values: Vec<f64> = self.parameters().iter().zip(&state.material).map(|(p, c)| p.value(*c)).collect();
        self.kind.material(&values)
    }

    pub(crate) fn finish_untouched(&self, launched: &Launch) -> Identification {
        let motion = Flight { input: self.input, data: &self.data, shape: &self.shape }
            .motion(&launched.state, &self.all_frames());
        self.without_intervals(launched, &launched.state, motion.ok().as_ref())
    }

    /// The end of the material stage as the result.
    pub(crate) fn finish_roughly(&self, launched: &Launch, state: &State) -> Result<Identification, IdentifyError> {
        let motion = self.simulation(launched.free).motion(state, &self.all_frames()).map_err(self.failure(1))?;
        Ok(self.without_intervals(launched, state, Some(&motion)))
    }

    fn without_intervals(&self, launched: &Launch, state: &State, motion: Option<&Motion>) -> Identification {
        let estimate = |(p, c): (&Parameter, &f64)| self.estimate(p, *c, None, None);
        let estimates = self.parameters().iter().zip(&state.material).map(estimate).collect();
        self.result(launched, state, estimates, DVec3::NAN, motion)
    }

    /// Intervals, checks, and everything into one result; `known` is what was measured at `state` before.
    pub(crate) fn finish(
        &self,
        launched: &Launch,
        state: &State,
        known: Option<Known>,
    ) -> Result<Identification, IdentifyError> {
        let simulation = self.simulation(launched.free);
        let prior = self.joint_prior(launched);
        let problem = Problem {
            forward: &simulation,
            objective: self.base_objective(),
            unknowns: self.joint_unknowns(launched),
            parameters: self.parameters(),
            level: self.all_frames(),
            prior: Some(&prior),
        };
        let count = problem.unknowns.len();
        let (check, finer) = (self.settings.resolution_check, self.simulation(launched.free));
        let ((motion, tangents), refined) = rayon::join(
            || match known {
                Some(Known { motion, tangents, .. }) => (Ok(motion), Ok(tangents)),
                None => Tangents::measure_with_motion(&problem, state),
            },
            || check.and_then(|factor| refined(finer, factor, state)),
        );
        let motion = motion.map_err(self.failure(1))?;
        self.tell(Event::Working).map_err(|_| IdentifyError::Interrupted)?;
        let (mut covariance, mut shifts) = (None, None);
        match tangents {
            Ok(mut tangents) => {
                // A refined grid is one more direction in which the residuals move: a nuisance, with the whole of its shift.
                if let Some(motion) = refined {
                    tangents.motions.push(motion);
                    tangents.steps.push(1.0);
                }
                let (clusters, columns) = (problem.clusters(&motion, &tangents), tangents.steps.len());
                let weights = self.weights_at(&clusters, count, launched);
                let known = prior.information_of(&problem.unknowns);
                let nuisances = DMatrix::identity(columns - count, columns - count);
                if columns > count {
                    shifts = interval::response(&clusters, &weights, count, &known, count);
                }
                let places = |of: &dyn Fn(&Unknown) -> bool| -> Vec<usize> {
                    (0..count).filter(|k| of(&problem.unknowns[*k])).collect()
                };
                let materials = places(&|u| matches!(u, Unknown::Material(_)));
                let shapes = places(&|u| matches!(u, Unknown::Shape(_)));
                covariance = interval::covariance(&clusters, &weights, count, &known, &nuisances)
                    .map(|c| c + interval::unrevealed(&clusters, &weights, count, &known, &materials, &shapes));
            }
            Err(reason) => self.warn(format!("no intervals: {reason}")),
        }
        let explained = checks::explained(self, launched, &motion);
        checks::at_limits(self, state);
        let place = |unknown: Unknown| problem.unknowns.iter().position(|u| *u == unknown);
        let deviation = |unknown: Unknown| {
            let k = place(unknown)?;
            covariance.as_ref().map(|c| half_width(c[(k, k)]))
        };
        let estimates = (0..self.parameters().len())
            .map(|i| {
                let (unknown, p) = (Unknown::Material(i), &self.parameters()[i]);
                let shift = place(unknown).and_then(|k| shifts.as_ref().map(|s| s[k]));
                let estimate = self.estimate(p, state.material[i], deviation(unknown), shift);
                Estimate { identifiable: estimate.identifiable && explained, ..estimate }
            })
            .collect();
        let velocity = [0, 1, 2].map(|a| {
            let half = deviation(Unknown::Velocity(a)).unwrap_or(0.0);
            half.hypot(self.flown_half_width(launched, Unknown::Velocity(a)))
        });
        let velocity = DVec3::from_array(velocity);
        Ok(self.result(launched, state, estimates, velocity, Some(&motion)))
    }

    /// Half-width of an unknown's interval from free flight alone, where the position is uncertain, too; 0 where it was not fitted.
    fn flown_half_width(&self, launched: &Launch, unknown: Unknown) -> f64 {
        let none = DMatrix::zeros(0, 0);
        let count = launched.unknowns.len();
        let place = launched.unknowns.iter().position(|u| *u == unknown);
        let covariance = interval::covariance(&launched.clusters, &self.weights, count, &none, &none);
        place.zip(covariance).map_or(0.0, |(k, c)| half_width(c[(k, k)]))
    }

    fn estimate(&self, p: &Parameter, coordinate: f64, half: Option<f64>, shift: Option<f64>) -> Estimate {
        let value = p.value(coordinate);
        let fixed = self.settings.fixed.iter().any(|(name, _)| name == p.name);
        let (low, high) = p.limits();
        let interval = match half {
            _ if fixed => (value, value),
            Some(half) => (p.value((coordinate - half).max(low)), p.value((coordinate + half).min(high))),
            None => p.bounds,
        };
        let at_bound = !fixed && ((coordinate - low).abs() < 1e-3 || (coordinate - high).abs() < 1e-3);
        let width = 0.5 * p.error(interval.1, interval.0).abs();
        Estimate {
            parameter: *p,
            value,
            interval_95: interval,
            identifiable: !at_bound && width < p.widest,
            fixed,
            resolution_shift: shift.map(|s| p.value((coordinate + s).clamp(low, high)) - value),
        }
    }

    /// Seconds of each stage, the time since the last checkpoint being that of the intervals.
    fn seconds(&self) -> Vec<(Stage, f64)> {
        let mut seconds = self.checkpoint.borrow().seconds.clone();
        let booked: f64 = seconds.iter().map(|(_, s)| s).sum();
        seconds.push((Stage::Intervals, self.before + self.clock.elapsed().as_secs_f64() - booked));
        seconds
    }

    fn result(
        &self,
        launched: &Launch,
        state: &State,
        estimates: Vec<Estimate>,
        velocity_interval_95: DVec3,
        motion: Option<&Motion>,
    ) -> Identification {
        if self.kind != MaterialKind::Sand {
            self.warn(format!(
                "density is taken as {} kg/m^3: the video determines only the ratios of the moduli, stresses and viscosities to it",
                self.input.density_kg_m3
            ));
        }
        Identification {
            material: self.material(state),
            estimates,
            velocity_m_s: state.velocity,
            velocity_interval_95,
            angular_velocity_rad_s: state.angular,
            free_frames: launched.free,
            loss: motion.map_or_else(Loss::default, |m| mean_loss(&self.data, &self.context, &self.input.opacities, m)),
            trace: self.checkpoint.borrow().trace.clone(),
            rollouts: self.fine.load(Ordering::Relaxed),
            coarse_rollouts: self.coarse.load(Ordering::Relaxed),
            seconds: self.seconds(),
            warnings: self.warnings.borrow().clone(),
            splat_factor: state.splat.exp(),
            positions: placed(self.input, &self.shape, state).0,
            particle_volume_m3: self.input.particle_volume_m3,
            volume_factors: volume_factors(self.input, &self.shape, state),
        }
    }
}

/// The motion at `state` on a grid refined by `factor`, for the resolution check.
fn refined(mut simulation: Simulation, factor: f64, state: &State) -> Option<Motion> {
    let resolution = &mut simulation.resolution;
    resolution.spacing_factor = 1.0 / factor;
    resolution.substeps_per_frame = (resolution.substeps_per_frame as f64 * factor).ceil() as usize;
    let level = Level { first: 0, end: simulation.data.moments.len(), pooling: 1 };
    simulation.motion(state, &level).ok()
}
