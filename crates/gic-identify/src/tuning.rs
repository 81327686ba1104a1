//! Every tuned number of identification, in one tree that a program can read, vary and switch off.
//!
//! Each field says what it means, its unit, and where it comes from: `Derived`, `Paper`, `Budget` (of time or memory),
//! or `Fitted on` scenes. "The nine scenes" are those of the published simulations: elastic_0, elastic_2, torus,
//! plasticine_3, newtonian_2, newtonian_7, non_newtonian_2, sand_1 and sand_3; eight crosses that are mirror-symmetric
//! and a torus. Lengths are in cells of the simulation grid, in particle spacings (half a cell by default), or in
//! pixels at the resolution at which masks are compared.
//!
//! Ranges, grids and search coordinates of the material parameters stand in `unknowns/parameter.rs`: they are facts of
//! a parameter.

use serde::{Deserialize, Serialize};

/// How many of the nearest points of an extracted surface make up what a distance is measured from. One for a place in
/// a list of fixed length, so it is fixed when gic is built. Fitted on: elastic_0.
pub(crate) const NEAREST_SURFACE_POINTS: usize = 6;

/// Gaussians end at so many standard deviations, where they fall below exp(-8). It is part of inner loops, so it is
/// fixed when gic is built. Derived: an earlier end is a step that finite differences see.
pub(crate) const CUTOFF_SIGMAS: f32 = 4.0;

/// Blur of the pixel itself [pixels^2], added to the projected variance. Derived: the variance of a box of one pixel.
pub(crate) const PIXEL_VARIANCE: f32 = 1.0 / 12.0;

/// Every tuned number of identification.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tuning {
    /// Steps of the simulation.
    pub resolution: ResolutionTuning,
    /// Masks at the resolution at which they are compared.
    pub masks: MaskTuning,
    /// Distances between simulated and extracted surfaces.
    pub surfaces: SurfaceTuning,
    /// Which particles are on the surface.
    pub membership: MembershipTuning,
    /// Widths of the Gaussians that draw the particles.
    pub splats: SplatTuning,
    /// How the body may differ from its reconstruction.
    pub shape: ShapeTuning,
    /// Steps and limits of the unknowns' coordinates.
    pub coordinates: CoordinateTuning,
    /// Levenberg-Marquardt.
    pub descent: DescentTuning,
    /// Weights of the residuals.
    pub noise: NoiseTuning,
    /// Stage 1.
    pub free_flight: FreeFlightTuning,
    /// Stage 2.
    pub search: SearchTuning,
    /// Stage 3.
    pub material: MaterialTuning,
    /// Stage 3 by the paper's optimiser.
    pub adam: AdamTuning,
    /// Stage 4.
    pub joint: JointTuning,
    /// Warnings and verdicts.
    pub verdicts: VerdictTuning,
}

impl Tuning {
    /// Whether no number differs from its default.
    pub fn is_default(&self) -> bool {
        *self == Tuning::default()
    }
}

/// Steps of the simulation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ResolutionTuning {
    /// Substeps of a frame on a grid of the reference spacing, at any frame rate; the finer the grid, the more. Every
    /// substep's transfers damp the motion a little, so other numbers of them find other parameters: 144 instead of 200
    /// cost 5 % of a bouncing solid's stiffness. Paper: its simulations'.
    pub substeps_per_frame: f64,
    /// The reference spacing of the grid [m]. Paper: its simulations'.
    pub grid_spacing_m: f64,
}

impl Default for ResolutionTuning {
    fn default() -> ResolutionTuning {
        ResolutionTuning { substeps_per_frame: 200.0, grid_spacing_m: 0.02 }
    }
}

/// Masks at the resolution at which they are compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MaskTuning {
    /// Most pixels of a picture, to a side, that are averaged into one: they are until a Gaussian's standard deviation
    /// is about one pixel. Budget: larger pictures of near bodies are rare.
    pub most_pooling: usize,
    /// Pixels around what is drawn that are compared, too, for hypotheses that differ by a small step. Derived: a step
    /// moves an outline by less.
    pub window_margin_px: usize,
}

impl Default for MaskTuning {
    fn default() -> MaskTuning {
        MaskTuning { most_pooling: 8, window_margin_px: 4 }
    }
}

/// Distances between simulated and extracted surfaces.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SurfaceTuning {
    /// Radius within which neighbours make the normal of an extracted point [cells]. Derived: two particle spacings.
    pub normal_radius_cells: f64,
    /// Beyond this, the extracted points themselves pull a particle, not the planes through them [cells]. Fitted on:
    /// the nine scenes.
    pub plane_reach_cells: f64,
    /// Beyond this, the particles themselves pull an extracted point, not the planes through them [cells]. Fitted on:
    /// the nine scenes.
    pub particle_plane_reach_cells: f64,
    /// About so many points take part per frame and direction at most. Budget: a tenth of the time of identification.
    pub most_points: usize,
    /// Points within this of an obstacle are in contact and do not count [cells]. Paper: its release ignores points
    /// near the ground.
    pub contact_margin_cells: f64,
    /// Where a point begins to count and where it counts fully, in units of the margin. Derived: they lie about the
    /// margin, so that nothing jumps.
    pub contact_fade: (f64, f64),
    /// Distances at the first frame beyond this are no offset between particles and their surface [cells]. Budget: they
    /// are errors of the reconstruction.
    pub calibration_reach_cells: f64,
    /// Residuals beyond this count linearly (Huber) [cells]. Fitted on: the nine scenes.
    pub huber_knee_cells: f64,
}

impl Default for SurfaceTuning {
    fn default() -> SurfaceTuning {
        SurfaceTuning {
            normal_radius_cells: 1.0,
            plane_reach_cells: 1.5,
            particle_plane_reach_cells: 1.0,
            most_points: 1500,
            contact_margin_cells: 1.0,
            contact_fade: (0.75, 1.25),
            calibration_reach_cells: 2.0,
            huber_knee_cells: 0.5,
        }
    }
}

/// Which particles are on the surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MembershipTuning {
    /// Radius within which a particle's neighbours decide [cells]. Derived: beyond the second neighbours of a lattice,
    /// short of the third.
    pub radius_cells: f64,
    /// How far from a particle its neighbours' centre lies where it begins to count as one of the surface, and from
    /// where it counts fully [radii]. Derived: in the middle of a lattice's flat face it is .16, in the next layer
    /// below .01.
    pub asymmetry: (f64, f64),
}

impl Default for MembershipTuning {
    fn default() -> MembershipTuning {
        MembershipTuning { radius_cells: 1.1, asymmetry: (0.06, 0.14) }
    }
}

/// Widths of the Gaussians that draw the particles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SplatTuning {
    /// Radius within which density is measured [particle spacings]. Derived: the smallest that averages over a lattice.
    pub density_radius_spacings: f64,
    /// Limits of the factor on a Gaussian's width by which it follows its neighbourhood's density. Fitted on: sand_1,
    /// sand_3.
    pub width_factors: (f32, f32),
}

impl Default for SplatTuning {
    fn default() -> SplatTuning {
        SplatTuning { density_radius_spacings: 2.0, width_factors: (0.8, 1.5) }
    }
}

/// How the body may differ from its reconstruction. Standard deviations are of the surface's position along its normal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ShapeTuning {
    /// Standard deviation where a camera sees the surface [particle spacings]. How far the matter that a particle
    /// stands for reaches beyond its centre is a convention to about a fifth of a spacing, in a simulation as in the
    /// pictures made of one. Fitted on: the nine scenes, whose outlines lie a quarter of a spacing inside their
    /// particles' cells.
    pub seen_deviation_spacings: f64,
    /// Standard deviation where no camera sees it [particle spacings]. Derived: half a spacing is what filling
    /// resolves.
    pub unseen_deviation_spacings: f64,
    /// By how much the standard deviation of what no camera sees grows per distance to what one sees. Fitted on: the
    /// nine scenes.
    pub unseen_deviation_per_distance: f64,
    /// Most that it grows so [particle spacings]. Fitted on: the nine scenes.
    pub most_unseen_growth_spacings: f64,
    /// Standard deviation of a common error of the whole surface [particle spacings]. Fitted on: the nine scenes, as
    /// that of what is seen.
    pub common_deviation_spacings: f64,
    /// Standard deviation of how much a reconstruction is rounded, edges cut and notches filled at once, per unit of
    /// bluntness (1/2 at a right-angled edge) [particle spacings]. Fitted on: the eight crosses, which lose 2 to 4 mm
    /// of their edges and have 5 to 10 mm too many in their notches.
    pub rounding_deviation_spacings: f64,
    /// Radius of the ball around a place whose emptiness tells whether it is an edge or a notch [particle spacings].
    /// Fitted on: the eight crosses.
    pub bluntness_radius_spacings: f64,
    /// Share of that ball which is full at a flat face, where the outermost particles lie half a spacing deep; a point
    /// counts by 1 - (d / radius)^2. Derived: 1/2 + 15/16 of that depth over the radius.
    pub bluntness_of_flat: f64,
    /// Distance over which errors are correlated [particle spacings]. Fitted on: the nine scenes.
    pub correlation_length_spacings: f64,
    /// Height over which the lowest tip fades out [particle spacings]. Derived: one layer of particles.
    pub tip_height_spacings: f64,
    /// Height over which all that touches first fades out [particle spacings]. Fitted on: the nine scenes.
    pub foot_height_spacings: f64,
    /// Reach of an anchor's displacement into the body [particle spacings]. Derived: the distance of anchors.
    pub displacement_reach_spacings: f64,
    /// Distance of anchors on the surface [particle spacings]. Budget: some hundred anchors.
    pub anchor_spacing_spacings: f64,
    /// Bodies with fewer anchors keep their shape. Budget: they have too few for the components.
    pub least_anchors: usize,
    /// Components with less than this share of the largest variance are left out. Budget: one rollout per component.
    pub least_variance_share: f64,
    /// A camera sees a place only where the cosine between its normal and the direction to the camera is larger. Fitted
    /// on: the nine scenes.
    pub least_facing_cosine: f64,
    /// A ray from a place to a camera ends in the body where it comes this near to a particle [particle spacings].
    /// Derived: a little below one spacing, and above the half that a lattice leaves free.
    pub ray_hit_distance_spacings: f64,
    /// Where a ray goes on by the distance to the nearest particle less this, it does not miss it [particle spacings].
    /// Derived: below the hit distance.
    pub ray_safe_distance_spacings: f64,
    /// First and least step of a ray [particle spacings]. Derived: below the hit distance.
    pub ray_step_spacings: f64,
    /// A ray leaves the body's neighbourhood at this distance [particle spacings]. Budget: larger than bodies are.
    pub ray_length_spacings: f64,
    /// Step of the finite differences that give a field's divergence [particle spacings]. Derived: a tenth of the
    /// fields' reach.
    pub divergence_step_spacings: f64,
    /// Anchors whose weight is below exp of minus this, relative to the nearest, do not displace a point. Budget: below
    /// rounding in f32.
    pub most_weight_exponent: f64,
}

impl Default for ShapeTuning {
    fn default() -> ShapeTuning {
        ShapeTuning {
            seen_deviation_spacings: 0.2,
            unseen_deviation_spacings: 0.5,
            unseen_deviation_per_distance: 0.25,
            most_unseen_growth_spacings: 2.0,
            common_deviation_spacings: 0.2,
            rounding_deviation_spacings: 0.6,
            bluntness_radius_spacings: 4.0,
            bluntness_of_flat: 0.62,
            correlation_length_spacings: 3.0,
            tip_height_spacings: 1.0,
            foot_height_spacings: 3.0,
            displacement_reach_spacings: 2.5,
            anchor_spacing_spacings: 2.5,
            least_anchors: 8,
            least_variance_share: 1e-3,
            least_facing_cosine: 0.25,
            ray_hit_distance_spacings: 0.75,
            ray_safe_distance_spacings: 0.7,
            ray_step_spacings: 0.5,
            ray_length_spacings: 200.0,
            divergence_step_spacings: 0.25,
            most_weight_exponent: 12.0,
        }
    }
}

/// Steps of one coordinate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Steps {
    /// Step of the finite differences. Derived: about 1 % of the value, or of what matters. Smaller ones drown in the
    /// rounding of f32 rollouts and in the return map's switches; at 1 % the derivative is off by a few per cent over
    /// 2,600 substeps, which costs Gauss-Newton a fraction of an iteration and does not move its fixed point to first
    /// order.
    pub difference: f64,
    /// Largest step of one iteration. Budget: beyond it the quadratic model says little.
    pub largest: f64,
}

/// Steps and limits of the unknowns' coordinates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CoordinateTuning {
    /// Moduli, stresses and viscosities [decades]. Derived: see [`Steps`].
    pub logarithmic: Steps,
    /// Poisson's ratio, by its logistic. Derived: see [`Steps`].
    pub bounded: Steps,
    /// The friction angle [units of 20 degrees]. Derived: see [`Steps`].
    pub linear: Steps,
    /// Initial velocity [m/s]. Derived: see [`Steps`].
    pub velocity_m_s: Steps,
    /// Initial angular velocity [rad/s]. Derived: see [`Steps`].
    pub angular_velocity_rad_s: Steps,
    /// Translation of all particles [m]. Derived: see [`Steps`].
    pub offset_m: Steps,
    /// Logarithm of the factor on the Gaussians' widths. Derived: see [`Steps`].
    pub log_splat_factor: Steps,
    /// Components of the shape [standard deviations]. Derived: see [`Steps`].
    pub shape: Steps,
    /// Largest component of the initial velocity [m/s]. Budget: faster than anything filmed.
    pub most_velocity_m_s: f64,
    /// Largest component of the initial angular velocity [rad/s]. Budget: faster than anything filmed.
    pub most_angular_velocity_rad_s: f64,
    /// Largest component of the translation [m]. Budget: further than any reconstruction is off.
    pub most_offset_m: f64,
    /// Largest logarithm of the factor on the Gaussians' widths. Budget: a factor of e.
    pub most_log_splat_factor: f64,
    /// Largest component of the shape [standard deviations]. Budget: four standard deviations do not happen.
    pub most_shape: f64,
}

impl Default for CoordinateTuning {
    fn default() -> CoordinateTuning {
        CoordinateTuning {
            logarithmic: Steps { difference: 0.005, largest: 0.5 },
            bounded: Steps { difference: 0.03, largest: 1.2 },
            linear: Steps { difference: 0.015, largest: 0.5 },
            velocity_m_s: Steps { difference: 2e-3, largest: 2.0 },
            angular_velocity_rad_s: Steps { difference: 1e-2, largest: 3.0 },
            offset_m: Steps { difference: 2e-4, largest: 0.05 },
            log_splat_factor: Steps { difference: 1e-2, largest: 0.2 },
            shape: Steps { difference: 0.15, largest: 1.0 },
            most_velocity_m_s: 100.0,
            most_angular_velocity_rad_s: 200.0,
            most_offset_m: 1.0,
            most_log_splat_factor: 1.0,
            most_shape: 4.0,
        }
    }
}

/// Levenberg-Marquardt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DescentTuning {
    /// Damping of the first step. Paper: Marquardt's is of this order.
    pub first_damping: f64,
    /// Ratio of the two dampings that are tried at once. Budget: as many as there are cores.
    pub damping_ratio: f64,
    /// Factor on the damping after a step that it allowed. Paper: Marquardt's.
    pub damping_decrease: f64,
    /// Least damping. Budget: less changes nothing.
    pub least_damping: f64,
    /// Damping at which a fit ends. Budget: steps are tiny then.
    pub most_damping: f64,
    /// A Jacobian that was carried along is measured anew when a step gains less than this share of what it predicted.
    /// Fitted on: the nine scenes.
    pub trusted_gain_share: f64,
    /// A fit ends when the quadratic model predicts less than this share of the least gain. Budget: such a step is the
    /// last one anyhow.
    pub least_predicted_share: f64,
    /// What a Jacobian that was carried along predicts is so uncertain that up to this many times the least gain are
    /// not worth measuring it anew. Budget: decision 26.
    pub remeasure_gain_ratio: f64,
    /// Least width of a Gaussian that a secant predicts, as a share of the present one. Budget: a guard.
    pub least_scale_share: f64,
    /// A fit that only hands over a start ends when every unknown moves by less than this many steps of the finite
    /// differences. Budget: the stage that follows goes on.
    pub rough_step_tolerance: f64,
    /// A fit that only hands over a start ends when the cost falls by less than this share. Budget: the stage that
    /// follows goes on.
    pub rough_gain_tolerance: f64,
}

impl Default for DescentTuning {
    fn default() -> DescentTuning {
        DescentTuning {
            first_damping: 1e-3,
            damping_ratio: 30.0,
            damping_decrease: 0.1,
            least_damping: 1e-6,
            most_damping: 1e6,
            trusted_gain_share: 0.5,
            least_predicted_share: 0.1,
            remeasure_gain_ratio: 4.0,
            least_scale_share: 0.1,
            rough_step_tolerance: 0.05,
            rough_gain_tolerance: 0.01,
        }
    }
}

/// Weights of the residuals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NoiseTuning {
    /// Weight of a pixel until the noise is known: the inverse square of an error of its alpha. Budget: free flight is
    /// fitted well with it.
    pub first_mask_weight: f64,
    /// Error of an extracted surface until the noise is known [cells]. Budget: free flight is fitted well with it.
    pub first_surface_error_cells: f64,
    /// Largest weight of a pixel. Derived: a thousandth of alpha is below what eight bits resolve.
    pub most_mask_weight: f64,
    /// Least error of an extracted surface [cells]. Derived: below the rounding of positions in f32.
    pub least_surface_error_cells: f64,
    /// How many times larger the errors of surfaces are after contact than their scatter shows: an extracted surface is
    /// wrong in one and the same way in all frames that resemble each other. And bodies that are completed by their
    /// mirror planes are so in flight only: what surfaces show there says little of those after contact. Fitted on: six
    /// of the nine scenes, whose errors are 3.1 times their standard errors when surfaces alone are fitted.
    pub surface_error_inflation: f64,
    /// The noise of a frame is measured with so many neighbours on each side: a frame alone is a small sample. Fitted
    /// on: the nine scenes.
    pub neighbouring_frames: usize,
    /// Errors of frames are correlated over this share of their number. Fitted on: the nine scenes.
    pub frames_per_lag: usize,
    /// Half-width of a 95 % interval in standard deviations. Derived: Student's t at 97.5 % for the ten-odd independent
    /// groups of residuals of a typical scene.
    pub student_t: f64,
}

impl Default for NoiseTuning {
    fn default() -> NoiseTuning {
        NoiseTuning {
            first_mask_weight: 100.0,
            first_surface_error_cells: 0.1,
            most_mask_weight: 1e6,
            least_surface_error_cells: 1e-3,
            surface_error_inflation: 3.0,
            neighbouring_frames: 1,
            frames_per_lag: 4,
            student_t: 2.2,
        }
    }
}

/// Stage 1: motion before contact.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FreeFlightTuning {
    /// A body that comes this near to an obstacle touches it [cells]. Derived: the reach of a particle's quadratic
    /// spline on the grid.
    pub contact_clearance_cells: f64,
    /// Most steps of a fit. Budget: free flight is in closed form, and cheap.
    pub iterations: usize,
    /// A fit ends when every unknown moves by less than this many steps of the finite differences. Budget: far below
    /// the error.
    pub step_tolerance: f64,
    /// A fit ends when the cost falls by less than this share. Budget: far below the error.
    pub gain_tolerance: f64,
    /// Extra pooling of the masks when the velocity is fitted first, at the second frame. Derived: outlines that do not
    /// overlap must pull.
    pub first_pooling: usize,
    /// Extra pooling of the masks at each later frame. Budget: the last fit is sharp.
    pub pooling: usize,
    /// Rotation shows when the cost with it is less than this share of that without. Fitted on: the nine scenes, which
    /// do not rotate.
    pub rotation_cost_share: f64,
    /// Rotation shows when one of its components is larger than so many standard errors. Fitted on: the nine scenes,
    /// which do not rotate.
    pub rotation_significance: f64,
}

impl Default for FreeFlightTuning {
    fn default() -> FreeFlightTuning {
        FreeFlightTuning {
            contact_clearance_cells: 1.5,
            iterations: 10,
            step_tolerance: 0.1,
            gain_tolerance: 1e-4,
            first_pooling: 8,
            pooling: 2,
            rotation_cost_share: 0.9,
            rotation_significance: 5.0,
        }
    }
}

/// Stage 2: starting points of the material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SearchTuning {
    /// Factor between the cells of the search and those of the estimate. Budget: a rollout costs a sixteenth.
    pub coarse_factor: f64,
    /// A coarse cell is a particle of the search when it is filled to this share. Derived: a corner that barely enters
    /// a cell would count as a whole one.
    pub least_filled_share: f64,
    /// Starts that are improved on the coarse grid. Budget: with the next a fifth of the search.
    pub coarse_fits: usize,
    /// Most steps of each. Budget: see above.
    pub coarse_iterations: usize,
    /// A coarse fit ends when the cost falls by less than this share. Budget: the grid is biased by more.
    pub coarse_gain_tolerance: f64,
    /// Points of the grid of starts are compared on the full grid until their particles are so many. The fewer
    /// particles there are, the less does the coarse grid resolve, and the cheaper is the full one. Budget: some
    /// seconds.
    pub full_grid_particles: usize,
    /// Least and most such points. Budget: some seconds.
    pub full_grid_points: (usize, usize),
    /// Starts from which the material is fitted on the full grid: as many as it has unknowns, but at least these.
    /// Fitted on: the nine scenes; the more unknowns, the more local minima.
    pub least_full_grid_fits: usize,
    /// Starts that cost so many times the best are left out. Fitted on: the nine scenes.
    pub most_cost_ratio: f64,
    /// Bodies of which fewer particles stay are searched with all of them. Budget: they are small.
    pub least_particles: usize,
    /// Rollouts between two moments at which the work may be stopped. Budget: some seconds.
    pub batch: usize,
}

impl Default for SearchTuning {
    fn default() -> SearchTuning {
        SearchTuning {
            coarse_factor: 2.0,
            least_filled_share: 0.25,
            coarse_fits: 3,
            coarse_iterations: 5,
            coarse_gain_tolerance: 0.02,
            full_grid_particles: 40_000,
            full_grid_points: (4, 16),
            least_full_grid_fits: 2,
            most_cost_ratio: 3.0,
            least_particles: 8,
            batch: 8,
        }
    }
}

/// Stage 3: the material with the motion of free flight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MaterialTuning {
    /// Extra pooling of the masks while the outlines may still be far apart, here and in the search: Gauss-Newton's
    /// steps reach about as far as the pictures are blurred, and a sharp outline would let it creep. Fitted on: the
    /// nine scenes.
    pub pooling: usize,
    /// Extra pooling of the masks that decide between minima that cost about the same. Fitted on: non_newtonian_2.
    pub sharp_pooling: usize,
    /// Steps from each start. Budget: the costs of plasticine_3's minima differ by 80 % after three.
    pub short_iterations: usize,
    /// Steps from the best of them. Fitted on: non_newtonian_2.
    pub long_iterations: usize,
    /// Steps with sharper masks. Budget: the joint stage goes on.
    pub sharp_iterations: usize,
    /// Steps before a fit may be given up. Budget: the first steps show little.
    pub least_iterations: usize,
    /// A short fit that costs so many times the best is given up. Fitted on: the nine scenes.
    pub give_up_cost_ratio: f64,
    /// Short fits that cost at most so many times the best go on, and so much may a neighbouring start cost. Fitted on:
    /// plasticine_3.
    pub continue_cost_ratio: f64,
    /// Minima that cost at most so many times the best are compared with sharper masks. Fitted on: plasticine_3,
    /// non_newtonian_2.
    pub sharpen_cost_ratio: f64,
    /// States whose coordinates differ by less lie in the same minimum [decades]. Fitted on: the nine scenes.
    pub same_minimum_distance: f64,
    /// How far from a minimum a fit starts again [decades]: first a factor of two in a modulus. Where that leads
    /// nowhere, one of 1.26: a stiff ring that comes down on its rim has minima that narrow. Fitted on:
    /// non_newtonian_2, torus, plasticine_3.
    pub restart_distances: (f64, f64),
    /// A neighbouring start counts when it costs less than the quadratic model predicts by this share: what a fit may
    /// leave where it ends. Derived: the tolerance of the fit.
    pub least_restart_gain_share: f64,
    /// Fits from neighbouring starts. Budget: each costs as much as a long fit.
    pub most_restarts: usize,
}

impl Default for MaterialTuning {
    fn default() -> MaterialTuning {
        MaterialTuning {
            pooling: 8,
            sharp_pooling: 2,
            short_iterations: 5,
            long_iterations: 14,
            sharp_iterations: 8,
            least_iterations: 2,
            give_up_cost_ratio: 3.0,
            continue_cost_ratio: 1.3,
            sharpen_cost_ratio: 1.05,
            same_minimum_distance: 0.2,
            restart_distances: (0.3, 0.1),
            least_restart_gain_share: 0.01,
            most_restarts: 3,
        }
    }
}

/// Stage 3 by the paper's optimiser.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AdamTuning {
    /// Learning rate of moduli, stresses and viscosities [decades]. Paper: section 4.3.
    pub rate: f64,
    /// Learning rate of the plastic viscosity [decades]. Paper: section 4.3.
    pub plastic_viscosity_rate: f64,
    /// Learning rate of Poisson's ratio. Paper: section 4.3.
    pub poisson_ratio_rate: f64,
    /// Learning rate of the friction angle [degrees]. Paper: section 4.3.
    pub friction_angle_rate_deg: f64,
    /// Failed rollouts after which the search ends with its best iterate. Budget: it has left where the simulator
    /// works.
    pub most_failures: usize,
    /// Factor on all rates after a failed rollout. Budget: as a line search halves its step.
    pub rate_after_failure: f64,
}

impl Default for AdamTuning {
    fn default() -> AdamTuning {
        AdamTuning {
            rate: 0.1,
            plastic_viscosity_rate: 0.05,
            poisson_ratio_rate: 0.02,
            friction_angle_rate_deg: 1.0,
            most_failures: 10,
            rate_after_failure: 0.5,
        }
    }
}

/// Stage 4: material, motion, splat size and shape together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct JointTuning {
    /// Most steps under the first weights. Budget: this fit only has to be good enough to weigh the frames anew.
    pub first_iterations: usize,
    /// That fit ends when the cost falls by less than this share. Budget: as above.
    pub first_gain_tolerance: f64,
    /// A fit ends when the cost falls by less than this. Derived: the cost is half of chi-squared, whose standard error
    /// is one.
    pub least_gain: f64,
    /// Standard deviation of the logarithm of the Gaussians' size about the one that fits free flight with the shape as
    /// reconstructed. Fitted on: the nine scenes.
    pub splat_deviation: f64,
}

impl Default for JointTuning {
    fn default() -> JointTuning {
        JointTuning { first_iterations: 5, first_gain_tolerance: 0.02, least_gain: 0.1, splat_deviation: 0.05 }
    }
}

/// Warnings and verdicts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VerdictTuning {
    /// Overlap of a camera's first mask with the particles' outline below which it shows something else. Budget: no
    /// right one is so wrong.
    pub wrong_overlap: f64,
    /// Median overlap of all cameras from which on a wrong one is recognised. Budget: the body is well reconstructed
    /// then.
    pub good_overlap: f64,
    /// Pixels, to a side, that are averaged into one for that. Budget: overlap needs no sharpness.
    pub overlap_pooling: usize,
    /// The model explains the frames after contact while their misfit is at most so many times that in flight, and the
    /// next. Fitted on: the nine scenes.
    pub most_misfit_ratio: f64,
    /// Pixels that may differ besides, as a share of the object's. Fitted on: the nine scenes, which differ in up to
    /// 7.4 %.
    pub mask_misfit: f64,
    /// Distance of surfaces that is allowed besides [cells]. Fitted on: the nine scenes.
    pub surface_misfit_cells: f64,
    /// An estimate this near to its limit is at it and not identified, in its coordinate. Derived: far below the step
    /// of the finite differences.
    pub limit_distance: f64,
}

impl Default for VerdictTuning {
    fn default() -> VerdictTuning {
        VerdictTuning {
            wrong_overlap: 0.5,
            good_overlap: 0.75,
            overlap_pooling: 2,
            most_misfit_ratio: 2.5,
            mask_misfit: 0.06,
            surface_misfit_cells: 0.5,
            limit_distance: 1e-3,
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;

    /// Calls `visit` with every number of a tree.
    fn numbers(tree: &mut Value, visit: &mut dyn FnMut(&mut Value)) {
        match tree {
            Value::Object(map) => map.values_mut().for_each(|value| numbers(value, visit)),
            Value::Array(list) => list.iter_mut().for_each(|value| numbers(value, visit)),
            number => visit(number),
        }
    }

    fn with_doubled(place: usize) -> (Value, usize) {
        let mut tree = serde_json::to_value(Tuning::default()).expect("a tree of numbers");
        let mut count = 0;
        numbers(&mut tree, &mut |number| {
            if count == place {
                *number = match number.as_u64() {
                    Some(whole) => (2 * whole).into(),
                    None => (2.0 * number.as_f64().expect("a number")).into(),
                };
            }
            count += 1;
        });
        (tree, count)
    }

    /// A program can vary each number by itself: every leaf of the tree is one, and is taken over as it is given.
    #[test]
    fn every_number_can_be_varied() {
        let (_, count) = with_doubled(usize::MAX);
        for place in 0..count {
            let (tree, _) = with_doubled(place);
            let varied: Tuning = serde_json::from_value(tree.clone()).expect("a tuning");
            assert_ne!(varied, Tuning::default());
            assert_eq!(serde_json::to_value(varied).expect("a tree of numbers"), tree);
        }
    }

    #[test]
    fn unknown_numbers_are_refused() {
        let tree = serde_json::json!({ "joint": { "least_gian": 0.2 } });
        assert!(serde_json::from_value::<Tuning>(tree).is_err());
    }
}
