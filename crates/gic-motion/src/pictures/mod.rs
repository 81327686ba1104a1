//! The pictures to reproduce, and the loss of a rendered one.

mod ball;
mod loss;
mod targets;
mod window;

pub use ball::{Ball, ball, mask_centre};
pub use loss::{PictureLoss, picture_loss, psnr};
pub use targets::{Bounds, Target, first_frame, held_out, training, windowed};
pub use window::drawn_bounds;
