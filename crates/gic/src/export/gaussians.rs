//! The twin as Gaussians in the scene's light: one picture, a sequence of files, or one stage.

use std::path::Path;

use gic_splat::Gaussians;
use gic_twin::atomic;
use gic_twin::interchange::UpAxis;
use glam::DVec3;

use super::{Export, ExportSource};
use crate::error::{Error, Result};

/// Names of the files of a sequence begin so.
pub(super) const SEQUENCE_FILE: &str = "frame_";

/// Writes the Gaussians that can be seen; says what.
pub(super) fn write(source: &ExportSource, format: Export, up: UpAxis, path: &Path) -> Result<String> {
    let skin = source.appearance()?;
    let turn = source.turn_to(up);
    // Those that are seen at time 0: the same ones in every frame.
    let kept = skin.visible_rows(source.body.particles());
    let at = |particles: &[DVec3]| {
        let mut drawn = skin.at(particles).select(&kept);
        for p in &mut drawn.positions {
            *p = (turn * DVec3::from_array(p.map(f64::from))).as_vec3().to_array();
        }
        drawn
    };
    match format {
        Export::GaussianUsd => {
            let frames: Vec<Gaussians> = source.frames()?.iter().map(|frame| at(frame)).collect();
            let up_axis = if up == UpAxis::Z { "Z" } else { "Y" };
            gic_splat::write_usd(path, &frames, source.body.motion().frame_rate_hz, up_axis)
                .map_err(Error::stage("writing Gaussians"))?;
            Ok(format!("{} Gaussians in {} frames", kept.len(), frames.len()))
        }
        Export::GaussianSequence => {
            let frames = source.frames()?;
            atomic::create_folder(path)?;
            for (i, frame) in frames.iter().enumerate() {
                let file = path.join(format!("{SEQUENCE_FILE}{i:04}.ply"));
                gic_splat::write_ply(&file, &at(frame)).map_err(Error::stage("writing Gaussians"))?;
            }
            Ok(format!("{} files of {} Gaussians", frames.len(), kept.len()))
        }
        _ => {
            gic_splat::write_ply(path, &at(source.body.particles())).map_err(Error::stage("writing Gaussians"))?;
            Ok(format!("{} Gaussians", kept.len()))
        }
    }
}
