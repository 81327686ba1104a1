//! What is exported: a run, a simulated folder, or a twin's file.

use std::path::{Path, PathBuf};

use gic_files::FileError;
use gic_geometry::Neighbours;
use gic_twin::interchange::{ExportBody, Motion, UpAxis};
use gic_twin::matter::read_particles;
use gic_twin::simulate::Trajectory;
use gic_twin::twin::{MatterSource, Twin};
use gic_view::skinned_gaussians::{SkinnedGaussians, colors};
use glam::{DQuat, DVec3};

use crate::config::{Config, Layer};
use crate::error::{Error, Result};
use crate::outputs::Inputs;
use crate::pipeline::{Stage, check_results};

/// Gaussians that make the colour of a point.
const COLORING_GAUSSIANS: usize = 6;

/// A twin's body, its motion and its colours.
pub struct ExportSource {
    /// The body and its motion.
    pub(super) body: ExportBody,
    /// Its colours, where they were made.
    pub(super) appearance: Option<SkinnedGaussians>,
    /// The folder for outputs without a name.
    folder: PathBuf,
    inputs: Inputs,
}

impl ExportSource {
    /// Opens a run folder, the folder of a simulation, or a twin's file.
    ///
    /// # Errors
    /// A run that is damaged or not identified yet; a simulation of several bodies, or of matter that has changed.
    pub fn open(path: &Path) -> Result<Self> {
        let simulation = path.join("prediction");
        if !path.is_dir() {
            let folder = path.parent().unwrap_or(Path::new("")).to_owned();
            return Self::new(Twin::read(path, &[])?, None, folder, Inputs::default().file(path));
        }
        if let Some(trajectory) = Trajectory::read(path)? {
            let twin = trajectory.single_twin(path)?;
            return Self::new(twin, Some((path, trajectory)), path.to_owned(), Inputs::default());
        }
        check_results(path, &[Stage::Identify, Stage::Predict, Stage::Appearance])?;
        let file = path.join("twin.json");
        if !file.exists() {
            return Err(Error::Usage {
                problem: format!("{} holds neither a twin nor a simulation", path.display()),
                hint: Some("finish the run with `gic identify`, or give a twin.json or a simulated folder".into()),
            });
        }
        let trajectory = Trajectory::read(&simulation)?.map(|trajectory| (simulation.as_path(), trajectory));
        let scene = Config::resolve(vec![Layer::read(&path.join("config.toml"))?])?.scene.path;
        let inputs = scene.iter().fold(Inputs::default().file(&file), |inputs, scene| inputs.scene(scene));
        Self::new(Twin::read(&file, &[])?, trajectory, path.to_owned(), inputs)
    }

    fn new(twin: Twin, simulated: Option<(&Path, Trajectory)>, folder: PathBuf, inputs: Inputs) -> Result<Self> {
        let matter = match &twin.continuum {
            MatterSource::File(matter) => Some(matter.clone()),
            MatterSource::Solid(_) => None,
        };
        let motion = simulated.as_ref().map(|(from, trajectory)| motion(from, trajectory, &twin)).transpose()?;
        let body = ExportBody::new(&twin, motion.unwrap_or_default())?;
        if let Some((from, trajectory)) = simulated
            && !trajectory.began_with(body.particles().iter().copied())
        {
            return Err(Error::File(FileError::Content {
                path: from.join("trajectory.json"),
                problem: "was not simulated from the particles that the twin has now".into(),
                hint: Some("simulate it again".into()),
            }));
        }
        let home = matter.as_deref().and_then(Path::parent);
        let appearance = home.map(|run| SkinnedGaussians::load(run, body.particles())).transpose()?.flatten();
        let inputs = matter.iter().fold(inputs, |inputs, file| inputs.file(file));
        Ok(Self { body, appearance, folder, inputs })
    }

    /// The folder for outputs without a name.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// What must not be written over.
    pub fn inputs(&self) -> &Inputs {
        &self.inputs
    }

    /// The frames of the motion.
    ///
    /// # Errors
    /// A twin that was not simulated.
    pub(super) fn frames(&self) -> Result<&[Vec<DVec3>]> {
        let frames = &self.body.motion().frames;
        if frames.is_empty() {
            return Err(Error::Usage {
                problem: "the twin was not simulated, so that it has no motion".into(),
                hint: Some("`gic simulate TWIN -o FOLDER`, then export FOLDER".into()),
            });
        }
        Ok(frames)
    }

    /// The colours.
    ///
    /// # Errors
    /// A twin without.
    pub(super) fn appearance(&self) -> Result<&SkinnedGaussians> {
        self.appearance.as_ref().ok_or_else(|| Error::Usage {
            problem: "the twin has no colours".into(),
            hint: Some("colours come with a run: `gic run SCENE -o RUN` makes them as its last stage".into()),
        })
    }

    /// Turns the body so that `up` points up.
    pub(super) fn turn_to(&self, up: UpAxis) -> DQuat {
        DQuat::from_rotation_arc(self.body.up().direction(), up.direction())
    }

    /// Colours of points of the body after it is turned so that `up` points up: those of the nearest Gaussians, in the
    /// scene's light; `None` without colours.
    pub(super) fn colors_toward(&self, up: UpAxis) -> Option<impl Fn(&[DVec3]) -> Vec<[f32; 3]> + 'static> {
        let appearance = self.appearance.as_ref()?;
        let seen = appearance.visible(self.body.particles());
        let back = self.turn_to(up).inverse();
        let centres: Vec<DVec3> = seen.positions.iter().map(|p| DVec3::from_array(p.map(f64::from))).collect();
        let painted: Vec<[f32; 3]> = colors(&seen).collect();
        let spacing = appearance.spacing();
        let gaussians = Neighbours::new(&centres, 2.0 * spacing);
        Some(move |points: &[DVec3]| {
            let color = |p: &DVec3| {
                let mut sum = [0.0; 4];
                for (d, i) in gaussians.nearest::<COLORING_GAUSSIANS>(back * *p) {
                    if let Some(color) = painted.get(i) {
                        let weight = 1.0 / (d / (spacing * spacing) + 0.1) as f32;
                        (0..3).for_each(|c| sum[c] += weight * color[c]);
                        sum[3] += weight;
                    }
                }
                [0, 1, 2].map(|c| (sum[c] / sum[3].max(f32::MIN_POSITIVE)).clamp(0.0, 1.0))
            };
            points.iter().map(color).collect()
        })
    }
}

fn motion(folder: &Path, trajectory: &Trajectory, twin: &Twin) -> Result<Motion> {
    let particles = |file: &String| Ok(read_particles(&folder.join(file))?.positions);
    let frames = trajectory.frames.iter().map(|frame| particles(&frame.file)).collect::<Result<_>>()?;
    Ok(Motion { frame_rate_hz: twin.frame_rate_hz, frames })
}
