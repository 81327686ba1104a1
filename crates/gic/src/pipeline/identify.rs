//! The stage `identify`: matter to material; writes the twin.

use std::collections::BTreeMap;
use std::ops::{ControlFlow, RangeInclusive};
use std::path::{Path, PathBuf};

use gic_files::FileError;
use gic_identify::{
    Checkpoint, Estimates, Event, IdentifyError, Input, MaterialChoice, Optimizer, Settings, Stage as IdentifyStage,
    Step, identify, sought,
};
use gic_mpm::{Body, MaterialKind, Options, Simulator, Stepping, World};
use gic_twin::atomic;
use gic_twin::matter::write_particles;
use gic_twin::twin::{MatterSource, Obstacle, Twin};
use glam::DVec3;

use super::identify_record::{IdentifyRecord, record, stage_name};
use super::predict::simulated_frame;
use super::stage::TWIN_MATTER;
use super::stamp::Recipe;
use super::surroundings::as_fitted;
use super::{Continuum, Run, Stage};
use crate::error::{Error, Result};

impl Run<'_> {
    pub(super) fn identify(&self, recipe: &Recipe) -> Result<()> {
        let model = self.model()?;
        let continuum = self.continuum()?;
        let surroundings = self.surroundings()?;
        self.note_resolution(&continuum);
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
            settings.starts = self.refined()?.minima;
            settings.stages = of_everything(settings.optimizer, IdentifyStage::Intervals);
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

/// The stages, up to `last`, that fit everything together from a material that is known. The paper's optimiser has no
/// such stage and fits the material alone.
pub(super) fn of_everything(optimizer: Optimizer, last: IdentifyStage) -> RangeInclusive<IdentifyStage> {
    let first = match optimizer {
        Optimizer::LevenbergMarquardt => IdentifyStage::Joint,
        Optimizer::Adam => IdentifyStage::Material,
    };
    first..=last
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
