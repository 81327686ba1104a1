//! The numbers of reading films: meaning, unit, and where each comes from.

// The empty scene.

/// Fewest frames that tell the empty scene. Derived: two that agree and one that does not.
pub(crate) const MIN_FRAMES: usize = 3;
/// Most frames that the empty scene is made from. Budget: the work grows with their square.
pub(crate) const MAX_SAMPLES: usize = 32;
/// Memory for them [bytes]. Budget: 32 frames of full HD are a fifth of it.
pub(crate) const SAMPLE_BYTES: usize = 1_000_000_000;
/// Least noise of a pixel [1]. Derived: a step of 8 bits, which codecs leave between their blocks.
pub(crate) const MIN_NOISE: f32 = 1.0 / 255.0;
/// A pixel's noise is at most that of so many pixels. Derived: an object covers a pixel for half of a film in less than
/// a twentieth of the picture.
pub(crate) const NOISE_SHARE: f64 = 0.95;
/// Colours within this many standard deviations are the same. Derived: one in 370 pixels is further off.
pub(crate) const SAME_COLOUR_NOISES: f32 = 3.0;
/// A pixel has changed by this many standard deviations. Fitted on: the filmed ball, as GIF and as H.264.
pub(crate) const CHANGE_NOISES: f32 = 3.0;
/// Least change of a pixel [1]. Fitted on: the filmed ball as H.264, whose still pixels drift by less.
pub(crate) const LEAST_CHANGE: f32 = 6.0 / 255.0;
/// Smallest region that an object can have left [pixels]. Derived: less is noise.
pub(crate) const LEAST_REGION_PX: usize = 16;
/// Pixels this far apart across a border show its contrast [pixels]. Derived: the width of a blurred outline.
pub(crate) const OUTLINE_REACH_PX: usize = 3;
/// The first and the last of so many parts of the film show what rests in them. Derived: long enough for a colour that
/// frames share, short enough to be over before the object rests.
pub(crate) const SHARING_PART: usize = 4;
/// What rests in a part of the film has its colour in this share of the part's frames. Fitted on: the filmed ball.
pub(crate) const RESTING_SHARE: f32 = 0.75;
/// Fewest frames in such a part. Derived: two could agree by chance.
pub(crate) const FEWEST_SHARING: usize = 3;
/// Outlines are weaker below this share of the others. Derived: half-way between none and alike.
pub(crate) const CLEARER_OUTLINE: f64 = 0.7;
/// A region is a soft shadow where the contrast of its outline is below this share of its change. Fitted on: the
/// filmed ball's shadows.
pub(crate) const SOFT_OUTLINE: f64 = 0.5;
/// In films of fewer frames each is looked at alone. Derived: in longer ones something moves on within a part.
pub(crate) const SHORT_FILM: usize = 16;
/// A colour is the empty scene's if this part of the frames share it. Derived: an object that is not at rest covers a
/// pixel in fewer frames.
pub(crate) const CLOSING_SHARE: usize = 8;

// Alignment.

/// Width and height to which films shrink to look for a flash [pixels]. Derived: a flash is everywhere.
pub(crate) const FLASH_SIZE_PX: (usize, usize) = (32, 24);
/// Least step of the brightness that is a flash [1]. Derived: lamps flicker by less.
pub(crate) const LEAST_FLASH: f32 = 0.05;
/// A flash or clap is clear where it is this many times as strong as the next one. Derived: the next could be it where
/// both are alike.
pub(crate) const CLEAR_RATIO: f32 = 2.0;
/// Rate at which sound is looked at [Hz]. Derived: a fiftieth of a millisecond.
pub(crate) const SOUND_RATE_HZ: usize = 48_000;
/// Windows in which sound has an amplitude [samples]. Derived: a millisecond.
pub(crate) const SOUND_WINDOW: usize = SOUND_RATE_HZ / 1000;
/// A clap rises out of the quiet of so many windows before. Derived: it begins within a few milliseconds.
pub(crate) const QUIET_WINDOWS: usize = 20;
/// Echoes of a clap last so many windows. Derived: a large room.
pub(crate) const ECHO_WINDOWS: usize = 300;
/// A clap begins where the sound reaches this share of its amplitude. Derived: far above the quiet before.
pub(crate) const ONSET_SHARE: f32 = 0.3;
/// Least amplitude of a clap, full scale being 1. Derived: above the rounding of 16 bits and of codecs.
pub(crate) const LEAST_CLAP: f32 = 0.01;

// Scenes.

/// Small pictures in a row of a sheet. Budget: two thousand pixels wide.
pub(crate) const SHEET_COLUMNS: usize = 12;
/// Pictures of two cameras this share of a period apart are simultaneous. Derived: a body that falls by its own size
/// between two frames moves by a hundredth of it.
pub(crate) const SIMULTANEOUS_SHARE: f64 = 0.01;

// Masks.

/// Cells along the hull by which masks are compared. Budget: two hundred carvings in a second or two.
pub(crate) const HULL_RESOLUTION: usize = 48;
/// Below this overlap with the hull a mask is doubtful. Derived: as `gic inspect` judges cameras.
pub(crate) const GOOD_OVERLAP: f64 = 0.9;
/// A mask is doubtful if the others overlap by this much better without it. Derived: as `gic inspect` judges cameras.
pub(crate) const TELLING_GAIN: f64 = 0.03;
