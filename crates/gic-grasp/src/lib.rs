//! `gic grasp`: two rigid pads, as of a parallel gripper, close on a twin, hold it and lift it.
//!
//! The matter floats weightless while the pads close slowly; at each width it comes to rest and the forces are
//! averaged. Then weight sets in, the gripper is raised from a table, and what slides or stays behind is measured.

mod antipodal;
mod contact;
mod error;
mod film;
mod gripper_frame;
mod pad_simulation;
mod report;

use std::ops::ControlFlow;
use std::path::PathBuf;

use gic_mpm::{Budget, Forecast, Material, Stepping, World};
use gic_twin::Interrupt;
use gic_twin::ResourceMeter;
use gic_twin::atomic;
use gic_twin::events::{Event, Events};
use gic_twin::simulate::{forecast_in_words, over_budget_hint};
use gic_twin::twin::{Setting, Twin};
use glam::DVec3;

pub use error::{GraspError, Result};
pub use gripper_frame::{AxisChoice, AxisError};
pub use report::{GraspReport, Lift, Squeeze};

use contact::{ContactFaces, contact_patches, mean_position};
use film::GraspFilm;
use gripper_frame::GripperFrame;
use pad_simulation::{GraspPhase, GraspState, PadPose, PadSimulation, Pads};

const STAGE: &str = "grasp";

/// Speed of each pad while closing, over the speed of waves in a bar: slow enough that inertia adds little force.
const CLOSING_WAVE_SPEEDS: f64 = 0.005;
/// Length of a frame while closing and holding, over the time that such a wave takes across the object.
const FRAME_WAVE_TIMES: f64 = 0.25;
/// What is left of the velocities after each such frame.
const VELOCITY_KEPT: f64 = 0.6;
/// Frames over which forces are averaged.
const AVERAGING_FRAMES: usize = 24;
/// Forces are steady when the means of two windows differ by less than this share.
const STEADY_RELATIVE_CHANGE: f64 = 2e-3;
/// Most windows to wait for that.
const MAX_AVERAGING_WINDOWS: usize = 40;
/// Fewest grid cells along a side of the pad.
const MIN_PAD_CELLS: f64 = 2.0;
/// Grid cells along a side of the pad below which forces are coarse.
const GOOD_PAD_CELLS: f64 = 4.0;
/// The finest grid that is worth its time, relative to the twin's.
pub const MAX_REFINEMENT: usize = 8;
/// Length of a frame while lifting [s].
const LIFT_FRAME_S: f64 = 0.01;
/// Frames in which weight sets in, in which the gripper rises, and in which it stands again.
const LIFT_FRAMES: [usize; 3] = [20, 40, 20];
/// Matter is taken to yield from this share of the yield stress on: f32 rounding.
const YIELD_SHARE: f64 = 0.999;

/// The gripper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gripper {
    /// Sides of a pad [m]: across and along the finger; the latter points up where it can.
    pub pad_m: [f64; 2],
    /// Coulomb coefficient of the pads.
    pub friction: f64,
    /// How far the object is lifted [m].
    pub lift_m: f64,
}

impl Default for Gripper {
    /// The fingertips of a Robotiq 2F-85, of rubber.
    fn default() -> Self {
        Self { pad_m: [0.022, 0.0375], friction: 0.5, lift_m: 0.05 }
    }
}

/// What to grasp, and how.
#[derive(Clone, Debug)]
pub struct GraspRequest {
    /// The twin's file.
    pub twin: PathBuf,
    /// Changes to the twin.
    pub settings: Vec<Setting>,
    /// Widths to close to [m], in any order.
    pub widths_m: Vec<f64>,
    /// Which way to close.
    pub axis: AxisChoice,
    /// The gripper.
    pub gripper: Gripper,
    /// Each particle is cut into this number cubed, on a grid as many times finer; `None` takes the least that lets the
    /// grid feel the pads.
    pub refine: Option<usize>,
    /// Folder for grasp.json and the pictures.
    pub out: PathBuf,
    /// Whether to make pictures.
    pub pictures: bool,
    /// Width and height of the pictures [pixels].
    pub size: [usize; 2],
    /// What it may take; what is forecast to take more is refused.
    pub budget: Budget,
    /// The film: .gif or .mp4.
    pub film: PathBuf,
}

/// Grasps a twin at every width and writes what was found into the folder.
///
/// # Errors
/// Bad input, matter that no gripper holds, an unstable simulation, an unwritable folder.
pub fn grasp(request: &GraspRequest, events: &Events, interrupt: &Interrupt) -> Result<GraspReport> {
    let widths = descending(&request.widths_m)?;
    let twin = Twin { colliders: Vec::new(), ..Twin::read(&request.twin, &request.settings)? };
    check_grippable(&twin.material)?;
    // A film that cannot be made is an error before the simulation.
    let film = request.pictures.then(|| film::FilmTarget::of(&request.film)).transpose()?;
    let (twin, world) = twin.to_world()?;
    atomic::create_folder(&request.out)?;
    let meter = ResourceMeter::start();
    let mut grasp = Grasp::new(request, &twin, &world, widths[0], events, interrupt)?;
    let forecast = grasp.forecast(&widths)?;
    let reason = format!("{} widths; {} or more", widths.len(), forecast_in_words(&forecast));
    events.send(&Event::StageStarted { stage: STAGE.into(), reason });
    let report = grasp.run(&widths)?;
    atomic::write_json(&request.out.join("grasp.json"), &report)?;
    if let Some(film) = film {
        let (gripper_frame, simulation) = (&grasp.gripper_frame, &grasp.simulation);
        let text = grasp.film.draw(
            gripper_frame,
            &simulation.pads,
            simulation.up,
            &report,
            (&request.out, request.size),
            &film,
        )?;
        events.note(STAGE, text);
    }
    events.send(&meter.done(STAGE));
    Ok(report)
}

/// The widths from the largest to the smallest, each once.
fn descending(widths: &[f64]) -> Result<Vec<f64>> {
    if let Some(bad) = widths.iter().find(|w| !(**w > 0.0 && w.is_finite())) {
        return Err(GraspError::Usage {
            problem: format!("a gripper cannot close to {bad} m"),
            hint: Some("give widths in metres above 0: --width-m 0.055,0.045,0.035".into()),
        });
    }
    let mut widths = widths.to_vec();
    widths.sort_by(|a, b| b.total_cmp(a));
    widths.dedup();
    if widths.is_empty() {
        return Err(GraspError::Usage {
            problem: "there is no width to close to".into(),
            hint: Some("give widths in metres: --width-m 0.055,0.045,0.035".into()),
        });
    }
    Ok(widths)
}

fn check_grippable(material: &Material) -> Result<()> {
    let why = match material {
        Material::Newtonian { .. } => "a fluid, which flows out between the pads",
        Material::Sand { .. } => "loose grains without cohesion, which fall from between the pads",
        _ => return Ok(()),
    };
    Err(GraspError::Usage {
        problem: format!("the twin's material is {}: {why}", material.model()),
        hint: Some("elastic, viscoelastic, plasticine and non-newtonian twins can be gripped".into()),
    })
}

/// One grasp in progress.
struct Grasp<'a> {
    request: &'a GraspRequest,
    events: &'a Events,
    gripper_frame: GripperFrame,
    simulation: PadSimulation<'a>,
    /// Distance of neighbouring particles [m].
    spacing: f64,
    /// Width of the object at rest [m].
    object_width: f64,
    /// Length of a frame while closing and holding [s].
    frame_s: f64,
    /// Speed of a pad while closing [m/s].
    speed: f64,
    /// Gravity in the gripper's frame [m/s^2].
    gravity: DVec3,
    /// Which particles have been at the yield stress.
    yielded: Vec<bool>,
    film: GraspFilm,
}

impl<'a> Grasp<'a> {
    fn new(
        request: &'a GraspRequest,
        twin: &Twin,
        world: &World,
        widest: f64,
        events: &'a Events,
        interrupt: &'a Interrupt,
    ) -> Result<Self> {
        let body = &world.bodies[0];
        let coarse = twin.particle_spacing_m.unwrap_or(body.particle_volume_m3.cbrt());
        let refine = request.refine.unwrap_or_else(|| least_refinement(&request.gripper, world.grid_spacing_m));
        let (grid, spacing) = (world.grid_spacing_m / refine as f64, coarse / refine as f64);
        check_pads(&request.gripper, grid, events)?;
        let up = (-world.gravity_m_s2).normalize_or(DVec3::Y);
        let mut gripper_frame =
            GripperFrame::choose(request.axis, &body.positions, coarse, up, &request.gripper, widest)?;
        let [short, long] = request.gripper.pad_m;
        let pads = Pads { size_m: [long, short], thickness_m: 6.0 * grid, friction: request.gripper.friction };
        let mut simulation = PadSimulation {
            world: World {
                bodies: vec![gripper_frame.body(body, coarse, refine)],
                colliders: Vec::new(),
                gravity_m_s2: DVec3::ZERO,
                grid_spacing_m: grid,
                frame_rate_hz: 1.0,
                stepping: Stepping::STABLE,
            },
            pads,
            up: gripper_frame.direction_to_gripper(up),
            interrupt,
        };
        let faces = ContactFaces::of(&simulation.start(0.0)?, &pads, simulation.up, spacing)
            .ok_or_else(|| nothing_there(request.axis))?;
        let object_width = faces.width();
        if widest >= object_width {
            return Err(GraspError::Usage {
                problem: format!(
                    "the object is {object_width:.4} m wide between the pads, so closing to {widest} m does not touch \
                     it"
                ),
                hint: Some("ask for widths below that, or choose another --axis".into()),
            });
        }
        let middle = 0.5 * (faces.x_m[0] + faces.x_m[1]);
        simulation.world.bodies[0].positions.iter_mut().for_each(|p| p.x -= middle);
        gripper_frame.origin += gripper_frame.world_from_gripper.x_axis * middle;
        let modulus = body.material.elastic_moduli().map_or(0.0, |[young, _]| young);
        let wave_speed = (modulus / body.density_kg_m3).sqrt();
        let film = GraspFilm::new(&simulation.world.bodies[0], spacing);
        Ok(Self {
            request,
            events,
            gripper_frame,
            spacing,
            object_width,
            frame_s: FRAME_WAVE_TIMES * object_width / wave_speed,
            speed: CLOSING_WAVE_SPEEDS * wave_speed,
            gravity: gripper_frame.direction_to_gripper(world.gravity_m_s2),
            yielded: vec![false; simulation.world.bodies[0].positions.len()],
            film,
            simulation,
        })
    }

    /// What closing, holding and lifting take at least: forces may need more windows until they are steady.
    ///
    /// # Errors
    /// More than the budget.
    fn forecast(&self, widths: &[f64]) -> Result<Forecast> {
        let narrowest = widths.iter().copied().fold(f64::INFINITY, f64::min);
        let closing = 0.5 * (self.object_width - narrowest) / self.speed / self.frame_s;
        let lifting = LIFT_FRAMES.iter().sum::<usize>() as f64 * LIFT_FRAME_S / self.frame_s;
        let frames = closing + widths.len() as f64 * (2.0 * AVERAGING_FRAMES as f64 + lifting);
        let world = World { frame_rate_hz: 1.0 / self.frame_s, ..self.simulation.world.clone() };
        let forecast = Forecast::of(&world, frames.ceil() as usize);
        let checked = forecast.and_then(|forecast| forecast.check(&self.request.budget).map(|()| forecast));
        checked.map_err(|source| {
            let hint = over_budget_hint(&source);
            GraspError::Failed { hint, source: source.into() }
        })
    }

    fn run(&mut self, widths: &[f64]) -> Result<GraspReport> {
        let body = &self.simulation.world.bodies[0];
        let (mass, material, particles) = (body.masses_kg().iter().sum(), body.material, self.yielded.len());
        let mut state = self.simulation.start(0.5 * self.object_width + 2.5 * self.simulation.world.grid_spacing_m)?;
        let mut squeezes = Vec::new();
        for (done, &width) in widths.iter().enumerate() {
            self.close(&mut state, width, widths[widths.len() - 1])?;
            let mut squeeze = self.measure(&mut state, width)?;
            squeeze.lift = self.lift(state.clone(), mass)?;
            let values = [("width_m", width), ("force_n", squeeze.force_n)];
            self.events.step(STAGE, "", done as u64 + 1, Some(widths.len() as u64), &values);
            squeezes.push(squeeze);
        }
        Ok(GraspReport {
            schema: "gic.grasp/1".into(),
            gic_version: gic_twin::VERSION.into(),
            axis: self.request.axis.name().into(),
            axis_direction: self.gripper_frame.world_from_gripper.x_axis.to_array(),
            centre_m: self.gripper_frame.origin.to_array(),
            object_width_m: self.object_width,
            pad_m: self.request.gripper.pad_m,
            friction: self.request.gripper.friction,
            lift_m: self.request.gripper.lift_m,
            mass_kg: mass,
            material: material.model().into(),
            yield_von_mises_pa: material.yield_von_mises_pa(),
            grid_spacing_m: self.simulation.world.grid_spacing_m,
            particle_spacing_m: self.spacing,
            particles,
            widths: squeezes,
        })
    }

    fn faces(&self, state: &GraspState) -> Result<ContactFaces> {
        ContactFaces::of(state, &self.simulation.pads, self.simulation.up, self.spacing).ok_or_else(|| {
            GraspError::Usage {
                problem: "the object was pushed out from between the pads".into(),
                hint: Some("choose another --axis, larger pads, or a width nearer to the object's own".into()),
            }
        })
    }

    /// A phase without weight along a path.
    fn weightless(&self, frames: usize, path: Vec<(f64, PadPose)>) -> GraspPhase {
        GraspPhase { frame_s: self.frame_s, frames, gravity_m_s2: DVec3::ZERO, path, keep: VELOCITY_KEPT, table: None }
    }

    /// Closes the pads to `width`; `narrowest` [m] is the last width to come.
    fn close(&mut self, state: &mut GraspState, width: f64, narrowest: f64) -> Result<()> {
        let start = state.pose;
        let end = PadPose { half_gap_m: 0.5 * width, ..start };
        let seconds = (start.half_gap_m - end.half_gap_m) / self.speed;
        let frames = (seconds / self.frame_s).ceil() as usize;
        let phase = self.weightless(frames, vec![(0.0, start), (seconds, end)]);
        // About forty pictures from the first touch to the narrowest width.
        let every = (self.object_width - narrowest) / 80.0 / self.speed / self.frame_s;
        let Self { simulation, yielded, film, .. } = self;
        let mut passed = f64::INFINITY;
        simulation.run(state, &phase, |moment| {
            mark_yielded(yielded, moment, &simulation.world);
            passed += 1.0;
            if passed >= every {
                passed = 0.0;
                film.record(moment);
            }
            ControlFlow::Continue(())
        })?;
        state.pose = end;
        Ok(())
    }

    /// Holds until the forces are steady, and measures.
    fn measure(&mut self, state: &mut GraspState, width: f64) -> Result<Squeeze> {
        let phase = self.weightless(MAX_AVERAGING_WINDOWS * AVERAGING_FRAMES, vec![(0.0, state.pose)]);
        let mut forces: Vec<[f64; 2]> = Vec::new();
        let mut stresses = Vec::new();
        let Self { simulation, yielded, film, .. } = self;
        simulation.run(state, &phase, |moment| {
            mark_yielded(yielded, moment, &simulation.world);
            forces.push([-moment.forces[0].force_n.x, moment.forces[1].force_n.x]);
            if !(forces.len().is_multiple_of(AVERAGING_FRAMES) && is_steady(&forces)) {
                return ControlFlow::Continue(());
            }
            film.hold(moment);
            stresses = moment.frame.von_mises_pa.clone();
            ControlFlow::Break(())
        })?;
        if stresses.is_empty() {
            return Err(GraspError::Failed {
                hint: Some("ask for a width that is nearer to the object's own, or larger pads".into()),
                source: format!("the forces on the pads do not become steady at a width of {width} m").into(),
            });
        }
        let window = &forces[forces.len() - AVERAGING_FRAMES..];
        let mean = |side: usize| window.iter().map(|f| f[side]).sum::<f64>() / AVERAGING_FRAMES as f64;
        let forces_n = [mean(0), mean(1)];
        let force_n = 0.5 * (forces_n[0] + forces_n[1]);
        let of_both = |f: &[f64; 2]| 0.5 * (f[0] + f[1]) - force_n;
        let faces = self.faces(state)?;
        let contact_patches = contact_patches(state, &self.simulation.pads, self.simulation.up, self.spacing, &faces);
        let yields = self.simulation.world.bodies[0].material.yield_von_mises_pa().is_some();
        Ok(Squeeze {
            width_m: width,
            measured_width_m: faces.width(),
            standoff_m: state.pose.half_gap_m - 0.5 * faces.width(),
            forces_n,
            force_n,
            imbalance: (forces_n[0] - forces_n[1]) / force_n.abs().max(f64::MIN_POSITIVE),
            force_spread_n: (window.iter().map(|f| of_both(f).powi(2)).sum::<f64>() / AVERAGING_FRAMES as f64).sqrt(),
            contact_areas_m2: [contact_patches[0].area_m2, contact_patches[1].area_m2],
            peak_von_mises_pa: percentile(&stresses, 1.0),
            p99_von_mises_pa: percentile(&stresses, 0.99),
            yielded_share: yields
                .then(|| self.yielded.iter().filter(|y| **y).count() as f64 / self.yielded.len() as f64),
            lift: None,
        })
    }

    /// Lets weight set in, raises the gripper and waits; `None` without gravity.
    fn lift(&mut self, mut state: GraspState, mass: f64) -> Result<Option<Lift>> {
        if self.gravity == DVec3::ZERO {
            return Ok(None);
        }
        let faces = self.faces(&state)?;
        let held = contact_patches(&state, &self.simulation.pads, self.simulation.up, self.spacing, &faces);
        let held: Vec<usize> = held.into_iter().flat_map(|side| side.particles).collect();
        let everything = 0..state.len();
        let (held_before, before) =
            (mean_position(&state, held.iter().copied()), mean_position(&state, everything.clone()));
        let table = self.table(&state);
        let lift = self.request.gripper.lift_m;
        let mut peak: f64 = 0.0;
        let mut carried = Vec::new();
        let up = self.simulation.up;
        for (weight, phase) in self.lift_phases(state.pose, table) {
            let Self { simulation, film, .. } = self;
            let mut index = 0;
            simulation.run(&mut state, &phase, |moment| {
                index += 1;
                if weight == 1.0 && index % 3 == 0 {
                    film.record(moment);
                }
                peak = moment.frame.von_mises_pa.iter().fold(peak, |most, &s| most.max(f64::from(s)));
                carried.push(-(moment.forces[0].force_n + moment.forces[1].force_n).dot(up));
                ControlFlow::Continue(())
            })?;
        }
        // Sliding along the pads; across them the matter only deforms.
        let slide = mean_position(&state, held.iter().copied()) - held_before - up * lift;
        let risen = (mean_position(&state, everything) - before).dot(up);
        let last = &carried[carried.len() - LIFT_FRAMES[2]..];
        Ok(Some(Lift {
            slip_m: slide.reject_from_normalized(DVec3::X).length(),
            dropped: risen < 0.5 * lift
                || state.mean_velocity().dot(up) < -lift / (LIFT_FRAMES[1] as f64 * LIFT_FRAME_S),
            carried_share: last.iter().sum::<f64>() / last.len() as f64 / (mass * self.gravity.length()),
            peak_von_mises_pa: peak,
        }))
    }

    /// The phases of lifting, each with the share of the weight that acts: on the table in steps, up, and standing.
    fn lift_phases(&self, pose: PadPose, table: DVec3) -> Vec<(f64, GraspPhase)> {
        let lift = self.request.gripper.lift_m;
        let [ramp, rise, rest] = LIFT_FRAMES;
        let phase = |weight: f64, frames: usize, path: Vec<(f64, PadPose)>, keep: f64| {
            let gravity_m_s2 = self.gravity * weight;
            (weight, GraspPhase { frame_s: LIFT_FRAME_S, frames, gravity_m_s2, path, keep, table: Some(table) })
        };
        let mut phases: Vec<_> =
            (1..ramp).map(|i| phase(i as f64 / ramp as f64, 1, vec![(0.0, pose)], VELOCITY_KEPT)).collect();
        // Starts and ends without a jerk of the speed.
        let smooth = |i: usize| {
            let t = i as f64 / rise as f64;
            (i as f64 * LIFT_FRAME_S, PadPose { lift_m: lift * t * t * (3.0 - 2.0 * t), ..pose })
        };
        phases.push(phase(1.0, rise + rest, (0..=rise).map(smooth).collect(), 1.0));
        phases
    }

    /// A point of the table that just carries the matter, at rest and as it is now [m].
    fn table(&self, state: &GraspState) -> DVec3 {
        let up = self.simulation.up;
        let rest = self.simulation.world.bodies[0].positions.iter().map(|p| p.dot(up));
        let now = (0..state.len()).map(|p| state.position(p).dot(up));
        up * (rest.chain(now).fold(f64::INFINITY, f64::min) - 0.5 * self.spacing)
    }
}

fn mark_yielded(yielded: &mut [bool], moment: &pad_simulation::GraspFrame<'_>, world: &World) {
    let Some(limit) = world.bodies[0].material.yield_von_mises_pa() else { return };
    let frame = moment.frame;
    for ((yielded, &stress), &j) in yielded.iter_mut().zip(&frame.von_mises_pa).zip(&frame.jacobian) {
        // Cauchy times J is Kirchhoff.
        *yielded |= f64::from(stress) * f64::from(j) >= YIELD_SHARE * limit;
    }
}

/// Whether the forces of the last window are those of the one before.
fn is_steady(forces: &[[f64; 2]]) -> bool {
    if forces.len() < 2 * AVERAGING_FRAMES {
        return false;
    }
    let mean = |end: usize, side: usize| {
        forces[end - AVERAGING_FRAMES..end].iter().map(|f| f[side]).sum::<f64>() / AVERAGING_FRAMES as f64
    };
    (0..2).all(|side| {
        let (now, before) = (mean(forces.len(), side), mean(forces.len() - AVERAGING_FRAMES, side));
        (now - before).abs() <= STEADY_RELATIVE_CHANGE * now.abs()
    })
}

/// Grid cells across a pad.
fn cells_across(gripper: &Gripper, grid: f64) -> f64 {
    gripper.pad_m[0].min(gripper.pad_m[1]) / grid
}

/// How many times finer than `grid` a grid must be to feel the pads, within reason.
fn least_refinement(gripper: &Gripper, grid: f64) -> usize {
    ((MIN_PAD_CELLS / cells_across(gripper, grid)).ceil() as usize).clamp(1, MAX_REFINEMENT)
}

fn check_pads(gripper: &Gripper, grid: f64, events: &Events) -> Result<()> {
    let cells = cells_across(gripper, grid);
    if cells < MIN_PAD_CELLS {
        return Err(GraspError::Usage {
            problem: format!(
                "a pad of {} x {} m is {cells:.1} grid cells of {grid} m across, too few to press with",
                gripper.pad_m[0], gripper.pad_m[1]
            ),
            hint: Some(format!(
                "simulate a finer twin with --refine {} or give a larger --pad",
                (GOOD_PAD_CELLS / cells).ceil()
            )),
        });
    }
    if cells < GOOD_PAD_CELLS {
        let text = format!("a pad is only {cells:.1} grid cells across, so forces are coarse: give a higher --refine");
        events.warn(STAGE, text);
    }
    Ok(())
}

fn nothing_there(axis: AxisChoice) -> GraspError {
    GraspError::Usage {
        problem: format!("there is no matter between the pads along the axis {}", axis.name()),
        hint: Some("choose another --axis, or larger pads with --pad".into()),
    }
}

/// The value that a share of the values does not exceed; 0 of none.
fn percentile(values: &[f32], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f32::total_cmp);
    sorted.get((share * sorted.len().saturating_sub(1) as f64) as usize).copied().map_or(0.0, f64::from)
}
