//! The evaluation as text.

use super::{Evaluation, FrameError, PictureError};
use gic_metrics::mean;

impl Evaluation {
    /// The evaluation as a table for people.
    pub fn table(&self) -> String {
        let mut text = format!(
            "{:<28} {:>12} {:>25} {:>12} {:>11}\n",
            self.model, "estimate", "95 % interval", "truth", "error x100"
        );
        for p in &self.parameters {
            let interval = format!("{:.4e} .. {:.4e}", p.interval_95[0], p.interval_95[1]);
            let verdict = match (p.identifiable, p.inside) {
                (false, _) => "  not determined",
                (true, true) => "",
                (true, false) => "  outside its interval",
            };
            text += &format!(
                "{:<28} {:>12.5e} {interval:>25} {:>12.5e} {:>11.2}  {}{verdict}\n",
                p.name, p.estimate, p.truth, p.error_x100, p.paper_name
            );
        }
        let v = &self.velocity;
        let vector = |v: [f64; 3]| format!("({:.4}, {:.4}, {:.4})", v[0], v[1], v[2]);
        text += &format!(
            "{:<28} {} m/s, truth {}, error x100 {:.2}, {} of 3 inside\n",
            "initial_velocity_m_s",
            vector(v.estimate_m_s),
            vector(v.truth_m_s),
            v.error_x100,
            v.inside
        );
        text += &self.frame_table();
        if let Some(r) = &self.registration {
            text += &format!(
                "registration off by {:.3} degrees, {:.2} mm at the object's centre, scale {:+.3} %\n",
                r.rotation_deg,
                1e3 * r.centre_m,
                100.0 * r.scale
            );
        }
        if let Some(error) = self.volume_error {
            text += &format!("volume {:+.2} %, ", 100.0 * error);
        }
        if let Some(error) = self.twin_volume_error {
            text += &format!("of the twin {:+.2} %, ", 100.0 * error);
        }
        text + &format!("masks re-rendered at the first frame: IoU {:.4}\n", self.mask_iou)
    }
}

/// A number, or a dash.
fn number(value: Option<f64>, decimals: usize) -> String {
    value.map_or("-".into(), |v| format!("{v:.decimals$}"))
}

/// Mean of what the frames have; `None` where one of them lacks it: the mean of some frames only would not be
/// comparable.
pub(crate) fn mean_of(frames: &[&FrameError], pick: &dyn Fn(&FrameError) -> Option<f64>) -> Option<f64> {
    let values = frames.iter().map(|f| pick(f)).collect::<Option<Vec<f64>>>()?;
    (!values.is_empty()).then(|| mean(values.into_iter()))
}

impl Evaluation {
    /// A line for each frame, and the means of frames that were fitted to and of those that were predicted.
    fn frame_table(&self) -> String {
        if self.frames.is_empty() {
            return String::new();
        }
        let mut text = format!(
            "\n{:<9} {:>9} {:>9} {:>7} {:>10} {:>9} {:>7} {:>8} {:>8} {:>8} {:>7} {:>7} {:>8} {:>7}\n",
            "frame",
            "CD filled",
            "predicted",
            "floor",
            "EMD filled",
            "predicted",
            "floor",
            "volume %",
            "mask IoU",
            "PSNR",
            "SSIM",
            "in box",
            "held out",
            "in box"
        );
        for f in &self.frames {
            text += &line(&f.frame.to_string(), &[f]);
        }
        let part = |observed: bool| self.frames.iter().filter(|f| f.observed == observed).collect::<Vec<_>>();
        for (name, frames) in [("observed", part(true)), ("future", part(false))] {
            if !frames.is_empty() && self.frames.len() > 1 {
                text += &line(name, &frames);
            }
        }
        text + "CD in 1e3 mm^2, EMD in m; volume and mask IoU of the filling; PSNR [dB] and SSIM of the twin's whole \
                pictures over black, PSNR also in the box around the object, and of the held-out cameras alone\n"
    }
}

/// The means of some frames as a line of the table.
fn line(name: &str, frames: &[&FrameError]) -> String {
    let of = |pick: &dyn Fn(&FrameError) -> Option<f64>| mean_of(frames, pick);
    let pictures = |pick: fn(&PictureError) -> f64| of(&|f| f.pictures.as_ref().map(pick));
    // The mean hides no sign of a single frame, and counts absolute errors otherwise.
    let volume = |f: &FrameError| f.volume_error.map(|v| 100.0 * if frames.len() > 1 { v.abs() } else { v });
    format!(
        "{name:<9} {:>9} {:>9} {:>7} {:>10} {:>9} {:>7} {:>8} {:>8} {:>8} {:>7} {:>7} {:>8} {:>7}\n",
        number(of(&|f| f.filling.map(|v| v[0])), 4),
        number(of(&|f| f.prediction.map(|v| v[0])), 4),
        number(of(&|f| Some(f.floor[0])), 4),
        number(of(&|f| f.filling.map(|v| v[1])), 4),
        number(of(&|f| f.prediction.map(|v| v[1])), 4),
        number(of(&|f| Some(f.floor[1])), 4),
        number(of(&volume), 2),
        number(of(&|f| f.mask_iou), 4),
        number(pictures(|p| p.psnr_db), 2),
        number(pictures(|p| p.ssim), 4),
        number(pictures(|p| p.box_psnr_db), 2),
        number(of(&|f| f.pictures.and_then(|p| p.held_out_psnr_db)), 2),
        number(of(&|f| f.pictures.and_then(|p| p.held_out_box_psnr_db)), 2),
    )
}
