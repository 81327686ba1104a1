//! What `gic eval` finds: a run against the truth, in the paper's units.

mod table;

use serde::{Deserialize, Serialize};

pub(crate) use table::mean_of;

/// A run against the truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Model of the material.
    pub model: String,
    /// Every parameter that was sought.
    pub parameters: Vec<ParameterError>,
    /// Initial velocity.
    pub velocity: VelocityError,
    /// Frames with true particles.
    pub frames: Vec<FrameError>,
    /// Volume of the reconstructed continuum over that of the truth, less one.
    pub volume_error: Option<f64>,
    /// The same of the twin, whose shape is fitted with its material.
    #[serde(default)]
    pub twin_volume_error: Option<f64>,
    /// Mean overlap of re-rendered masks at the first frame.
    pub mask_iou: f64,
    /// Where a scan was registered and the truth tells where it lies.
    #[serde(default)]
    pub registration: Option<RegistrationError>,
}

/// Error of a parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParameterError {
    /// Its key in `twin.json`.
    pub name: String,
    /// What the paper's table calls it.
    pub paper_name: String,
    /// The estimate.
    pub estimate: f64,
    /// Its 95 % interval.
    pub interval_95: [f64; 2],
    /// Whether the run says that the video determines it.
    pub identifiable: bool,
    /// The truth.
    pub truth: f64,
    /// Absolute error in the paper's unit: log10 (nu: as is; friction angle: radians), times 100.
    pub error_x100: f64,
    /// Whether the interval holds the truth.
    pub inside: bool,
}

/// Error of the initial velocity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VelocityError {
    /// The estimate [m/s].
    pub estimate_m_s: [f64; 3],
    /// The truth [m/s].
    pub truth_m_s: [f64; 3],
    /// Mean absolute error of its components, times 100.
    pub error_x100: f64,
    /// How many components lie in their interval.
    pub inside: usize,
}

/// One frame: distances of particle clouds, chamfer [1e3 mm^2] and earth mover's [m], and pictures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameError {
    /// Number of the frame.
    pub frame: usize,
    /// Whether the run was fitted to this frame; otherwise it is a prediction.
    pub observed: bool,
    /// The continuum filled from this frame's Gaussians against the truth; `None` for frames that were not fitted to.
    pub filling: Option<[f64; 2]>,
    /// The simulated twin against the truth, where it was simulated.
    pub prediction: Option<[f64; 2]>,
    /// Volume of the filled body over that of the truth in this frame, less one.
    pub volume_error: Option<f64>,
    /// Mean overlap of the re-rendered filled body with the masks.
    pub mask_iou: Option<f64>,
    /// Two samplings of the truth against each other: what a perfect answer would score.
    pub floor: [f64; 2],
    /// The twin's pictures, where it was simulated and has colours.
    pub pictures: Option<PictureError>,
}

/// Pictures of the twin against those of the video, both over black: means over cameras.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PictureError {
    /// PSNR of whole pictures [dB], as the paper measures.
    pub psnr_db: f64,
    /// SSIM of whole pictures.
    pub ssim: f64,
    /// PSNR inside the box around the object's mask [dB].
    pub box_psnr_db: f64,
    /// SSIM inside that box.
    pub box_ssim: f64,
    /// Overlap of alpha and mask.
    pub mask_iou: f64,
    /// `psnr_db` of the cameras whose pictures nothing was trained on; `None` where no camera was held out.
    #[serde(default)]
    pub held_out_psnr_db: Option<f64>,
    /// `box_psnr_db` of those cameras.
    pub held_out_box_psnr_db: Option<f64>,
}

/// Errors of a registration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RegistrationError {
    /// Angle between the rotations [degrees].
    pub rotation_deg: f64,
    /// How far the object's centre is placed from where it is [m]. (The translation itself depends on where the scan's
    /// origin lies.)
    pub centre_m: f64,
    /// Scale over the true one, less one.
    pub scale: f64,
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// An elastic body without parameters; of each frame, whether it was observed, and its chamfer distance.
    pub(crate) fn evaluation(values: &[(bool, f64)]) -> Evaluation {
        let pictures = PictureError {
            psnr_db: 30.0,
            ssim: 0.9,
            box_psnr_db: 0.0,
            box_ssim: 0.0,
            mask_iou: 0.0,
            held_out_psnr_db: None,
            held_out_box_psnr_db: None,
        };
        let frame = |(i, &(observed, v)): (usize, &(bool, f64))| FrameError {
            frame: i,
            observed,
            filling: None,
            prediction: Some([v, v / 10.0]),
            volume_error: None,
            mask_iou: None,
            floor: [0.0; 2],
            pictures: Some(pictures),
        };
        Evaluation {
            model: "elastic".into(),
            parameters: Vec::new(),
            velocity: VelocityError { estimate_m_s: [0.0; 3], truth_m_s: [0.0; 3], error_x100: 0.0, inside: 3 },
            frames: values.iter().enumerate().map(frame).collect(),
            volume_error: None,
            twin_volume_error: None,
            mask_iou: 1.0,
            registration: None,
        }
    }
}
