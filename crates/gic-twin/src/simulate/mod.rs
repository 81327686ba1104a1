//! `gic simulate`: a twin's future, frame by frame, resumable after each.

mod budget;
mod checkpoint;
mod shared_world;
mod trajectory;

use std::mem::discriminant;
use std::path::{Path, PathBuf};

use gic_files::FolderLock;
use gic_mpm::{Budget, Doubt, Forecast, Frame, Options, SimulationError, Simulator};

use crate::atomic;
use crate::error::{Result, TwinError};
use crate::events::{Event, Events};
use crate::interrupt::Interrupt;
use crate::matter::write_particles;
use crate::resource_usage::ResourceMeter;
use crate::twin::Twin;
pub use budget::{forecast_in_words, over_budget_hint, usual_budget};
pub use shared_world::{Companion, CompanionError, Scenario, SharedWorld};
pub use trajectory::{FrameSummary, Trajectory};

const STAGE: &str = "simulate";

/// What to simulate, and where to.
#[derive(Clone, Debug)]
pub struct SimulationRequest {
    /// The twin and what is changed about it.
    pub scenario: Scenario,
    /// Folder for the frames.
    pub out: PathBuf,
    /// Frames in all, the initial state included; `None` takes the twin's.
    pub frames: Option<usize>,
    /// Start at frame 0, whatever the folder holds.
    pub restart: bool,
    /// What it may take; what is forecast to take more is refused.
    pub budget: Budget,
}

/// What a simulation gave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SimulationOutcome {
    /// Frames on disk.
    pub frames: usize,
    /// Frames that were there already.
    pub reused: usize,
    /// Particles in each.
    pub particles: usize,
}

/// Simulates a twin and writes every frame; goes on where an earlier call with the same twin and settings stopped.
///
/// # Errors
/// Bad input, an unstable simulation, an unwritable folder or one that another process writes into;
/// [`TwinError::Interrupted`] after the frame during which the interrupt came.
pub fn simulate(request: &SimulationRequest, events: &Events, interrupt: &Interrupt) -> Result<SimulationOutcome> {
    let shared = SharedWorld::read(&request.scenario)?;
    let frames = request.frames.unwrap_or(shared.twin.frames);
    let forecast = Forecast::of(&shared.world, frames);
    let forecast = forecast.and_then(|forecast| forecast.check(&request.budget).map(|()| forecast));
    let forecast = forecast.map_err(|source| setup_error(&shared.twin, source))?;
    atomic::create_folder(&request.out)?;
    let _lock = FolderLock::take(&request.out)?;
    let mut run = SimulationRun::open(request, &shared, frames)?;
    let reused = run.trajectory.frames.len();
    let particles = run.trajectory.particles;
    if reused >= frames {
        let reason = format!("{} holds {reused} frames of this simulation already", request.out.display());
        events.send(&Event::StageSkipped { stage: STAGE.into(), reason });
        return Ok(SimulationOutcome { frames: reused, reused, particles });
    }
    let goes_on = if reused > 0 { format!(", goes on after frame {}", reused - 1) } else { String::new() };
    let in_words = forecast_in_words(&forecast);
    let reason = format!("{frames} frames of {particles} particles{goes_on}; {in_words}");
    events.send(&Event::StageStarted { stage: STAGE.into(), reason });
    let mut doubts = Doubts { events, told: Vec::new() };
    doubts.tell(shared.world.doubts());
    let meter = ResourceMeter::start();
    for index in reused..frames {
        if interrupt.requested() {
            return Err(TwinError::Interrupted {
                after: format!("{index} of {frames} frames"),
                resume: format!("run the same command again to go on with frame {index}"),
            });
        }
        let summary = run.frame(index, &mut doubts)?;
        let values = [("substeps", summary.substeps as f64), ("speed_m_s", summary.largest_speed_m_s)];
        events.step(STAGE, "", index as u64 + 1, Some(frames as u64), &values);
    }
    events.send(&meter.done(STAGE));
    Ok(SimulationOutcome { frames, reused, particles })
}

/// What has been said of a simulation's doubts: each kind once, by the first frame that shows it.
struct Doubts<'a> {
    events: &'a Events,
    told: Vec<Doubt>,
}

impl Doubts<'_> {
    fn tell(&mut self, doubts: Vec<Doubt>) {
        let known = |frame: &Option<usize>, kind: &Doubt| {
            frame.is_some() && self.told.iter().any(|told| discriminant(told) == discriminant(kind))
        };
        let new: Vec<Doubt> = doubts.into_iter().filter(|doubt| !known(&doubt.frame(), doubt)).collect();
        for doubt in new {
            self.events.warn(STAGE, doubt.to_string());
            self.told.push(doubt);
        }
    }
}

/// A simulation and its folder.
struct SimulationRun<'a> {
    out: &'a Path,
    simulator: Simulator,
    trajectory: Trajectory,
    identity: [u8; 32],
    frame_rate_hz: f64,
    /// Mass of each particle [kg].
    masses: Vec<f64>,
}

impl<'a> SimulationRun<'a> {
    /// Sets up the simulation and resumes from what the folder holds of it.
    fn open(request: &'a SimulationRequest, shared: &SharedWorld, frames: usize) -> Result<Self> {
        let options = Options { budget: request.budget, ..Options::default() };
        let simulator = Simulator::new(&shared.world, &options).map_err(|source| setup_error(&shared.twin, source))?;
        let trajectory = Trajectory::new(shared, &options, &request.out)?;
        let mut run = Self {
            out: &request.out,
            simulator,
            identity: trajectory.identity(),
            trajectory,
            frame_rate_hz: shared.world.frame_rate_hz,
            masses: shared.masses(),
        };
        if !request.restart {
            run.resume(frames)?;
        }
        Ok(run)
    }

    fn resume(&mut self, frames: usize) -> Result<()> {
        let Some(found) = Trajectory::read(self.out)? else { return Ok(()) };
        if let Some(difference) = found.difference(&self.trajectory) {
            return Err(TwinError::OtherRun {
                path: self.out.to_owned(),
                difference,
                hint: "choose another folder with -o, or add --restart to replace what is there".into(),
            });
        }
        let present = found.frames.iter().take_while(|frame| self.out.join(&frame.file).is_file()).count();
        if present >= frames {
            self.trajectory.frames = found.frames;
            return Ok(());
        }
        // Without a usable state the frames are computed again, to the same bytes.
        if let Some(snapshot) = checkpoint::read(self.out, &self.identity)?.filter(|s| s.frame < present) {
            self.simulator.restore(&snapshot).map_err(TwinError::simulation("taking up the saved state"))?;
            self.trajectory.frames = found.frames;
            self.trajectory.frames.truncate(snapshot.frame + 1);
        }
        Ok(())
    }

    /// Computes a frame and writes it: particles first, then its line in the trajectory, then the state that goes on
    /// from it.
    fn frame(&mut self, index: usize, doubts: &mut Doubts) -> Result<&FrameSummary> {
        let frame = if index == 0 {
            self.simulator.frame()
        } else {
            self.simulator.advance_frame().map_err(TwinError::simulation("simulation"))?
        };
        doubts.tell(frame.doubts());
        let file = format!("particles_{index:04}.ply");
        write_frame(&self.out.join(&file), &frame)?;
        let summary = FrameSummary::new(&frame, file, self.frame_rate_hz, &self.masses);
        self.trajectory.frames.push(summary);
        self.trajectory.write(self.out)?;
        checkpoint::write(self.out, &self.identity, &self.simulator.snapshot())?;
        Ok(&self.trajectory.frames[index])
    }
}

/// The error of a world that the simulator refuses, with the twin's name of the obstacle.
fn setup_error(twin: &Twin, source: SimulationError) -> TwinError {
    let hint = match &source {
        SimulationError::InsideCollider { collider, .. } => {
            let label = twin.colliders.get(*collider).map(|o| o.label(*collider)).unwrap_or_default();
            Some(format!("move the continuum (`centre_m` of a shape) or {label} apart"))
        }
        _ => over_budget_hint(&source),
    };
    TwinError::Simulation { stage: "setting up the simulation", hint, source: source.into() }
}

/// Writes a frame as binary PLY: position [m], velocity [m/s], von Mises stress [Pa], relative volume.
pub fn write_frame(path: &Path, frame: &Frame) -> Result<()> {
    let rows = (0..frame.positions.len()).map(|i| {
        let [x, y, z] = frame.positions[i].as_vec3().to_array();
        let [vx, vy, vz] = frame.velocities[i].as_vec3().to_array();
        [x, y, z, vx, vy, vz, frame.von_mises_pa[i], frame.jacobian[i]]
    });
    write_particles(path, ["x", "y", "z", "vx", "vy", "vz", "von_mises_pa", "J"], rows)
}
