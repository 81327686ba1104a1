//! The numbers of training that are not settings ([`crate::TrainSettings`]): meaning, unit, and where each comes from.
//!
//! The origin is the last sentence: derived, from a paper, a budget of time or memory, or fitted on scenes.

// The first Gaussians.

/// Never start with, or stay below, fewer Gaussians than this. Budget: too few to show a body at all.
pub(crate) const MIN_GAUSSIANS: usize = 100;
/// A sparse point belongs to the object if more than this share of the masks of the pictures that see it show it.
/// Derived: a mask misses single points near its outline; a point of the background is outside most masks.
pub(crate) const SPARSE_POINT_MASK_SHARE: f64 = 0.9;
/// The spacing of sparse points is the median of about this many. Budget: the search is quadratic.
pub(crate) const SPACING_SAMPLE: usize = 500;
/// The visual hull is carved from at most this many pictures, evenly spread. Budget: more change its surface by little.
pub(crate) const MAX_HULL_VIEWS: usize = 64;
/// Cells along the hull for the first carving, which counts its surface cells. Budget: a fraction of the second
/// carving.
pub(crate) const COARSE_HULL_RESOLUTION: usize = 40;
/// Fewest cells along the hull of the second carving. Derived: one block of the carving.
pub(crate) const MIN_HULL_RESOLUTION: usize = 8;
/// Most cells along the hull of the second carving. Budget: 64 million cells.
pub(crate) const MAX_HULL_RESOLUTION: usize = 400;
/// A point belongs to the hull of a moving object seen by one camera at a time unless more than this share of the
/// pictures miss it. Fitted on: D-NeRF mutant.
pub(crate) const TOLERATED_MISS_SHARE: f64 = 0.3;

// Smoothing over neighbours.

/// Neighbours of each point before the relation is made symmetric. Derived: a point of a square sheet has eight around
/// it.
pub(crate) const NEIGHBOURS: usize = 8;
/// The search for neighbours looks this many spacings far at least. Derived: the eight of a square sheet lie within
/// 1.5.
pub(crate) const SEARCH_RADIUS_SPACINGS: f64 = 2.0;
/// Conjugate gradients stop at this residual, relative to the right-hand side. Budget: a preconditioner need not be
/// exact.
pub(crate) const SMOOTHING_TOLERANCE: f64 = 1e-2;
/// Most steps of conjugate gradients. Derived: four times the bound for four spacings, sqrt(33) / 2 ln 200 = 15.
pub(crate) const MAX_SMOOTHING_ITERATIONS: usize = 60;

// Parameters of Gaussians.

/// The halves of a split Gaussian are this many times smaller. Paper: Kerbl et al. 2023, section 5.2.
pub(crate) const SPLIT_SHRINKAGE: f32 = 1.6;
/// Harmonics above degree 0 learn this many times slower than that of degree 0. Paper: Kerbl et al. 2023, released
/// code.
pub(crate) const SH_REST_SLOWDOWN: f64 = 20.0;

// The loss of a picture.

/// Smallest area that picture terms are divided by, as a share of the window: an almost empty mask must not dominate.
/// Derived: an object fills more than this of its own window.
pub(crate) const MIN_AREA_SHARE: f64 = 0.02;

// The base motion.

/// Cells of the lattice along the longest side of the points' box. Fitted on: PAC-NeRF elastic_2.
pub(crate) const CELLS_ALONG_LONGEST_SIDE: f64 = 10.0;
/// Neighbouring nodes of the lattice share their pull over about this many cells. Derived: the width of a trilinear
/// weight.
pub(crate) const LATTICE_SMOOTHING_CELLS: f64 = 1.0;
/// Learning rate of the first fit of a frame's affine map, first and last step; shifts in widths of the object. Fitted
/// on: PAC-NeRF elastic_0.
pub(crate) const TRACKING_MAP_RATE: (f64, f64) = (1.5e-2, 1.5e-3);
/// The same of its bend. Fitted on: PAC-NeRF elastic_0.
pub(crate) const TRACKING_BEND_RATE: (f64, f64) = (4.0e-3, 8.0e-4);
/// Views per step of these fits. Budget: two are faster, and lose the spray of PAC-NeRF sand_1.
pub(crate) const TRACKING_VIEWS_PER_STEP: usize = 4;
/// An affine map explains a frame whose loss is at most this many times the first frame's. Fitted on: PAC-NeRF
/// elastic_2.
pub(crate) const EXPLAINED_LOSS_RATIO: f64 = 1.5;

// The network.

/// Length of the network's unit, in radii of the object's ball at the first frame. Derived: the object stays within one
/// unit of its centre while it moves by half its size.
pub(crate) const NETWORK_UNIT_RADII: f64 = 2.0;
/// The motion bases' output layer starts this many times smaller than the others. Derived: almost no motion at first.
pub(crate) const BASES_OUTPUT_GAIN: f64 = 0.01;
/// Steps over which the network's learning rate rises to its full value. Derived: a tenth of Adam's memory of second
/// moments.
pub(crate) const NETWORK_RISE_STEPS: f64 = 100.0;

// Progress.

/// Weight of the newest step in the moving average of the loss. Derived: averages over fifty steps.
pub(crate) const LOSS_AVERAGE_WEIGHT: f64 = 0.02;
/// A smaller gain on the held-out views does not count as progress [dB]. Budget: steps that gain less are not worth
/// their time.
pub(crate) const MIN_PROGRESS_DB: f64 = 0.02;
/// Nor does a smaller relative gain of the mean loss, where nothing is held out. Budget: as [`MIN_PROGRESS_DB`].
pub(crate) const MIN_PROGRESS_LOSS: f64 = 0.005;
