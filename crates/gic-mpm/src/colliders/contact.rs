//! What an obstacle does to the velocity of a grid node inside it; forward and backward.
//!
//! Velocities here are relative to the obstacle's surface. With the outward normal n, v_n = v . n and v_t = v - v_n n:
//! sticky v' = 0; slip v' = f(v_t); separating v' = v where v_n >= 0, else f(v_t). Coulomb friction shortens the
//! tangential part by the normal impulse times the coefficient: f(v_t) = v_t max(0, 1 - mu max(-v_n, 0) / |v_t|).

use glam::DVec3;

/// What happens to the grid velocity inside an obstacle, relative to the obstacle's own velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Contact {
    /// No relative motion.
    Sticky,
    /// No relative motion along the normal in either direction; Coulomb friction along the surface.
    Slip {
        /// Coulomb coefficient.
        friction: f64,
    },
    /// No approach along the normal, free to leave; Coulomb friction along the surface while it presses.
    Separating {
        /// Coulomb coefficient.
        friction: f64,
    },
}

/// How friction acts on a tangential velocity.
enum Tangential {
    /// No friction: unchanged.
    Free,
    /// Friction holds it: zero.
    Held,
    /// Shortened by `mu * press` along its direction.
    Sliding { direction: DVec3, speed: f64, friction: f64, press: f64 },
}

impl Tangential {
    fn of(tangential: DVec3, press: f64, friction: f64) -> Self {
        let speed = tangential.length();
        if friction * press <= 0.0 {
            Self::Free
        } else if friction * press < speed {
            Self::Sliding { direction: tangential / speed, speed, friction, press }
        } else {
            Self::Held
        }
    }

    fn apply(&self, tangential: DVec3) -> DVec3 {
        match *self {
            Self::Free => tangential,
            Self::Held => DVec3::ZERO,
            Self::Sliding { direction, speed, friction, press } => direction * (speed - friction * press),
        }
    }

    /// Adjoint of the tangential velocity and of the press, from the adjoint of the result.
    fn adjoint(&self, result_bar: DVec3) -> (DVec3, f64) {
        match *self {
            Self::Free => (result_bar, 0.0),
            Self::Held => (DVec3::ZERO, 0.0),
            Self::Sliding { direction, speed, friction, press } => {
                let along = direction * direction.dot(result_bar);
                let scale = 1.0 - friction * press / speed;
                (along + (result_bar - along) * scale, -friction * direction.dot(result_bar))
            }
        }
    }
}

impl Contact {
    /// The relative velocity after contact.
    pub(crate) fn respond(&self, velocity: DVec3, normal: DVec3) -> DVec3 {
        let along_normal = velocity.dot(normal);
        match *self {
            Self::Sticky => DVec3::ZERO,
            Self::Separating { .. } if along_normal >= 0.0 => velocity,
            Self::Slip { friction } | Self::Separating { friction } => {
                let tangential = velocity - normal * along_normal;
                Tangential::of(tangential, (-along_normal).max(0.0), friction).apply(tangential)
            }
        }
    }

    /// The adjoint of the relative velocity before contact, from the adjoint of the one after.
    pub(crate) fn respond_adjoint(&self, velocity: DVec3, normal: DVec3, after_bar: DVec3) -> DVec3 {
        let along_normal = velocity.dot(normal);
        match *self {
            Self::Sticky => DVec3::ZERO,
            Self::Separating { .. } if along_normal >= 0.0 => after_bar,
            Self::Slip { friction } | Self::Separating { friction } => {
                let tangential = velocity - normal * along_normal;
                let press = (-along_normal).max(0.0);
                let (tangential_bar, press_bar) = Tangential::of(tangential, press, friction).adjoint(after_bar);
                let along_bar = if along_normal < 0.0 { -press_bar } else { 0.0 };
                tangential_bar - normal * normal.dot(tangential_bar) + normal * along_bar
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const UP: DVec3 = DVec3::Y;

    #[test]
    fn sticky_stops() {
        assert_eq!(Contact::Sticky.respond(DVec3::new(1.0, -2.0, 3.0), UP), DVec3::ZERO);
    }

    #[test]
    fn slip_keeps_the_tangent_and_separating_lets_go() {
        let (down, up) = (DVec3::new(1.0, -2.0, 3.0), DVec3::new(1.0, 2.0, 3.0));
        let slip = Contact::Slip { friction: 0.0 };
        let separating = Contact::Separating { friction: 0.0 };
        assert_eq!(slip.respond(down, UP), DVec3::new(1.0, 0.0, 3.0));
        assert_eq!(slip.respond(up, UP), DVec3::new(1.0, 0.0, 3.0));
        assert_eq!(separating.respond(down, UP), DVec3::new(1.0, 0.0, 3.0));
        assert_eq!(separating.respond(up, UP), up);
    }

    #[test]
    fn coulomb_friction_takes_mu_times_the_normal_impulse_or_holds() {
        let contact = Contact::Separating { friction: 0.5 };
        assert_eq!(contact.respond(DVec3::new(3.0, -2.0, 0.0), UP), DVec3::new(2.0, 0.0, 0.0));
        assert_eq!(contact.respond(DVec3::new(0.9, -2.0, 0.0), UP), DVec3::ZERO);
    }

    proptest! {
        #[test]
        fn adjoint_matches_finite_differences(
            v in proptest::array::uniform3(-2.0f64..2.0), n in proptest::array::uniform3(-1.0f64..1.0),
            bar in proptest::array::uniform3(-1.0f64..1.0), friction in 0.0f64..1.0, kind in 0usize..3,
        ) {
            let (v, n, bar) = (DVec3::from(v), DVec3::from(n), DVec3::from(bar));
            prop_assume!(n.length() > 0.1);
            let n = n.normalize();
            let contact = [Contact::Sticky, Contact::Slip { friction }, Contact::Separating { friction }][kind];
            // Stay away from the kinks, where there is no derivative to compare with.
            let (along, tangent) = (v.dot(n), (v - n * v.dot(n)).length());
            prop_assume!(along.abs() > 1e-3 && tangent > 1e-2 && (tangent + friction * along.min(0.0)).abs() > 1e-3);
            let adjoint = contact.respond_adjoint(v, n, bar);
            let h = 1e-6;
            for axis in DVec3::AXES {
                let difference = contact.respond(v + axis * h, n) - contact.respond(v - axis * h, n);
                prop_assert!((difference.dot(bar) / (2.0 * h) - adjoint.dot(axis)).abs() < 1e-7);
            }
        }
    }
}
