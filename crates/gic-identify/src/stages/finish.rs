//! Intervals and checks at the estimate, and everything into one result.

use std::sync::atomic::Ordering;

use gic_mpm::MaterialKind;
use glam::DVec3;
use nalgebra::DMatrix;

use crate::checkpoint::Event;
use crate::forward::flight::{Flight, placed, volume_factors};
use crate::forward::simulation::Simulation;
use crate::forward::trajectories::{ForwardModel, FrameSelection, Trajectories};
use crate::result::{Estimate, Estimates, Loss, Stage};
use crate::solve::linearisation::{Linearisation, Tangents};
use crate::solve::loss::mean_loss;
use crate::solve::problem::Problem;
use crate::stages::Identification;
use crate::stages::free_flight::FreeFlightFit;
use crate::uncertainty::interval::{self, half_width};
use crate::uncertainty::verdicts;
use crate::unknowns::parameter::material_of;
use crate::unknowns::state::{State, Unknown};
use crate::{IdentifyError, Parameter};

impl Identification<'_> {
    fn material(&self, state: &State) -> gic_mpm::Material {
        let values: Vec<f64> = self.parameters().iter().zip(&state.material).map(|(p, c)| p.value(*c)).collect();
        material_of(self.kind, &values)
    }

    pub(crate) fn finish_untouched(&self, flight_fit: &FreeFlightFit) -> Estimates {
        let trajectories = Flight { input: self.input, video: &self.video, shape: &self.shape }
            .trajectories(&flight_fit.state, &self.all_frames());
        self.without_intervals(flight_fit, &flight_fit.state, trajectories.ok().as_ref())
    }

    /// The end of the material stage as the result.
    pub(crate) fn finish_roughly(&self, flight_fit: &FreeFlightFit, state: &State) -> Result<Estimates, IdentifyError> {
        let trajectories =
            self.simulation(flight_fit.free).trajectories(state, &self.all_frames()).map_err(self.failure(1))?;
        Ok(self.without_intervals(flight_fit, state, Some(&trajectories)))
    }

    fn without_intervals(
        &self,
        flight_fit: &FreeFlightFit,
        state: &State,
        trajectories: Option<&Trajectories>,
    ) -> Estimates {
        let estimate = |(p, c): (&Parameter, &f64)| self.estimate(p, *c, None, None);
        let estimates = self.parameters().iter().zip(&state.material).map(estimate).collect();
        self.result(flight_fit, state, estimates, DVec3::NAN, trajectories)
    }

    /// Intervals, checks, and everything into one result; `known` is what was measured at `state` before.
    pub(crate) fn finish(
        &self,
        flight_fit: &FreeFlightFit,
        state: &State,
        known: Option<Linearisation>,
    ) -> Result<Estimates, IdentifyError> {
        let simulation = self.simulation(flight_fit.free);
        let prior = self.joint_prior(flight_fit);
        let problem = Problem {
            forward: &simulation,
            objective: self.base_objective(),
            unknowns: self.joint_unknowns(flight_fit),
            parameters: self.parameters(),
            selection: self.all_frames(),
            prior: Some(&prior),
        };
        let count = problem.unknowns.len();
        let factor = self.settings.resolution_check;
        let (check, finer) = ((factor > 0.0).then_some(factor), self.simulation(flight_fit.free));
        let ((trajectories, tangents), refined) = rayon::join(
            || match known {
                Some(Linearisation { trajectories, tangents, .. }) => (Ok(trajectories), Ok(tangents)),
                None => Tangents::measure_with_motion(&problem, state),
            },
            || check.and_then(|factor| refined(finer, factor, state)),
        );
        let trajectories = trajectories.map_err(self.failure(1))?;
        self.tell(Event::Working).map_err(|_| IdentifyError::Interrupted)?;
        let (mut covariance, mut shifts) = (None, None);
        match tangents {
            Ok(mut tangents) => {
                // A refined grid is one more direction in which the residuals move: a nuisance, with the whole of its shift.
                if let Some(trajectories) = refined {
                    tangents.perturbed.push(trajectories);
                    tangents.steps.push(1.0);
                }
                let (blocks, columns) = (tangents.blocks(&problem, &trajectories), tangents.steps.len());
                let weights = self.weights_at(&blocks, count, flight_fit);
                let known = prior.information_of(&problem.unknowns);
                let nuisances = DMatrix::identity(columns - count, columns - count);
                if columns > count {
                    shifts = interval::response(&blocks, &weights, count, &known, count);
                }
                let places = |of: &dyn Fn(&Unknown) -> bool| -> Vec<usize> {
                    (0..count).filter(|k| of(&problem.unknowns[*k])).collect()
                };
                let materials = places(&|u| matches!(u, Unknown::Material(_)));
                let shapes = places(&|u| matches!(u, Unknown::Shape(_)));
                covariance = interval::covariance(&blocks, &weights, count, &known, &nuisances).map(|c| {
                    c + interval::shape_prior_covariance(&blocks, &weights, count, &known, &materials, &shapes)
                });
            }
            Err(reason) => self.warn(format!("no intervals: {reason}")),
        }
        let compared = (&self.video, &self.context);
        let drawn = (&trajectories, self.input.opacities.as_slice());
        let unexplained = verdicts::unexplained(compared, drawn, flight_fit.free, self.input.grid_spacing_m);
        let explained = unexplained.is_empty();
        let at_limits = verdicts::at_limits(self.parameters(), &self.free_materials(), state);
        unexplained.into_iter().chain(at_limits).for_each(|warning| self.warn(warning));
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
            half.hypot(self.flown_half_width(flight_fit, Unknown::Velocity(a)))
        });
        let velocity = DVec3::from_array(velocity);
        Ok(self.result(flight_fit, state, estimates, velocity, Some(&trajectories)))
    }

    /// Half-width of an unknown's interval from free flight alone, where the position is uncertain, too; 0 where it was not fitted.
    fn flown_half_width(&self, flight_fit: &FreeFlightFit, unknown: Unknown) -> f64 {
        let none = DMatrix::zeros(0, 0);
        let count = flight_fit.unknowns.len();
        let place = flight_fit.unknowns.iter().position(|u| *u == unknown);
        let covariance = interval::covariance(&flight_fit.blocks, &self.weights, count, &none, &none);
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
        flight_fit: &FreeFlightFit,
        state: &State,
        estimates: Vec<Estimate>,
        velocity_interval_95: DVec3,
        trajectories: Option<&Trajectories>,
    ) -> Estimates {
        if self.kind != MaterialKind::Sand {
            self.warn(format!(
                "density is taken as {} kg/m^3: the video determines only the ratios of the moduli, stresses and viscosities to it",
                self.input.density_kg_m3
            ));
        }
        Estimates {
            material: self.material(state),
            estimates,
            velocity_m_s: state.velocity,
            velocity_interval_95,
            angular_velocity_rad_s: state.angular,
            free_frames: flight_fit.free,
            loss: trajectories
                .map_or_else(Loss::default, |m| mean_loss(&self.video, &self.context, &self.input.opacities, m)),
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
fn refined(mut simulation: Simulation, factor: f64, state: &State) -> Option<Trajectories> {
    let resolution = &mut simulation.resolution;
    resolution.spacing_factor = 1.0 / factor;
    resolution.substeps_per_frame = (resolution.substeps_per_frame as f64 * factor).ceil() as usize;
    let selection = FrameSelection { first: 0, end: simulation.video.frames.len(), pooling: 1 };
    simulation.trajectories(state, &selection).ok()
}
