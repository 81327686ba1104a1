//! Coarse-to-fine filling: Algorithm 1 of the paper, a function per group of lines.
//!
//! The structure is the paper's: internal particles are kept where every view's rendered depth lies in front of them
//! and its mask covers them; a density field is upsampled, mean-filtered and reassigned level by level. Three things
//! differ, each because what is made of the body downstream (its mass, its contact time) needs its volume without bias:
//!
//! 1. *Densities are shares, not flags.* A voxel that holds any particle gets density 1 in the paper, which makes the
//!    body half a voxel too large all around. Here the particles are stratified, eight to a voxel of the finest level,
//!    each with a weight that ramps across the surface, and a voxel's density is their mean: the level 0.5 then lies
//!    where the surface lies, to a small part of a voxel.
//! 2. *Certainly empty is reassigned too.* Where a mask or several depth maps say empty, reassigning writes zero as
//!    well as writing one inside. What is left to the interpolated and filtered field is what is in doubt: where only
//!    one depth map sees past the surface and another one sees matter, as it does through a gap between Gaussians.
//! 3. *Undersides.* What no view sees is filled, but not down to the last ray that grazes the body: the boundary that
//!    no view sees is smooth, and the body keeps its volume (see [`crate::Unseen`]). A body that is its own mirror
//!    image is then completed by it ([`crate::Completion`]).

mod coarse_to_fine;
mod filling;
mod gaussians;
mod internal;
mod unseen;

use gic_geometry::DensityField;
use gic_scene::Camera;
use gic_splat::Gaussians;

use self::coarse_to_fine::coarse_to_fine;
use self::gaussians::{initialize_field, quartiles_of_scale, usable_gaussians};
use self::internal::internal_particles;
use self::unseen::place_unseen;
use crate::evidence::Evidence;
use crate::{ContinuumError, FillSettings, MaskedView, Symmetry};

pub(crate) use self::coarse_to_fine::smooth;
pub use self::filling::Filling;

/// Algorithm 1: the density field of one frame from its Gaussians and masks.
pub fn fill(gaussians: &Gaussians, views: &[MaskedView], settings: &FillSettings) -> Result<Filling, ContinuumError> {
    settings.validate()?;
    let usable = usable_gaussians(gaussians, &Evidence::gather(views, None, &settings.tuning)?, settings)?;
    let [small, scale] = quartiles_of_scale(&usable);
    let evidence = Evidence::gather(views, Some((&usable, scale)), &settings.tuning)?;
    let inset = settings.tuning.depth.inset * small;
    let (field, doubt) = density_field(&usable, &evidence, inset, settings)?;
    Ok(Filling { field, doubt, th_min: settings.th_min, gaussians_used: usable.len(), views_used: evidence.len() })
}

/// What outlines alone leave of a body whose mirror planes they show: the mirror images of all views see it, too, and
/// none of the Gaussians' depths count.
pub fn fill_outlines(
    gaussians: &Gaussians,
    views: &[MaskedView],
    symmetry: &Symmetry,
    settings: &FillSettings,
) -> Result<Filling, ContinuumError> {
    settings.validate()?;
    let outlines = Evidence::gather(views, None, &settings.tuning)?;
    let views_used = outlines.len();
    let mirrored: Vec<Vec<Camera>> = outlines.iter().map(|view| symmetry.mirrored_cameras(view.camera)).collect();
    let evidence = with_mirror_images(outlines, &mirrored);
    let usable = usable_gaussians(gaussians, &evidence, settings)?;
    let (field, doubt) = density_field(&usable, &evidence, 0.0, settings)?;
    Ok(Filling { field, doubt, th_min: settings.th_min, gaussians_used: usable.len(), views_used })
}

/// The views and all that their `mirrored` cameras see: the same pictures.
fn with_mirror_images<'a>(mut views: Vec<Evidence<'a>>, mirrored: &'a [Vec<Camera>]) -> Vec<Evidence<'a>> {
    for k in 0..views.len() {
        for camera in &mirrored[k] {
            views.push(views[k].seen_from(camera));
        }
    }
    views
}

/// Lines 5 to 15: the density field that views leave, whose depths lie `inset` [m] below the surface, and how much each
/// voxel's matter is in doubt.
fn density_field(
    usable: &Gaussians,
    evidence: &[Evidence],
    inset: f64,
    settings: &FillSettings,
) -> Result<(DensityField, Vec<f32>), ContinuumError> {
    let grid = initialize_field(usable, settings)?;
    let particles = internal_particles(&grid, evidence, inset, settings);
    let mut field = coarse_to_fine(&particles, usable, settings);
    let doubt = place_unseen(&mut field, evidence, inset, settings);
    smooth(&mut field);
    if !field.values.iter().any(|&v| f64::from(v) >= settings.th_min) {
        return Err(ContinuumError::Empty);
    }
    Ok((field, doubt))
}
