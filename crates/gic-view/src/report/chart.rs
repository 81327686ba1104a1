//! Line charts as inline SVG.

use std::fmt::Write;

use crate::html::escape;

/// A line of a chart.
pub struct Series {
    /// What it shows.
    pub name: String,
    /// (x, y), in the order of drawing.
    pub points: Vec<(f64, f64)>,
}

const WIDTH: f64 = 360.0;
const HEIGHT: f64 = 200.0;
const LEFT: f64 = 56.0;
const BOTTOM: f64 = 24.0;
const MARGIN: f64 = 10.0;
const COLOURS: [&str; 6] = ["#0074d9", "#ff851b", "#2ecc40", "#b10dc9", "#ff4136", "#888888"];

/// A chart with a caption; `logarithmic` is for values above zero. Empty when there is nothing to draw.
pub fn chart(caption: &str, series: &[Series], logarithmic: bool) -> String {
    let usable = |p: &(f64, f64)| p.0.is_finite() && p.1.is_finite() && (!logarithmic || p.1 > 0.0);
    let scale = |y: f64| if logarithmic { y.log10() } else { y };
    let all = || series.iter().flat_map(|s| &s.points).filter(|p| usable(p)).map(|p| (p.0, scale(p.1)));
    if all().count() < 2 {
        return String::new();
    }
    let range = |values: &mut dyn Iterator<Item = f64>| {
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if high > low { (low, high) } else { (low - 0.5, high + 0.5) }
    };
    let (x0, x1) = range(&mut all().map(|p| p.0));
    let (y0, y1) = range(&mut all().map(|p| p.1));
    let at_x = |x: f64| LEFT + (x - x0) / (x1 - x0) * (WIDTH - LEFT - MARGIN);
    let at_y = |y: f64| MARGIN + (y1 - y) / (y1 - y0) * (HEIGHT - MARGIN - BOTTOM);
    let mut svg = format!("<figure><svg width=\"{WIDTH}\" height=\"{HEIGHT}\" role=\"img\">");
    for share in [0.0, 0.5, 1.0] {
        let y = y0 + share * (y1 - y0);
        let value = if logarithmic { 10f64.powf(y) } else { y };
        let _ = write!(
            svg,
            "<line x1=\"{LEFT}\" x2=\"{:.1}\" y1=\"{:.1}\" y2=\"{:.1}\" stroke=\"#8885\"/>\
             <text x=\"2\" y=\"{:.1}\">{}</text>",
            WIDTH - MARGIN,
            at_y(y),
            at_y(y),
            at_y(y) + 3.0,
            short_number(value)
        );
    }
    for (x, anchor) in [(x0, "start"), (x1, "end")] {
        let (px, py) = (at_x(x), HEIGHT - 8.0);
        let _ = write!(svg, "<text x=\"{px:.1}\" y=\"{py}\" text-anchor=\"{anchor}\">{}</text>", short_number(x));
    }
    for (i, line) in series.iter().enumerate() {
        let points: Vec<String> = line
            .points
            .iter()
            .filter(|p| usable(p))
            .map(|p| format!("{:.1},{:.1}", at_x(p.0), at_y(scale(p.1))))
            .collect();
        let colour = COLOURS[i % COLOURS.len()];
        let _ = write!(
            svg,
            "<polyline fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\" points=\"{}\">\
             <title>{}</title></polyline>",
            points.join(" "),
            escape(&line.name)
        );
        if series.len() > 1 {
            let (x, y) = (WIDTH - MARGIN - 4.0, MARGIN + 12.0 * (i as f64 + 1.0));
            let name = escape(&line.name);
            let _ = write!(svg, "<text x=\"{x}\" y=\"{y}\" text-anchor=\"end\" style=\"fill:{colour}\">{name}</text>");
        }
    }
    let _ = write!(svg, "</svg><figcaption>{}</figcaption></figure>", escape(caption));
    svg
}

/// A number in few characters.
pub fn short_number(value: f64) -> String {
    if value == 0.0 || (1e-3..1e5).contains(&value.abs()) {
        let digits = if value.abs() >= 100.0 { 0 } else { 3 };
        format!("{value:.digits$}")
    } else {
        format!("{value:.2e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_that_are_no_numbers_are_left_out() {
        let points = vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, 3.0)];
        let svg = chart("c", &[Series { name: "a<b".into(), points }], true);
        assert!(!svg.contains("NaN") && svg.contains("a&lt;b"), "{svg}");
        assert_eq!(svg.matches(',').count(), 2);
    }

    #[test]
    fn nothing_to_draw_is_nothing() {
        assert!(chart("c", &[], false).is_empty());
    }
}
