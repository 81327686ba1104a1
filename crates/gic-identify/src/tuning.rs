//! Every tuned number of identification, in one tree that a program can read, vary and switch off.
//!
//! Each field says what it means, its unit, and where it comes from: `Derived`, `Paper`, `Budget` (of time or memory),
//! or `Fitted on` scenes. "The nine scenes" are those of the published simulations: elastic_0, elastic_2, torus,
//! plasticine_3, newtonian_2, newtonian_7, non_newtonian_2, sand_1 and sand_3; eight crosses that are mirror-symmetric
//! and a torus. Lengths are in cells of the simulation grid, in particle spacings (half a cell by default), or in
//! pixels at the resolution at which masks are compared.
//!
//! Ranges, grids and search coordinates of the material parameters stand in `unknowns/parameter.rs`, units of the other
//! unknowns in `unknowns/coordinates.rs`: they are facts of what is sought.

use serde::{Deserialize, Serialize};

/// How many of the nearest points of an extracted surface make up what a distance is measured from. One for a place in
/// a list of fixed length, so it is fixed when gic is built. Fitted on: elastic_0.
pub(crate) const NEAREST_SURFACE_POINTS: usize = 6;

/// Gaussians end at so many standard deviations, where they fall below exp(-8). It is part of inner loops, so it is
/// fixed when gic is built. Derived: an earlier end is a step that finite differences see.
pub(crate) const CUTOFF_SIGMAS: f32 = 4.0;

/// Variance of what is uniform over a step of one: the blur of the pixel itself [pixels^2], which is added to projected
/// variances, and the error of what is rounded. Derived: that of a box.
pub(crate) const STEP_VARIANCE: f32 = 1.0 / 12.0;

/// Every tuned number of identification.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tuning {
    /// Steps of the simulation.
    pub resolution: ResolutionTuning,
    /// Masks at the resolution at which they are compared.
    pub masks: MaskTuning,
    /// Surfaces of particles, and distances from the extracted ones.
    pub surfaces: SurfaceTuning,
    /// How the body may differ from its reconstruction.
    pub shape: ShapeTuning,
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
    /// Substeps of a frame times the spacing of the grid [m], at any frame rate: 200 on a grid of 0.02 m. Every
    /// substep's transfers damp the motion a little, so other numbers of them find other parameters: 144 instead of 200
    /// cost 5 % of a bouncing solid's stiffness. Paper: its simulations'.
    pub substeps_times_spacing_m: f64,
    /// Standard deviation of the logarithm of the factor on the side of the grid's cells. Derived: round spacings, of
    /// which the nearest is taken, lie a factor of 1.5 apart.
    pub log_cell_deviation: f64,
}

impl Default for ResolutionTuning {
    fn default() -> ResolutionTuning {
        ResolutionTuning { substeps_times_spacing_m: 4.0, log_cell_deviation: 0.4 }
    }
}

/// Masks at the resolution at which they are compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MaskTuning {
    /// Pixels, to a side, that are averaged into one while the outlines may still be far apart: Gauss-Newton's steps
    /// reach about as far as the pictures are blurred, and a sharp outline would let it creep. What is averaged away
    /// tells of the deformation. Fitted on: bunny_elastic, as a scene and filmed.
    pub blur_pooling: usize,
}

impl Default for MaskTuning {
    fn default() -> MaskTuning {
        MaskTuning { blur_pooling: 4 }
    }
}

/// Surfaces of particles, and distances from the extracted ones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SurfaceTuning {
    /// Radius within which a particle's neighbours tell how dense matter is and where its outside lies [particle
    /// spacings]. Derived: beyond the second neighbours along a lattice's axis, short of the next.
    pub neighbourhood_spacings: f64,
    /// How far from a particle its neighbours' centre lies where it is half inside, half one of the surface [radii].
    /// Derived: in the middle of a lattice's flat face it is .16, in the next layer below .01.
    pub asymmetry: f64,
    /// Part of a threshold over which it fades to both sides, so that nothing jumps. Derived: .16 and .01 of the above
    /// lie beyond.
    pub fade: f64,
    /// Points within this of an extracted point make its normal; beyond it, the points themselves pull, not the planes
    /// through them [cells]. Derived: three particle spacings, over which a surface is a plane.
    pub plane_radius_cells: f64,
    /// About so many points take part per frame and direction at most. Budget: a tenth of the time of identification.
    pub most_points: usize,
    /// Points within this of an obstacle are in contact and do not count [cells]. Paper: its release ignores points
    /// near the ground.
    pub contact_margin_cells: f64,
    /// Residuals beyond this count linearly (Huber) [cells]. Fitted on: the nine scenes.
    pub huber_knee_cells: f64,
}

impl Default for SurfaceTuning {
    fn default() -> SurfaceTuning {
        SurfaceTuning {
            neighbourhood_spacings: 2.2,
            asymmetry: 0.1,
            fade: 0.25,
            plane_radius_cells: 1.5,
            most_points: 1500,
            contact_margin_cells: 1.0,
            huber_knee_cells: 0.5,
        }
    }
}

/// How the body may differ from its reconstruction. Standard deviations are of the surface's position along its normal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ShapeTuning {
    /// Standard deviation of how much a reconstruction is rounded, edges cut and notches filled at once, per unit of
    /// bluntness (1/2 at a right-angled edge) [particle spacings]. Fitted on: the eight crosses, which lose 2 to 4 mm
    /// of their edges and have 5 to 10 mm too many in their notches.
    pub rounding_deviation_spacings: f64,
    /// Radius of the ball around a place whose emptiness tells whether it is an edge or a notch [particle spacings].
    /// Fitted on: the eight crosses.
    pub bluntness_radius_spacings: f64,
    /// Distance over which errors of what pictures tell are correlated, and height over which all that touches first
    /// fades out [particle spacings]. Fitted on: the nine scenes.
    pub correlation_length_spacings: f64,
    /// Distance of anchors on the surface, and reach of their displacement into the body [particle spacings]. Budget:
    /// some hundred anchors.
    pub anchor_spacing_spacings: f64,
    /// What the functionals leave is sought where a component moves the surface by at least this, root mean square of
    /// its standard deviation [particle spacings]. Budget: one rollout each.
    pub least_displacement_spacings: f64,
    /// At most so many components are sought, those that move the surface most. Budget: a surface that is poorly known
    /// all over has some hundred.
    pub most_components: usize,
}

impl Default for ShapeTuning {
    fn default() -> ShapeTuning {
        ShapeTuning {
            rounding_deviation_spacings: 0.6,
            bluntness_radius_spacings: 4.0,
            correlation_length_spacings: 3.0,
            anchor_spacing_spacings: 2.5,
            least_displacement_spacings: 0.015,
            most_components: 48,
        }
    }
}

/// Levenberg-Marquardt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DescentTuning {
    /// Step of the finite differences [units of the coordinates]. Smaller ones drown in the rounding of f32 rollouts
    /// and in the return map's switches; at 1 % the derivative is off by a few per cent over 2,600 substeps, which
    /// costs Gauss-Newton a fraction of an iteration and does not move its fixed point to first order. Derived: about
    /// 1 % of what matters.
    pub difference: f64,
    /// A Jacobian that was carried along may be measured anew when a step gains less than this share of what it
    /// predicted, and the fit may still gain enough by this share of what it predicts. A state belongs to a minimum
    /// where its cost rises by at least this share of what that one's quadratic model predicts, and by at most its
    /// inverse. Fitted on: the nine scenes.
    pub trusted_gain_share: f64,
    /// A fit that only hands over a start ends when the cost falls by less than this share. Budget: the stage that
    /// follows goes on.
    pub gain_tolerance: f64,
}

impl Default for DescentTuning {
    fn default() -> DescentTuning {
        DescentTuning { difference: 0.01, trusted_gain_share: 0.5, gain_tolerance: 0.01 }
    }
}

/// Weights of the residuals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NoiseTuning {
    /// How many times larger the errors of surfaces are after contact than their scatter shows: an extracted surface is
    /// wrong in one and the same way in all frames that resemble each other. And bodies that are completed by their
    /// mirror planes are so in flight only: what surfaces show there says little of those after contact. Fitted on: six
    /// of the nine scenes, whose errors are 3.1 times their standard errors when surfaces alone are fitted.
    pub surface_error_inflation: f64,
    /// Errors of frames are correlated over one in so many of them; so many of a frame's neighbours to each side help
    /// to measure its noise. Fitted on: the nine scenes.
    pub frames_per_lag: usize,
    /// By how many independent pieces of information the errors are known that priors and the flight have. Derived: the
    /// ten-odd frames whose outlines measure them.
    pub freedom: f64,
}

impl Default for NoiseTuning {
    fn default() -> NoiseTuning {
        NoiseTuning { surface_error_inflation: 3.0, frames_per_lag: 4, freedom: 10.0 }
    }
}

/// Stage 1: motion before contact.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FreeFlightTuning {
    /// Rotation shows when one of its components is larger than so many standard errors. Fitted on: 60 flights of
    /// fifteen bodies that do not rotate, seen by all, three and two cameras, in which it is 2.6 at most.
    pub rotation_significance: f64,
}

impl Default for FreeFlightTuning {
    fn default() -> FreeFlightTuning {
        FreeFlightTuning { rotation_significance: 5.0 }
    }
}

/// Stage 2: starting points of the material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SearchTuning {
    /// Factor between the cells of the search and those of the estimate. Budget: a rollout costs a sixteenth.
    pub coarse_factor: f64,
    /// Starts from which a fit takes a step. Budget: of 148 perfectly seen blocks of all laws 108 are recovered with
    /// two or three, 107 with five.
    pub starts: usize,
    /// Points of the grid of starts that are compared on the full grid, too. Budget: some seconds; of 70 perfectly seen
    /// blocks of plasticine 57 are recovered with half as many, 61 with these, 63 with twice as many.
    pub full_grid_points: usize,
}

impl Default for SearchTuning {
    fn default() -> SearchTuning {
        SearchTuning { coarse_factor: 2.0, starts: 3, full_grid_points: 16 }
    }
}

/// Stage 3: the material with the motion of free flight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MaterialTuning {
    /// Fits that cost at most so many times the best go on, and so much may a neighbouring start cost. Fitted on: 30
    /// blocks of plasticine, of which two more are recovered than with 1.3.
    pub most_cost_ratio: f64,
    /// Distances at which neighbours of a minimum are looked at: what changes the motion visibly, and each half of the
    /// one before. Budget: two rollouts each for every parameter. The minima of plasticine that yields at .5 % of
    /// strain lie a factor of 1.4 in Young's modulus apart.
    pub neighbour_distances: usize,
}

impl Default for MaterialTuning {
    fn default() -> MaterialTuning {
        MaterialTuning { most_cost_ratio: 2.0, neighbour_distances: 3 }
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
}

impl Default for AdamTuning {
    fn default() -> AdamTuning {
        AdamTuning { rate: 0.1, plastic_viscosity_rate: 0.05, poisson_ratio_rate: 0.02, friction_angle_rate_deg: 1.0 }
    }
}

/// Stage 4: material, motion and shape together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct JointTuning {
    /// A fit ends when the cost falls by less than this. Derived: the cost is half of chi-squared, whose standard error
    /// is one.
    pub least_gain: f64,
}

impl Default for JointTuning {
    fn default() -> JointTuning {
        JointTuning { least_gain: 0.1 }
    }
}

/// Warnings and verdicts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VerdictTuning {
    /// Overlap of a camera's first mask with the particles' outline below which it shows something else, and median
    /// overlap of all cameras below which none is known to be right. Budget: no right one is so wrong.
    pub wrong_overlap: f64,
}

impl Default for VerdictTuning {
    fn default() -> VerdictTuning {
        VerdictTuning { wrong_overlap: 0.5 }
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
