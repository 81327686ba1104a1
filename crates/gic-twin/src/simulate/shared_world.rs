//! The bodies of a simulation: a twin, and others that share its world.

use std::path::PathBuf;
use std::str::FromStr;

use gic_mpm::{Stepping, World};
use glam::DVec3;

use crate::error::Result;
use crate::twin::{Obstacle, Setting, Twin};

/// Another twin, or another copy of the same, in the world of the first: its own matter and material, the first one's
/// gravity, obstacles, grid and frame rate.
#[derive(Clone, Debug, PartialEq)]
pub struct Companion {
    /// The twin's file, or a run folder.
    pub twin: PathBuf,
    /// By how much it is moved [m].
    pub shift_m: [f64; 3],
}

/// A text that is no [`Companion`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` must be TWIN@X,Y,Z, for example other/twin.json@0,0.4,0 (metres)")]
pub struct CompanionError(String);

impl FromStr for Companion {
    type Err = CompanionError;

    fn from_str(text: &str) -> std::result::Result<Self, CompanionError> {
        let wrong = || CompanionError(text.into());
        let (path, shift) = text.rsplit_once('@').ok_or_else(wrong)?;
        let numbers: Option<Vec<f64>> =
            shift.split(',').map(|x| x.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
        let shift_m = numbers.and_then(|n| <[f64; 3]>::try_from(n).ok()).ok_or_else(wrong)?;
        if path.is_empty() { Err(wrong()) } else { Ok(Self { twin: path.into(), shift_m }) }
    }
}

/// A twin, what is changed about it, and what comes into its world.
#[derive(Clone, Debug, Default)]
pub struct Scenario {
    /// The twin's file.
    pub twin: PathBuf,
    /// Changes to the twin.
    pub settings: Vec<Setting>,
    /// Further obstacles.
    pub obstacles: Vec<Obstacle>,
    /// Further twins in the same world.
    pub companions: Vec<Companion>,
}

/// The twin and its companions in one world.
pub struct SharedWorld {
    /// The twin whose world it is, with spacings resolved.
    pub twin: Twin,
    /// The others, with what they are moved by [m].
    pub(super) companions: Vec<(Twin, [f64; 3])>,
    /// What is simulated: one body for each twin.
    pub world: World,
}

impl SharedWorld {
    /// Reads the twins of a scenario.
    ///
    /// # Errors
    /// Twins that cannot be read, and settings that do not fit them.
    pub fn read(scenario: &Scenario) -> Result<Self> {
        let mut first = Twin::read(&scenario.twin, &scenario.settings)?;
        first.colliders.extend(scenario.obstacles.iter().cloned());
        let (twin, mut world) = first.to_world()?;
        let mut companions = Vec::new();
        for companion in &scenario.companions {
            let (other, theirs) = Twin::read(&companion.twin, &[])?.to_world()?;
            for mut body in theirs.bodies {
                body.positions.iter_mut().for_each(|p| *p += DVec3::from(companion.shift_m));
                world.bodies.push(body);
            }
            world.stepping = finer(world.stepping, theirs.stepping);
            companions.push((other, companion.shift_m));
        }
        Ok(Self { twin, companions, world })
    }

    /// Mass of each particle [kg], one body after the other.
    pub(super) fn masses(&self) -> Vec<f64> {
        self.world.bodies.iter().flat_map(gic_mpm::Body::masses_kg).collect()
    }
}

/// Substeps that serve both.
fn finer(a: Stepping, b: Stepping) -> Stepping {
    Stepping {
        least_substeps_per_frame: a.least_substeps_per_frame.max(b.least_substeps_per_frame),
        courant: a.courant.min(b.courant),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn companions_are_a_path_and_a_shift() {
        let companion: Companion = "a@b/twin.json@0,0.4,-1".parse().unwrap();
        assert_eq!(companion, Companion { twin: "a@b/twin.json".into(), shift_m: [0.0, 0.4, -1.0] });
        for wrong in ["twin.json", "twin.json@1,2", "twin.json@1,2,x", "@1,2,3", "t@1,2,inf"] {
            assert!(wrong.parse::<Companion>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn the_finer_stepping_wins() {
        let careful = Stepping { courant: 0.2, ..Stepping::STABLE };
        let both = Stepping { courant: 0.2, ..Stepping::at_least(200) };
        assert_eq!(finer(Stepping::at_least(100), Stepping::at_least(200)), Stepping::at_least(200));
        assert_eq!(finer(careful, Stepping::at_least(200)), both);
        assert_eq!(finer(Stepping::at_least(200), careful), both);
    }
}
