//! Corners of a tag to a fraction of a pixel: all of the tag is laid over the picture, not its outline alone.
//!
//! The tag's pattern T, mapped by the homography of its four corners c and blurred by a Gaussian of s pixels, explains
//! the brightness as `gain T + offset`; c and s minimise the squared difference, gain and offset follow linearly.

use gic_optimize::least_squares;
use nalgebra::{DVector, Matrix3, Vector3};

use crate::board::CORNERS;
use crate::detect::{DATA_MODULES, Sighting, dark_modules};
use crate::grey::Grey;
use crate::homography::homography;
use crate::tuning::{
    ALIGN_DIFFERENCE_PX, ALIGN_MARGIN_MODULES, ALIGN_MOST_PIXELS, BLUR_DIFFERENCE_PX, FIRST_BLUR_PX, LEAST_CORRELATION,
    LEAST_SIDE_PX, MOST_SHIFT_MODULES, SEARCH_STEPS,
};

/// The tag's corners where its pattern fits best; `None` where it fits badly, or far from where it was looked for.
pub(crate) fn align(picture: &Grey, tag: &Sighting) -> Option<Sighting> {
    let side = shortest_side(&tag.corners);
    if side.is_nan() || side < LEAST_SIDE_PX {
        return None;
    }
    let pattern = Pattern::of(tag)?;
    let pixels = pattern.pixels(picture, &tag.corners)?;
    let residuals = |unknowns: &DVector<f64>| pattern.fit(&pixels, unknowns).0;
    let mut start = DVector::from_element(9, FIRST_BLUR_PX);
    start.as_mut_slice()[..8].copy_from_slice(tag.corners.as_flattened());
    let mut differences = [ALIGN_DIFFERENCE_PX; 9];
    differences[8] = BLUR_DIFFERENCE_PX;
    let found = least_squares(residuals, start, &differences).unknowns;
    let corners = [0, 1, 2, 3].map(|k| [found[2 * k], found[2 * k + 1]]);
    let moved = corners.iter().zip(&tag.corners).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f64::max);
    let module = side / pattern.modules as f64;
    let is_there =
        moved <= (MOST_SHIFT_MODULES * module).max(1.0) && pattern.fit(&pixels, &found).1 >= LEAST_CORRELATION;
    is_there.then_some(Sighting { corners, ..*tag })
}

/// A tag where it is guessed to be, shifted by some modules to where its pattern correlates best with the picture.
pub(crate) fn shifted(picture: &Grey, tag: &Sighting) -> Option<Sighting> {
    let pattern = Pattern::of(tag)?;
    let pixels = pattern.pixels(picture, &tag.corners)?;
    let step = 0.5 * shortest_side(&tag.corners) / pattern.modules as f64;
    let at = |n: i32| {
        let across = 2 * SEARCH_STEPS + 1;
        let shift = [n % across, n / across].map(|k| f64::from(k - SEARCH_STEPS) * step);
        tag.corners.map(|[x, y]| [x + shift[0], y + shift[1]])
    };
    let correlation = |corners: &[[f64; 2]; 4]| {
        let mut unknowns = DVector::from_element(9, 0.0);
        unknowns.as_mut_slice()[..8].copy_from_slice(corners.as_flattened());
        pattern.fit(&pixels, &unknowns).1
    };
    let trials = (0..(2 * SEARCH_STEPS + 1).pow(2)).map(at).map(|corners| (correlation(&corners), corners));
    let (_, corners) = trials.max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(Sighting { corners, ..*tag })
}

/// The shortest side of a tag [pixels].
pub(crate) fn shortest_side(corners: &[[f64; 2]; 4]) -> f64 {
    let side = |k: usize| {
        let (a, b) = (corners[k], corners[(k + 1) % 4]);
        (a[0] - b[0]).hypot(a[1] - b[1])
    };
    (0..4).map(side).fold(f64::INFINITY, f64::min)
}

struct Pattern {
    dark: [[bool; DATA_MODULES]; DATA_MODULES],
    border: usize,
    modules: usize,
}

/// A pixel's middle and brightness.
type Pixel = ([f64; 2], f64);

impl Pattern {
    fn of(tag: &Sighting) -> Option<Pattern> {
        Some(Pattern { dark: dark_modules(tag.id)?, border: tag.border, modules: DATA_MODULES + 2 * tag.border })
    }

    /// 1 where the paper is white, at a place in modules from the tag's upper left corner.
    fn white(&self, x: f64, y: f64) -> f64 {
        let (x, y) = (x.floor(), y.floor());
        let inside = |n: f64, from: usize, to: usize| n >= from as f64 && n < to as f64;
        if !(inside(x, 0, self.modules) && inside(y, 0, self.modules)) {
            return 1.0;
        }
        let (from, to) = (self.border, self.border + DATA_MODULES);
        if !(inside(x, from, to) && inside(y, from, to)) {
            return 0.0;
        }
        if self.dark[y as usize - from][x as usize - from] { 0.0 } else { 1.0 }
    }

    /// Modules from the tag's upper left corner, of a pixel.
    fn modules_from_picture(&self, corners: &[[f64; 2]; 4]) -> Option<Matrix3<f64>> {
        let n = self.modules as f64;
        homography(corners, &CORNERS.map(|[x, y]| [(x + 0.5) * n, (0.5 - y) * n]))
    }

    /// The pixels on the tag and the white around it, without the white's corners; `None` where too few are there.
    fn pixels(&self, picture: &Grey, corners: &[[f64; 2]; 4]) -> Option<Vec<Pixel>> {
        let map = self.modules_from_picture(corners)?;
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for axis in 0..2 {
            corners.iter().for_each(|corner| low[axis] = low[axis].min(corner[axis]));
            corners.iter().for_each(|corner| high[axis] = high[axis].max(corner[axis]));
            let around = (high[axis] - low[axis]) / self.modules as f64 * ALIGN_MARGIN_MODULES + 1.0;
            (low[axis], high[axis]) = (low[axis] - around, high[axis] + around);
        }
        let sizes = [picture.width, picture.height];
        let is_inside = (0..2).all(|axis| low[axis] >= 0.0 && high[axis] <= sizes[axis] as f64);
        if !is_inside {
            return None;
        }
        let area = (high[0] - low[0]) * (high[1] - low[1]);
        let step = ((area / ALIGN_MOST_PIXELS).sqrt().ceil() as usize).max(1);
        let (n, margin) = (self.modules as f64, ALIGN_MARGIN_MODULES);
        let mut pixels = Vec::new();
        for row in (low[1] as usize..high[1] as usize).step_by(step) {
            for column in (low[0] as usize..high[0] as usize).step_by(step) {
                let place = [column as f64 + 0.5, row as f64 + 0.5];
                let [x, y] = mapped(&map, place);
                let beyond = [x, y].map(|m| (-m).max(m - n));
                if beyond[0].max(beyond[1]) < margin && beyond[0].min(beyond[1]) < 0.0 {
                    pixels.push((place, f64::from(picture.values[row * picture.width + column])));
                }
            }
        }
        (pixels.len() > 3 * 9).then_some(pixels)
    }

    /// Brightness minus what the pattern explains, and their correlation.
    fn fit(&self, pixels: &[Pixel], unknowns: &DVector<f64>) -> (DVector<f64>, f64) {
        let corners = [0, 1, 2, 3].map(|k| [unknowns[2 * k], unknowns[2 * k + 1]]);
        let Some(map) = self.modules_from_picture(&corners) else {
            return (DVector::from_element(pixels.len(), f64::INFINITY), 0.0);
        };
        let white: Vec<f64> = if unknowns[8] == 0.0 {
            let sharp = |place: &[f64; 2]| mapped(&map, *place);
            pixels.iter().map(|(place, _)| sharp(place)).map(|[x, y]| self.white(x, y)).collect()
        } else {
            // A pixel's own box and the blur.
            let spread = (unknowns[8] * unknowns[8] + 1.0 / 12.0).sqrt();
            pixels.iter().map(|(place, _)| self.blurred(&map, *place, spread)).collect()
        };
        let count = pixels.len() as f64;
        let means = (white.iter().sum::<f64>() / count, pixels.iter().map(|pixel| pixel.1).sum::<f64>() / count);
        let (mut xx, mut xy, mut yy) = (1e-12, 0.0, 1e-12);
        for (white, (_, value)) in white.iter().zip(pixels) {
            let (x, y) = (white - means.0, value - means.1);
            (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
        }
        // Paper is brighter than ink.
        let gain = (xy / xx).max(0.0);
        let residuals = white.iter().zip(pixels).map(|(white, (_, value))| value - means.1 - gain * (white - means.0));
        (DVector::from_iterator(pixels.len(), residuals), xy / (xx * yy).sqrt())
    }

    /// White around a pixel, weighted by a Gaussian of `spread` pixels.
    fn blurred(&self, map: &Matrix3<f64>, [u, v]: [f64; 2], spread: f64) -> f64 {
        /// Places across, in standard deviations, and their weights: six even parts of -2 to 2.
        const PLACES: [(f64, f64); 6] =
            [(-1.667, 0.071), (-1.0, 0.1685), (-0.333, 0.2605), (0.333, 0.2605), (1.0, 0.1685), (1.667, 0.071)];
        let mut sum = 0.0;
        for (y, wy) in PLACES {
            for (x, wx) in PLACES {
                let [mx, my] = mapped(map, [u + x * spread, v + y * spread]);
                sum += wx * wy * self.white(mx, my);
            }
        }
        sum
    }
}

fn mapped(map: &Matrix3<f64>, [x, y]: [f64; 2]) -> [f64; 2] {
    let p = map * Vector3::new(x, y, 1.0);
    [p.x / p.z, p.y / p.z]
}
