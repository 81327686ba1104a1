//! The stage `identify`: matter to material; writes the twin.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::{ControlFlow, RangeInclusive};
use std::path::{Path, PathBuf};

use gic_files::FileError;
use gic_identify::{
    Checkpoint, Estimates, Event, IdentifyError, Input, MaterialChoice, Observation, Optimizer, Settings,
    Stage as IdentifyStage, Step, Target, View, WorldEstimate, identify, sought,
};
use gic_mpm::{Body, MaterialKind, Options, Simulator, Stepping, World};
use gic_scene::Camera;
use gic_twin::atomic;
use gic_twin::matter::write_particles;
use gic_twin::twin::{MatterSource, Obstacle, Twin};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::clock::Clock;
use super::predict::simulated_frame;
use super::stamp::Recipe;
use super::surroundings::{Surroundings, as_fitted};
use super::{Continuum, Run, Stage};
use crate::error::{Error, Result};

/// Name of the file, beside `twin.json`, of the twin's particles at time 0: the continuum as the fit moved and reshaped
/// it.
pub(crate) const TWIN_MATTER: &str = "twin.ply";

/// `identify.json`: the estimate and how it was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IdentifyRecord {
    /// The material's model.
    pub model: String,
    /// The parameters.
    pub estimates: Vec<EstimateRecord>,
    /// Initial velocity [m/s].
    pub velocity_m_s: [f64; 3],
    /// Half-width of its 95 % interval [m/s]; absent where it could not be measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub velocity_interval_95_m_s: Option<[f64; 3]>,
    /// Initial angular velocity [rad/s].
    pub angular_velocity_rad_s: [f64; 3],
    /// Side of a cell of the simulation grid [m].
    pub grid_spacing_m: f64,
    /// Its 95 % interval [m]; absent where it was not sought or could not be measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grid_spacing_interval_95_m: Option<[f64; 2]>,
    /// The ground; absent where it was known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ground: Option<GroundRecord>,
    /// Factor on gravity in the lengths that the cameras see, which are by this factor longer than the true ones.
    /// Absent where it is 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gravity_factor: Option<f64>,
    /// The factor that its 95 % interval reaches to either side; absent where it was in no doubt.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gravity_interval_95_factor: Option<f64>,
    /// Leading frames in which nothing is touched.
    pub free_frames: usize,
    /// Mean chamfer distance of the surfaces [m]; absent where none are fitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chamfer_m: Option<f64>,
    /// Mean absolute difference of re-rendered and observed masks.
    pub mask_l1: f64,
    /// Pixels that differ, as a share of the object's.
    pub mask_error: f64,
    /// Rollouts on the full grid.
    pub rollouts: usize,
    /// Rollouts on the coarse grid of the search.
    pub coarse_rollouts: usize,
    /// Seconds of each stage of identification.
    pub seconds: Vec<(String, f64)>,
    /// Factor on the Gaussians' standard deviations that fits the first masks.
    pub splat_factor: f64,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Every step.
    pub trace: Vec<StepRecord>,
}

/// One estimated parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimateRecord {
    /// Its key in `twin.json`.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// 95 % interval.
    pub interval_95: [f64; 2],
    /// Whether the video determines it.
    pub identifiable: bool,
    /// Whether it was given.
    pub fixed: bool,
}

/// Density [kg/m^3] of an object that fills a volume [m^3]: of its mass, where that is known.
fn density_of(settings: &gic_identify::Settings, volume_m3: f64) -> f64 {
    settings.mass_kg.map_or(settings.density_kg_m3, |mass_kg| mass_kg / volume_m3)
}

/// Where the ground was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroundRecord {
    /// How much higher it is below the body than it was taken to be [m].
    pub height_m: f64,
    /// Half-width of its 95 % interval [m]; absent where it could not be measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_interval_95_m: Option<f64>,
    /// Tilts about two axes in it [degrees].
    #[serde(default)]
    pub tilt_deg: [f64; 2],
    /// Half-widths of their 95 % intervals [degrees].
    #[serde(default)]
    pub tilt_interval_95_deg: [Option<f64>; 2],
    /// Factor on its friction.
    #[serde(default = "one")]
    pub friction_factor: f64,
    /// The factor that the 95 % interval of that reaches to either side.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction_interval_95_factor: Option<f64>,
}

fn one() -> f64 {
    1.0
}

impl From<WorldEstimate> for GroundRecord {
    fn from(found: WorldEstimate) -> Self {
        GroundRecord {
            height_m: found.height_m,
            height_interval_95_m: found.height_half_width_m,
            tilt_deg: found.tilt_rad.map(f64::to_degrees),
            tilt_interval_95_deg: found.tilt_half_width_rad.map(|half| half.map(f64::to_degrees)),
            friction_factor: found.log_friction.exp(),
            friction_interval_95_factor: found.log_friction_half_width.map(f64::exp),
        }
    }
}

/// One step of identification.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepRecord {
    /// Stage of identification.
    pub stage: String,
    /// Count within the stage.
    pub iteration: usize,
    /// The stage's own objective.
    pub objective: f64,
    /// Parameters, in the order of the estimates.
    pub values: Vec<f64>,
    /// Initial velocity [m/s].
    pub velocity_m_s: [f64; 3],
    /// Rollouts so far.
    pub rollouts: usize,
}

impl IdentifyRecord {
    /// Each component of the initial velocity: its letter, its value and its 95 % interval [m/s], if that is known.
    pub fn velocity_components(&self) -> [(&'static str, f64, Option<[f64; 2]>); 3] {
        [("x", 0), ("y", 1), ("z", 2)].map(|(letter, axis)| {
            let v = self.velocity_m_s[axis];
            (letter, v, self.velocity_interval_95_m_s.map(|half| [v - half[axis], v + half[axis]]))
        })
    }
}

impl Run<'_> {
    pub(super) fn identify(&self, recipe: &Recipe) -> Result<()> {
        let model = self.model()?;
        let continuum = self.continuum()?;
        let surroundings = self.surroundings()?;
        let input = self.identify_input(&continuum, &surroundings)?;
        let (begun, checkpoint) = (self.path("stamps/identify.begun.json"), self.path("identify.checkpoint.json"));
        // Results of finished stages that belong to other settings or other matter must not be taken up.
        let goes_on = recipe.goes_on(&begun)?;
        if !goes_on && checkpoint.exists() {
            std::fs::remove_file(&checkpoint).map_err(FileError::write(&checkpoint))?;
        }
        recipe.write(&begun)?;
        let mut settings = self.identify_settings(&input).among_laws(model);
        if self.refines() {
            settings.target = only_masks(settings.target);
            settings.start = Some(self.refined()?.parameters);
            settings.stages = after_refinement(settings.optimizer);
        }
        let found = self.fit(&input, model, &settings, (Stage::Identify, &checkpoint))?;
        for warning in &found.warnings {
            self.events.warn(Stage::Identify.name(), warning);
        }
        let record =
            IdentifyRecord { free_frames: self.frames_of(found.free_frames, &input), ..record(model.name(), &found) };
        atomic::write_json(&self.path("identify.json"), &record)?;
        self.write_matter(&continuum, &found)?;
        self.twin(&input, as_fitted(surroundings.obstacles, &found.colliders), &found, &record)?
            .write(&self.path("twin.json"))?;
        if checkpoint.exists() {
            std::fs::remove_file(&checkpoint).map_err(FileError::write(&checkpoint))?;
        }
        Ok(())
    }

    /// Fits one model. What finished parts of it found is kept in `checkpoint`, and taken up from there.
    pub(super) fn fit(
        &self,
        input: &Input,
        model: MaterialKind,
        settings: &Settings,
        (stage, checkpoint): (Stage, &Path),
    ) -> Result<Estimates> {
        let names: Vec<&str> = sought(model).iter().map(|p| p.name).collect();
        let resume: Checkpoint =
            if checkpoint.exists() { atomic::read_json(checkpoint)? } else { Checkpoint::default() };
        let mut unwritten = None;
        let found = identify(input, model, settings, resume, &mut |event| {
            match event {
                Event::Step(step) => self.report_step(stage, &names, step),
                Event::Reached(state) => unwritten = atomic::write_json(checkpoint, state).err(),
                Event::Working => (),
            }
            if self.interrupt.requested() || unwritten.is_some() {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        });
        match (found, unwritten) {
            (_, Some(error)) => Err(error.into()),
            (Err(IdentifyError::Interrupted), None) => {
                Err(self.interrupted("the last finished stage of identification"))
            }
            (found, None) => found.map_err(Error::stage("identification")),
        }
    }

    /// The material's model: as given, or as selected.
    pub(super) fn model(&self) -> Result<MaterialKind> {
        match self.material()? {
            MaterialChoice::Law(kind) => Ok(kind),
            MaterialChoice::Auto => self.selection()?.chosen_model(),
        }
    }

    /// What the settings say of the material.
    pub(super) fn material(&self) -> Result<MaterialChoice> {
        self.config.identify.material.ok_or_else(|| Error::Usage {
            problem: "the material's model is not known".into(),
            hint: Some(
                "add --material elastic, viscoelastic, plasticine, sand, newtonian, non-newtonian, or auto to have it found".into(),
            ),
        })
    }

    fn report_step(&self, stage: Stage, names: &[&str], step: &Step) {
        let mut values = vec![("objective", step.objective), ("rollouts", step.rollouts as f64)];
        values.extend(names.iter().copied().zip(step.values.iter().copied()));
        let axes = ["velocity_x_m_s", "velocity_y_m_s", "velocity_z_m_s"];
        values.extend(axes.into_iter().zip(step.velocity_m_s.to_array()));
        self.events.step(stage.name(), stage_name(step.stage), step.iteration as u64, None, &values);
    }

    pub(super) fn identify_input(&self, continuum: &Continuum, surroundings: &Surroundings) -> Result<Input> {
        let config = &self.config.identify;
        let Some(frame_rate_hz) = self.scene.frame_rate else {
            return Err(Error::Usage {
                problem: "the frames of the scene are not evenly spaced in time".into(),
                hint: Some("give the frame rate with --frame-rate-hz".into()),
            });
        };
        let particles = &continuum.particles;
        let (grid_spacing_m, substeps_per_frame) = config.resolution(continuum.grid_spacing_m);
        let scale = (continuum.appearance.scale * particles.spacing) as f32;
        let grid = format!("grid {:.2} mm, {substeps_per_frame} substeps a frame", 1e3 * grid_spacing_m);
        let known = std::iter::once(grid).chain(continuum.summary.remarks());
        self.events.note(Stage::Identify.name(), known.collect::<Vec<_>>().join("; "));
        let mut cameras = self.scene.cameras.clone();
        let clock = Clock::of(&self.scene.moments().times, frame_rate_hz);
        let mut observations = Vec::new();
        for frame in 0..self.scene.times.len() {
            observations.extend(self.observe(frame, continuum, &clock, &mut cameras)?);
        }
        let volume_m3 = particles.volume * particles.volume_factors.iter().map(|share| f64::from(*share)).sum::<f64>();
        Ok(Input {
            positions: particles.positions.clone(),
            particle_volume_m3: particles.volume,
            volume_factors: particles.volume_factors.iter().map(|factor| f64::from(*factor)).collect(),
            opacities: particles.densities.iter().map(|d| continuum.appearance.opacity * d).collect(),
            scales: vec![scale; particles.positions.len()],
            doubts: particles.doubts.clone(),
            surface_error_m: continuum.surface_error_m(),
            cameras,
            observations,
            frame_rate_hz: clock.rate_hz(),
            gravity_m_s2: surroundings.gravity_m_s2,
            colliders: surroundings.obstacles.iter().map(Obstacle::to_collider).collect(),
            world_doubt: surroundings.doubt,
            was_filmed: self.was_filmed(),
            density_kg_m3: density_of(config, volume_m3),
            grid_spacing_m,
            substeps_per_frame: clock.substeps(substeps_per_frame),
        })
    }

    /// What a frame shows: all at its time where its views can be taken as of one time, else each at its own.
    fn observe(
        &self,
        frame: usize,
        continuum: &Continuum,
        clock: &Clock,
        cameras: &mut Vec<Camera>,
    ) -> Result<Vec<Observation>> {
        let views = self.scene.views_at(frame).iter().zip(self.masks(frame)?);
        if !self.scene.is_seen_at_once(frame) {
            let mut moments: BTreeMap<usize, Observation> = BTreeMap::new();
            for (view, mask) in views {
                let observation = moments.entry(clock.tick(view.time_s)).or_default();
                observation.time_s = view.time_s;
                observation.views.push(View { camera: view.camera, mask: mask.coverage });
            }
            return Ok(moments.into_values().collect());
        }
        let mut place = |view: &gic_scene::View| match self.scene.camera_at_frame(view) {
            Cow::Borrowed(_) => view.camera,
            Cow::Owned(moved) => {
                cameras.push(moved);
                cameras.len() - 1
            }
        };
        // A scan has no surface in later frames, and where outlines made the body its surface is known only while they
        // do.
        let outlined = continuum.summary.outline_frames;
        let surface = continuum.surfaces.get(frame).filter(|_| outlined == 0 || frame < outlined);
        let surface = surface.cloned().unwrap_or_default();
        Ok(vec![Observation {
            time_s: self.scene.times[frame],
            surface: surface.points,
            surface_doubts: surface.doubts,
            views: views.map(|(view, mask)| View { camera: place(view), mask: mask.coverage }).collect(),
        }])
    }

    /// Observations of the first `frames` of the video.
    pub(super) fn observations_of(&self, frames: usize, input: &Input) -> usize {
        let end = self.scene.times.get(frames).copied().unwrap_or(f64::INFINITY);
        input.observations.partition_point(|observation| observation.time_s < end)
    }

    /// Frames of the video that the first `observations` show.
    fn frames_of(&self, observations: usize, input: &Input) -> usize {
        (0..=self.scene.times.len()).take_while(|frames| self.observations_of(*frames, input) <= observations).count()
            - 1
    }

    pub(super) fn identify_settings(&self, input: &Input) -> Settings {
        let config = &self.config.identify;
        let frames = config.frames.map(|frames| self.observations_of(frames, input));
        // A scan shows the surface at rest only.
        let target = if self.scan().is_some() { Target::Masks } else { config.target };
        Settings { target, frames, ..config.clone() }
    }

    /// The particles of the continuum where and how large the fit found them, with their attributes.
    fn write_matter(&self, continuum: &Continuum, found: &Estimates) -> Result<()> {
        let particles = &continuum.particles;
        let rows = (0..found.positions.len()).map(|i| {
            let [x, y, z] = found.positions[i].as_vec3().to_array();
            let (density, surface) = (particles.densities[i], f32::from(particles.surface[i]));
            [x, y, z, density, surface, found.volume_factors[i] as f32]
        });
        Ok(write_particles(&self.path(TWIN_MATTER), ["x", "y", "z", "density", "surface", "volume_factor"], rows)?)
    }

    fn twin(
        &self,
        input: &Input,
        obstacles: Vec<Obstacle>,
        found: &Estimates,
        record: &IdentifyRecord,
    ) -> Result<Twin> {
        let mut intervals_95: BTreeMap<String, [f64; 2]> =
            record.estimates.iter().map(|e| (e.name.clone(), e.interval_95)).collect();
        for (letter, _, interval) in record.velocity_components() {
            intervals_95.extend(interval.map(|interval| (format!("initial_velocity_{letter}_m_s"), interval)));
        }
        let mut seconds: BTreeMap<String, f64> =
            self.stage_seconds()?.into_iter().map(|(stage, s)| (stage.name().to_owned(), s)).collect();
        for (stage, s) in &record.seconds {
            *seconds.entry(stage.clone()).or_default() += s;
        }
        let total = seconds.values().sum();
        let frame_rate_hz = self.scene.frame_rate.unwrap_or(input.frame_rate_hz);
        let ticks = input.frame_rate_hz / frame_rate_hz;
        seconds.insert("total".into(), total);
        Ok(Twin {
            intervals_95,
            identifiable: record.estimates.iter().map(|e| (e.name.clone(), e.identifiable)).collect(),
            initial_velocity_m_s: record.velocity_m_s,
            initial_angular_velocity_rad_s: record.angular_velocity_rad_s,
            density_kg_m3: input.density_kg_m3,
            gravity_m_s2: found.gravity_m_s2.into(),
            colliders: obstacles,
            grid_spacing_m: Some(found.grid_spacing_m),
            particle_spacing_m: Some(found.particle_volume_m3.cbrt()),
            frame_rate_hz,
            frames: self.frames_to_simulate(),
            substeps_per_frame: Some((found.substeps_per_frame as f64 * ticks).round() as usize),
            loss: Some(found.loss.chamfer_m.unwrap_or_default() + found.loss.mask_l1),
            seed: self.config.seed,
            gic_version: Some(gic_twin::VERSION.into()),
            seconds,
            ..Twin::new(found.material, MatterSource::File(PathBuf::from(TWIN_MATTER)))
        })
    }

    /// Frames at the scene's rate up to its last time, the first included.
    pub(super) fn frames_to_simulate(&self) -> usize {
        self.video.times.len().checked_sub(1).map_or(0, |last| simulated_frame(&self.video, last)) + 1
    }

    /// The result of identification.
    ///
    /// # Errors
    /// A missing or damaged file.
    pub fn identified(&self) -> Result<IdentifyRecord> {
        Ok(atomic::read_json(&self.path("identify.json"))?)
    }
}

/// What is left to fit once refinement has fitted the material: everything together. The paper's optimiser has no such
/// stage and fits the material to the refined body.
fn after_refinement(optimizer: Optimizer) -> RangeInclusive<IdentifyStage> {
    let first = match optimizer {
        Optimizer::LevenbergMarquardt => IdentifyStage::Joint,
        Optimizer::Adam => IdentifyStage::Material,
    };
    first..=IdentifyStage::Joint
}

/// What a refined body is compared with: surfaces of frames are those of the bodies before.
pub(super) fn only_masks(target: Target) -> Target {
    if target == Target::Both { Target::Masks } else { target }
}

/// Particles in every frame up to `last` [m].
pub(super) fn motion_of(
    input: &Input,
    found: &Estimates,
    last: usize,
) -> std::result::Result<Vec<Vec<DVec3>>, gic_mpm::SimulationError> {
    let world = World {
        bodies: vec![Body {
            material: found.material,
            density_kg_m3: input.density_kg_m3,
            particle_volume_m3: found.particle_volume_m3,
            volume_factors: found.volume_factors.clone(),
            positions: found.positions.clone(),
            velocity_m_s: found.velocity_m_s,
            angular_velocity_rad_s: found.angular_velocity_rad_s,
            own_velocities_m_s: Vec::new(),
        }],
        colliders: found.colliders.clone(),
        gravity_m_s2: found.gravity_m_s2,
        grid_spacing_m: found.grid_spacing_m,
        frame_rate_hz: input.frame_rate_hz,
        stepping: Stepping::at_least(found.substeps_per_frame),
    };
    let mut simulator = Simulator::new(&world, &Options::default())?;
    let mut frames = vec![simulator.frame().positions];
    for _ in 0..last {
        frames.push(simulator.advance_frame()?.positions);
    }
    Ok(frames)
}

fn record(model: &str, found: &Estimates) -> IdentifyRecord {
    let step = |step: &Step| StepRecord {
        stage: stage_name(step.stage).into(),
        iteration: step.iteration,
        objective: step.objective,
        values: step.values.clone(),
        velocity_m_s: step.velocity_m_s.into(),
        rollouts: step.rollouts,
    };
    let estimate = |e: &gic_identify::Estimate| EstimateRecord {
        name: e.parameter.name.into(),
        value: e.value,
        interval_95: e.interval_95.into(),
        identifiable: e.identifiable,
        fixed: e.fixed,
    };
    IdentifyRecord {
        model: model.into(),
        estimates: found.estimates.iter().map(estimate).collect(),
        velocity_m_s: found.velocity_m_s.into(),
        velocity_interval_95_m_s: found.velocity_interval_95.map(Into::into),
        angular_velocity_rad_s: found.angular_velocity_rad_s.into(),
        ground: found.world.map(GroundRecord::from),
        gravity_factor: found.world.map(|world| world.log_gravity.exp()).filter(|factor| *factor != 1.0),
        gravity_interval_95_factor: found.world.and_then(|world| world.log_gravity_half_width).map(f64::exp),
        grid_spacing_m: found.grid_spacing_m,
        grid_spacing_interval_95_m: found.grid_spacing_interval_95_m.map(Into::into),
        free_frames: found.free_frames,
        chamfer_m: found.loss.chamfer_m,
        mask_l1: found.loss.mask_l1,
        mask_error: found.loss.mask_error,
        rollouts: found.rollouts,
        coarse_rollouts: found.coarse_rollouts,
        seconds: found.seconds.iter().map(|(stage, s)| (stage_name(*stage).to_owned(), *s)).collect(),
        splat_factor: found.splat_factor,
        warnings: found.warnings.clone(),
        trace: found.trace.iter().map(step).collect(),
    }
}

fn stage_name(stage: IdentifyStage) -> &'static str {
    match stage {
        IdentifyStage::Velocity => "velocity",
        IdentifyStage::Search => "search",
        IdentifyStage::Material => "material",
        IdentifyStage::Joint => "joint",
        IdentifyStage::Intervals => "intervals",
    }
}
