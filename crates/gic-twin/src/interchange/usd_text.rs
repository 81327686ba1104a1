//! Values of OpenUSD's text form.

use std::fmt::Write as _;

use glam::{DQuat, DVec3};

/// What of several frames is written: one value at rest, and one for each time code.
pub(super) fn sampled(text: &mut String, declaration: &str, rest: &str, frames: impl Iterator<Item = String>) {
    let _ = writeln!(text, "            {declaration} = {rest}");
    let mut frames = frames.enumerate().peekable();
    if frames.peek().is_none() {
        return;
    }
    let _ = writeln!(text, "            {declaration}.timeSamples = {{");
    for (frame, value) in frames {
        let _ = writeln!(text, "                {frame}: {value},");
    }
    *text += "            }\n";
}

/// Points [m] at rest and in every frame, and their bounds.
pub(super) fn moving_points(text: &mut String, rest: &[DVec3], frames: &[Vec<DVec3>]) {
    sampled(text, "point3f[] points", &points(rest), frames.iter().map(|frame| points(frame)));
    sampled(text, "float3[] extent", &extent(rest), frames.iter().map(|frame| extent(frame)));
}

fn extent(all: &[DVec3]) -> String {
    let low = all.iter().fold(DVec3::INFINITY, |low, &p| low.min(p));
    let high = all.iter().fold(DVec3::NEG_INFINITY, |high, &p| high.max(p));
    points(&[low, high])
}

pub(super) fn points(all: &[DVec3]) -> String {
    list(all.iter().map(|p| triple(*p)))
}

pub(super) fn triple(p: DVec3) -> String {
    // f32 is what USD keeps; its shortest form is exact.
    let [x, y, z] = p.as_vec3().to_array();
    format!("({x}, {y}, {z})")
}

/// Real part first.
pub(super) fn quaternion(q: DQuat) -> String {
    format!("({}, {}, {}, {})", q.w, q.x, q.y, q.z)
}

pub(super) fn list(items: impl Iterator<Item = String>) -> String {
    format!("[{}]", items.collect::<Vec<_>>().join(", "))
}
