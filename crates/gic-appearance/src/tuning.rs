//! The numbers of this crate that are not settings: meaning, unit, and where each comes from.
//!
//! The origin is the last sentence: derived, from a paper, a budget of time or memory, or fitted on scenes.

const RADIANS_PER_DEGREE: f64 = std::f64::consts::PI / 180.0;

// The twin's colours.

/// Pixels around the mask in which what is drawn counts. Derived: SSIM's window of 11 fits in.
pub(crate) const WINDOW_MARGIN_PX: usize = 12;
/// Opacities stay below this, so that their logits stay finite. Paper: the cap of alpha in Kerbl et al. 2023.
pub(crate) const MAX_OPACITY: f64 = 0.99;
/// What a Gaussian's neighbours say of its albedo, in pixels that say the same. Derived: one, the least that a picture
/// can say; what is seen covers hundreds.
pub(crate) const NEIGHBOUR_PIXELS: f64 = 1.0;
/// Sweeps that carry albedo into what no picture shows. Budget: as many layers of Gaussians, several times a body's.
pub(crate) const HIDDEN_SWEEPS: usize = 100;

// The scan's points and the outlines of the masks.

/// A scan with fewer opaque Gaussians is refused. Budget: too few for an outline.
pub(crate) const MIN_OPAQUE_GAUSSIANS: usize = 100;
/// At most this many points of the scan are drawn for an outline. Budget: thousands of starts in seconds.
pub(crate) const MAX_OUTLINE_POINTS: usize = 2_500;
/// Gaussians of less opacity are no part of the outline. Derived: below it, two of them leave half of the light.
pub(crate) const MIN_OUTLINE_OPACITY: f32 = 0.3;
/// Side of a square with the mask's area, in cells of the outline. Derived: fine enough for limbs, coarse enough that
/// [`MAX_OUTLINE_POINTS`] leave no holes.
pub(crate) const CELLS_ACROSS_MASK: f64 = 20.0;
/// Room around the mask, in sizes of the mask. Derived: a scan that starts beside the mask is still seen.
pub(crate) const OUTLINE_MARGIN: f64 = 0.5;
/// The first radius of the scan, as a share of the object's ball: a root mean square against a radius that holds all.
/// Derived: that of a ball's volume is sqrt(3/5) = .77, of bodies with limbs less.
pub(crate) const FIRST_SIZE_SHARE: f64 = 0.7;
/// Rounds of moving and growing a start so that its outlines lie on the masks'. Budget: each draws all outlines once.
pub(crate) const ALIGNMENT_ROUNDS: usize = 4;

// The choice among placements.

/// Starts nearer than this to a better one lead to the same place [rad]. Derived: above the covering's 16 degrees.
pub(crate) const START_SEPARATION_RAD: f64 = 25.0 * RADIANS_PER_DEGREE;
/// Fits nearer than this are the same [rad]. Derived: half of the covering's 16 degrees.
pub(crate) const SAME_PLACEMENT_RAD: f64 = 8.0 * RADIANS_PER_DEGREE;
/// Rays to the object closer together than this do not tell its size from its distance [rad]. Derived: one pixel of
/// an outline 100 pixels wide then moves the object by two fifths of its radius.
pub(crate) const MIN_BASELINE_RAD: f64 = 3.0 * RADIANS_PER_DEGREE;
/// Fits of the second round. Budget: each costs several of the first round.
pub(crate) const FINALISTS: usize = 3;

// The fit to the pictures.

/// Pictures of the first fits are at most this wide across the object [pixels]. Budget: such pictures cost a fraction
/// of whole ones.
pub(crate) const COARSE_OBJECT_PX: f64 = 90.0;
/// Length of a step of the first fits, first and last: turn [rad], shift in radii of the object. Fitted on:
/// Spring-Gaus' real captures.
pub(crate) const COARSE_RATES: (f64, f64) = (3e-2, 3e-3);
/// The same of the second fits. Fitted on: Spring-Gaus' real captures.
pub(crate) const FINE_RATES: (f64, f64) = (6e-3, 1e-4);
/// The logarithm of the size changes by this share of the turn's step. Derived: then all seven numbers move pictures
/// alike.
pub(crate) const SIZE_STEP_SHARE: f64 = 0.5;
/// A colour of the scan is at most this many times brighter or darker than the video's. Derived: what cameras differ
/// by.
pub(crate) const MAX_CHANNEL_GAIN: f64 = 10.0;
