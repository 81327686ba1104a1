//! The constitutive laws.

pub(crate) mod elastic;
mod hencky;
pub(crate) mod kind;
pub(crate) mod law;
pub(crate) mod material;
pub(crate) mod newtonian;
pub(crate) mod non_newtonian;
pub(crate) mod plasticine;
pub(crate) mod sand;
#[cfg(test)]
mod tests;
pub(crate) mod viscoelastic;

/// Runs an expression with `$law` naming the generic law type of a material.
macro_rules! with_law {
    ($material:expr, $law:ident => $body:expr) => {
        match $material {
            crate::Material::Elastic { .. } => {
                type $law<R> = crate::laws::elastic::Elastic<R>;
                $body
            }
            crate::Material::Plasticine { .. } => {
                type $law<R> = crate::laws::plasticine::Plasticine<R>;
                $body
            }
            crate::Material::Sand { .. } => {
                type $law<R> = crate::laws::sand::Sand<R>;
                $body
            }
            crate::Material::Newtonian { .. } => {
                type $law<R> = crate::laws::newtonian::Newtonian<R>;
                $body
            }
            crate::Material::Viscoelastic { .. } => {
                type $law<R> = crate::laws::viscoelastic::Viscoelastic<R>;
                $body
            }
            crate::Material::NonNewtonian { .. } => {
                type $law<R> = crate::laws::non_newtonian::NonNewtonian<R>;
                $body
            }
        }
    };
}
pub(crate) use with_law;
