//! The public simulator: frame after frame, with states that can be saved and restored.

use std::io::{self, Read, Write};

use serde::{Deserialize, Serialize};

use crate::World;
use crate::error::SimulationError;
use crate::options::{Options, Precision};
use crate::rollouts::frames::{Advanced, Frame, Rollout, Timing};
use crate::substep::engine::Engine;
use crate::substep::prepared_world::PreparedWorld;
use crate::substep::state::{NUMBERS, State};

/// Runs an expression with `$engine` bound to the engine that the options ask for.
macro_rules! with_engine {
    ($options:expr, $engine:ident => $body:expr) => {
        match $options.precision {
            crate::options::Precision::F64 => {
                let $engine = crate::substep::scalar::ScalarEngine::<f64>::new();
                $body
            }
            crate::options::Precision::F32 if $options.twin => {
                let $engine = crate::substep::scalar::ScalarEngine::<f32>::new();
                $body
            }
            crate::options::Precision::F32 => {
                let level = $options.level.unwrap_or_else(gic_simd::Level::active);
                let $engine = crate::substep::fast::FastEngine::<f32>::new(level, $options.parallel);
                $body
            }
        }
    };
}
pub(crate) use with_engine;

/// A simulation in progress.
pub struct Simulator(Box<dyn Drive>);

impl Simulator {
    /// Sets up a world at frame 0.
    ///
    /// # Errors
    /// Where [`World::validate`] finds something wrong.
    pub fn new(world: &World, options: &Options) -> Result<Self, SimulationError> {
        let prepared = PreparedWorld::new(world, options.rules)?;
        Ok(Self(with_engine!(options, engine => Box::new(Running::new(engine, prepared, world, options.precision)))))
    }

    /// Number of the current frame; 0 at the start.
    pub fn frame_index(&self) -> usize {
        self.0.frame_index()
    }

    /// The current frame. Contact forces are those of the last [`Self::advance_frame`], zero right after a start or a restore.
    pub fn frame(&self) -> Frame {
        self.0.frame()
    }

    /// Computes the next frame. After an error the state is that before the call.
    ///
    /// # Errors
    /// [`SimulationError::Unstable`], [`SimulationError::TooStiff`] or [`SimulationError::LeftDomain`].
    pub fn advance_frame(&mut self) -> Result<Frame, SimulationError> {
        self.0.advance_frame()
    }

    /// The complete state: a simulator of the same world and options that restores it continues with the same bits.
    pub fn snapshot(&self) -> Snapshot {
        self.0.snapshot()
    }

    /// Continues from a saved state.
    ///
    /// # Errors
    /// [`SimulationError::StateMismatch`] when it has another number of particles, another precision, or numbers that are not finite.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), SimulationError> {
        self.0.restore(snapshot)
    }
}

/// Simulates `frames` frames, frame 0 included, and hands each to `on_frame`.
///
/// # Errors
/// As [`Simulator::new`] and [`Simulator::advance_frame`].
pub fn rollout(
    world: &World,
    options: &Options,
    frames: usize,
    mut on_frame: impl FnMut(Frame),
) -> Result<(), SimulationError> {
    let mut simulator = Simulator::new(world, options)?;
    if frames > 0 {
        on_frame(simulator.frame());
    }
    for _ in 1..frames {
        on_frame(simulator.advance_frame()?);
    }
    Ok(())
}

/// A saved state of a [`Simulator`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Frame at whose end it was taken.
    pub frame: usize,
    /// Precision of the simulator.
    pub precision: Precision,
    /// Per particle in input order: position [m], velocity [m/s], affine velocity gradient [1/s] and deformation gradient, matrices by rows.
    pub particles: Vec<[f64; NUMBERS]>,
}

/// First bytes of a saved snapshot.
const MAGIC: &[u8; 8] = b"gic-mpm1";

impl Snapshot {
    /// Writes it exactly: magic, frame, precision (0 = f32, 1 = f64), particle count, then the particles; little-endian, 8 bytes a number.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write(&self, mut out: impl Write) -> io::Result<()> {
        out.write_all(MAGIC)?;
        let precision = match self.precision {
            Precision::F32 => 0u64,
            Precision::F64 => 1,
        };
        for number in [self.frame as u64, precision, self.particles.len() as u64] {
            out.write_all(&number.to_le_bytes())?;
        }
        for number in self.particles.iter().flatten() {
            out.write_all(&number.to_le_bytes())?;
        }
        Ok(())
    }

    /// Reads what [`Self::write`] wrote.
    ///
    /// # Errors
    /// Those of the reader, and `InvalidData` when it is not a snapshot.
    pub fn read(mut input: impl Read) -> io::Result<Self> {
        let mut word = || -> io::Result<[u8; 8]> {
            let mut bytes = [0; 8];
            input.read_exact(&mut bytes)?;
            Ok(bytes)
        };
        let invalid =
            |what: &str| io::Error::new(io::ErrorKind::InvalidData, format!("not a saved simulator state: {what}"));
        if &word()? != MAGIC {
            return Err(invalid("wrong first bytes"));
        }
        let frame = u64::from_le_bytes(word()?) as usize;
        let precision = match u64::from_le_bytes(word()?) {
            0 => Precision::F32,
            1 => Precision::F64,
            _ => return Err(invalid("unknown precision")),
        };
        let count = u64::from_le_bytes(word()?) as usize;
        // Grows as it reads, so that a corrupt count cannot ask for all memory.
        let mut particles = Vec::new();
        for _ in 0..count {
            let mut particle = [0.0; NUMBERS];
            for number in &mut particle {
                *number = f64::from_le_bytes(word()?);
            }
            particles.push(particle);
        }
        Ok(Self { frame, precision, particles })
    }
}

/// A simulator whose engine is hidden.
trait Drive: Send {
    fn frame_index(&self) -> usize;
    fn frame(&self) -> Frame;
    fn advance_frame(&mut self) -> Result<Frame, SimulationError>;
    fn snapshot(&self) -> Snapshot;
    fn restore(&mut self, snapshot: &Snapshot) -> Result<(), SimulationError>;
}

struct Running<E: Engine> {
    engine: E,
    prepared: PreparedWorld,
    timing: Timing,
    precision: Precision,
    state: State<E::Number>,
    index: usize,
    last: Option<Advanced>,
}

impl<E: Engine> Running<E> {
    fn new(engine: E, prepared: PreparedWorld, world: &World, precision: Precision) -> Self {
        let state = prepared.initial_state();
        Self { engine, prepared, timing: Timing::of(world), precision, state, index: 0, last: None }
    }

    fn rollout(&self) -> Rollout<'_, E> {
        Rollout::new(&self.engine, &self.prepared, self.timing)
    }
}

impl<E: Engine + Send> Drive for Running<E> {
    fn frame_index(&self) -> usize {
        self.index
    }

    fn frame(&self) -> Frame {
        self.rollout().frame(self.index, &self.state, self.last.as_ref())
    }

    fn advance_frame(&mut self) -> Result<Frame, SimulationError> {
        let rollout = Rollout::new(&self.engine, &self.prepared, self.timing);
        // In case of an error the state remains that of the last frame.
        let advanced = rollout.advance_frame(&mut self.state, self.index + 1, &mut |_, _| {})?;
        self.index += 1;
        self.last = Some(advanced);
        Ok(self.frame())
    }

    fn snapshot(&self) -> Snapshot {
        let particles = (0..self.state.len()).map(|p| self.state.to_numbers(p)).collect();
        Snapshot { frame: self.index, precision: self.precision, particles }
    }

    fn restore(&mut self, snapshot: &Snapshot) -> Result<(), SimulationError> {
        let mismatch = |reason: String| Err(SimulationError::StateMismatch { reason });
        let (have, want) = (snapshot.particles.len(), self.state.len());
        if have != want {
            return mismatch(format!("it has {have} particles, the world {want}"));
        }
        if snapshot.precision != self.precision {
            return mismatch(format!(
                "it was computed in {:?}, the options ask for {:?}",
                snapshot.precision, self.precision
            ));
        }
        if let Some(p) = snapshot.particles.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            return mismatch(format!("particle {p} holds a number that is not finite"));
        }
        for (p, numbers) in snapshot.particles.iter().enumerate() {
            self.state.set_numbers(p, numbers);
        }
        self.index = snapshot.frame;
        self.last = None;
        Ok(())
    }
}
