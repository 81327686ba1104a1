//! Pictures of a grasp on its table: one per width, stress from blue to red, and a film.

use std::path::{Path, PathBuf};

use gic_geometry::outward_normals;
use gic_mpm::Body;
use gic_view::render::{FilmEncoder, FixedCameraRenderer, FrameParticles};
use glam::DVec3;

use super::gripper_frame::GripperFrame;
use super::pad_simulation::{GraspFrame, PadPose, Pads};
use super::percentile::percentile;
use super::report::GraspReport;
use crate::error::{GraspError, Result};

/// Particles whose outward normal is shorter lie so deep that no picture shows them.
const MIN_VISIBLE_NORMAL: f32 = 0.15;
/// Frames per second of the film.
const FILM_RATE_HZ: f64 = 20.0;
/// Thickness of a pad in pictures, over its short side.
const DRAWN_THICKNESS: f64 = 0.35;

/// What the pictures show of one moment.
struct FilmFrame {
    /// Positions in the gripper's frame [m].
    positions: Vec<DVec3>,
    von_mises_pa: Vec<f32>,
    pose: PadPose,
}

/// All that will be drawn.
pub(super) struct GraspFilm {
    /// The particles that can be seen.
    visible: Vec<usize>,
    film: Vec<FilmFrame>,
    holds: Vec<FilmFrame>,
}

/// A film to be made.
pub(super) struct FilmTarget {
    path: PathBuf,
    encoder: FilmEncoder,
}

impl FilmTarget {
    /// Fails at once where such a film cannot be made here.
    pub(super) fn of(path: &Path) -> Result<Self> {
        Ok(Self { path: path.to_owned(), encoder: FilmEncoder::of(path, 1.0)? })
    }
}

impl GraspFilm {
    /// For particles at rest [m], `spacing` metres apart.
    pub(super) fn new(body: &Body, spacing: f64) -> Self {
        let points: Vec<[f32; 3]> = body.positions.iter().map(|p| p.as_vec3().to_array()).collect();
        let normals = outward_normals(&points, spacing);
        let length = |n: &[f32; 3]| n.iter().map(|x| x * x).sum::<f32>().sqrt();
        let visible = (0..points.len()).filter(|&i| length(&normals[i]) >= MIN_VISIBLE_NORMAL).collect();
        Self { visible, film: Vec::new(), holds: Vec::new() }
    }

    /// Adds a moment to the film.
    pub(super) fn record(&mut self, moment: &GraspFrame<'_>) {
        let shot = self.shot(moment);
        self.film.push(shot);
    }

    /// Adds a moment as the picture of a width, and to the film.
    pub(super) fn hold(&mut self, moment: &GraspFrame<'_>) {
        self.record(moment);
        let shot = self.shot(moment);
        self.holds.push(shot);
    }

    fn shot(&self, moment: &GraspFrame<'_>) -> FilmFrame {
        FilmFrame {
            positions: self.visible.iter().map(|&p| moment.frame.positions[p]).collect(),
            von_mises_pa: self.visible.iter().map(|&p| moment.frame.von_mises_pa[p]).collect(),
            pose: moment.state.pose,
        }
    }

    /// Draws everything into a folder; says in a sentence what.
    pub(super) fn draw(
        &self,
        gripper_frame: &GripperFrame,
        pads: &Pads,
        up: DVec3,
        report: &GraspReport,
        (folder, size): (&Path, [usize; 2]),
        film: &FilmTarget,
    ) -> Result<String> {
        // Of what can be seen: inside, stress may be several times larger.
        let most = self.holds.iter().map(|shot| percentile(&shot.von_mises_pa, 0.98)).fold(0.0, f64::max);
        let drawer = FilmDrawer { gripper_frame, pads, up, spacing: report.particle_spacing_m, report };
        let held: Vec<FrameParticles> = self.holds.iter().map(|shot| drawer.particles(shot)).collect();
        let moving: Vec<FrameParticles> = self.film.iter().map(|shot| drawer.particles(shot)).collect();
        let points = || held.iter().chain(&moving).flat_map(|p| &p.positions);
        let low = points().fold(DVec3::INFINITY, |low, &p| low.min(p));
        let high = points().fold(DVec3::NEG_INFINITY, |high, &p| high.max(p));
        // The table: below all of the body before it is lifted.
        let rest = || self.film.first().into_iter().flat_map(|shot| &shot.positions);
        let lowest = rest().min_by(|a, b| a.dot(up).total_cmp(&b.dot(up))).copied().unwrap_or(DVec3::ZERO);
        let side = gripper_frame.world_from_gripper.z_axis + 0.45 * gripper_frame.world_from_gripper.x_axis;
        let studio = FixedCameraRenderer::new(
            (low, high),
            (gripper_frame.world_from_gripper * up, side, gripper_frame.point_to_world(lowest)),
            size,
            most,
            report.particle_spacing_m,
        );
        for (particles, width) in held.iter().zip(&report.widths) {
            let path = folder.join(format!("width_{:.1}mm.png", 1e3 * width.width_m));
            studio.picture(particles, None).save_png(&path).map_err(GraspError::failed)?;
        }
        let picture =
            |(index, particles): (usize, &FrameParticles)| studio.picture(particles, Some(index as f64 / FILM_RATE_HZ));
        let pictures: Vec<_> = moving.iter().enumerate().map(picture).collect();
        let made = film.encoder.write(&pictures, FILM_RATE_HZ)?;
        let name = film.path.display();
        Ok(format!("{} pictures in {}; {}; film {name}: {made}", held.len(), folder.display(), studio.legend()))
    }
}

/// Turns shots into particles of the world, the pads among them.
struct FilmDrawer<'a> {
    gripper_frame: &'a GripperFrame,
    pads: &'a Pads,
    up: DVec3,
    spacing: f64,
    report: &'a GraspReport,
}

impl FilmDrawer<'_> {
    fn particles(&self, shot: &FilmFrame) -> FrameParticles {
        let mut positions = shot.positions.clone();
        let mut von_mises_pa = shot.von_mises_pa.clone();
        positions.extend(self.pads_at(shot.pose));
        // What is no number is drawn grey.
        von_mises_pa.resize(positions.len(), f32::NAN);
        let speeds = vec![0.0; positions.len()];
        let positions = positions.into_iter().map(|p| self.gripper_frame.point_to_world(p)).collect();
        FrameParticles { positions, speeds, von_mises_pa }
    }

    /// Points on the faces of both pads, which are drawn where they touch: nearer by what the grid keeps them apart.
    fn pads_at(&self, pose: PadPose) -> Vec<DVec3> {
        let standoff = self.report.widths.first().map_or(0.0, |w| w.standoff_m);
        let [long, short] = self.pads.size_m;
        let size = DVec3::new(DRAWN_THICKNESS * short, long, short);
        let counts = (size / self.spacing).ceil().max(DVec3::splat(2.0)).as_u64vec3();
        let mut points = Vec::new();
        for i in 0..counts.x {
            for j in 0..counts.y {
                for k in 0..counts.z {
                    let at = [i, j, k];
                    if !(0..3).any(|a| at[a] == 0 || at[a] + 1 == counts[a]) {
                        continue;
                    }
                    let share = DVec3::from_array(at.map(|n| n as f64)) / (counts - 1).as_dvec3();
                    let p = size * (share - DVec3::new(0.0, 0.5, 0.5));
                    let face = pose.half_gap_m - standoff + 0.5 * self.spacing;
                    for side in [-1.0, 1.0] {
                        points.push(DVec3::new(side * (face + p.x), p.y, p.z) + self.up * pose.lift_m);
                    }
                }
            }
        }
        points
    }
}
