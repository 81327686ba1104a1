//! A registration against the truth.

use std::path::Path;

use gic_bench::{RegistrationError, Truth};
use gic_scene::Similarity;
use gic_twin::atomic;
use glam::{DMat3, DQuat, DVec3};
use serde::Deserialize;

use crate::error::Result;
use crate::pipeline::RegistrationRecord;

/// `gt/registration.json`: x_video = scale * R * x_scan + t.
#[derive(Deserialize)]
struct TrueRegistration {
    scale: f64,
    #[serde(rename = "R")]
    rotation: [[f64; 3]; 3],
    t: [f64; 3],
}

/// Compares; `None` where the run has no registration or the truth has none.
pub(super) fn registration_error(run: &Path, truth: &Truth) -> Result<Option<RegistrationError>> {
    let (found, known) = (run.join("registration.json"), truth.folder().join("registration.json"));
    if !(found.exists() && known.exists()) {
        return Ok(None);
    }
    let found = atomic::read_json::<RegistrationRecord>(&found)?.best.similarity();
    let known: TrueRegistration = atomic::read_json(&known)?;
    let known = Similarity {
        scale: known.scale,
        rotation: DMat3::from_cols_array_2d(&known.rotation).transpose(),
        translation: known.t.into(),
    };
    let Some(particles) = truth.particles(0)? else { return Ok(None) };
    let sum: DVec3 = particles.iter().map(|p| DVec3::from_array(p.map(f64::from))).sum();
    Ok(Some(compare(&found, &known, sum / particles.len() as f64)))
}

/// `centre` is the object's true centre in the video [m].
fn compare(found: &Similarity, known: &Similarity, centre: DVec3) -> RegistrationError {
    let in_scan = known.rotation.transpose() * (centre - known.translation) / known.scale;
    let turn = DQuat::from_mat3(&(found.rotation * known.rotation.transpose()));
    RegistrationError {
        rotation_deg: turn.to_scaled_axis().length().to_degrees(),
        centre_m: found.point(in_scan).distance(centre),
        scale: found.scale / known.scale - 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_those_that_were_made() {
        let known =
            Similarity { scale: 0.3, rotation: DMat3::from_rotation_x(0.7), translation: DVec3::new(1.0, -2.0, 0.5) };
        let centre = DVec3::new(0.1, 0.2, -0.3);
        // Turned and grown about the centre, then moved by 2 mm.
        let (turn, growth) = (DMat3::from_rotation_z(0.01), 1.02);
        let found = Similarity {
            scale: growth * known.scale,
            rotation: turn * known.rotation,
            translation: growth * (turn * (known.translation - centre)) + centre + DVec3::new(0.0, 0.002, 0.0),
        };
        let error = compare(&found, &known, centre);
        assert!((error.rotation_deg - 0.01f64.to_degrees()).abs() < 1e-9);
        assert!((error.centre_m - 0.002).abs() < 1e-12 && (error.scale - 0.02).abs() < 1e-12, "{error:?}");
        let none = compare(&known, &known, centre);
        assert!(none.rotation_deg < 1e-5 && none.centre_m < 1e-12 && none.scale == 0.0);
    }
}
