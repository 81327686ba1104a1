//! The stage `register`: where the scan of the object lies in the first frame of the video.

use std::ops::ControlFlow;

use gic_appearance::{Candidate, Registration, check_registrable, register};
use gic_scene::Similarity;
use gic_twin::atomic;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use super::{Run, Stage};
use crate::error::{Error, Result};

/// An alternative is as good as the best where its loss is at most this many times the best one's.
const AMBIGUOUS_LOSS_RATIO: f64 = 1.25;
/// Alternatives that a message names.
const NAMED_ALTERNATIVES: usize = 3;

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
        let Similarity { scale, rotation, translation } = candidate.world_from_scan;
        Self {
            matrix: candidate.world_from_scan.matrix(),
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

    /// Whether it overlaps with every mask by at least `bound`; what is not a number does not.
    fn overlaps(&self, bound: f64) -> bool {
        self.mask_iou.iter().all(|iou| *iou >= bound)
    }

    /// For messages.
    fn describe(&self) -> String {
        let overlaps: Vec<String> = self.mask_iou.iter().map(|iou| format!("{iou:.3}")).collect();
        format!("turned {:.0} degrees, scale {:.4}, overlaps {}", self.apart_deg, self.scale, overlaps.join(" "))
    }
}

impl RegistrationRecord {
    fn overlaps_text(&self) -> String {
        let named = self.cameras.iter().zip(&self.best.mask_iou).map(|(name, iou)| format!("{name} {iou:.3}"));
        named.collect::<Vec<_>>().join(", ")
    }

    fn alternatives_text(&self) -> String {
        let named: Vec<String> =
            self.alternatives.iter().take(NAMED_ALTERNATIVES).map(PlacementRecord::describe).collect();
        if named.is_empty() { "none".into() } else { named.join("; ") }
    }
}

impl Run<'_> {
    /// The result of registration.
    ///
    /// # Errors
    /// A scene without a scan, a missing or damaged file.
    pub fn registration(&self) -> Result<RegistrationRecord> {
        self.require_scan()?;
        Ok(atomic::read_json(&self.path("registration.json"))?)
    }

    /// Refuses settings that a scan does not allow, before the first stage starts.
    pub(super) fn check_scan(&self) -> Result<()> {
        let refused =
            |problem: &str, hint: &str| Err(Error::Usage { problem: problem.into(), hint: Some(hint.into()) });
        if self.config.identify.target != gic_identify::Target::Masks {
            return refused(
                "photographs of the object at rest show no surface in later frames to compare with",
                "leave --target out: masks are used",
            );
        }
        if !self.config.reconstruct.held_out.is_empty() {
            return refused(
                "held-out cameras are not known for real captures: photographs and video have cameras of their own",
                "leave --held-out out",
            );
        }
        check_registrable(&self.scene).map_err(Error::stage("registration"))
    }

    pub(super) fn require_scan(&self) -> Result<()> {
        match self.scan() {
            Some(_) => Ok(()),
            None => Err(Error::Usage {
                problem: "the scene has no photographs of the object at rest, so there is nothing to register".into(),
                hint: Some("registration belongs to real captures, with `static` beside `dynamic`".into()),
            }),
        }
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
        if let Some(warning) = check_placement(&record, self.config.register.least_iou)? {
            self.events.warn(stage, warning);
        }
        let text = format!(
            "scale {:.5} m per unit of the scan; overlap with masks: {}",
            record.best.scale,
            record.overlaps_text()
        );
        self.events.note(stage, text);
        Ok(atomic::write_json(&self.path("registration.json"), &record)?)
    }

    fn registration_record(&self, found: &Registration) -> RegistrationRecord {
        let (best, others) = (&found.candidates[0], &found.candidates[1..]);
        RegistrationRecord {
            best: PlacementRecord::new(best),
            cameras: found.cameras.iter().map(|&camera| self.scene.camera_names[camera].clone()).collect(),
            alternatives: others.iter().map(PlacementRecord::new).collect(),
        }
    }
}

/// Refuses a placement that the masks contradict; warns of another that is as good.
fn check_placement(record: &RegistrationRecord, bound: f64) -> Result<Option<String>> {
    if !record.best.overlaps(bound) {
        return Err(Error::Usage {
            problem: format!(
                "no placement of the scanned object explains the masks of the first frame: the best overlaps with them \
                 by {} (intersection over union), below {bound}; next best: {}",
                record.overlaps_text(),
                record.alternatives_text()
            ),
            hint: Some(
                "look at both with `gic inspect`: the photographs and the video may show different objects, a camera's \
                 pose may be wrong, or the object may be deformed in the first frame; \
                 --set register.least_iou=X accepts less"
                    .into(),
            ),
        });
    }
    let as_good =
        |other: &&PlacementRecord| other.loss < AMBIGUOUS_LOSS_RATIO * record.best.loss && other.overlaps(bound);
    Ok(record.alternatives.iter().find(as_good).map(|other| {
        format!(
            "another placement explains the first frame about as well ({}); if the twin moves oddly, the object looks \
             alike from there",
            other.describe()
        )
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn placement(iou: f64, loss: f64, apart_deg: f64) -> PlacementRecord {
        PlacementRecord {
            matrix: [[0.0; 4]; 4],
            scale: 0.3,
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation_m: [0.0; 3],
            mask_iou: vec![0.99, iou, 0.98],
            loss,
            apart_deg,
        }
    }

    fn record(best: PlacementRecord, alternatives: Vec<PlacementRecord>) -> RegistrationRecord {
        RegistrationRecord { best, cameras: ["A", "B", "C"].map(String::from).to_vec(), alternatives }
    }

    #[test]
    fn a_placement_that_one_mask_contradicts_is_refused_with_the_alternatives() {
        let other = placement(0.6, 0.5, 131.0);
        let error = check_placement(&record(placement(0.7, 0.4, 0.0), vec![other]), 0.9).unwrap_err();
        let text = error.to_string();
        for part in ["B 0.700", "below 0.9", "turned 131 degrees", "0.600"] {
            assert!(text.contains(part), "`{part}` is not in: {text}");
        }
        assert!(error.hint().unwrap().contains("different objects"));
        assert!(check_placement(&record(placement(f64::NAN, 0.4, 0.0), Vec::new()), 0.9).is_err());
    }

    #[test]
    fn an_equal_alternative_is_warned_of() {
        let check_placement =
            |loss| check_placement(&record(placement(0.97, 0.1, 0.0), vec![placement(0.96, loss, 90.0)]), 0.9).unwrap();
        assert!(check_placement(0.11).unwrap().contains("turned 90 degrees"));
        assert_eq!(check_placement(0.3), None);
    }

    #[test]
    fn a_record_keeps_the_transformation() {
        let similarity = Similarity {
            scale: 0.3,
            rotation: DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(-1.0),
            translation: DVec3::new(0.1, 0.2, 0.3),
        };
        let candidate = Candidate { world_from_scan: similarity, iou: vec![0.9], loss: 0.1, apart_rad: 0.0 };
        let text = serde_json::to_string(&record(PlacementRecord::new(&candidate), Vec::new())).unwrap();
        let back: RegistrationRecord = serde_json::from_str(&text).unwrap();
        assert_eq!(back.best.similarity(), similarity);
        // Rows of the matrix are rows of scale times rotation.
        assert!((back.best.matrix[0][1] - 0.3 * back.best.rotation[0][1]).abs() < 1e-15);
        assert!((back.best.rotation[0][1] - similarity.rotation.y_axis.x).abs() < 1e-15);
    }
}
