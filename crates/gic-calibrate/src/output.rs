//! Results: `calibration.json` for `gic import --calibration`, and lenses from such files.

use std::path::Path;

use gic_twin::atomic;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::error::{CalibrateError, Result};
use crate::lens::Lens;
use crate::request::{BoardOn, CalibrateRequest, Motion};
use crate::sightings::Sightings;
use crate::solution::Solution;
use crate::tuning::HIGH_RMS_PX;

/// The schema of files with cameras.
const CALIBRATION: &str = "gic.calibration/1";
/// The schema of files with lenses alone.
const INTRINSICS: &str = "gic.intrinsics/1";
/// Gravity at the Earth's surface [m/s^2] (standard acceleration of free fall).
const GRAVITY_M_S2: f64 = 9.80665;

/// Calibrated cameras.
#[derive(Clone, Debug, Default)]
pub struct Calibrated {
    /// The cameras, in the order of the films.
    pub cameras: Vec<CalibratedCamera>,
    /// How far the ground may lie from the board's plane [m], one standard deviation.
    pub ground_sd_m: f64,
}

/// A calibrated camera, as it stands in the file.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct CalibratedCamera {
    /// Its name: that of its film.
    pub name: String,
    /// Width of its pictures [pixels].
    pub width_px: f64,
    /// Height of its pictures [pixels].
    pub height_px: f64,
    /// Focal length along x [pixels].
    pub fx_px: f64,
    /// Focal length along y [pixels].
    pub fy_px: f64,
    /// Principal point, x [pixels].
    pub cx_px: f64,
    /// Principal point, y [pixels].
    pub cy_px: f64,
    /// Distortion by Brown's model, as OpenCV has it.
    pub distortion: Distortion,
    /// Camera to world, x right, y down, z forward, by rows. Missing where lenses alone were sought.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub world_from_camera: Option<[[f64; 4]; 3]>,
    /// Number of tags that it sees, over all its views.
    pub tags: usize,
    /// Root mean square distance of corners from where they should be [pixels].
    pub rms_px: f64,
    /// Corners that are too far off to count.
    pub discarded_corners: usize,
    /// Standard deviations; missing for known lenses.
    pub sd: Deviations,
}

/// k1, k2, p1, p2.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
#[allow(missing_docs)]
pub struct Distortion {
    pub k1: f64,
    pub k2: f64,
    pub p1: f64,
    pub p2: f64,
}

/// Standard deviations by the corners' scatter.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Deviations {
    /// Of fx and fy [pixels].
    pub focal_px: Option<[f64; 2]>,
    /// Of cx and cy [pixels].
    pub principal_px: Option<[f64; 2]>,
    /// Of k1, k2, p1 and p2.
    pub distortion: Option<[f64; 4]>,
    /// Of the centre, over all directions [m].
    pub centre_m: Option<f64>,
}

impl Calibrated {
    pub(crate) fn of(solution: &Solution, sightings: &Sightings, request: &CalibrateRequest) -> Calibrated {
        let cameras: Vec<CalibratedCamera> =
            (0..sightings.names.len()).map(|camera| one(solution, sightings, camera, request)).collect();
        // A corner's noise on the board.
        let on_board = cameras.iter().filter_map(|camera| {
            let place = camera.world_from_camera?;
            let distance = place.iter().map(|row| row[3] * row[3]).sum::<f64>().sqrt();
            Some(camera.rms_px * distance / camera.fx_px)
        });
        let ground_sd_m = on_board.fold(0.0, f64::max);
        Calibrated { cameras, ground_sd_m }
    }

    /// What to say of cameras that are worse than they could be.
    pub fn warnings(&self) -> Vec<String> {
        let high = self.cameras.iter().filter(|camera| camera.rms_px > HIGH_RMS_PX);
        let mut all: Vec<String> = high
            .map(|camera| {
                format!(
                    "camera {}: corners miss by {:.2} pixels; look at residuals/{}.png: a board that is not flat, that \
                     moved, or another --board or --pixel-aspect shows in the arrows",
                    camera.name, camera.rms_px, camera.name
                )
            })
            .collect();
        let unsure = self.cameras.iter().filter(|camera| {
            camera.sd.focal_px.is_some_and(|[sd, _]| sd > crate::tuning::UNSURE_FOCAL_SHARE * camera.fx_px)
        });
        all.extend(unsure.map(|camera| {
            format!(
                "camera {}: its focal length is not well told; tilt the board, bring it nearer, or film a moving board \
                 with --moving --intrinsics and give --lenses",
                camera.name
            )
        }));
        all
    }
}

fn one(solution: &Solution, sightings: &Sightings, camera: usize, request: &CalibrateRequest) -> CalibratedCamera {
    let lens = &solution.rig.lenses[camera];
    let [fx_px, fy_px] = lens.focal_px();
    let [cx_px, cy_px] = lens.principal_px();
    let [k1, k2, p1, p2] = lens.distortion();
    let place = solution.rig.world_from_camera[camera].to_matrix();
    let row = |n: usize| [place[(n, 0)], place[(n, 1)], place[(n, 2)], place[(n, 3)]];
    let own = || solution.corners.iter().filter(|corner| sightings.views[corner.view].camera == camera);
    let kept = || own().filter(|corner| corner.is_kept);
    let squares: f64 = kept().map(|corner| corner.residual[0].powi(2) + corner.residual[1].powi(2)).sum();
    let covariance = &solution.deviations[camera];
    let lens_sd = covariance.lens.as_ref().map(|all| [0, 1, 2, 3, 4, 5, 6, 7].map(|k| all[(k, k)].sqrt()));
    let focal_sd = covariance.lens.as_ref().map(|all| {
        let fy = all[(0, 0)] + 2.0 * all[(0, 1)] + all[(1, 1)];
        [fx_px * all[(0, 0)].sqrt(), fy_px * fy.max(0.0).sqrt()]
    });
    CalibratedCamera {
        name: sightings.names[camera].clone(),
        width_px: sightings.sizes[camera][0] as f64,
        height_px: sightings.sizes[camera][1] as f64,
        fx_px,
        fy_px,
        cx_px,
        cy_px,
        distortion: Distortion { k1, k2, p1, p2 },
        world_from_camera: (!request.intrinsics_only).then(|| [row(0), row(1), row(2)]),
        tags: sightings.views.iter().filter(|view| view.camera == camera).map(|view| view.tags.len()).sum(),
        rms_px: (squares / kept().count().max(1) as f64).sqrt(),
        discarded_corners: own().count() - kept().count(),
        sd: Deviations {
            focal_px: focal_sd,
            principal_px: lens_sd.map(|sd| [sd[2], sd[3]]),
            distortion: lens_sd.map(|sd| [sd[4], sd[5], sd[6], sd[7]]),
            centre_m: covariance.centre.as_ref().map(|all| all.trace().max(0.0).sqrt()),
        },
    }
}

/// The file's name in the folder of results.
pub(crate) fn file_name(request: &CalibrateRequest) -> &'static str {
    if request.intrinsics_only { "intrinsics.json" } else { "calibration.json" }
}

/// Writes the file of cameras or lenses.
pub(crate) fn write(calibrated: &Calibrated, request: &CalibrateRequest) -> Result<()> {
    let mut all = json!({
        "schema": if request.intrinsics_only { INTRINSICS } else { CALIBRATION },
        "board": request.board.to_string(),
        "tag_size_m": request.tag_size_m,
        "board_moves": request.motion == Motion::Moving,
        "cameras": calibrated.cameras,
    });
    if let (Value::Object(keys), false) = (&mut all, request.intrinsics_only) {
        keys.insert("metric".into(), json!(true));
        if request.board_on == BoardOn::Floor {
            keys.insert("up".into(), json!([0.0, 0.0, 1.0]));
            keys.insert("gravity_m_s2".into(), json!([0.0, 0.0, -GRAVITY_M_S2]));
            let ground = json!({"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0], "sd_m": calibrated.ground_sd_m});
            keys.insert("ground".into(), ground);
        }
    }
    atomic::create_folder(&request.out)?;
    Ok(atomic::write_json(&request.out.join(file_name(request)), &all)?)
}

/// The lenses of a file that [`write`] made, in the order of the cameras.
pub(crate) fn known_lenses(file: &Path, sightings: &Sightings) -> Result<Vec<Lens>> {
    let wrong = |problem: String| {
        CalibrateError::usage(
            format!("{}: {problem}", file.display()),
            "give a file of `gic calibrate` with all cameras, for pictures of the same size",
        )
    };
    let text = std::fs::read_to_string(file).map_err(|error| wrong(error.to_string()))?;
    let all: Value = serde_json::from_str(&text).map_err(|error| wrong(format!("is not JSON: {error}")))?;
    let cameras: Vec<CalibratedCamera> = serde_json::from_value(all.get("cameras").cloned().unwrap_or_default())
        .map_err(|error| wrong(format!("cameras: {error}")))?;
    let lens = |(name, size): (&String, &[usize; 2])| {
        let camera = cameras.iter().find(|camera| camera.name == *name);
        let camera = camera.ok_or_else(|| wrong(format!("knows no camera {name}")))?;
        let Distortion { k1, k2, p1, p2 } = camera.distortion;
        if [camera.width_px, camera.height_px] != size.map(|n| n as f64) {
            return Err(wrong(format!("camera {name} was calibrated for pictures of another size")));
        }
        Ok(Lens::new([camera.fx_px, camera.fy_px], [camera.cx_px, camera.cy_px], [k1, k2, p1, p2]))
    };
    sightings.names.iter().zip(&sightings.sizes).map(lens).collect()
}
