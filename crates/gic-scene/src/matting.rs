//! Masks made from pictures: against the empty background, against a copy over white.

use crate::picture::{Mask, Picture};

/// Coverage a from a picture I and its copy over white W = a I + (1 - a): least squares over the three channels.
pub(crate) fn from_white(picture: &Picture, over_white: &Picture) -> Mask {
    let pairs = picture.rgb.chunks_exact(3).zip(over_white.rgb.chunks_exact(3));
    let coverage = pairs
        .map(|(image, white)| {
            let (mut product, mut square) = (0.0, 0.0);
            for channel in 0..3 {
                product += (1.0 - white[channel]) * (1.0 - image[channel]);
                square += (1.0 - image[channel]) * (1.0 - image[channel]);
            }
            if square > 1e-6 { (product / square).clamp(0.0, 1.0) } else { 0.0 }
        })
        .collect();
    Mask { width: over_white.width, height: over_white.height, coverage }
}

/// The object's coverage in a picture, by comparing it with the picture of the empty background (of the same size).
///
/// A shadow scales the background's colour, the object changes it: for each pixel I of the picture over B of the
/// background, the shade s = <I, B> / <B, B> and the residual |I - s B| tell them apart. Pixels with a residual above
/// the noise, brighter than the background or far darker than a soft shadow seed the object; clean-up closes gaps,
/// fills small holes and keeps the largest component. Across the outline, coverage a solves I = a F + (1 - a) s B with
/// F the colours just inside and s the shade just outside.
pub fn difference_matte(picture: &Picture, background: &Picture) -> Mask {
    let (width, height) = (picture.width.min(background.width), picture.height.min(background.height));
    let shading: Vec<Shading> = (0..width * height)
        .map(|i| Shading::new(picture.at(i % width, i / width), background.at(i % width, i / width)))
        .collect();
    let threshold = residual_threshold(&shading);
    let seeds = shading.iter().map(|pixel| pixel.is_object(threshold)).collect();
    let mut object = PixelSet { width, height, inside: seeds };
    object.keep_largest();
    object.close(2);
    object.fill_holes(0.01);
    let (core, reach) = (object.eroded(), object.dilated());
    let coverage = (0..width * height)
        .map(|i| {
            if core.inside[i] {
                1.0
            } else if !reach.inside[i] {
                0.0
            } else {
                let (x, y) = (i % width, i / width);
                let at_edge = Outline { picture, background, shading: &shading, core: &core, reach: &reach };
                at_edge.coverage(x, y).unwrap_or(f32::from(u8::from(object.inside[i])))
            }
        })
        .collect();
    Mask { width, height, coverage }
}

/// How a pixel differs from the empty background.
#[derive(Clone, Copy)]
struct Shading {
    /// Brightness in units of the background's: 1 unchanged, below 1 in shadow.
    shade: f32,
    /// Largest difference of a channel after scaling the background by the shade.
    residual: f32,
}

/// Shades of soft shadows: darker or brighter pixels belong to the object.
const SHADOW_SHADES: std::ops::RangeInclusive<f32> = 0.3..=1.05;
/// Smallest residual that seeds the object, in units of full brightness: above the rounding of 8-bit pictures and the
/// coloured light that an object throws on the floor (0.012 in the measured scenes).
const MIN_OBJECT_RESIDUAL: f32 = 0.02;

impl Shading {
    fn new(image: [f32; 3], background: [f32; 3]) -> Shading {
        let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        // A black background pixel has no colour to compare: the whole picture is residual.
        let shade = dot(image, background) / dot(background, background).max(1e-4);
        let residual = (0..3).map(|c| (image[c] - shade * background[c]).abs()).fold(0.0, f32::max);
        Shading { shade, residual }
    }

    fn is_object(self, threshold: f32) -> bool {
        self.residual > threshold || !SHADOW_SHADES.contains(&self.shade)
    }
}

/// The residual that separates object from background: six times the noise, which the median pixel shows, because most
/// pixels are background.
fn residual_threshold(shading: &[Shading]) -> f32 {
    let mut residuals: Vec<f32> = shading.iter().map(|pixel| pixel.residual).collect();
    if residuals.is_empty() {
        return MIN_OBJECT_RESIDUAL;
    }
    let middle = residuals.len() / 2;
    let (_, median, _) = residuals.select_nth_unstable_by(middle, f32::total_cmp);
    MIN_OBJECT_RESIDUAL.max(6.0 * *median)
}

/// What is known on both sides of the object's outline.
struct Outline<'a> {
    picture: &'a Picture,
    background: &'a Picture,
    shading: &'a [Shading],
    /// Pixels certainly inside.
    core: &'a PixelSet,
    /// Pixels not certainly outside.
    reach: &'a PixelSet,
}

impl Outline<'_> {
    /// Coverage of the pixel in column `x`, row `y`; `None` without pixels inside near by, or where the object has the
    /// background's colour.
    fn coverage(&self, x: usize, y: usize) -> Option<f32> {
        let (mut front, mut front_count) = ([0.0; 3], 0.0);
        for radius in [2, 4] {
            self.core.near(x, y, radius, |x, y, inside| {
                if inside {
                    let colour = self.picture.at(x, y);
                    (0..3).for_each(|c| front[c] += colour[c]);
                    front_count += 1.0;
                }
            });
            if front_count > 0.0 {
                break;
            }
        }
        if front_count == 0.0 {
            return None;
        }
        let (mut shade, mut shade_count) = (0.0, 0.0);
        self.reach.near(x, y, 3, |x, y, inside| {
            if !inside {
                shade += self.shading[y * self.reach.width + x].shade;
                shade_count += 1.0;
            }
        });
        let shade = if shade_count > 0.0 { shade / shade_count } else { 1.0 };
        let (image, behind) = (self.picture.at(x, y), self.background.at(x, y));
        let (mut product, mut square) = (0.0, 0.0);
        for c in 0..3 {
            let (back, step) = (shade * behind[c], front[c] / front_count - shade * behind[c]);
            product += (image[c] - back) * step;
            square += step * step;
        }
        (square > 1e-4).then(|| (product / square).clamp(0.0, 1.0))
    }
}

/// A set of pixels.
struct PixelSet {
    width: usize,
    height: usize,
    inside: Vec<bool>,
}

impl PixelSet {
    /// Calls `visit(column, row, inside)` for all pixels at most `radius` columns and rows away.
    fn near(&self, x: usize, y: usize, radius: usize, mut visit: impl FnMut(usize, usize, bool)) {
        for row in y.saturating_sub(radius)..(y + radius + 1).min(self.height) {
            for column in x.saturating_sub(radius)..(x + radius + 1).min(self.width) {
                visit(column, row, self.inside[row * self.width + column]);
            }
        }
    }

    /// The region grown by one pixel in all eight directions.
    fn dilated(&self) -> PixelSet {
        self.spread(true)
    }

    /// The region shrunk by one pixel in all eight directions; beyond the picture it goes on.
    fn eroded(&self) -> PixelSet {
        self.spread(false)
    }

    /// Every pixel with a `value` pixel among its eight neighbours takes `value`.
    fn spread(&self, value: bool) -> PixelSet {
        let mut inside = self.inside.clone();
        for y in 0..self.height {
            for x in 0..self.width {
                let mut found = false;
                self.near(x, y, 1, |_, _, inside| found |= inside == value);
                if found {
                    inside[y * self.width + x] = value;
                }
            }
        }
        PixelSet { inside, ..*self }
    }

    /// Closes gaps of up to `2 * radius` pixels.
    fn close(&mut self, radius: usize) {
        let mut closed = PixelSet { inside: self.inside.clone(), ..*self };
        (0..radius).for_each(|_| closed = closed.dilated());
        (0..radius).for_each(|_| closed = closed.eroded());
        self.inside = closed.inside;
    }

    /// Keeps the largest connected component, diagonal neighbours included.
    fn keep_largest(&mut self) {
        let components = self.components(true, true);
        let largest = components.into_iter().max_by_key(Vec::len).unwrap_or_default();
        self.inside.fill(false);
        largest.into_iter().for_each(|i| self.inside[i] = true);
    }

    /// Fills enclosed holes smaller than `fraction` of the region: texture that matched the background, not openings.
    fn fill_holes(&mut self, fraction: f64) {
        let limit = fraction * self.inside.iter().filter(|&&inside| inside).count() as f64;
        for hole in self.components(false, false).into_iter().filter(|hole| hole.len() as f64 <= limit) {
            hole.into_iter().for_each(|i| self.inside[i] = true);
        }
    }

    /// The connected components of pixels equal to `value`, in reading order of their first pixel.
    fn components(&self, value: bool, diagonal: bool) -> Vec<Vec<usize>> {
        let mut seen = vec![false; self.inside.len()];
        let mut components = Vec::new();
        for first in 0..self.inside.len() {
            if seen[first] || self.inside[first] != value {
                continue;
            }
            seen[first] = true;
            let mut component = vec![first];
            let mut next = 0;
            while next < component.len() {
                let (x, y) = (component[next] % self.width, component[next] / self.width);
                next += 1;
                self.near(x, y, 1, |column, row, inside| {
                    let i = row * self.width + column;
                    if inside == value && !seen[i] && (diagonal || column == x || row == y) {
                        seen[i] = true;
                        component.push(i);
                    }
                });
            }
            components.push(component);
        }
        components
    }
}
