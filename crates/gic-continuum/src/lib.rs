//! From Gaussians to matter (paper section 4.2).
//!
//! Filling makes a body of one frame's Gaussians and masks: a [`gic_geometry::DensityField`] whose level of one half is
//! the surface. In the order of the data:
//!
//! | folder | step | equation or paper |
//! |---|---|---|
//! | `evidence` | what a view's pixels say of a place: mask `M(u)` and depth `D(u) / A(u)`; bounds of it over boxes | Algorithm 1, lines 2 and 3; pyramids as in Greene, Kass & Miller 1993 |
//! | `fill` | from particles inside all masks and behind all depths to a field, level by level; the boundary that no view sees | Algorithm 1; mean curvature motion: Merriman, Bence & Osher 1992 |
//! | `symmetry` | mirror planes of the surface or of outlines; the body averaged with its images | point-to-plane fits: Chen & Medioni 1992; silhouette coherence: Hernandez, Schmitt & Cipolla 2007 |
//! | `across_time` | the surface of the first frame moves to where the pictures of all moments want it | Cheung, Baker & Kanade 2005; plane sweep: Collins 1996 |
//! | `particles` | particles for simulation, drawn as Gaussians | eq. 7 |
//!
//! [`ShapeFrom`] tells which first bodies depths make and which outlines. All tuned numbers stand in [`Tuning`].

mod across_time;
mod choices;
mod error;
mod evidence;
mod fill;
mod particles;
mod settings;
mod shape_from;
mod symmetry;
#[cfg(test)]
mod test_cross;
mod tuning;

pub use across_time::{AcrossTime, Moment, MomentView};
pub use choices::Settings;
pub use error::ContinuumError;
pub use evidence::MaskedView;
pub use fill::{Filling, fill, fill_outlines};
pub use particles::{
    Agreement, Appearance, Drawing, Particles, agreement, calibrate, compare_with_masks, informed_gaussians,
    sample_particles, sample_points,
};
pub use settings::{FillSettings, Unseen};
pub use shape_from::ShapeFrom;
pub use symmetry::{Completion, MirrorPlane, Symmetry};
pub use tuning::*;
