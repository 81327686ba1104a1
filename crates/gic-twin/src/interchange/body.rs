//! The body that every export describes: the twin's particles, meshes that enclose exactly their volume, and the motion
//! of both.

use gic_geometry::{DensityField, TetMesh, TriangleMesh, marching_cubes, tetrahedra};
use gic_mpm::World;
use glam::{DQuat, DVec3};

use super::EmbeddedPoints;
use crate::error::{Result, TwinError};
use crate::twin::{MatterSource, Obstacle, ObstacleShape, Twin};

/// Voxels of the density field to a particle's spacing.
const VOXELS_PER_SPACING: f64 = 2.0;
/// Edge of the tetrahedra over the particles' spacing.
pub(super) const TETRAHEDRON_EDGE: f64 = 2.0;
/// A mesh's volume is that of the particles to this share.
const VOLUME_TOLERANCE: f64 = 2e-4;
/// Halvings of the level at most.
const LEVEL_ITERATIONS: usize = 24;

/// Particles of a body in every frame of a simulation.
#[derive(Clone, Debug, Default)]
pub struct Motion {
    /// Frames per second.
    pub frame_rate_hz: f64,
    /// Positions [m] in every frame, shape [f, n]; empty where nothing was simulated.
    pub frames: Vec<Vec<DVec3>>,
}

/// Which axis points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpAxis {
    /// The second.
    Y,
    /// The third.
    Z,
}

impl UpAxis {
    /// The direction.
    pub fn direction(self) -> DVec3 {
        if self == Self::Y { DVec3::Y } else { DVec3::Z }
    }
}

/// One body for all formats: what is simulated, what encloses it, and how it moves.
///
/// The density field is the sum of a cubic B-spline around each particle, as wide as their spacing and weighted with
/// the particle's volume: 1 inside, 1/2 at the surface of matter that fills its place. Each mesh is its level set of
/// the level at which the mesh holds the particles' volume, so that the density times the volume of any mesh is the
/// mass of the particles.
pub struct ExportBody {
    twin: Twin,
    world: World,
    masses: Vec<f64>,
    motion: Motion,
}

impl ExportBody {
    /// The body of a twin, with the motion of its particles (or none).
    ///
    /// # Errors
    /// Matter that cannot be read; a motion of another number of particles.
    pub fn new(twin: &Twin, motion: Motion) -> Result<Self> {
        let (twin, world) = twin.to_world()?;
        let masses = world.bodies[0].masses_kg();
        if let Some(frame) = motion.frames.iter().position(|frame| frame.len() != masses.len()) {
            return Err(TwinError::Usage {
                problem: format!(
                    "frame {frame} holds {} particles, and the twin {}",
                    motion.frames[frame].len(),
                    masses.len()
                ),
                hint: Some("simulate the twin again".into()),
            });
        }
        Ok(Self { twin, world, masses, motion })
    }

    /// The twin, with spacings resolved.
    pub fn twin(&self) -> &Twin {
        &self.twin
    }

    /// Its world: particles, grid and obstacles.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Positions of the particles at time 0 [m].
    pub fn particles(&self) -> &[DVec3] {
        &self.world.bodies[0].positions
    }

    /// Mass of each particle [kg].
    pub fn masses_kg(&self) -> &[f64] {
        &self.masses
    }

    /// Mass of the body [kg]: the sum over its particles.
    pub fn mass_kg(&self) -> f64 {
        self.masses.iter().sum()
    }

    /// Volume at rest [m^3].
    pub fn volume_m3(&self) -> f64 {
        self.mass_kg() / self.twin.density_kg_m3
    }

    /// Distance of neighbouring particles at rest [m].
    pub fn particle_spacing_m(&self) -> f64 {
        self.world.bodies[0].particle_volume_m3.cbrt()
    }

    /// Centre of mass at time 0 [m].
    pub fn centre_of_mass_m(&self) -> DVec3 {
        self.particles().iter().zip(&self.masses).map(|(p, m)| *p * *m).sum::<DVec3>() / self.mass_kg()
    }

    /// Velocity of each point of the body [m] at time 0 [m/s].
    pub fn velocity_field(&self) -> impl Fn(DVec3) -> DVec3 + use<> {
        let body = &self.world.bodies[0];
        let (velocity, spin, centre) = (body.velocity_m_s, body.angular_velocity_rad_s, self.centre_of_mass_m());
        move |point| velocity + spin.cross(point - centre)
    }

    /// The motion of its particles.
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    /// Points [m], given at time 0, in every frame of the motion.
    pub fn carried(&self, points: &[DVec3]) -> Vec<Vec<DVec3>> {
        if self.motion.frames.is_empty() {
            return Vec::new();
        }
        let carrier = EmbeddedPoints::new(points, self.particles(), self.particle_spacing_m());
        self.motion.frames.iter().map(|frame| carrier.deformed(frame)).collect()
    }

    /// Which axis points up: against gravity, y where there is none.
    pub fn up(&self) -> UpAxis {
        let gravity = DVec3::from(self.twin.gravity_m_s2).abs();
        if gravity.z > gravity.y { UpAxis::Z } else { UpAxis::Y }
    }

    /// The same body with everything turned so that `up` points up.
    #[must_use]
    pub fn turned_up(mut self, up: UpAxis) -> Self {
        if self.up() == up {
            return self;
        }
        let turn = DQuat::from_rotation_arc(self.up().direction(), up.direction());
        let turned = |v: [f64; 3]| (turn * DVec3::from(v)).to_array();
        let twin = &mut self.twin;
        twin.gravity_m_s2 = turned(twin.gravity_m_s2);
        twin.initial_velocity_m_s = turned(twin.initial_velocity_m_s);
        twin.initial_angular_velocity_rad_s = turned(twin.initial_angular_velocity_rad_s);
        if let MatterSource::Solid(solid) = &mut twin.continuum {
            solid.centre_m = turned(solid.centre_m);
            solid.rotation_deg = turned_angles(turn, solid.rotation_deg);
        }
        twin.colliders.iter_mut().for_each(|obstacle| turn_obstacle(obstacle, turn));
        self.world.gravity_m_s2 = self.twin.gravity_m_s2.into();
        self.world.colliders = self.twin.colliders.iter().map(Obstacle::to_collider).collect();
        let body = &mut self.world.bodies[0];
        body.velocity_m_s = turn * body.velocity_m_s;
        body.angular_velocity_rad_s = turn * body.angular_velocity_rad_s;
        for p in body.positions.iter_mut().chain(self.motion.frames.iter_mut().flatten()) {
            *p = turn * *p;
        }
        self
    }

    /// The closed surface around the particles' volume.
    ///
    /// # Errors
    /// Particles too far apart for a surface.
    pub fn surface(&self) -> Result<TriangleMesh> {
        let field = self.density_field()?;
        self.enclosing(|level| Ok(marching_cubes(&field, level)), TriangleMesh::volume)
    }

    /// Tetrahedra that fill the particles' volume.
    ///
    /// # Errors
    /// Particles too far apart for a mesh.
    pub fn tetrahedra(&self) -> Result<TetMesh> {
        let field = self.density_field()?;
        let edge = TETRAHEDRON_EDGE * self.particle_spacing_m();
        let mesh = |level| tetrahedra(&field, level, edge).map_err(|e| no_mesh(&e));
        self.enclosing(mesh, TetMesh::volume)
    }

    /// The mesh of the level at which it holds the particles' volume, by bisection: the higher the level, the less is
    /// inside.
    fn enclosing<M>(&self, mesh: impl Fn(f64) -> Result<M>, volume: impl Fn(&M) -> f64) -> Result<M> {
        let wanted = self.volume_m3();
        let (mut low, mut high) = (0.0, 1.0);
        let mut level = 0.5;
        for _ in 0..LEVEL_ITERATIONS {
            let (found, held) = match mesh(level) {
                Ok(found) => {
                    let held = volume(&found);
                    (Some(found), held)
                }
                Err(_) if level > 0.0 => (None, 0.0),
                Err(error) => return Err(error),
            };
            match found {
                Some(found) if (held / wanted - 1.0).abs() < VOLUME_TOLERANCE => return Ok(found),
                _ if held > wanted => low = level,
                _ => high = level,
            }
            level = 0.5 * (low + high);
        }
        Err(no_mesh(&"no level of the particles' density holds their volume; they overlap or lie too far apart"))
    }

    fn density_field(&self) -> Result<DensityField> {
        let body = &self.world.bodies[0];
        let spacing = self.particle_spacing_m();
        let low = body.positions.iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
        let high = body.positions.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
        // A spline reaches two spacings; beyond it one voxel stays empty, so that every level set is closed.
        let margin = DVec3::splat(2.0 * spacing) + DVec3::splat(spacing / VOXELS_PER_SPACING);
        let covering = DensityField::covering(low - margin, high + margin, spacing / VOXELS_PER_SPACING, 1);
        let mut field = covering.map_err(|e| no_mesh(&e))?;
        for (p, mass) in body.positions.iter().zip(&self.masses) {
            let weight = mass / (body.density_kg_m3 * body.particle_volume_m3);
            add_spline(&mut field, *p, spacing, weight);
        }
        Ok(field)
    }
}

/// Adds `weight` times the tensor product of cubic B-splines around `p` [m], with knots `spacing` [m] apart.
fn add_spline(field: &mut DensityField, p: DVec3, spacing: f64, weight: f64) {
    let reach = 2.0 * spacing;
    let at = |axis: usize, i: usize| field.origin[axis] + (i as f64 + 0.5) * field.spacing;
    let first = |axis: usize| (((p[axis] - reach - field.origin[axis]) / field.spacing).ceil().max(0.0)) as usize;
    let ranges: [Vec<(usize, f64)>; 3] = [0, 1, 2].map(|axis| {
        (first(axis).saturating_sub(1)..field.size[axis])
            .map(|i| (i, (at(axis, i) - p[axis]) / spacing))
            .take_while(|(_, u)| *u < 2.0)
            .map(|(i, u)| (i, cubic_spline(u)))
            .filter(|(_, w)| *w > 0.0)
            .collect()
    });
    for &(z, wz) in &ranges[2] {
        for &(y, wy) in &ranges[1] {
            for &(x, wx) in &ranges[0] {
                let i = field.index(x, y, z);
                field.values[i] += (weight * wx * wy * wz) as f32;
            }
        }
    }
}

/// The cubic B-spline with knots at whole numbers.
fn cubic_spline(u: f64) -> f64 {
    let u = u.abs();
    if u < 1.0 {
        2.0 / 3.0 - u * u + 0.5 * u * u * u
    } else if u < 2.0 {
        (2.0 - u).powi(3) / 6.0
    } else {
        0.0
    }
}

fn no_mesh(reason: &dyn std::fmt::Display) -> TwinError {
    TwinError::Usage {
        problem: format!("the particles cannot be meshed: {reason}"),
        hint: Some("export the particles themselves with --format ply or --format particles".into()),
    }
}

/// Angles [degrees] of `turn` after the rotation by `angles` [degrees].
fn turned_angles(turn: DQuat, angles: [f64; 3]) -> [f64; 3] {
    let (z, y, x) = (turn * crate::rotation(angles)).to_euler(glam::EulerRot::ZYX);
    [x, y, z].map(f64::to_degrees)
}

fn turn_obstacle(obstacle: &mut Obstacle, turn: DQuat) {
    let turned = |v: &mut [f64; 3]| *v = (turn * DVec3::from(*v)).to_array();
    match &mut obstacle.shape {
        // Its own rotation acts on the normal as it is written: both become the normal as it is.
        ObstacleShape::HalfSpace { point_m, normal } => {
            turned(point_m);
            let own = crate::rotation(obstacle.rotation_deg.take().unwrap_or_default());
            *normal = (turn * own * DVec3::from(*normal)).to_array();
        }
        ObstacleShape::Sphere { centre_m, .. } => turned(centre_m),
        ObstacleShape::Box { centre_m, .. }
        | ObstacleShape::Cylinder { centre_m, .. }
        | ObstacleShape::Capsule { centre_m, .. } => {
            turned(centre_m);
            obstacle.rotation_deg = Some(turned_angles(turn, obstacle.rotation_deg.unwrap_or_default()));
        }
    }
    obstacle.velocity_m_s.iter_mut().for_each(turned);
    obstacle.angular_velocity_rad_s.iter_mut().for_each(turned);
    obstacle.keyframes.iter_mut().for_each(|key| turned(&mut key.position_m));
}

#[cfg(test)]
mod tests {
    use gic_mpm::Material;

    use super::*;
    use crate::matter::{Solid, SolidKind};
    use crate::twin::ContactKind;

    fn ball() -> Twin {
        let material = Material::Elastic { youngs_modulus_pa: 3e5, poisson_ratio: 0.4 };
        let kind = SolidKind::Sphere { radius_m: 0.1 };
        let shape = Solid { kind, centre_m: [0.0, 0.5, 0.2], rotation_deg: [0.0; 3] };
        let floor = ObstacleShape::HalfSpace { point_m: [0.0, -1.0, 0.0], normal: [0.0, 2.0, 0.0] };
        let mut table = Obstacle::new(
            ObstacleShape::Cylinder { centre_m: [0.0, 0.1, 0.0], radius_m: 0.3, height_m: 0.1 },
            ContactKind::Slip,
        );
        table.rotation_deg = Some([10.0, 20.0, 30.0]);
        Twin {
            colliders: vec![Obstacle::new(floor, ContactKind::Sticky), table],
            initial_velocity_m_s: [0.5, 0.0, -1.0],
            particle_spacing_m: Some(0.01),
            ..Twin::new(material, MatterSource::Solid(shape))
        }
    }

    #[test]
    fn every_mesh_holds_the_mass_of_the_particles_and_lies_where_they_are() {
        let body = ExportBody::new(&ball(), Motion::default()).unwrap();
        let surface = body.surface().unwrap();
        assert!(surface.is_watertight());
        let tetrahedra = body.tetrahedra().unwrap();
        for volume in [surface.volume(), tetrahedra.volume()] {
            assert!((1000.0 * volume / body.mass_kg() - 1.0).abs() < 1e-3, "{volume}");
        }
        // The ball's own radius, which the particles fill to a part of their spacing.
        for p in &surface.vertices {
            let error = (*p - DVec3::new(0.0, 0.5, 0.2)).length() - 0.1;
            assert!(error.abs() < 0.35 * 0.01, "{error}");
        }
    }

    #[test]
    fn turned_worlds_move_as_before_turned() {
        let plain = ExportBody::new(&ball(), Motion::default()).unwrap();
        let turned = ExportBody::new(&ball(), Motion::default()).unwrap().turned_up(UpAxis::Z);
        let turn = |v: DVec3| DVec3::new(v.x, -v.z, v.y);
        assert_eq!(turned.up(), UpAxis::Z);
        assert!((DVec3::from(turned.twin.gravity_m_s2) - DVec3::NEG_Z * 9.8).length() < 1e-12);
        assert!((turned.velocity_field()(DVec3::ZERO) - turn(plain.velocity_field()(DVec3::ZERO))).length() < 1e-12);
        for (a, b) in plain.particles().iter().zip(turned.particles()) {
            assert!((turn(*a) - *b).length() < 1e-12);
        }
        // Points of the obstacles are as far from them as before.
        for (a, b) in plain.world.colliders.iter().zip(&turned.world.colliders) {
            for p in [DVec3::new(0.1, 0.2, -0.3), DVec3::new(0.0, 0.05, 0.0)] {
                assert!((a.signed_distance(p, 0.0) - b.signed_distance(turn(p), 0.0)).abs() < 1e-9, "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn a_motion_of_other_particles_is_refused() {
        let motion = Motion { frame_rate_hz: 24.0, frames: vec![vec![DVec3::ZERO; 3]] };
        let error = ExportBody::new(&ball(), motion).err().unwrap();
        assert!(error.to_string().contains("frame 0 holds 3 particles"), "{error}");
    }
}
