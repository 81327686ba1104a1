//! What is around the body: gravity and obstacles, given, stated by the scene, or guessed.

use gic_identify::WorldDoubt;
use gic_mpm::{Collider, ColliderPath, Contact};
use gic_scene::{CalibrationError, Camera, Format, GroundSource, Inspection};
use gic_twin::twin::{ContactKind, Obstacle, ObstacleShape, Twin};
use glam::DVec3;

use super::{Run, Stage};
use crate::error::{Error, Result};

/// Gravity where a scene says which way is up but not how strong it is [m/s^2].
const GRAVITY_M_S2: f64 = 9.8;
/// Standard deviation of the height of a ground that is guessed from the lowest the object gets, in sizes of the
/// object. Judgement: hulls hang below bodies by as much.
const GUESSED_HEIGHT_SHARE: f64 = 0.1;
/// Coulomb coefficient of a filmed floor. Judgement: most dry pairs of materials have 0.3 to 0.7.
const FILMED_FRICTION: f64 = 0.5;
/// Standard deviation of its logarithm. Judgement: a factor of two to either side.
const FILMED_LOG_FRICTION: f64 = std::f64::consts::LN_2;
/// Standard deviation of the tilt of a filmed floor about each of its axes [rad]. Judgement: floors and tables are
/// level to a degree.
const FILMED_TILT_RAD: f64 = 0.02;

/// Gravity and obstacles of a run.
pub(super) struct Surroundings {
    pub(super) gravity_m_s2: DVec3,
    pub(super) obstacles: Vec<Obstacle>,
    /// How well the ground and gravity are known; `None` where they are exact.
    pub(super) doubt: Option<WorldDoubt>,
}

impl Run<'_> {
    /// Gravity as given, as the scene states it, or downward; obstacles from a file, the scene's ground, or the lowest
    /// that the object gets.
    pub(super) fn surroundings(&self) -> Result<Surroundings> {
        let given = self.config.identify.gravity_m_s2.map(DVec3::from).or(self.scene.world.gravity);
        let file = self.config.identify.colliders.as_deref();
        let needs_guess = given.is_none() || file.is_none() && self.scene.world.ground.is_none();
        let seen = needs_guess.then(|| gic_scene::inspect(&self.scene)).transpose();
        let seen = seen.map_err(Error::stage("looking for up and the ground"))?;
        let gravity_m_s2 = match given {
            Some(gravity) => gravity,
            None => self.gravity_against(seen.as_ref())?,
        };
        if let Some(path) = file {
            return Ok(Surroundings { gravity_m_s2, obstacles: Twin::read_obstacles(path)?, doubt: None });
        }
        let (obstacles, doubt) = match (self.scene.world.ground, seen) {
            (Some(plane), _) => {
                let doubt = self.doubt(self.scene.world.ground_deviation_m);
                (self.floor(plane.point.into(), plane.normal.into()), doubt)
            }
            (None, Some(seen)) => self.guessed_floor(&seen),
            (None, None) => (Vec::new(), None),
        };
        Ok(Surroundings { gravity_m_s2, obstacles, doubt })
    }

    /// Gravity against the direction that is up.
    fn gravity_against(&self, seen: Option<&Inspection>) -> Result<DVec3> {
        let Some((up, source)) = seen.and_then(|seen| seen.up) else {
            return Err(Error::Usage {
                problem: "nothing tells which way is up".into(),
                hint: Some("say which way things fall with --set identify.gravity_m_s2=[0.0, -9.8, 0.0]".into()),
            });
        };
        if source == GroundSource::Guess {
            let text = format!(
                "the scene does not say which way is up; taken as {up:.2?}, the mean of the cameras'. Say which way \
                 things fall with --set identify.gravity_m_s2=[x, y, z]"
            );
            self.events.warn(Stage::Identify.name(), text);
        }
        Ok(-GRAVITY_M_S2 * DVec3::from(up))
    }

    /// The plane below the lowest that the object gets.
    fn guessed_floor(&self, seen: &Inspection) -> (Vec<Obstacle>, Option<WorldDoubt>) {
        let (Some((point, normal, _)), Some(hull)) = (seen.ground, &seen.hull) else {
            let text = "the scene does not say where its ground is, so the object falls through nothing; \
                        give --colliders FILE";
            self.events.warn(Stage::Identify.name(), text);
            return (Vec::new(), None);
        };
        let height_m = GUESSED_HEIGHT_SHARE * hull.size_m.into_iter().fold(0.0, f64::max);
        let text = format!(
            "the scene does not say where its ground is; it is sought within some {:.0} mm of the lowest the object \
             gets, the plane through {point:.3?} with normal {normal:.2?}. Give --colliders FILE where it is known",
            2e3 * height_m
        );
        self.events.warn(Stage::Identify.name(), text);
        (self.floor(point, normal), self.doubt(height_m))
    }

    /// How well the world is known whose floor's height is known to `height_m` [m]; `None` where it is exact.
    fn doubt(&self, height_m: f64) -> Option<WorldDoubt> {
        let (shared_m, log_length) = self.shared_camera_error().unwrap_or_default();
        let doubt = floor_doubt(height_m.hypot(shared_m), self.is_film(), self.has_real_cameras())?;
        Some(WorldDoubt { log_gravity: log_length, ..doubt })
    }

    /// What the errors of all cameras may have in common, which no flight tells: how far the body is higher or lower
    /// than they say [m], and the logarithm of the factor on its lengths, standard deviations. `None` where the cameras
    /// are as they are said to be.
    fn shared_camera_error(&self) -> Option<(f64, f64)> {
        let (deviations, about) = (&self.scene.calibration_error_deviations, self.scene.flight.as_ref()?.about);
        let lateral_m2 = |(error, camera): (&CalibrationError, &Camera)| {
            let turned_m = error.turn_rad.length() * camera.centre.distance(about);
            (turned_m.powi(2) + error.shift_m.length_squared()) / 3.0
        };
        let count = (!deviations.is_empty()).then_some(deviations.len() as f64)?;
        let lateral_m2: f64 = deviations.iter().zip(&self.scene.cameras).map(lateral_m2).sum();
        let log_length = deviations.iter().map(|error| error.focal).sum::<f64>() / count;
        // The mean of independent errors; focal lengths are told apart by the flight, but hardly their common factor.
        let shared = (lateral_m2.sqrt() / count, log_length);
        (shared.0.is_finite() && shared.1.is_finite()).then_some(shared)
    }

    /// Whether it shows something real, which no simulator made on a grid.
    pub(super) fn was_filmed(&self) -> bool {
        self.is_film() || self.has_real_cameras()
    }

    /// Whether cameras lag or are not as stated.
    pub(super) fn has_real_cameras(&self) -> bool {
        !self.scene.delays_s.is_empty() || !self.scene.calibration_errors.is_empty()
    }

    /// Whether the scene was filmed, and not rendered by a suite whose files say what the ground is.
    fn is_film(&self) -> bool {
        matches!(self.scene.format, Format::Nerfstudio | Format::Colmap)
    }

    /// The ground: sticky in the synthetic suites, whose files say so, and one that things bounce off on film.
    fn floor(&self, point: [f64; 3], normal: [f64; 3]) -> Vec<Obstacle> {
        let shape = ObstacleShape::HalfSpace { point_m: point, normal };
        vec![if self.is_film() {
            Obstacle { friction: Some(FILMED_FRICTION), ..Obstacle::new(shape, ContactKind::Separating) }
        } else {
            Obstacle::new(shape, ContactKind::Sticky)
        }]
    }
}

/// The doubt of a floor. Where cameras lag or are not as stated, somebody filmed, whatever the format: then a floor
/// whose height is known is not quite level either.
fn floor_doubt(height_m: f64, is_film: bool, has_real_cameras: bool) -> Option<WorldDoubt> {
    let tilt_rad = if is_film || has_real_cameras { FILMED_TILT_RAD } else { 0.0 };
    let log_friction = if is_film { FILMED_LOG_FRICTION } else { 0.0 };
    let doubt = WorldDoubt { height_m, tilt_rad, log_friction, ..WorldDoubt::default() };
    (height_m > 0.0 || has_real_cameras).then_some(doubt)
}

/// The obstacles as the fit moved them.
pub(super) fn as_fitted(mut obstacles: Vec<Obstacle>, fitted: &[Collider]) -> Vec<Obstacle> {
    for (obstacle, collider) in obstacles.iter_mut().zip(fitted) {
        if let (ObstacleShape::HalfSpace { point_m, normal }, ColliderPath::Uniform { position_m, .. }, Some(fitted)) =
            (&mut obstacle.shape, &collider.path, collider.normal())
        {
            (*point_m, *normal) = ((*position_m).into(), fitted.into());
        }
        if let (Some(friction), Contact::Slip { friction: fitted } | Contact::Separating { friction: fitted }) =
            (&mut obstacle.friction, collider.contact)
        {
            *friction = fitted;
        }
    }
    obstacles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_filmed_has_a_floor_that_may_slope() {
        assert_eq!(floor_doubt(0.0, false, false), None, "a suite states its floor");
        let tilt = |doubt: Option<WorldDoubt>| doubt.expect("in doubt").tilt_rad;
        assert_eq!(tilt(floor_doubt(0.01, false, false)), 0.0, "of a suite only the height");
        assert!(tilt(floor_doubt(0.0, false, true)) > 0.0, "cameras that lag are real");
        assert!(floor_doubt(0.01, true, false).is_some_and(|doubt| doubt.tilt_rad > 0.0 && doubt.log_friction > 0.0));
    }
}
