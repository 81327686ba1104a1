//! A simulation that can be pulled at and changed while it runs.

use gic_mpm::{Body, Frame, Level, MaterialError, Options, SimulationError, Simulator, Snapshot, World};
use glam::DVec3;

use crate::hand::Hand;
use crate::outward::outward;

/// Where a particle's velocity stands in a snapshot.
const VELOCITY: core::ops::Range<usize> = 3..6;

/// A simulation of a world of one body, in one thread.
pub struct LiveSimulation {
    world: World,
    simulator: Simulator,
    frame: Frame,
    hand: Option<Hand>,
}

impl LiveSimulation {
    /// Sets up a world at its start.
    ///
    /// # Errors
    /// As [`Simulator::new`].
    pub fn new(world: World) -> Result<Self, SimulationError> {
        let simulator = simulator(&world)?;
        let frame = simulator.frame();
        Ok(Self { world, simulator, frame, hand: None })
    }

    /// What was reached last: positions, velocities, stresses.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Time since the start [s].
    pub fn time_s(&self) -> f64 {
        self.frame.index as f64 / self.world.frame_rate_hz
    }

    /// Centre of mass [m].
    pub fn centre_of_mass(&self) -> DVec3 {
        let masses = self.body().masses_kg();
        let moment: DVec3 = masses.iter().zip(&self.frame.positions).map(|(m, p)| *m * *p).sum();
        moment / masses.iter().sum::<f64>()
    }

    /// Outward directions for the light, shape [n, 3].
    pub fn outward(&self) -> Vec<[f32; 3]> {
        outward(&self.frame.positions, self.spacing())
    }

    /// Computes the next frame; what is held is pulled first.
    ///
    /// # Errors
    /// As [`Simulator::advance_frame`]; the state is then that before the call, the pull included.
    pub fn advance(&mut self) -> Result<(), SimulationError> {
        if let Some(hand) = &self.hand {
            let mut snapshot = self.simulator.snapshot();
            for (p, velocity) in hand.pulled(&self.frame.positions, &self.frame.velocities) {
                snapshot.particles[p][VELOCITY].copy_from_slice(&velocity.to_array());
            }
            self.simulator.restore(&snapshot)?;
        }
        self.frame = self.simulator.advance_frame()?;
        Ok(())
    }

    /// Back to the start, with the parameters as they are now.
    ///
    /// # Errors
    /// As [`Simulator::new`].
    pub fn restart(&mut self) -> Result<(), SimulationError> {
        *self = Self::new(self.world.clone())?;
        Ok(())
    }

    /// Changes a parameter of the law, numbered as in [`gic_mpm::MaterialKind::parameter_names`]; the motion goes on.
    ///
    /// # Errors
    /// A value out of range.
    pub fn set_parameter(&mut self, index: usize, value: f64) -> Result<(), MaterialError> {
        let material = &mut self.world.bodies[0].material;
        let mut values = material.parameters();
        if let Some(parameter) = values.get_mut(index) {
            *parameter = value;
        }
        *material = material.with_parameters(&values)?;
        Ok(())
    }

    /// Changes gravity [m/s^2]; the motion goes on.
    pub fn set_gravity(&mut self, gravity_m_s2: DVec3) {
        self.world.gravity_m_s2 = gravity_m_s2;
    }

    /// Lets what was changed take effect.
    ///
    /// # Errors
    /// As [`Simulator::new`].
    pub fn apply_changes(&mut self) -> Result<(), SimulationError> {
        let snapshot: Snapshot = self.simulator.snapshot();
        self.simulator = simulator(&self.world)?;
        self.simulator.restore(&snapshot)
    }

    /// Grabs what a ray from `eye` [m] along the unit vector `direction` meets first; returns where it is held [m].
    pub fn grab(&mut self, eye: DVec3, direction: DVec3) -> Option<DVec3> {
        let positions = &self.body().positions;
        let low = positions.iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
        let high = positions.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
        let side = (high - low).max_element();
        self.hand = Hand::grab(&self.frame.positions, eye, direction, self.spacing(), side);
        self.hand.as_ref().map(|hand| hand.target)
    }

    /// Pulls what is held to a place [m].
    pub fn pull(&mut self, target: DVec3) {
        if let Some(hand) = &mut self.hand {
            hand.target = target;
        }
    }

    /// Lets go.
    pub fn release(&mut self) {
        self.hand = None;
    }

    fn body(&self) -> &Body {
        &self.world.bodies[0]
    }

    /// Distance of neighbouring particles [m].
    fn spacing(&self) -> f64 {
        self.body().particle_volume_m3.cbrt()
    }
}

fn simulator(world: &World) -> Result<Simulator, SimulationError> {
    let options = Options { level: Some(Level::Scalar), parallel: false, ..Options::default() };
    Simulator::new(world, &options)
}

#[cfg(test)]
pub(crate) mod tests {
    use gic_mpm::{Collider, Contact, Material, Stepping};

    use super::*;

    /// A soft block 4 cm above a floor.
    pub(crate) fn falling_block() -> World {
        let spacing = 0.02;
        let positions = (0..1000)
            .map(|n| DVec3::new(f64::from(n / 100), f64::from(n / 10 % 10) + 2.5, f64::from(n % 10)) * spacing)
            .collect();
        let body = Body {
            material: Material::Elastic { youngs_modulus_pa: 2e4, poisson_ratio: 0.3 },
            density_kg_m3: 1000.0,
            particle_volume_m3: spacing * spacing * spacing,
            volume_factors: vec![1.0; 1000],
            positions,
            velocity_m_s: DVec3::new(0.0, -1.0, 0.0),
            angular_velocity_rad_s: DVec3::ZERO,
            own_velocities_m_s: Vec::new(),
        };
        World {
            bodies: vec![body],
            colliders: vec![Collider::plane(DVec3::ZERO, DVec3::Y, Contact::Separating { friction: 0.0 })],
            gravity_m_s2: DVec3::new(0.0, -9.8, 0.0),
            grid_spacing_m: 2.0 * spacing,
            frame_rate_hz: 60.0,
            stepping: Stepping::STABLE,
        }
    }

    fn heights(simulation: &mut LiveSimulation, frames: usize) -> Vec<f64> {
        (0..frames)
            .map(|_| {
                simulation.advance().unwrap();
                simulation.centre_of_mass().y
            })
            .collect()
    }

    #[test]
    fn a_changed_parameter_changes_what_follows_and_a_start_stays() {
        let mut simulation = LiveSimulation::new(falling_block()).unwrap();
        let soft = heights(&mut simulation, 30);
        simulation.restart().unwrap();
        assert_eq!(heights(&mut simulation, 30), soft);
        simulation.restart().unwrap();
        simulation.set_parameter(0, 2e5).unwrap();
        simulation.apply_changes().unwrap();
        let stiff = heights(&mut simulation, 30);
        let lowest = |heights: &[f64]| heights.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(lowest(&stiff) > lowest(&soft) + 0.01, "{} {}", lowest(&stiff), lowest(&soft));
        assert!(simulation.set_parameter(1, 0.5).is_err());
    }

    #[test]
    fn changes_that_change_nothing_leave_the_bits() {
        let mut simulation = LiveSimulation::new(falling_block()).unwrap();
        let alone = heights(&mut simulation, 12);
        simulation.restart().unwrap();
        let mut first = heights(&mut simulation, 6);
        simulation.set_gravity(DVec3::new(0.0, -9.8, 0.0));
        simulation.apply_changes().unwrap();
        first.extend(heights(&mut simulation, 6));
        assert_eq!(first, alone);
    }

    #[test]
    fn a_hand_lifts_the_body() {
        let mut simulation = LiveSimulation::new(falling_block()).unwrap();
        simulation.set_parameter(0, 1e5).unwrap();
        simulation.apply_changes().unwrap();
        let eye = DVec3::new(0.09, 0.14, 2.0);
        assert!(simulation.grab(eye, DVec3::Z).is_none(), "behind the eye");
        let held = simulation.grab(eye, DVec3::NEG_Z).unwrap();
        assert!(held.z > 0.12, "the near side is held: {held}");
        simulation.pull(held + DVec3::new(0.0, 0.3, 0.0));
        let lifted = *heights(&mut simulation, 60).last().unwrap();
        simulation.release();
        let fallen = *heights(&mut simulation, 60).last().unwrap();
        assert!(lifted > 0.25 && fallen < 0.2, "{lifted} {fallen}");
    }
}
