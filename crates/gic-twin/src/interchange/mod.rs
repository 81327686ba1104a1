//! A twin in the formats of other programs: MuJoCo (MJCF), OpenUSD, glTF, and a plain particle set. All describe one
//! [`ExportBody`].

mod body;
mod embedding;
mod gltf;
mod loaders;
mod mjcf;
mod particle_set;
mod usd;
mod usd_text;

pub use body::{ExportBody, Motion, UpAxis};
pub use embedding::EmbeddedPoints;
pub use gltf::write_glb;
pub use mjcf::write_mjcf;
pub use particle_set::{write_particle_set, write_particles_ply};
pub use usd::{UsdLook, write_usd};

use gic_mpm::Material;
use glam::DVec3;

use crate::error::{Result, TwinError};
use crate::twin::{ContactKind, Obstacle, Twin};

/// Colours of points of the body at time 0 [m]: RGB in [0, 1] as in pictures (sRGB).
pub type Paint<'a> = dyn Fn(&[DVec3]) -> Vec<[f32; 3]> + 'a;

/// A channel of a picture as light.
fn linear_of_srgb(value: f32) -> f32 {
    let value = value.clamp(0.0, 1.0);
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// Colours of points of the body at time 0 [m] as light.
fn linear_colors(paint: &Paint, at: &[DVec3]) -> Vec<DVec3> {
    paint(at).into_iter().map(|color| DVec3::from(color.map(|v| linear_of_srgb(v).into()))).collect()
}

/// Friction that stands for a contact without any slip. Fitted on: cat, in MuJoCo; with 1 it slides.
const STICKY_FRICTION: f64 = 2.0;

/// Friction of an obstacle in programs that know no other contact.
fn friction(obstacle: &Obstacle) -> f64 {
    let sticky = if obstacle.contact == ContactKind::Sticky { STICKY_FRICTION } else { 0.0 };
    obstacle.friction.unwrap_or(sticky)
}

/// Lame's mu and lambda [Pa] from Young's modulus [Pa] and Poisson's ratio.
fn lame([young, poisson]: [f64; 2]) -> [f64; 2] {
    [young / (2.0 * (1.0 + poisson)), young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))]
}

/// Whether matter takes its shape again.
fn is_elastic(material: &Material) -> bool {
    matches!(material, Material::Elastic { .. } | Material::Viscoelastic { .. })
}

/// Whether the matter of a body stays together, so that its surface moves with its particles.
pub fn stays_together(material: &Material) -> bool {
    is_elastic(material) || matches!(material, Material::Plasticine { .. })
}

/// Young's modulus [Pa] and Poisson's ratio for programs that know elastic solids only.
///
/// # Errors
/// The twin is no elastic solid, and `approximate` is not given or of no help.
fn elastic_solid(twin: &Twin, format: &str, approximate: bool) -> Result<[f64; 2]> {
    let refused = |hint: &str| TwinError::Usage {
        problem: format!("{format} describes elastic solids, and the twin's material is {}", twin.material.model()),
        hint: Some(hint.into()),
    };
    match twin.material.elastic_moduli() {
        Some(moduli) if approximate || is_elastic(&twin.material) => Ok(moduli),
        Some(_) => Err(refused(
            "--approximate exports the elastic solid that it is before it yields; --format usd and --format particles \
             hold every law",
        )),
        None => Err(refused("--format usd and --format particles hold every law")),
    }
}
