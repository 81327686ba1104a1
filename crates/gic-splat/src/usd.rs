//! Moving Gaussians as OpenUSD's `ParticleField3DGaussianSplat` (26.03 and later), in its text form.

use std::io::Write;
use std::path::Path;

use gic_files::{FileError, write_with};

use crate::{Gaussians, Shape};

/// Writes the frames [m] of the same Gaussians as time samples of one prim, `/World/Gaussians`; the first frame also
/// stands where no time is asked for. `up_axis` is Y or Z.
///
/// # Errors
/// No frame, frames of different numbers of Gaussians, and what the system says.
pub fn write_usd(path: &Path, frames: &[Gaussians], frame_rate_hz: f64, up_axis: &str) -> Result<(), FileError> {
    let invalid = |problem: &str| std::io::Error::new(std::io::ErrorKind::InvalidInput, problem.to_owned());
    write_with(path, |out| {
        let Some(first) = frames.first() else { return Err(invalid("there are no frames")) };
        if frames.iter().any(|frame| frame.len() != first.len()) {
            return Err(invalid("frames hold different numbers of Gaussians"));
        }
        write!(
            out,
            "#usda 1.0\n(\n    defaultPrim = \"World\"\n    metersPerUnit = 1\n    upAxis = \"{up_axis}\"\n    \
             startTimeCode = 0\n    endTimeCode = {}\n    timeCodesPerSecond = {frame_rate_hz}\n    \
             framesPerSecond = {frame_rate_hz}\n)\n\ndef Xform \"World\"\n{{\n    \
             def ParticleField3DGaussianSplat \"Gaussians\"\n    {{\n        \
             uniform int radiance:sphericalHarmonicsDegree = {}\n        float[] opacities = {}\n",
            frames.len() - 1,
            first.sh_degree,
            numbers(&first.opacities)
        )?;
        let (scales, rotations): (Vec<[f32; 3]>, Vec<[f32; 4]>) = match &first.shape {
            Shape::Isotropic { scales } => {
                (scales.iter().map(|s| [*s; 3]).collect(), vec![[1.0, 0.0, 0.0, 0.0]; scales.len()])
            }
            Shape::Anisotropic { scales, rotations } => (scales.clone(), rotations.clone()),
        };
        writeln!(out, "        float3[] scales = {}", tuples(&scales))?;
        writeln!(out, "        quatf[] orientations = {}", tuples(&rotations))?;
        sampled(out, "point3f[] positions", frames, |frame| tuples(&frame.positions))?;
        sampled(out, "float3[] extent", frames, extent)?;
        sampled(out, "float3[] radiance:sphericalHarmonicsCoefficients", frames, |frame| tuples(&frame.sh))?;
        write!(out, "    }}\n}}\n")
    })
}

/// An attribute in the first frame, and in each.
fn sampled(
    out: &mut impl Write,
    declaration: &str,
    frames: &[Gaussians],
    value: impl Fn(&Gaussians) -> String,
) -> std::io::Result<()> {
    writeln!(out, "        {declaration} = {}", value(&frames[0]))?;
    writeln!(out, "        {declaration}.timeSamples = {{")?;
    for (i, frame) in frames.iter().enumerate() {
        writeln!(out, "            {i}: {},", value(frame))?;
    }
    writeln!(out, "        }}")
}

/// The box around three standard deviations of each Gaussian.
fn extent(frame: &Gaussians) -> String {
    let mut bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for (i, p) in frame.positions.iter().enumerate() {
        let reach = 3.0 * frame.scale(i);
        for axis in 0..3 {
            bounds[0][axis] = bounds[0][axis].min(p[axis] - reach);
            bounds[1][axis] = bounds[1][axis].max(p[axis] + reach);
        }
    }
    tuples(&bounds)
}

fn numbers(values: &[f32]) -> String {
    let all: Vec<String> = values.iter().map(f32::to_string).collect();
    format!("[{}]", all.join(", "))
}

fn tuples<const N: usize>(values: &[[f32; N]]) -> String {
    let tuple = |v: &[f32; N]| format!("({})", v.map(|x| x.to_string()).join(", "));
    let all: Vec<String> = values.iter().map(tuple).collect();
    format!("[{}]", all.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_become_time_samples() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("g.usda");
        let at = |y: f32| Gaussians {
            sh: vec![[0.5, 0.0, -0.5]],
            ..Gaussians::colorless(vec![[0.0, y, 1.0]], vec![0.5], vec![0.25])
        };
        write_usd(&path, &[at(0.0), at(2.0)], 24.0, "Z").unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        for part in [
            "upAxis = \"Z\"",
            "float3[] scales = [(0.25, 0.25, 0.25)]",
            "quatf[] orientations = [(1, 0, 0, 0)]",
            "point3f[] positions = [(0, 0, 1)]",
            "1: [(0, 2, 1)],",
            "1: [(-0.75, 1.25, 0.25), (0.75, 2.75, 1.75)],",
        ] {
            assert!(text.contains(part), "`{part}` is missing in:\n{text}");
        }
        assert!(write_usd(&path, &[], 24.0, "Z").is_err());
        assert!(write_usd(&path, &[at(0.0), Gaussians::colorless(vec![], vec![], vec![])], 24.0, "Z").is_err());
    }
}
