//! Every tuned number of this crate, once: meaning, unit, origin, value.
//!
//! The last sentence of each comment is the number's origin:
//! - `Derived`: follows from the geometry or from other numbers.
//! - `Paper`: the paper's own value, or the named one's.
//! - `Budget`: more of it costs time and gains little; results move within their scatter.
//! - `Fitted on`: chosen for the best results on the named data. *The nine scenes* are nine synthetic videos of a torus
//!   and of crosses, all of which are their own mirror images; *three cameras* are the same scenes with three of their
//!   eleven cameras.
//!
//! [`Tuning`] can be written as a tree and read back, so that a program can vary each number. What stays outside of the
//! table: voxels halve from level to level, levels of one half between empty and full, half a pixel and half a voxel, a
//! voxel within which a view sees matter, guards against division by zero, and the depths at which colours are
//! compared, which size arrays.

use serde::{Deserialize, Serialize};

/// A struct of tuned numbers with their values as its default.
macro_rules! tuned {
    ($(#[$about:meta])* $name:ident { $($(#[$doc:meta])* $field:ident: $kind:ty = $value:expr,)* }) => {
        $(#[$about])*
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $name {
            $($(#[$doc])* #[doc = concat!("\n\nDefault: `", stringify!($value), "`.")] pub $field: $kind,)*
        }

        impl Default for $name {
            fn default() -> $name {
                $name { $($field: $value,)* }
            }
        }
    };
}

/// All tuned numbers of filling.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tuning {
    /// Which Gaussians count.
    pub gaussians: GaussianTuning,
    /// Where the surface lies, by the rendered depths.
    pub depth: DepthTuning,
    /// Algorithm 1.
    pub filling: FillingTuning,
    /// The boundary that no view sees.
    pub unseen: UnseenTuning,
    /// Mirror planes of surfaces and of outlines.
    pub symmetry: SymmetryTuning,
    /// The shape by the pictures of all moments.
    pub across_time: AcrossTimeTuning,
    /// Particles and how they are drawn.
    pub particles: ParticleTuning,
    /// Where iterations end.
    pub iterations: IterationTuning,
    /// A camera sees a place only where the cosine between its normal and the direction to the camera is larger; what
    /// it sees more obliquely counts as at this cosine. The sides of a wedge that hangs below an unseen part are what
    /// rays along silhouettes leave behind, so that no camera looks at them from the front. Fitted on: the nine scenes,
    /// with all cameras and with three.
    pub facing_cosine: f64,
}

impl Default for Tuning {
    fn default() -> Tuning {
        Tuning {
            gaussians: GaussianTuning::default(),
            depth: DepthTuning::default(),
            filling: FillingTuning::default(),
            unseen: UnseenTuning::default(),
            symmetry: SymmetryTuning::default(),
            across_time: AcrossTimeTuning::default(),
            particles: ParticleTuning::default(),
            iterations: IterationTuning::default(),
            facing_cosine: 0.25,
        }
    }
}

impl Tuning {
    /// Whether every number has its default.
    pub fn is_default(&self) -> bool {
        *self == Tuning::default()
    }
}

tuned! {
    /// Which Gaussians count.
    GaussianTuning {
        /// Where a Gaussian ends [standard deviations]: so wide is the air around a body, and a hole between two of
        /// them; centres further from the rendered surface are hidden or stray. Derived: along an axis it holds 99.7 %.
        extent: f64 = 3.0,
        /// A Gaussian with no more than this many Gaussians around it, itself included, is a fleck. Fitted on: the nine
        /// scenes; of one, pairs stand out from a pile of the tests.
        fleck_neighbours: usize = 2,
        /// How far around a Gaussian others count as its neighbours [the object's sizes]: how far they lie apart does
        /// not depend on the voxels. Fitted on: the nine scenes (with two voxels of the last of five levels, bodies
        /// become hollow).
        fleck_distance: f64 = 0.04,
    }
}

tuned! {
    /// Where the surface lies, by the rendered depths.
    DepthTuning {
        /// How far the centres of the Gaussians lie below the true surface [lower quartiles of their standard
        /// deviations]. The alpha of overlapping Gaussians at an outline falls to one half 1.3 to 1.5 standard
        /// deviations above their centres, and the emptiest of several noisy depth maps takes away more. Small
        /// Gaussians decide where edges are, so the lower quartile tells more than the median. A constant, because
        /// silhouettes cannot tell it better: the inset at which the re-rendered area equals the masks' depends on the
        /// scale the particles are drawn with. Fitted on: volumes of plasticine_3 and bunny_elastic.
        inset: f64 = 3.2,
        /// Photographs of a scan that filling looks at: these numbers are for the emptiest of about so many views.
        /// Fitted on: a scan, of whose fifty depth maps three are wrong nearly everywhere, so that the body shrank by 7
        /// %.
        scan_photographs: usize = 12,
        /// Depths of neighbouring pixels are interpolated where they differ by no more than this [widths of a pixel at
        /// that depth]. Fitted on: the nine scenes.
        continuous_within: f32 = 4.0,
    }
}

tuned! {
    /// Algorithm 1.
    FillingTuning {
        /// Side of the voxels of the first level: the object's size over this number. With four levels the finest are
        /// 1/80 of it, half of a simulated particle's spacing, so that corners are not rounded off. Fitted on: the nine
        /// scenes (with 1/48 tips are cut).
        first_level_divisor: f64 = 10.0,
        /// One of so many views must see in front of the surface at a point, at most four, before it is empty although
        /// another view sees matter there. A point that fewer views (but at least one) call empty is left to the
        /// density field: a hole between Gaussians in one view does not dig a tunnel. Where no view sees matter, one is
        /// enough. Fitted on: the nine scenes, with all cameras and with three.
        views_per_vote: usize = 4,
        /// Mean filters in a row: with reassigning after each on every level, and of the unseen boundary before it is
        /// sharpened. Paper: line 12 of Algorithm 1.
        filter_rounds: usize = 2,
    }
}

tuned! {
    /// The boundary that no view sees.
    UnseenTuning {
        /// If less than this share of the boundary is seen, too little is known to say anything about the rest. Budget:
        /// a guard.
        least_seen: f64 = 0.3,
        /// Slope of the sharpening at one half. Budget.
        sharpness: f32 = 3.0,
        /// How far above the smoothest surface undersides are expected [voxels of the first level]. Notches that no
        /// camera sees into make them higher, round bellies lower. Fitted on: the nine scenes.
        lift: f64 = 0.125,
        /// Standard deviation of the change of a body's volume over a video, as a share: soft bodies are squeezed when
        /// they land. Fitted on: the nine scenes.
        volume_deviation: f64 = 0.02,
        /// Standard deviation of how far the unseen boundary is from where it is expected [voxels of the first level];
        /// it is moved by two of these at most, and so deep below it matter is in doubt. Fitted on: the nine scenes.
        boundary_deviation: f64 = 0.25,
    }
}

tuned! {
    /// Mirror planes of a surface, and of outlines. Sizes are the largest side of the body's box.
    SymmetryTuning {
        /// Normals of a first plane that are tried on a surface, evenly over a half sphere; those of a second plane, at
        /// right angles to it, are as close together. Budget: 7 degrees apart.
        normals: usize = 400,
        /// Points of the surface whose mirror images rate a plane and fit it. Budget.
        points: usize = 1000,
        /// The best so many planes are fitted, and the best so many sets of planes of outlines. Budget.
        candidates: usize = 12,
        /// A mirrored point counts as this far from the surface at most, so that a handle on one side only does not
        /// decide [sizes]. Fitted on: the nine scenes.
        farthest_miss: f64 = 0.1,
        /// Up to this far from the surface distances are measured from its tangent plane [spacings of its points].
        /// Derived: where the nearest of these is one of the next ones.
        tangent_spacings: f64 = 2.0,
        /// A plane whose mirrored points lie further from the surface in the mean is none; and this far inside of a
        /// surface that no view sees a point counts at most, as notches are filled too far [sizes]. Fitted on: the nine
        /// scenes, whose true planes have .003 to .008, and a toy with one plane, whose other candidates have .016 and
        /// more.
        largest_misfit: f64 = 1.0 / 110.0,
        /// Planes agree as well as others, and a body has kept its shape, where they miss by at most so many times as
        /// much. Fitted on: plasticine_3, with all cameras and with three.
        same_misfit: f64 = 1.25,
        /// Normals of a first plane that are tried on outlines, as above. Budget: 18 degrees apart.
        outline_normals: usize = 60,
        /// Rays along the outline of each view, and places on each. Budget.
        outline_rays: usize = 75,
        /// Cameras whose outlines tell three planes, if there are any; to fewer the flight adds another moment. Fitted
        /// on: elastic_0, whose planes two cameras miss and three find.
        telling_outlines: usize = 3,
        /// A ray misses by no more than this [pixels]. Budget: a guard against outliers.
        farthest_miss_px: f32 = 10.0,
        /// Planes are none where rays miss by more than this, root mean square [pixels]. Fitted on: three cameras,
        /// where true planes have .1 to .4 and others 1.6 and more.
        largest_miss_px: f64 = 0.5,
    }
}

tuned! {
    /// The shape by the pictures of all moments.
    AcrossTimeTuning {
        /// Standard deviation of the difference between the moves of neighbours in a round [voxels of half the field's
        /// side]. Fitted on: bunny_elastic with three cameras.
        neighbour_deviation: f64 = 0.5,
        /// Share of a place's deformation by which it errs, as a standard deviation. Derived: moduli of a first fit err
        /// by a tenth to a fifth, and small strains go with their inverse.
        deformation_error: f64 = 0.2,
        /// Least standard deviation of a colour, in [0, 1]. Derived: a few steps of eight bits.
        colour_noise: f32 = 3.0 / 255.0,
        /// Standard deviation of a move where nothing is seen [units of the depths that are tried]. Derived: half of
        /// the farthest.
        move_deviation: f64 = 1.0,
        /// Standard deviation of the weights with which places around a voxel share in its move; they end at two of
        /// these, and a place that lies no deeper behind what is nearest is seen [voxels]. Fitted on: plasticine_3
        /// with three cameras.
        smoothing_deviation: f64 = 0.675,
    }
}

impl AcrossTimeTuning {
    /// Where the weights of places around a voxel end [voxels].
    pub(crate) fn reach(&self) -> f64 {
        2.0 * self.smoothing_deviation
    }
}

tuned! {
    /// Particles and how they are drawn.
    ParticleTuning {
        /// Cells of the simulation's grid along the side of a cube with the body's volume, before their side is
        /// rounded: 8,000 particles. Paper: 0.02 m for objects whose boxes are 0.3 to 0.45 m.
        cells_across: f64 = 10.0,
        /// Distance of neighbouring particles [cells]. Paper: two a cell along each axis.
        spacing: f64 = 0.5,
        /// Points along each axis of a particle's cell that are asked to which particle they belong. Budget.
        share_points: usize = 4,
        /// Spacing of the points that are drawn [spacings of the particles that are simulated]. Budget.
        drawing_spacing: f64 = 0.6,
        /// Opacity of a particle of density 1; the scale is then fitted to the masks. Derived: what eq. 7 leaves open,
        /// in place of the scale.
        opacity: f32 = 0.9,
    }
}

impl ParticleTuning {
    /// Two cells of the simulation's grid, of particles that are `spacing` apart: it resolves nothing shorter.
    pub fn resolved(&self, spacing: f64) -> f64 {
        2.0 * spacing / self.spacing
    }
}

tuned! {
    /// Where iterations end.
    IterationTuning {
        /// Rounds after which an iteration ends in any case. Budget.
        most_rounds: usize = 30,
        /// An iteration ends where it changes less than this: a share of the surface, voxels, spacings. Budget.
        tolerance: f64 = 0.01,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_number_can_be_given_and_the_others_stay() {
        let read: Tuning = serde_json::from_str(r#"{"iterations": {"most_rounds": 7}}"#).unwrap();
        let mut expected = Tuning::default();
        expected.iterations.most_rounds = 7;
        assert_eq!(read, expected);
        assert!(
            serde_json::from_str::<Tuning>(r#"{"iterations": {"rounds": 7}}"#).is_err(),
            "a name that there is not"
        );
    }

    #[test]
    fn a_written_table_is_read_back_to_the_bit() {
        let tuning = Tuning::default();
        let text = serde_json::to_string(&tuning).unwrap();
        assert_eq!(serde_json::from_str::<Tuning>(&text).unwrap(), tuning);
    }
}
