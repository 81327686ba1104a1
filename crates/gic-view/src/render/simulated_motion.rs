//! A simulated motion on disk, as `gic simulate` writes it.

use std::path::{Path, PathBuf};

use gic_geometry::KdTree;
use gic_twin::matter::read_particles;
use gic_twin::simulate::Trajectory;
use glam::DVec3;

use crate::error::{Result, ViewError};

/// A simulated motion on disk.
pub struct SimulatedMotion {
    /// Its frames in numbers.
    pub trajectory: Trajectory,
    folder: PathBuf,
    /// The run it belongs to, if it was opened as a run.
    pub run: Option<PathBuf>,
}

/// The particles of a frame.
#[derive(Clone)]
pub struct FrameParticles {
    /// Positions [m].
    pub positions: Vec<DVec3>,
    /// Speeds [m/s].
    pub speeds: Vec<f32>,
    /// Von Mises stresses [Pa].
    pub von_mises_pa: Vec<f32>,
}

/// Where the matter of a body comes from.
pub(crate) struct BodyMatter {
    /// Number of its particles.
    pub(crate) particles: usize,
    /// The file of its particles at rest; `None` for a shape.
    pub(crate) file: Option<PathBuf>,
    /// By how much it was moved before the simulation [m]; `None` for the first body, which stays where it is.
    pub(crate) shift_m: Option<DVec3>,
    /// What to call it: the folder of its run, the name of its file, or its shape.
    pub(crate) name: String,
}

impl SimulatedMotion {
    /// Opens a folder of frames, or the prediction of a run.
    ///
    /// # Errors
    /// A folder without frames, damaged files.
    pub fn open(path: &Path) -> Result<Self> {
        let predicted = path.join("prediction");
        for (folder, run) in [(path, None), (predicted.as_path(), Some(path.to_owned()))] {
            if let Some(trajectory) = Trajectory::read(folder)?
                && !trajectory.frames.is_empty()
            {
                return Ok(Self { trajectory, folder: folder.to_owned(), run });
            }
        }
        Err(ViewError::Usage {
            problem: format!("{} holds no simulated frames", path.display()),
            hint: Some("give the folder that `gic simulate` wrote, or a finished run".into()),
        })
    }

    /// Reads the particles of a frame.
    ///
    /// # Errors
    /// A missing or damaged file.
    pub fn particles(&self, index: usize) -> Result<FrameParticles> {
        let read = read_particles(&self.folder.join(&self.trajectory.frames[index].file))?;
        Ok(FrameParticles {
            positions: read.positions,
            speeds: read.velocities.iter().map(|v| v.length() as f32).collect(),
            von_mises_pa: read.von_mises_pa,
        })
    }

    /// The matter of each body, in the order of the particles.
    pub(crate) fn continua(&self) -> Vec<BodyMatter> {
        let companions = self.trajectory.twin.get("companions").and_then(|c| c.as_array());
        let others = companions.into_iter().flatten().filter_map(|c| Some((c.get("twin")?, c.get("shift_m"))));
        let twins = std::iter::once((&self.trajectory.twin, None)).chain(others);
        let single = [self.trajectory.particles];
        // A trajectory of one body may leave the list out.
        let counts = if self.trajectory.bodies.is_empty() { &single[..] } else { &self.trajectory.bodies };
        let matter =
            |(&particles, (twin, shift)): (&usize, (&serde_json::Value, Option<&serde_json::Value>))| BodyMatter {
                particles,
                file: twin.get("continuum").and_then(|c| c.as_str()).map(|file| self.folder.join(file)),
                shift_m: shift.and_then(vector),
                name: self.body_name(twin),
            };
        let mut bodies: Vec<BodyMatter> = counts.iter().zip(twins).map(matter).collect();
        // Copies of the same get numbers.
        for index in 1..bodies.len() {
            let earlier = bodies[..index].iter().filter(|body| body.name == bodies[index].name).count();
            if earlier > 0 {
                bodies[index].name += &format!(" ({})", earlier + 1);
            }
        }
        bodies
    }

    fn body_name(&self, twin: &serde_json::Value) -> String {
        let text = |pointer: &str| twin.pointer(pointer).and_then(|value| value.as_str());
        let model = text("/material/model").unwrap_or("body");
        let Some(file) = text("/continuum") else {
            return format!("{model} {}", text("/continuum/shape").unwrap_or("body"));
        };
        let file = self.folder.join(file);
        // Links and `..` hide the folder's name.
        let file = file.canonicalize().unwrap_or(file);
        let is_of_run = file.file_name().is_some_and(|name| name == "twin.ply");
        let name = if is_of_run { file.parent().and_then(Path::file_name) } else { file.file_stem() };
        name.map_or_else(|| model.to_owned(), |name| name.to_string_lossy().into_owned())
    }

    /// Frames per second of the simulation.
    pub(crate) fn frame_rate_hz(&self) -> f64 {
        self.trajectory.twin.get("frame_rate_hz").and_then(|rate| rate.as_f64()).unwrap_or(24.0)
    }

    /// Lowest and highest coordinates [m] over all frames.
    pub(crate) fn bounds(&self) -> (DVec3, DVec3) {
        self.trajectory.frames.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), frame| {
            (low.min(frame.low_m.into()), high.max(frame.high_m.into()))
        })
    }

    /// Up: against gravity.
    pub(crate) fn up(&self) -> DVec3 {
        let gravity = self.trajectory.twin.get("gravity_m_s2").and_then(vector).unwrap_or(DVec3::NEG_Y);
        (-gravity).normalize_or(DVec3::Y)
    }

    /// A point [m] and the normal of each plane among the obstacles.
    pub(crate) fn planes(&self) -> Vec<(DVec3, DVec3)> {
        let colliders = self.trajectory.twin.get("colliders").and_then(|c| c.as_array());
        let planes = colliders.into_iter().flatten().filter(|c| c.get("shape").is_some_and(|s| s == "half_space"));
        planes.filter_map(|c| Some((c.get("point_m").and_then(vector)?, c.get("normal").and_then(vector)?))).collect()
    }
}

fn vector(value: &serde_json::Value) -> Option<DVec3> {
    let numbers: Vec<f64> = value.as_array()?.iter().filter_map(|x| x.as_f64()).collect();
    <[f64; 3]>::try_from(numbers).ok().map(DVec3::from)
}

impl FrameParticles {
    /// Median distance [m] of some particles to the nearest of the others.
    pub(crate) fn spacing(&self) -> f64 {
        /// Number of particles, about, whose neighbours are sought.
        const SAMPLE: usize = 500;
        let points: Vec<[f32; 3]> = self.positions.iter().map(|p| p.as_vec3().to_array()).collect();
        let step = (points.len() / SAMPLE).max(2);
        let others: Vec<[f32; 3]> =
            points.iter().enumerate().filter(|(i, _)| !i.is_multiple_of(step)).map(|(_, &p)| p).collect();
        let tree = KdTree::new(&others);
        let sampled = points.iter().step_by(step);
        let mut distances: Vec<f32> =
            sampled.filter_map(|&p| tree.nearest(p)).map(|(_, squared)| squared.sqrt()).collect();
        distances.sort_by(f32::total_cmp);
        distances.get(distances.len() / 2).copied().filter(|&d| d > 0.0).map_or(0.01, f64::from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spacing_of_a_lattice_is_found() {
        let positions = (0..1000).map(|i| DVec3::new((i % 10) as f64, (i / 10 % 10) as f64, (i / 100) as f64) * 0.02);
        let particles = FrameParticles { positions: positions.collect(), speeds: Vec::new(), von_mises_pa: Vec::new() };
        assert!((particles.spacing() - 0.02).abs() < 1e-6);
    }
}
