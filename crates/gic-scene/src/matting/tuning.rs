//! The numbers of matting against the background: meaning, unit, and where each comes from.

/// Least noise of a channel [1]. Derived: half a step of 8 bits.
pub(super) const MIN_NOISE: f32 = 0.5 / 255.0;
/// How far the filter that takes the noise away reaches [pixels], and how alike pixels are that it mixes, in standard
/// deviations of the noise. Budget: the nine neighbours take two thirds of the noise. Fitted on: film_ball and a
/// rendered film with noise, where 3 pixels and 3 deviations smear shadows into the object.
pub(super) const DENOISE_RADIUS_PX: usize = 1;
pub(super) const DENOISE_RANGE: f32 = 2.0;
/// Deepest shadow: the share of light that it takes. Fitted on: film_ball, where the ball touches the floor.
pub(super) const MAX_SHADOW_DEPTH: f32 = 0.85;
/// Most that the background grows brighter, as a depth. Derived: light that the object throws on the floor.
pub(super) const MIN_SHADOW_DEPTH: f32 = -0.05;
/// Share of the background's pixels in shadow. Fitted on: the filmed ball and torus; .05 and .2 give nearly the same.
pub(super) const SHADOW_SHARE: f32 = 0.1;
/// Spread of a shadow's tint over the picture, as a share of what the shadow takes, where too few pixels tell it.
/// Fitted on: film_ball, bear_sand, torus, elastic_0.
pub(super) const USUAL_TINT_SPREAD: f32 = 0.04;
/// Pixels in shadow that tell the spread. Derived: their median is then known to a tenth.
pub(super) const FEWEST_SHADOW_PIXELS: usize = 100;
/// The least spread. Fitted on: the filmed ball and torus.
pub(super) const MIN_TINT_SPREAD: f32 = 0.02;
/// The spread before the tint is known, and the largest. Derived: daylight and lamps differ by some tenths between
/// channels.
pub(super) const UNKNOWN_TINT_SPREAD: f32 = 0.1;
/// Coloured light that the object throws on the background, in units of full brightness. Measured: the most in the
/// nine scenes of PAC-NeRF.
pub(super) const REFLECTED_LIGHT: f32 = 0.012;
/// Depth from which a shadow tells its tint. Derived: shallower ones are less than the noise of films.
pub(super) const TELLING_DEPTH: f32 = 0.1;
/// Most that a shadow's tint differs from grey. Derived: lamps and daylight; more is an object.
pub(super) const MOST_TINT: f32 = 0.2;
/// Rounds of fitting the tint and the object's colours. Budget: further ones change few pixels.
pub(super) const TINT_FITS: usize = 5;
pub(super) const COLOUR_FITS: usize = 3;
/// Pixels of the background that do anything. Derived: no pixel is worth more than 7 of its neighbours' doubts.
pub(super) const STRAY_SHARE: f32 = 1e-3;
/// Share of pixels that the object covers, before it is known. Derived: the order of magnitude of filmed objects.
pub(super) const OBJECT_SHARE: f32 = 0.1;
/// Steps of a channel in the table of the object's colours. Derived: wider than the noise, narrower than a colour.
pub(super) const COLOUR_STEPS: usize = 16;
/// The object's pixels whose colours its other pixels do not tell. Derived: half of it may be unlike the rest.
pub(super) const NEW_COLOUR_SHARE: f32 = 0.5;
/// Cost of a border between two pixels of one colour, in units of the logarithm of a likelihood. Fitted on: film_ball,
/// a rendered film with noise, bear_sand, torus, elastic_0; 24 is as good, 4 leaves holes where the object looks like
/// the background, and 32 loses a small object.
pub(super) const BORDER_COST: f32 = 16.0;
