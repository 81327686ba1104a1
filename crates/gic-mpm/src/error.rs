//! What can go wrong in a simulation, and the way out.

use glam::DVec3;

use crate::MaterialError;
use crate::budget::{Budget, Forecast};
use crate::options::Precision;

/// Why a simulation could not be set up or continued.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SimulationError {
    /// A number of the world makes no sense.
    #[error("{field} = {value}: {expected}")]
    Invalid {
        /// Which one, as in `bodies[0].density_kg_m3`.
        field: String,
        /// The value found.
        value: String,
        /// What it must be.
        expected: &'static str,
    },
    /// A material's parameters make no sense.
    #[error("bodies[{body}]: {source}")]
    Material {
        /// Number of the body.
        body: usize,
        /// What is wrong.
        source: MaterialError,
    },
    /// There is nothing to simulate.
    #[error("the world has no particles: give at least one body with at least one position")]
    Empty,
    /// Particles are too light, too heavy, or too different to be computed together.
    #[error(
        "the particles weigh from {lightest_kg:e} to {heaviest_kg:e} kg, which cannot be computed with: \
         check density_kg_m3, particle_volume_m3 and volume_factors, and the unit of lengths"
    )]
    Masses {
        /// The lightest [kg].
        lightest_kg: f64,
        /// The heaviest [kg].
        heaviest_kg: f64,
    },
    /// A body is smaller than a cell.
    #[error("bodies[{body}] is {cells:.2} cells across, so the grid does not see its shape: lower `grid_spacing_m`")]
    Unresolved {
        /// Number of the body.
        body: usize,
        /// Cells along its largest side.
        cells: f64,
    },
    /// The simulation would take more memory or time than it may.
    #[error(
        "{} particles, {} frames of {} substeps: about {:.3} GB and {:.3} hours on one core, more than the budget of \
         {:.3} GB and {:.3} hours: raise `grid_spacing_m` and the particles' spacing, simulate fewer frames or substeps, \
         or raise the budget",
        forecast.particles, forecast.frames, forecast.substeps_per_frame,
        forecast.memory_bytes / 1e9, forecast.seconds / 3600.0, budget.memory_bytes / 1e9, budget.seconds / 3600.0
    )]
    OverBudget {
        /// What it would take.
        forecast: Forecast,
        /// What it may take.
        budget: Budget,
    },
    /// A particle starts inside an obstacle.
    #[error(
        "particle {particle} at {position} m starts {depth_m:.4} m inside colliders[{collider}]: \
         move the body or the collider"
    )]
    InsideCollider {
        /// Number of the particle.
        particle: usize,
        /// Where it is [m].
        position: DVec3,
        /// Number of the collider.
        collider: usize,
        /// How deep [m].
        depth_m: f64,
    },
    /// A frame stays unstable however many substeps it gets.
    #[error(
        "frame {frame} is unstable even with {substeps} substeps: particle {particle} moves at {velocity} m/s; \
         lower the stiffness or the viscosity, raise `grid_spacing_m`, or check the parameters' units"
    )]
    Unstable {
        /// The frame that was being computed.
        frame: usize,
        /// The substeps of the last attempt.
        substeps: usize,
        /// Number of the first particle that broke the bound.
        particle: usize,
        /// Its velocity [m/s]; not finite if it became NaN.
        velocity: DVec3,
    },
    /// The time step that the material needs is beyond reason.
    #[error(
        "bodies[{body}] needs {substeps:.3e} substeps per frame (wave speed {wave_speed_m_s:.1} m/s, \
         particles up to {speed_m_s:.1} m/s, on a {grid_spacing_m} m grid), more than {limit}: \
         lower its stiffness, viscosity or velocity, or raise `grid_spacing_m`"
    )]
    TooStiff {
        /// Number of the body.
        body: usize,
        /// Substeps that stability asks for.
        substeps: f64,
        /// Speed of sound [m/s].
        wave_speed_m_s: f64,
        /// Speed of the fastest particle in the frame, with what gravity may add [m/s].
        speed_m_s: f64,
        /// Grid spacing [m].
        grid_spacing_m: f64,
        /// Most substeps that are tried.
        limit: usize,
    },
    /// An obstacle moves too fast for any substep.
    #[error(
        "frame {frame}: colliders[{collider}] moves at {speed_m_s:.3e} m/s, a cell in less than the shortest of {limit} \
         substeps: lower its velocity, set its keyframes farther apart in time, or raise `grid_spacing_m`"
    )]
    ColliderTooFast {
        /// The frame that was to be computed.
        frame: usize,
        /// Number of the obstacle.
        collider: usize,
        /// Speed of its surface [m/s].
        speed_m_s: f64,
        /// Most substeps that are tried.
        limit: usize,
    },
    /// Momentum came from nowhere or went there.
    #[error(
        "frame {frame}: of the momentum at work {share:.1e} comes neither from gravity nor from obstacles; \
         {substeps} substeps a frame are too short for single precision: take fewer or a higher frame rate"
    )]
    MomentumLost {
        /// The frame that was being computed.
        frame: usize,
        /// Share of the momentum that has no cause.
        share: f64,
        /// Substeps of the frame.
        substeps: usize,
    },
    /// Substeps are so short that positions round them away.
    #[error(
        "frame {frame}: rounding in {substeps} substeps may move particle {particle} at {position} m by {drift_m:.1e} m, \
         over a tenth of a cell: take fewer substeps or a higher frame rate, or move the world nearer to its origin"
    )]
    Rounded {
        /// The frame that was being computed.
        frame: usize,
        /// Number of the first particle to which that happens.
        particle: usize,
        /// Where it is [m].
        position: DVec3,
        /// Substeps of the frame.
        substeps: usize,
        /// How far it may be moved [m].
        drift_m: f64,
    },
    /// A particle was pressed into an obstacle farther than contact allows.
    #[error(
        "frame {frame}: particle {particle} at {position} m is {depth_m:.4} m inside colliders[{collider}], \
         through which it was pressed: move the obstacles less far into each other, or lower `grid_spacing_m`"
    )]
    ThroughCollider {
        /// The frame that was being computed.
        frame: usize,
        /// Number of the particle.
        particle: usize,
        /// Where it is [m].
        position: DVec3,
        /// Number of the obstacle.
        collider: usize,
        /// How deep [m].
        depth_m: f64,
    },
    /// A particle went too far from the others or from the origin.
    #[error(
        "frame {frame}: particle {particle} left the domain at {position} m with {velocity} m/s ({reason}); \
         add a collider that holds it, simulate fewer frames, or raise `grid_spacing_m`"
    )]
    LeftDomain {
        /// The frame that was being computed.
        frame: usize,
        /// Number of the particle.
        particle: usize,
        /// Where it is [m].
        position: DVec3,
        /// How fast it is [m/s].
        velocity: DVec3,
        /// Which limit it broke.
        reason: &'static str,
    },
    /// A snapshot does not belong to this world.
    #[error("the saved state does not fit this world: {reason}")]
    StateMismatch {
        /// What differs.
        reason: StateMismatch,
    },
    /// A gradient does not fit its memory budget.
    #[error(
        "the gradient needs at least {needed_bytes} bytes, but `gradient_memory_bytes` is {budget_bytes}: \
         raise it or use fewer particles"
    )]
    MemoryBudget {
        /// Smallest budget that works.
        needed_bytes: usize,
        /// The budget given.
        budget_bytes: usize,
    },
    /// The caller asked to stop.
    #[error("interrupted")]
    Interrupted,
    /// The loss returned a gradient of the wrong length or with a NaN.
    #[error("the loss gradient of frame {frame} {reason}")]
    LossGradient {
        /// The frame.
        frame: usize,
        /// What is wrong with it.
        reason: LossGradientError,
    },
}

/// What of a saved state differs from the simulator that is to continue from it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StateMismatch {
    /// Another number of particles.
    #[error("it has {found} particles, the world {expected}")]
    Particles {
        /// Particles of the saved state.
        found: usize,
        /// Particles of the world.
        expected: usize,
    },
    /// Another precision.
    #[error("it was computed in {found:?}, the options ask for {expected:?}")]
    Precision {
        /// Precision of the saved state.
        found: Precision,
        /// Precision of the simulator.
        expected: Precision,
    },
    /// A number that is none.
    #[error("particle {particle} holds a number that is not finite")]
    NotFinite {
        /// Number of the particle.
        particle: usize,
    },
}

/// What is wrong with the gradient that a loss returned.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LossGradientError {
    /// The frame was not simulated.
    #[error("belongs to no frame: {frames} were simulated, counted from 0")]
    NoSuchFrame {
        /// Frames simulated.
        frames: usize,
    },
    /// Not one entry for each particle.
    #[error("has {found} entries for {particles} particles")]
    Length {
        /// Entries returned.
        found: usize,
        /// Particles of the frame.
        particles: usize,
    },
    /// A number that is none.
    #[error("is not finite at particle {particle}")]
    NotFinite {
        /// Number of the particle.
        particle: usize,
    },
}
