//! Metrics of the field: PSNR, SSIM (with its gradient), mask overlap, chamfer distance and earth mover's distance.
//!
//! Images are row-major from the top left, RGB in [0, 1], shape [height * width, 3]; masks are coverage in [0, 1],
//! shape [height * width]; point clouds are in metres, shape [n, 3]. Every random choice takes a seed, and every
//! reduction has a fixed order, so that a number can be made again.

mod assignment;
mod cloud;
mod error;
mod image;
mod ssim;
mod statistics;

pub use assignment::{Assignment, assign};
pub use cloud::{
    CHAMFER_POINTS, CloudMetrics, EMD_POINTS, chamfer, compare_clouds, earth_mover, noise_floor, sample_points,
    sample_volume,
};
pub use error::MetricError;
pub use image::{Rectangle, mask_iou, psnr, soft_iou};
pub use ssim::{ssim, ssim_with_gradient};
pub use statistics::{mean, mean_and_variance};
