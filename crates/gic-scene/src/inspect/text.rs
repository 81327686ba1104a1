//! What was found, in words.

use std::fmt;

use super::{GroundSource, Inspection, mean};

impl fmt::Display for Inspection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unit = if self.metric { "m" } else { "units" };
        writeln!(f, "{}", self.root.display())?;
        writeln!(f, "  format      {}", self.format)?;
        let rate = self.frame_rate_hz.map_or(String::new(), |rate| format!(", {rate:.2} frames/s"));
        writeln!(
            f,
            "  content     {} cameras, {} frames ({:.3} to {:.3} s{rate}), {} pictures",
            self.camera_count, self.frame_count, self.time_range_s[0], self.time_range_s[1], self.view_count
        )?;
        let [train, validation, test] = self.split_counts;
        if validation + test > 0 {
            writeln!(f, "  splits      {train} train, {validation} validation, {test} test")?;
        }
        if self.rest_views > 0 {
            writeln!(f, "  at rest     {} photographs, in a world frame of their own", self.rest_views)?;
        }
        let sources: Vec<String> = self.mask_sources.iter().map(|(word, count)| format!("{word} ({count})")).collect();
        writeln!(f, "  masks       {}", sources.join(", "))?;
        if let Some((up, source)) = self.up {
            writeln!(f, "  up          {}{}", vector(up), guess(source))?;
        }
        if let Some((point, normal, source)) = self.ground {
            writeln!(f, "  ground      through {} {unit}, normal {}{}", vector(point), vector(normal), guess(source))?;
        }
        match &self.hull {
            Some(hull) => {
                writeln!(f, "  hull        {} to {} {unit}", vector(hull.low_m), vector(hull.high_m))?;
                writeln!(
                    f,
                    "              size {} {unit}, volume {:.3e} {unit}^3, overlap with the masks {:.3}",
                    vector(hull.size_m),
                    hull.volume_m3,
                    hull.mean_iou
                )?;
            }
            None => writeln!(f, "  hull        none: no point of space projects into all masks")?,
        }
        if let Some(flight) = &self.flight {
            writeln!(
                f,
                "  flight      {} frames, outlines agree to {:.2} pixels: velocity {} {unit}/s, acceleration {} {unit}/s^2,",
                flight.frames,
                flight.miss_px,
                vector(flight.velocity_m_s),
                vector(flight.acceleration_m_s2)
            )?;
            writeln!(f, "              angular velocity {} rad/s", vector(flight.angular_velocity_rad_s))?;
        }
        if let Some(fall) = &self.fall {
            let rate = fall
                .frame_rate_hz
                .map_or(String::new(), |rate| format!("; if lengths are metres, the film has {rate:.1} frames/s"));
            let (gravity, unit) = (fall.gravity_m_s2, fall.unit_m);
            writeln!(
                f,
                "  free fall   with gravity {gravity:.2} m/s^2 and these times, a length of 1 is {unit:.3} m{rate}"
            )?;
        }
        self.write_cameras(f)?;
        for warning in &self.warnings {
            writeln!(f, "  warning: {warning}")?;
        }
        Ok(())
    }
}

impl Inspection {
    /// One line a camera; one line in all for moving cameras.
    fn write_cameras(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const MAX_CAMERA_LINES: usize = 24;
        if self.cameras.len() > MAX_CAMERA_LINES {
            let coverage = mean(&self.cameras.iter().map(|camera| camera.coverage).collect::<Vec<_>>());
            let sizes = self.cameras.iter().map(|camera| camera.size);
            let (least, most) = (sizes.clone().min().unwrap_or_default(), sizes.max().unwrap_or_default());
            let size = if least == most { pixels(least) } else { format!("{} to {}", pixels(least), pixels(most)) };
            return writeln!(f, "  cameras     {size}, masks cover {:.1} % on average", 100.0 * coverage);
        }
        writeln!(f, "  camera      pixels     pictures  covered  overlap with the hull")?;
        for camera in &self.cameras {
            let overlap = camera.reprojection_iou.map_or("-".to_owned(), |overlap| format!("{overlap:.3}"));
            let (name, size) = (&camera.name, pixels(camera.size));
            writeln!(f, "  {name:<10}  {size:<9}  {:>8}  {:>5.1} %  {overlap}", camera.views, 100.0 * camera.coverage)?;
        }
        Ok(())
    }
}

fn pixels(size: [usize; 2]) -> String {
    format!("{}x{}", size[0], size[1])
}

fn vector(v: [f64; 3]) -> String {
    // Adding zero turns -0 into 0.
    format!("({:.3}, {:.3}, {:.3})", v[0] + 0.0, v[1] + 0.0, v[2] + 0.0)
}

fn guess(source: GroundSource) -> &'static str {
    match source {
        GroundSource::Format => "",
        GroundSource::Guess => " (a guess)",
    }
}
