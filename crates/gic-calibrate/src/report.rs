//! What shows whether a calibration is right: pictures with residuals, and a page of them.

use std::fmt::Write;
use std::path::Path;

use gic_film::FilmError;
use gic_scene::Picture;
use gic_twin::atomic;

use crate::error::Result;
use crate::grey::Grey;
use crate::output::{Calibrated, CalibratedCamera, file_name};
use crate::request::CalibrateRequest;
use crate::sightings::Sightings;
use crate::solution::Solution;
use crate::tuning::{ARROW_TIMES, DRAWING_WIDTH_PX};

const TAG: [f32; 3] = [0.1, 0.8, 0.3];
const RESIDUAL: [f32; 3] = [1.0, 0.8, 0.1];
const DISCARDED: [f32; 3] = [1.0, 0.1, 0.1];

/// Draws for each camera the tags of its richest view, and from all corners of all views a line to where it should be,
/// enlarged.
pub(crate) fn draw(solution: &Solution, sightings: &Sightings, out: &Path) -> Result<()> {
    let folder = out.join("residuals");
    atomic::create_folder(&folder)?;
    for (camera, name) in sightings.names.iter().enumerate() {
        let own = (0..sightings.views.len()).filter(|&n| sightings.views[n].camera == camera);
        let Some(richest) = own.max_by_key(|&n| sightings.views[n].tags.len()) else { continue };
        let factor = DRAWING_WIDTH_PX.div_ceil(sightings.sizes[camera][0]).max(1);
        let mut picture = enlarged(&sightings.pictures[richest], factor);
        let scaled = |[x, y]: [f64; 2]| [x * factor as f64, y * factor as f64];
        for tag in &sightings.views[richest].tags {
            (0..4).for_each(|k| line(&mut picture, scaled(tag.corners[k]), scaled(tag.corners[(k + 1) % 4]), TAG));
        }
        for corner in solution.corners.iter().filter(|corner| sightings.views[corner.view].camera == camera) {
            let colour = if corner.is_kept { RESIDUAL } else { DISCARDED };
            let end = [0, 1].map(|axis| corner.seen[axis] - ARROW_TIMES / factor as f64 * corner.residual[axis]);
            line(&mut picture, scaled(corner.seen), scaled(end), colour);
        }
        picture.save_png(&folder.join(format!("{name}.png"))).map_err(FilmError::from)?;
    }
    Ok(())
}

fn enlarged(grey: &Grey, factor: usize) -> Picture {
    let (width, height) = (grey.width * factor, grey.height * factor);
    let value = |n: usize| grey.values[n / width / factor * grey.width + n % width / factor] / 255.0;
    Picture { width, height, rgb: (0..width * height).flat_map(|n| [value(n); 3]).collect() }
}

/// A line of one pixel's width, as far as it lies in the picture.
fn line(picture: &mut Picture, from: [f64; 2], to: [f64; 2], colour: [f32; 3]) {
    // A corner behind a camera is nowhere.
    let length = (to[0] - from[0]).hypot(to[1] - from[1]).min(1e4);
    let steps = length.ceil().max(1.0) as usize;
    for step in 0..=steps {
        let share = step as f64 / steps as f64;
        let [x, y] = [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]));
        if x >= 0.0 && y >= 0.0 && x < picture.width as f64 && y < picture.height as f64 {
            let at = 3 * (y as usize * picture.width + x as usize);
            picture.rgb[at..at + 3].copy_from_slice(&colour);
        }
    }
}

/// Writes `report.html`.
pub(crate) fn write_page(calibrated: &Calibrated, request: &CalibrateRequest) -> Result<()> {
    let mut page = String::from(
        "<!doctype html><meta charset=\"utf-8\"><title>Calibration</title><style>body{font:15px sans-serif;margin:2em}\
         td,th{padding:.2em .8em;text-align:right}img{max-width:100%}</style><h1>Calibration</h1>",
    );
    let _ = write!(
        page,
        "<p>Board {}, tags of {} m; results in {}.</p><table><tr><th>camera<th>tags<th>discarded<th>rms [px]<th>fx \
         [px]<th>k1<th>centre [m]<th>sd [m]</tr>",
        request.board,
        request.tag_size_m,
        file_name(request)
    );
    for camera in &calibrated.cameras {
        let row = camera.cells().map(|cell| format!("<td>{}", escaped(&cell)));
        let _ = write!(page, "<tr>{}</tr>", row.concat());
    }
    page += "</table>";
    for warning in calibrated.warnings() {
        let _ = write!(page, "<p><b>Warning:</b> {}</p>", escaped(&warning));
    }
    let _ = write!(
        page,
        "<p>Green: tags. Yellow: from a corner to where the cameras put it, {ARROW_TIMES} times as long as in the \
         picture; they should point everywhere. Red: corners that were left out.</p>"
    );
    for camera in &calibrated.cameras {
        let name = escaped(&camera.name);
        let _ = write!(page, "<h2>{name}</h2><img src=\"residuals/{name}.png\" alt=\"residuals of {name}\">");
    }
    Ok(atomic::write(&request.out.join("report.html"), page.as_bytes())?)
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

impl CalibratedCamera {
    /// A row of the report: name, tags, discarded corners, rms, focal length, distortion, centre and its deviation.
    pub fn cells(&self) -> [String; 8] {
        let sd = |sd: Option<f64>, digits: usize| sd.map_or("known".to_owned(), |sd| format!("± {sd:.digits$}"));
        let centre =
            self.world_from_camera.map_or("-".to_owned(), |place| place.map(|row| format!("{:.4}", row[3])).join(" "));
        [
            self.name.clone(),
            self.tags.to_string(),
            self.discarded_corners.to_string(),
            format!("{:.3}", self.rms_px),
            format!("{:.2} {}", self.fx_px, sd(self.sd.focal_px.map(|sd| sd[0]), 2)),
            format!("{:.4} {}", self.distortion.k1, sd(self.sd.distortion.map(|sd| sd[0]), 4)),
            centre,
            self.sd.centre_m.filter(|_| self.world_from_camera.is_some()).map_or("-".into(), |sd| format!("{sd:.4}")),
        ]
    }
}
