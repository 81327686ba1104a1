//! Line charts as inline SVG: a title, units, round numbers on the axes.

use serde::Serialize;

use crate::error::Result;
use crate::template;
use crate::units::three_digits;

/// A chart.
#[derive(Clone, Debug, Default)]
pub struct Chart {
    /// What it shows.
    pub title: String,
    /// Unit of the values; empty where they have none.
    pub unit: String,
    /// What runs along x, in whole numbers.
    pub x_title: String,
    /// The lines.
    pub series: Vec<Series>,
    /// Whether values are shown by their logarithm; those that are not above zero are left out then.
    pub logarithmic: bool,
    /// A value to compare with, and what it is.
    pub marked: Option<(f64, String)>,
    /// What one has to know to read it.
    pub note: String,
}

/// A line of a chart.
#[derive(Clone, Debug, Default)]
pub struct Series {
    /// What it shows.
    pub name: String,
    /// (x, y) in pieces that are not joined.
    pub pieces: Vec<Vec<(f64, f64)>>,
}

impl Series {
    /// A line in one piece.
    pub fn whole(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.into(), pieces: vec![points] }
    }
}

const WIDTH: f64 = 420.0;
const HEIGHT: f64 = 230.0;
const LEFT: f64 = 62.0;
const RIGHT: f64 = WIDTH - 20.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = HEIGHT - 38.0;
/// Lines of a chart that are told apart by colour.
const COLORS: usize = 6;
/// Points of a line that still get a dot each.
const MOST_DOTS: usize = 60;
/// Numbers on an axis, at most.
const MOST_TICKS: f64 = 6.0;

/// The context of the template.
#[derive(Serialize)]
struct Drawing<'a> {
    title: &'a str,
    unit: &'a str,
    x_title: &'a str,
    note: &'a str,
    width: f64,
    height: f64,
    left: f64,
    right: f64,
    bottom: f64,
    x_ticks: Vec<Tick>,
    y_ticks: Vec<Tick>,
    marked: Option<Tick>,
    lines: Vec<Line<'a>>,
}

#[derive(Serialize)]
struct Tick {
    at: f64,
    label: String,
}

#[derive(Serialize)]
struct Line<'a> {
    name: &'a str,
    number: usize,
    pieces: Vec<String>,
    dots: Vec<Dot>,
}

#[derive(Serialize)]
struct Dot {
    x: f64,
    y: f64,
    text: String,
}

/// From numbers to places along an axis.
struct Axis {
    low: f64,
    high: f64,
    from: f64,
    to: f64,
    logarithmic: bool,
}

impl Axis {
    fn over(values: impl Iterator<Item = f64>, (from, to): (f64, f64), logarithmic: bool) -> Self {
        let scale = |v: f64| if logarithmic { v.log10() } else { v };
        let (low, high) = values.map(scale).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        let wider = if high > low { 0.0 } else { (0.05 * low.abs()).max(0.5) };
        Self { low: low - wider, high: high + wider, from, to, logarithmic }
    }

    fn at(&self, value: f64) -> f64 {
        let scaled = if self.logarithmic { value.log10() } else { value };
        let place = self.from + (scaled - self.low) / (self.high - self.low) * (self.to - self.from);
        (10.0 * place).round() / 10.0
    }

    /// Round numbers within the axis, `least_step` apart or more.
    fn round_numbers(&self, least_step: f64) -> Vec<f64> {
        if self.logarithmic && self.high - self.low > 1.0 {
            let digits: &[f64] = if self.high - self.low > 2.5 { &[1.0] } else { &[1.0, 2.0, 5.0] };
            let decades = self.low.floor() as i32..=self.high.ceil() as i32;
            let numbers = decades.flat_map(|power| digits.iter().map(move |digit| digit * 10f64.powi(power)));
            return numbers.filter(|v| (self.low - 1e-9..=self.high + 1e-9).contains(&v.log10())).collect();
        }
        let exponent = |v: f64| if self.logarithmic { 10f64.powf(v) } else { v };
        let (low, high) = (exponent(self.low), exponent(self.high));
        let rough = (high - low) / MOST_TICKS;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * power).into_iter().find(|step| *step >= rough);
        let step = step.unwrap_or(10.0 * power).max(least_step);
        let count = ((high / step + 1e-9).floor() - (low / step - 1e-9).ceil()) as usize;
        (0..=count).map(|i| ((low / step - 1e-9).ceil() + i as f64) * step).collect()
    }
}

impl Chart {
    /// The chart as HTML; empty when there is nothing to draw.
    ///
    /// # Errors
    /// None but those of the template.
    pub fn html(&self) -> Result<String> {
        let usable = |p: &&(f64, f64)| p.0.is_finite() && p.1.is_finite() && (!self.logarithmic || p.1 > 0.0);
        let all = || self.series.iter().flat_map(|s| s.pieces.iter().flatten()).filter(usable);
        if all().count() < 2 {
            return Ok(String::new());
        }
        let marked = self.marked.as_ref().filter(|(value, _)| !self.logarithmic || *value > 0.0);
        let x = Axis::over(all().map(|p| p.0), (LEFT, RIGHT), false);
        let values = all().map(|p| p.1).chain(marked.map(|(value, _)| *value));
        let y = Axis::over(values, (BOTTOM, TOP), self.logarithmic);
        let line = |(i, series): (usize, &'_ Series)| {
            let points = series.pieces.iter().flatten().filter(usable).count();
            let place = |p: &(f64, f64)| (x.at(p.0), y.at(p.1));
            let piece = |points: &Vec<(f64, f64)>| {
                let places: Vec<String> =
                    points.iter().filter(usable).map(place).map(|(x, y)| format!("{x},{y}")).collect();
                places.join(" ")
            };
            let dot = |p: &(f64, f64)| Dot { x: place(p).0, y: place(p).1, text: self.told(p) };
            let dots = series.pieces.iter().flatten().filter(usable).filter(|_| points <= MOST_DOTS).map(dot);
            (i % COLORS, series.pieces.iter().map(piece).collect(), dots.collect())
        };
        let lines = self.series.iter().enumerate().map(|(i, series)| {
            let (number, pieces, dots) = line((i, series));
            Line { name: &series.name, number, pieces, dots }
        });
        let drawing = Drawing {
            title: &self.title,
            unit: &self.unit,
            x_title: &self.x_title,
            note: &self.note,
            width: WIDTH,
            height: HEIGHT,
            left: LEFT,
            right: RIGHT,
            bottom: BOTTOM,
            x_ticks: x.round_numbers(1.0).into_iter().map(|v| Tick { at: x.at(v), label: format!("{v:.0}") }).collect(),
            y_ticks: ticks(&y),
            marked: marked.map(|(value, label)| Tick { at: y.at(*value), label: label.clone() }),
            lines: lines.collect(),
        };
        template::fill(&[("chart.svg", include_str!("chart.svg"))], &drawing)
    }

    /// What a point says when it is pointed at.
    fn told(&self, &(x, y): &(f64, f64)) -> String {
        format!("{} {x:.0}: {} {}", self.x_title, three_digits(y), self.unit).trim_end().to_owned()
    }
}

/// Numbers of the axis of values, all with as many digits as tell them apart.
fn ticks(axis: &Axis) -> Vec<Tick> {
    let numbers = axis.round_numbers(0.0);
    let step = numbers.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    let largest = numbers.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    let label = |v: f64| {
        if !(1e-3..1e5).contains(&largest) {
            if v == 0.0 { "0".into() } else { format!("{v:e}") }
        } else {
            let decimals = if step.is_finite() { (-step.log10().floor()).max(0.0) as usize } else { 2 };
            // Rounding makes -0 of small negative numbers.
            format!("{:.*}", if axis.logarithmic && v >= 1.0 { 0 } else { decimals }, v + 0.0)
        }
    };
    numbers.iter().map(|&v| Tick { at: axis.at(v), label: label(round_off(v)) }).collect()
}

/// A number without the last digits, in which sums of steps err.
fn round_off(value: f64) -> f64 {
    format!("{value:.9e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(series: Vec<Series>, logarithmic: bool) -> String {
        let titles = (String::from("a<b"), String::from("frame"));
        Chart { title: titles.0, x_title: titles.1, series, logarithmic, ..Chart::default() }.html().unwrap()
    }

    #[test]
    fn points_that_are_no_numbers_are_left_out() {
        let svg = chart(vec![Series::whole("s", vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, 3.0)])], true);
        assert!(!svg.contains("NaN") && svg.contains("a&lt;b"), "{svg}");
        assert_eq!(svg.matches("<circle").count(), 2);
    }

    #[test]
    fn nothing_to_draw_is_nothing() {
        assert!(chart(Vec::new(), false).is_empty());
    }

    #[test]
    fn frames_are_whole_numbers_and_pieces_are_not_joined() {
        let pieces = vec![vec![(0.0, 3.0), (1.0, 2.0)], vec![(2.0, 9.0), (3.0, 8.0)]];
        let svg = chart(vec![Series { name: "s".into(), pieces }], false);
        assert_eq!(svg.matches("<polyline").count(), 2);
        for frame in ["0", "1", "2", "3"] {
            assert!(svg.contains(&format!(">{frame}</text>")), "{frame}: {svg}");
        }
        assert!(!svg.contains(">0.5</text>"), "{svg}");
    }

    #[test]
    fn axes_have_round_numbers() {
        let axis = Axis::over([0.898, 0.981].into_iter(), (0.0, 1.0), false);
        let labels: Vec<String> = ticks(&axis).into_iter().map(|tick| tick.label).collect();
        assert_eq!(labels, ["0.90", "0.92", "0.94", "0.96", "0.98"]);
        let axis = Axis::over([150.0, 62_000.0].into_iter(), (0.0, 1.0), true);
        let labels: Vec<String> = ticks(&axis).into_iter().map(|tick| tick.label).collect();
        assert_eq!(labels, ["1000", "10000"]);
    }
}
