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
/// Standard deviation of the angle between up and what is taken for it in a film, about each axis [rad]. Judgement:
/// floors and tables are level to a degree.
const FILMED_TILT_RAD: f64 = 0.02;

/// What the errors of all cameras may have in common, which no flight tells, standard deviations: the world is off by
/// as much as they see it.
#[derive(Clone, Copy, Default)]
struct SharedCameraError {
    /// How far everything is off along each axis [m].
    lateral_m: f64,
    /// How far it is turned about each axis [rad].
    turn_rad: f64,
    /// The logarithm of the factor on its lengths.
    log_length: f64,
}

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
                let doubt = self.doubt(self.scene.world.ground_deviation_m, 0.0);
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
        (self.floor(point, normal), self.doubt(height_m, FILMED_TILT_RAD))
    }

    /// How well the world is known whose floor's height is known to `height_m` [m] and, in a film, whose tilt to
    /// `tilt_rad` [rad], but for what the cameras have wrong; `None` where it is exact.
    fn doubt(&self, height_m: f64, tilt_rad: f64) -> Option<WorldDoubt> {
        let shared = self.shared_camera_error().unwrap_or_default();
        let (height_m, tilt_rad) = (height_m.hypot(shared.lateral_m), tilt_rad.hypot(shared.turn_rad));
        let doubt = floor_doubt(height_m, tilt_rad, self.was_filmed())?;
        Some(WorldDoubt { log_gravity: shared.log_length, ..doubt })
    }

    /// What the errors of all cameras may have in common. `None` where the cameras are as they are said to be.
    fn shared_camera_error(&self) -> Option<SharedCameraError> {
        let (deviations, about) = (&self.scene.calibration_error_deviations, self.scene.flight.as_ref()?.about);
        let count = (!deviations.is_empty()).then_some(deviations.len() as f64)?;
        let lateral_m2 = |(error, camera): (&CalibrationError, &Camera)| {
            let turned_m = error.turn_rad.length() * camera.centre.distance(about);
            turned_m.powi(2) + error.shift_m.length_squared()
        };
        let lateral_m2: f64 = deviations.iter().zip(&self.scene.cameras).map(lateral_m2).sum();
        let turn_rad2: f64 = deviations.iter().map(|error| error.turn_rad.length_squared()).sum();
        // Of a vector along each axis, the mean of independent errors.
        let along_axis = |squares: f64| (squares / 3.0).sqrt() / count;
        let shared = SharedCameraError {
            lateral_m: along_axis(lateral_m2),
            turn_rad: along_axis(turn_rad2),
            // Focal lengths are told apart by the flight, but hardly their common factor.
            log_length: deviations.iter().map(|error| error.focal).sum::<f64>() / count,
        };
        let all = [shared.lateral_m, shared.turn_rad, shared.log_length];
        all.iter().all(|deviation| deviation.is_finite()).then_some(shared)
    }

    /// Whether it shows something real, which no simulator made on a grid: the format is not that of a suite, whose
    /// files say what the ground is, or the cameras lag or are not as stated.
    pub(super) fn was_filmed(&self) -> bool {
        matches!(self.scene.format, Format::Nerfstudio | Format::Colmap) || self.has_real_cameras()
    }

    /// Whether cameras lag or are not as stated.
    pub(super) fn has_real_cameras(&self) -> bool {
        !self.scene.delays_s.is_empty() || !self.scene.calibration_errors.is_empty()
    }

    /// The ground: sticky in the synthetic suites, whose files say so; on film one that things bounce off, or sticky.
    fn floor(&self, point: [f64; 3], normal: [f64; 3]) -> Vec<Obstacle> {
        let shape = ObstacleShape::HalfSpace { point_m: point, normal };
        vec![if self.was_filmed() {
            Obstacle { friction: Some(FILMED_FRICTION), ..Obstacle::new(shape, ContactKind::Separating) }
        } else {
            Obstacle::new(shape, ContactKind::Sticky)
        }]
    }
}

/// The doubt of a floor and of gravity. Where somebody filmed, contact is guessed, and up is not quite up.
fn floor_doubt(height_m: f64, tilt_rad: f64, was_filmed: bool) -> Option<WorldDoubt> {
    let of_film = |deviation: f64| if was_filmed { deviation } else { 0.0 };
    let doubt = WorldDoubt {
        height_m,
        tilt_rad: of_film(tilt_rad),
        log_friction: of_film(FILMED_LOG_FRICTION),
        may_stick: was_filmed,
        gravity_tilt_rad: of_film(FILMED_TILT_RAD),
        ..WorldDoubt::default()
    };
    (height_m > 0.0 || was_filmed).then_some(doubt)
}

/// The obstacles as the fit moved them.
pub(super) fn as_fitted(mut obstacles: Vec<Obstacle>, fitted: &[Collider]) -> Vec<Obstacle> {
    for (obstacle, collider) in obstacles.iter_mut().zip(fitted) {
        if let (ObstacleShape::HalfSpace { point_m, normal }, ColliderPath::Uniform { position_m, .. }, Some(fitted)) =
            (&mut obstacle.shape, &collider.path, collider.normal())
        {
            (*point_m, *normal) = ((*position_m).into(), fitted.into());
        }
        match (&mut obstacle.friction, collider.contact) {
            (_, Contact::Sticky) if obstacle.contact != ContactKind::Sticky => {
                (obstacle.contact, obstacle.friction) = (ContactKind::Sticky, None);
            }
            (Some(friction), Contact::Slip { friction: fitted } | Contact::Separating { friction: fitted }) => {
                *friction = fitted;
            }
            _ => (),
        }
    }
    obstacles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn up_is_not_quite_up_where_somebody_filmed() {
        assert_eq!(floor_doubt(0.0, 0.0, false), None, "a suite states its floor");
        let tilts = |doubt: Option<WorldDoubt>| doubt.map(|doubt| (doubt.tilt_rad, doubt.gravity_tilt_rad));
        assert_eq!(tilts(floor_doubt(0.01, 0.01, false)), Some((0.0, 0.0)), "of a suite only the height");
        let stated = floor_doubt(0.0, 0.001, true);
        assert_eq!(tilts(stated), Some((0.001, FILMED_TILT_RAD)), "cameras that lag are real");
        assert!(stated.is_some_and(|doubt| doubt.log_friction > 0.0 && doubt.may_stick));
        let guessed = floor_doubt(0.01, FILMED_TILT_RAD, true);
        assert_eq!(tilts(guessed), Some((FILMED_TILT_RAD, FILMED_TILT_RAD)));
        assert!(guessed.is_some_and(|doubt| doubt.log_friction > 0.0));
    }
}
