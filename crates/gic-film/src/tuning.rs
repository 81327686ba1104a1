//! The numbers of reading films: meaning, unit, and where each comes from.

// The empty scene.

/// Fewest frames that tell the empty scene. Derived: two that agree and one that does not.
pub(crate) const MIN_FRAMES: usize = 3;
/// Most frames that the empty scene is made from. Budget: the work grows with their square.
pub(crate) const MAX_SAMPLES: usize = 32;
/// Memory for them [bytes]. Budget: 32 frames of full HD are a fifth of it.
pub(crate) const SAMPLE_BYTES: usize = 1_000_000_000;
/// Least noise of a channel [1]. Derived: half a step of 8 bits.
pub(crate) const MIN_NOISE: f32 = 0.5 / 255.0;
/// Colours within this many standard deviations are the same. Derived: one in 370 pixels is further off.
pub(crate) const SAME_COLOUR_NOISES: f32 = 3.0;
/// A pixel has changed by this many standard deviations. Derived: one in 16,000 pixels by chance.
pub(crate) const CHANGE_NOISES: f32 = 4.0;
/// Least change of a pixel [1]. Derived: two steps of 8 bits, as much as a codec's blocks differ.
pub(crate) const LEAST_CHANGE: f32 = 2.0 / 255.0;
/// Smallest region that an object can have left [pixels]. Derived: less is noise.
pub(crate) const LEAST_REGION_PX: usize = 16;
/// Pixels this far apart across a border show its contrast [pixels]. Derived: the width of a blurred outline.
pub(crate) const OUTLINE_REACH_PX: usize = 3;
/// The first and the last of so many parts of the film show what rests in them. Derived: long enough for a colour that
/// frames share, short enough to be over before the object rests.
pub(crate) const SHARING_PART: usize = 4;
/// A colour is the empty scene's if this part of the frames share it. Derived: an object that is not at rest covers a
/// pixel in fewer frames.
pub(crate) const CLOSING_SHARE: usize = 8;
