//! The adjoint of one substep against central differences in f64, from a state that is deformed, yields and touches
//! obstacles.
//!
//! The loss is linear in every number of the new state, so that nothing an engine computes can hide. Errors are
//! relative to the derivative itself.

use crate::laws::law::Coefficients;
use crate::rollouts::gradcheck::{gradcheck_materials, gradcheck_world};
use crate::substep::engine::{Bars, Engine, Segment};
use crate::substep::fast::FastEngine;
use crate::substep::grid_update::Impulse;
use crate::substep::prepared_world::PreparedWorld;
use crate::substep::scalar::ScalarEngine;
use crate::substep::state::{NUMBERS_PER_PARTICLE, State};
use crate::{Level, Material, Rules, World};

const TOLERANCE: f64 = 1e-5;

const SUBSTEP: Segment = Segment { start: 0.0, dt: 2e-4, substeps: 1 };

/// Name, numbers of a particle's state, and step of the differences.
const FIELDS: [(&str, core::ops::Range<usize>, f64); 4] = [
    ("positions [m]", 0..3, 1e-8),
    ("velocities [m/s]", 3..6, 1e-5),
    ("affine velocities [1/s]", 6..15, 1e-3),
    ("deformation gradients", 15..24, 1e-6),
];

/// A number in [-1, 1) for each pair, without pattern.
fn noise(seed: usize, index: usize) -> f64 {
    let mut x = (seed as u64) << 32 | index as u64;
    for _ in 0..3 {
        x = (x ^ (x >> 31)).wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    }
    (x >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// Changes each number of a state.
fn changed(state: &State<f64>, change: impl Fn(usize, usize) -> f64) -> State<f64> {
    let mut state = state.clone();
    for p in 0..state.len() {
        let mut numbers = state.to_numbers(p);
        for (i, number) in numbers.iter_mut().enumerate() {
            *number += change(p, i);
        }
        state.set_numbers(p, &numbers);
    }
    state
}

/// Strains of a tenth, slightly compressed (sand that is pulled apart has no stress), shear rates of some 1/s.
fn deformed(prepared: &PreparedWorld) -> State<f64> {
    changed(&prepared.initial_state(), |p, i| match i {
        0..3 => 0.0,
        3..6 => 0.5 * noise(1, p * NUMBERS_PER_PARTICLE + i),
        6..15 => 20.0 * noise(2, p * NUMBERS_PER_PARTICLE + i),
        _ => 0.1 * noise(3, p * NUMBERS_PER_PARTICLE + i) - if i % 4 == 3 { 0.02 } else { 0.0 },
    })
}

/// The derivative of the loss with respect to a number of the new state; positions count in cells, velocity gradients
/// per cell.
fn weight(particle: usize, number: usize) -> f64 {
    let scale = match number {
        0..3 => 50.0,
        6..15 => 0.02,
        _ => 1.0,
    };
    scale * noise(4, particle * NUMBERS_PER_PARTICLE + number)
}

/// A start and where it leads.
struct Case {
    world: World,
    start: State<f64>,
    end: State<f64>,
}

fn end(prepared: &PreparedWorld, start: &State<f64>) -> State<f64> {
    let mut state = start.clone();
    let mut ignored = vec![Impulse::default(); prepared.colliders.len()];
    ScalarEngine::new().advance(prepared, &mut state, SUBSTEP, &mut ignored).expect("the state is stable");
    state
}

impl Case {
    fn new(material: Material) -> Self {
        let world = gradcheck_world(material);
        let prepared = prepared(&world);
        let start = deformed(&prepared);
        let end = end(&prepared, &start);
        Self { world, start, end }
    }

    /// The loss, less that of the case itself (which keeps rounding small).
    fn loss(&self, world: &World, start: &State<f64>) -> f64 {
        let end = end(&prepared(world), start);
        let particle = |p: usize| {
            let pairs = end.to_numbers(p).into_iter().zip(self.end.to_numbers(p)).enumerate();
            pairs.map(|(i, (now, then))| weight(p, i) * (now - then)).sum::<f64>()
        };
        (0..end.len()).map(particle).sum()
    }

    fn difference_by_world(&self, value: f64, set: impl Fn(&mut World, f64)) -> f64 {
        let step = 1e-5 * value;
        let loss = |value: f64| {
            let mut world = self.world.clone();
            set(&mut world, value);
            self.loss(&world, &self.start)
        };
        (loss(value + step) - loss(value - step)) / (2.0 * step)
    }

    fn difference_by_state(&self, step: f64, direction: impl Fn(usize, usize) -> f64) -> f64 {
        let loss = |step: f64| self.loss(&self.world, &changed(&self.start, |p, i| step * direction(p, i)));
        (loss(step) - loss(-step)) / (2.0 * step)
    }

    /// The adjoint of the start and the body's derivatives.
    fn adjoint(&self, engine: &impl Engine<Number = f64>) -> (State<f64>, Bars) {
        let prepared = prepared(&self.world);
        let mut adjoint = changed(&State::zeros(self.start.len()), weight);
        let mut bars = Bars::zeros(&prepared);
        let Ok(tape) = engine.record(&prepared, &self.start, SUBSTEP) else { panic!("the state is stable") };
        engine.reverse(&prepared, tape, &mut adjoint, &mut bars);
        (adjoint, bars)
    }

    /// Particles whose deformation the law did not leave as the trial put it.
    fn yielding(&self) -> usize {
        let trial = |p: usize| {
            let f = &self.start.deformation[p];
            f.add_scaled(SUBSTEP.dt, &self.start.affine[p].times(f))
        };
        let differs = |p: &usize| trial(*p).0.iter().zip(self.end.deformation[*p].0).any(|(a, b)| (a - b).abs() > 1e-6);
        (0..self.start.len()).filter(differs).count()
    }
}

fn prepared(world: &World) -> PreparedWorld {
    PreparedWorld::new(world, Rules::Exact).expect("the world is valid")
}

fn assert_close(what: &str, adjoint: f64, difference: f64) {
    let error = (adjoint - difference).abs() / difference.abs();
    println!("{what}: {adjoint:.9e}, difference {difference:.9e}, relative error {error:.1e}");
    assert!(error <= TOLERANCE, "{what}: {adjoint} against {difference}");
}

fn assert_adjoint(engine: &impl Engine<Number = f64>) {
    for material in gradcheck_materials() {
        let case = Case::new(material);
        let (adjoint, Bars { bodies, factors }) = case.adjoint(engine);
        let bars = bodies[0];
        let model = material.model();

        let values = material.parameters();
        let by_parameter = material.parameter_gradient(&Coefficients(bars.coefficients));
        for (i, name) in material.parameter_names().iter().enumerate() {
            let difference = case.difference_by_world(values[i], |world, value| {
                let mut values = values.clone();
                values[i] = value;
                world.bodies[0].material = material.with_parameters(&values).expect("a small change");
            });
            assert_close(&format!("{model} {name}"), by_parameter[i], difference);
        }
        // Masses and volumes of particles are in a unit of their own.
        let unit = prepared(&case.world).mass_unit;
        let (density, volume) = (case.world.bodies[0].density_kg_m3, case.world.bodies[0].particle_volume_m3);
        let by_density = case.difference_by_world(density, |world, value| world.bodies[0].density_kg_m3 = value);
        assert_close(&format!("{model} density"), bars.mass * volume / unit, by_density);
        // At constant mass: at constant density, volume has no effect on a single body.
        let by_volume = case.difference_by_world(volume, |world, value| {
            world.bodies[0].particle_volume_m3 = value;
            world.bodies[0].density_kg_m3 = density * volume / value;
        });
        assert_close(&format!("{model} particle volume"), bars.volume / unit, by_volume);

        let middle = case.start.len() / 2;
        for particle in [3, middle, case.start.len() - 1] {
            let by_factor = case.difference_by_world(case.world.bodies[0].volume_factors[particle], |world, value| {
                world.bodies[0].volume_factors[particle] = value;
            });
            assert_close(&format!("{model} volume factor of particle {particle}"), factors[particle], by_factor);
        }
        for (field, (name, numbers, step)) in FIELDS.into_iter().enumerate() {
            // All particles at once, then single ones: at the ground, inside, at the far end.
            for (kind, only) in [None, Some(3), Some(middle), Some(case.start.len() - 1)].into_iter().enumerate() {
                let direction = |p: usize, i: usize| {
                    let moves = numbers.contains(&i) && only.is_none_or(|only| only == p);
                    if moves { noise(10 + 4 * field + kind, p * NUMBERS_PER_PARTICLE + i) } else { 0.0 }
                };
                let along: f64 = (0..case.start.len())
                    .flat_map(|p| adjoint.to_numbers(p).into_iter().enumerate().map(move |(i, bar)| (p, i, bar)))
                    .map(|(p, i, bar)| bar * direction(p, i))
                    .sum();
                let difference = case.difference_by_state(step, direction);
                assert_close(&format!("{model} {name}, particles {only:?}"), along, difference);
            }
        }
    }
}

#[test]
fn the_scalar_engines_adjoint_is_that_of_a_substep() {
    assert_adjoint(&ScalarEngine::new());
}

#[test]
fn the_lane_engines_adjoint_is_that_of_a_substep() {
    assert_adjoint(&FastEngine::new(Level::Scalar, false));
}

/// Otherwise the tests above would say nothing about return maps.
#[test]
fn the_start_yields() {
    for material in gradcheck_materials() {
        let case = Case::new(material);
        let yielding = case.yielding();
        println!("{}: {yielding} of {} particles", material.model(), case.start.len());
        match material {
            Material::Elastic { .. } | Material::Viscoelastic { .. } => assert_eq!(yielding, 0),
            Material::Newtonian { .. } => {}
            _ => assert!(yielding * 2 >= case.start.len()),
        }
    }
}
