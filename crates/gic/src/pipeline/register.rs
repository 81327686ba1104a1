//! The stage `register`: where the scan of the object lies in the first frame of the video.

use std::ops::ControlFlow;

use gic_motion::{Candidate, Registration, register};
use gic_scene::Similarity;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use super::{Run, Stage};
use crate::atomic;
use crate::error::{Error, Result};

/// An alternative is as good as the best where its loss is at most this many times the best one's.
const AS_GOOD: f64 = 1.25;
/// Alternatives that a message names.
const NAMED: usize = 3;

/// `registration.json`: from the scan's frame to the world of the video.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RegistrationRecord {
    /// What the best placement is.
    #[serde(flatten)]
    pub best: PlacementRecord,
    /// Names of the cameras, in the order of the overlaps.
    pub cameras: Vec<String>,
    /// The next best that differ, best first.
    pub alternatives: Vec<PlacementRecord>,
}

/// x_video = scale * rotation * x_scan + translation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlacementRecord {
    /// The 4x4 matrix of all three, row by row.
    pub matrix: [[f64; 4]; 4],
    /// Metres per unit of the scan.
    pub scale: f64,
    /// Rotation matrix, row by row.
    pub rotation: [[f64; 3]; 3],
    /// Translation [m].
    pub translation_m: [f64; 3],
    /// Overlap with the mask of each camera, intersection over union.
    pub mask_iou: Vec<f64>,
    /// Mean loss over the cameras.
    pub loss: f64,
    /// Angle to the best one's rotation [degrees].
    pub apart_deg: f64,
}

impl PlacementRecord {
    fn new(candidate: &Candidate) -> Self {
        let Similarity { scale, rotation, translation } = candidate.similarity;
        Self {
            matrix: candidate.similarity.matrix(),
            scale,
            rotation: rotation.transpose().to_cols_array_2d(),
            translation_m: translation.into(),
            mask_iou: candidate.iou.clone(),
            loss: candidate.loss,
            apart_deg: candidate.apart_rad.to_degrees(),
        }
    }

    /// The transformation.
    pub fn similarity(&self) -> Similarity {
        Similarity {
            scale: self.scale,
            rotation: DMat3::from_cols_array_2d(&self.rotation).transpose(),
            translation: DVec3::from(self.translation_m),
        }
    }

    fn least_iou(&self) -> f64 {
        self.mask_iou.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// For messages.
    fn describe(&self) -> String {
        let overlaps: Vec<String> = self.mask_iou.iter().map(|iou| format!("{iou:.3}")).collect();
        format!("turned {:.0} degrees, scale {:.4}, overlaps {}", self.apart_deg, self.scale, overlaps.join(" "))
    }
}

impl RegistrationRecord {
    fn alternatives_text(&self) -> String {
        let named: Vec<String> = self.alternatives.iter().take(NAMED).map(PlacementRecord::describe).collect();
        if named.is_empty() { "none".into() } else { named.join("; ") }
    }
}

impl Run<'_> {
    /// The result of registration.
    ///
    /// # Errors
    /// A scene without a scan, a missing or damaged file.
    pub fn registration(&self) -> Result<RegistrationRecord> {
        if self.scan().is_none() {
            return Err(Error::Usage {
                problem: "the scene has no photographs of the object at rest, so there is nothing to register".into(),
                hint: Some("registration belongs to real captures, with `static` beside `dynamic`".into()),
            });
        }
        atomic::read_json(&self.path("registration.json"))
    }

    pub(super) fn register(&self) -> Result<()> {
        let scan = self.gaussians()?.canonical;
        let stage = Stage::Register.name();
        let mut tell = |done: usize, of: usize| {
            self.events.step(stage, "", done as u64, Some(of as u64), &[]);
            if self.interrupt.requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let found =
            register(&scan, &self.scene, &self.config.register, &mut tell).map_err(Error::stage("registration"))?;
        if self.interrupt.requested() {
            return Err(self.interrupted("reconstruct"));
        }
        let record = self.registration_record(&found);
        self.check_registration(&record)?;
        atomic::write_json(&self.path("registration.json"), &record)
    }

    fn registration_record(&self, found: &Registration) -> RegistrationRecord {
        let (best, others) = (&found.candidates[0], &found.candidates[1..]);
        RegistrationRecord {
            best: PlacementRecord::new(best),
            cameras: found.cameras.iter().map(|&camera| self.scene.camera_names[camera].clone()).collect(),
            alternatives: others.iter().map(PlacementRecord::new).collect(),
        }
    }

    /// Refuses a placement that the masks contradict, and names one that is as good.
    fn check_registration(&self, record: &RegistrationRecord) -> Result<()> {
        let (least, bound) = (record.best.least_iou(), self.config.register.least_iou);
        let overlaps: Vec<String> =
            record.cameras.iter().zip(&record.best.mask_iou).map(|(name, iou)| format!("{name} {iou:.3}")).collect();
        let overlaps = overlaps.join(", ");
        if least.is_nan() || least < bound {
            return Err(Error::Usage {
                problem: format!(
                    "no placement of the scanned object explains the masks of the first frame: the best overlaps with them by {overlaps} \
                     (intersection over union), below {bound}; next best: {}",
                    record.alternatives_text()
                ),
                hint: Some(
                    "look at both with `gic inspect`: the photographs and the video may show different objects, a camera's pose may be wrong, \
                     or the object may be deformed in the first frame; --set register.least_iou=X accepts less"
                        .into(),
                ),
            });
        }
        self.events.note(
            Stage::Register.name(),
            format!("scale {:.5} m per unit of the scan; overlap with masks: {overlaps}", record.best.scale),
        );
        let as_good = |other: &&PlacementRecord| other.loss < AS_GOOD * record.best.loss && other.least_iou() >= bound;
        if let Some(other) = record.alternatives.iter().find(as_good) {
            let text = format!(
                "another placement explains the first frame about as well ({}); if the twin moves oddly, the object looks alike from there",
                other.describe()
            );
            self.events.warn(Stage::Register.name(), text);
        }
        Ok(())
    }
}
