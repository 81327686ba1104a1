//! The numbers of calibration: meaning, unit, and where each comes from.

// Detection.

/// Pictures are enlarged until their longer side has so many pixels. Budget: a quarter of a second a picture.
pub(crate) const LARGEST_ENLARGED_PX: usize = 1_600;
/// Most times that pictures are enlarged. Fitted on: film_ball, where more finds no more.
pub(crate) const MOST_ENLARGED: usize = 4;
/// Most bits of a tag that are read wrongly. Derived: 36h11 tells tags apart by 11, and two leave no doubt.
pub(crate) const MOST_WRONG_BITS: u32 = 1;
/// Least contrast of a tag's bits to the threshold between them [grey levels]. Derived: above the noise of pictures.
pub(crate) const LEAST_DECISION_MARGIN: f32 = 10.0;
/// Frames that are averaged for a still board. Budget: noise falls by six, a second a film.
pub(crate) const STILL_FRAMES: usize = 36;
/// A still board's corners move by less between the first and the last frame [pixels]. Derived: more is read as blur.
pub(crate) const STILL_SHIFT_PX: f64 = 1.0;
/// Most moments of a moving board. Budget: a minute for four cameras.
pub(crate) const MOVING_MOMENTS: usize = 24;

// Alignment of a tag's pattern.

/// Shortest side of a tag that is aligned [pixels]. Fitted on: film_ball, where smaller ones are not found.
pub(crate) const LEAST_SIDE_PX: f64 = 5.0;
/// White around a tag that takes part [modules]. Derived: boards leave a module of white.
pub(crate) const ALIGN_MARGIN_MODULES: f64 = 0.75;
/// Most pixels of a tag that take part. Budget: twenty milliseconds a tag.
pub(crate) const ALIGN_MOST_PIXELS: f64 = 900.0;
/// Steps for derivatives by corners and blur [pixels]. Derived: wider than the places that the blur is summed over.
pub(crate) const ALIGN_DIFFERENCE_PX: f64 = 0.1;
/// See [`ALIGN_DIFFERENCE_PX`].
pub(crate) const BLUR_DIFFERENCE_PX: f64 = 0.1;
/// Blur to begin with [pixels]. Derived: that of a sharp picture.
pub(crate) const FIRST_BLUR_PX: f64 = 0.6;
/// Least correlation of pattern and picture. Fitted on: film_ball, where other tags have less.
pub(crate) const LEAST_CORRELATION: f64 = 0.75;
/// Corners are found within so many modules. Derived: beyond a module the bits' pattern is ambiguous.
pub(crate) const MOST_SHIFT_MODULES: f64 = 1.0;

/// Guessed tags are looked for within so many half modules. Fitted on: film_ball, whose second camera begins with two.
pub(crate) const SEARCH_STEPS: i32 = 5;

// Start.

/// Focal lengths that are tried, in widths of the picture, lowest and highest. Derived: views of 110 to 17 degrees.
pub(crate) const FOCAL_RANGE_WIDTHS: [f64; 2] = [0.35, 3.5];
/// Focal lengths that are tried. Derived: a tenth apart.
pub(crate) const FOCAL_TRIALS: usize = 25;

// Bundle adjustment: standard deviations of what is known without pictures.

/// Logarithm of the focal length in widths. Derived: all usual lenses lie within two deviations.
pub(crate) const FOCAL_SD: f64 = 0.7;
/// Ratio of the focal lengths, as a logarithm. Fitted on: film_ball, by its reference.
pub(crate) const ASPECT_SD: f64 = 0.001;
/// Principal point, as a share of the width. Fitted on: film_ball, by its reference.
pub(crate) const PRINCIPAL_SD_WIDTHS: f64 = 0.005;
/// Radial distortion k1. Fitted on: the filmed ball; phones have less, webcams up to four times as much.
pub(crate) const K1_SD: f64 = 0.1;
/// Radial distortion k2, with many views. Fitted on: as k1.
pub(crate) const K2_SD: f64 = 0.1;
/// Tangential distortion p1 and p2, with many views. Derived: lenses are centred.
pub(crate) const TANGENTIAL_SD: f64 = 1e-3;
/// The same, and k2, with few views: none. Fitted on: film_ball, where one view trades them for tilt and focal length.
pub(crate) const UNTOLD_SD: f64 = 1e-6;
/// Views of a board in different places that tell all of a lens. Derived: Zhang (2000) has the least errors from 5 on.
pub(crate) const MANY_VIEWS: usize = 5;

// Bundle adjustment: noise.

/// Least noise of a corner [pixels]. Derived: what rendered boards reach.
pub(crate) const LEAST_NOISE_PX: f64 = 0.01;
/// Corners count fully within so many deviations, and by less beyond (Cauchy's loss). Derived: 95 % efficient.
pub(crate) const CAUCHY_NOISES: f64 = 2.385;
/// Corners further off than so many deviations are left out. Derived: one in 270,000 by chance.
pub(crate) const OUTLIER_NOISES: f64 = 5.0;
/// Rounds of noise and weights. Budget: the noise settles within five.
pub(crate) const NOISE_ROUNDS: usize = 6;
/// Most steps of a round. Budget: twice what films take.
pub(crate) const MOST_STEPS: usize = 60;
/// A round ends with a step that gains less than this share. Derived: a hundredth of a deviation.
pub(crate) const CONVERGED_GAIN: f64 = 1e-6;
/// Most searches for tags that detection left out. Fitted on: film_ball, where the sixth finds none.
pub(crate) const GUIDED_ROUNDS: usize = 10;

// Report.

/// Above this a camera is warned of [pixels]. Fitted on: the filmed ball, of which half is left over.
pub(crate) const HIGH_RMS_PX: f64 = 0.5;
/// Residuals are drawn so many times as long. Derived: a quarter of a pixel is seen.
pub(crate) const ARROW_TIMES: f64 = 40.0;
/// Width to which small pictures are enlarged for drawing [pixels]. Budget: a page's width.
pub(crate) const DRAWING_WIDTH_PX: usize = 1_200;
/// A focal length is unsure beyond this share. Derived: it moves a camera by the same share of its distance.
pub(crate) const UNSURE_FOCAL_SHARE: f64 = 0.02;
