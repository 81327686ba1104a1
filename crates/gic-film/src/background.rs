//! The picture of the empty scene, from a film in which an object moves, comes to rest, or is held at first.
//!
//! For each pixel the colour that most frames share. Where the first or the last frames show another one, an object or
//! its shadow rested there in some of the film, and the outline decides: the empty scene has none, so the picture with
//! less contrast across the border of the changed region is the empty one. Pixels that no frames share a colour of are
//! never free; they are filled from around.

use std::ops::Range;

use gic_scene::Picture;
use gic_twin::Interrupt;
use rayon::prelude::*;

use crate::error::{FilmError, Result};
use crate::film::Film;
use crate::frames::Frame;
use crate::tuning::{
    CHANGE_NOISES, CLEARER_OUTLINE, CLOSING_SHARE, FEWEST_SHARING, LEAST_CHANGE, LEAST_REGION_PX, MAX_SAMPLES,
    MIN_FRAMES, MIN_NOISE, NOISE_SHARE, OUTLINE_REACH_PX, RESTING_SHARE, SAME_COLOUR_NOISES, SAMPLE_BYTES,
    SHARING_PART, SHORT_FILM, SOFT_OUTLINE,
};

/// The empty scene of a camera.
#[derive(Clone, Debug)]
pub struct EmptyScene {
    /// The picture.
    pub picture: Picture,
    /// Number of pixels that are never free and were filled from around.
    pub never_free: usize,
    /// Number of pixels of resting objects and shadows that were taken out.
    pub taken_out: usize,
}

impl EmptyScene {
    /// From a film's frames, spread over all of it.
    ///
    /// # Errors
    /// Frames that cannot be decoded, films of fewer than three frames, an interruption.
    pub fn of(film: &Film, interrupt: &Interrupt) -> Result<EmptyScene> {
        let count = film.times_s.len();
        if count < MIN_FRAMES {
            return Err(FilmError::content(
                &film.path,
                format!("has {count} frames, too few to tell the empty scene from the object"),
                "film for longer, or give a picture of the empty scene in `backgrounds`",
            ));
        }
        let fitting = (SAMPLE_BYTES / (3 * film.width * film.height).max(1)).clamp(MIN_FRAMES, MAX_SAMPLES);
        let mut selection = film.all();
        selection.every = count.div_ceil(fitting);
        let mut samples = Vec::new();
        for frame in film.frames(&selection)? {
            samples.push(frame?);
            interrupt.check("some pictures")?;
        }
        Ok(EmptyScene::from_samples(&samples))
    }

    /// From frames of one size, in the order of time.
    pub(crate) fn from_samples(samples: &[Frame]) -> EmptyScene {
        let (width, height) = (samples[0].width, samples[0].height);
        let noise = noise(samples);
        let mut most = Shared::among(samples, 0..samples.len(), &noise);
        let part = (samples.len() / SHARING_PART).max(FEWEST_SHARING);
        let mut taken_out = 0;
        // In a shorter film nothing rests for long.
        if 2 * part <= samples.len() {
            for some in [0..part, samples.len() - part..samples.len()] {
                taken_out += most.correct(&Shared::among(samples, some, &noise), part, width, &noise);
            }
        }
        // What lingers in a short film still leaves its place free in some frame.
        if samples.len() < SHORT_FILM {
            for frame in 0..samples.len() {
                let mut alone = Shared::among(samples, frame..frame + 1, &noise);
                alone.support.fill(u16::MAX);
                taken_out += most.correct(&alone, 1, width, &noise);
            }
        }
        let enough = (samples.len() / CLOSING_SHARE).max(2);
        let known: Vec<bool> = most.support.iter().map(|support| usize::from(*support) >= enough).collect();
        let never_free = known.iter().filter(|known| !**known).count();
        fill(&mut most.colours, known, width);
        let rgb = most.colours.into_iter().flatten().collect();
        EmptyScene { picture: Picture { width, height, rgb }, never_free, taken_out }
    }
}

/// Standard deviation of each pixel between frames that show the same, mean of its channels [1]: by the median
/// step from frame to frame, because dithering and codecs spread noise unevenly.
fn noise(samples: &[Frame]) -> Vec<f32> {
    /// Standard deviations of a normal distribution in its median absolute deviation, inverted.
    const BY_MEDIAN: f32 = 1.4826;
    let pixels = samples[0].width * samples[0].height;
    let of_pixel = |pixel: usize| {
        let step = |pair: &[Frame]| {
            let steps = (3 * pixel..3 * pixel + 3).map(|value| pair[0].rgb[value].abs_diff(pair[1].rgb[value]));
            steps.map(u16::from).sum::<u16>()
        };
        let mut steps: Vec<u16> = samples.windows(2).map(step).collect();
        let middle = steps.len() / 2;
        let median = f32::from(*steps.select_nth_unstable(middle).1) / (3.0 * 255.0);
        (BY_MEDIAN * median / std::f32::consts::SQRT_2).max(MIN_NOISE)
    };
    let mut noise: Vec<f32> = (0..pixels).into_par_iter().map(of_pixel).collect();
    // What always moves is no noise.
    let place = (NOISE_SHARE * (pixels - 1) as f64) as usize;
    let most = *noise.clone().select_nth_unstable_by(place, f32::total_cmp).1;
    noise.iter_mut().for_each(|sigma| *sigma = sigma.min(most));
    noise
}

/// The colour that most of some frames share, for each pixel.
struct Shared {
    colours: Vec<[f32; 3]>,
    /// Number of frames that share it.
    support: Vec<u16>,
}

impl Shared {
    fn among(samples: &[Frame], some: Range<usize>, noise: &[f32]) -> Shared {
        let samples = &samples[some];
        let pixels = samples[0].width * samples[0].height;
        let shared = (0..pixels).into_par_iter().map(|pixel| {
            let colour = |sample: &Frame| [0, 1, 2].map(|c| sample.rgb[3 * pixel + c]);
            let colours: Vec<[u8; 3]> = samples.iter().map(colour).collect();
            // Two values of one colour differ by noise twice.
            let same = SAME_COLOUR_NOISES * std::f32::consts::SQRT_2 * noise[pixel] * 255.0;
            shared_colour(&colours, same.ceil().min(255.0) as u8)
        });
        let (colours, support) = shared.unzip();
        Shared { colours, support }
    }

    /// Takes regions over from `other`, of so many frames, where it rests and its outlines show less; returns their
    /// number of pixels.
    fn correct(&mut self, other: &Shared, frames: usize, width: usize, noise: &[f32]) -> usize {
        let changed: Vec<bool> = (0..noise.len())
            .map(|pixel| {
                let (ours, others) = (self.colours[pixel], other.colours[pixel]);
                let threshold = (CHANGE_NOISES * noise[pixel]).max(LEAST_CHANGE);
                let rests = RESTING_SHARE * frames as f32 <= f32::from(other.support[pixel]);
                rests && (0..3).any(|c| (ours[c] - others[c]).abs() > threshold)
            })
            .collect();
        let mut taken = 0;
        for region in regions(&changed, width).into_iter().filter(|region| region.len() >= LEAST_REGION_PX) {
            let grown = Grown::around(&region, &changed, width);
            let [ours, others] = [&self.colours, &other.colours].map(|inside| grown.contrast(inside, &self.colours));
            let mean = |colours: &[[f32; 3]]| {
                region.iter().map(|pixel| f64::from(colours[*pixel].iter().sum::<f32>())).sum::<f64>()
                    / region.len() as f64
            };
            let gain = mean(&other.colours) - mean(&self.colours);
            // A soft shadow has hardly an outline: the brighter picture is without it.
            let is_shadow = ours.max(others) < SOFT_OUTLINE * gain.abs();
            if if is_shadow { gain > 0.0 } else { others < CLEARER_OUTLINE * ours } {
                for &pixel in &grown.pixels {
                    self.colours[pixel] = other.colours[pixel];
                    self.support[pixel] = other.support[pixel];
                }
                taken += region.len();
            }
        }
        taken
    }
}

/// The mean of the largest group of values that are like one of them, and the group's size.
fn shared_colour(colours: &[[u8; 3]], same: u8) -> ([f32; 3], u16) {
    let alike = |a: &[u8; 3], b: &[u8; 3]| (0..3).all(|c| a[c].abs_diff(b[c]) <= same);
    let group_size = |a: &[u8; 3]| colours.iter().filter(|b| alike(a, b)).count();
    let mut best = (0, colours[0]);
    for colour in colours {
        let size = group_size(colour);
        if size > best.0 {
            best = (size, *colour);
        }
        if 2 * best.0 > colours.len() + 1 && alike(&best.1, colour) {
            // A majority: no other group is larger.
            break;
        }
    }
    let mut sum = [0.0; 3];
    for colour in colours.iter().filter(|colour| alike(&best.1, colour)) {
        (0..3).for_each(|c| sum[c] += f32::from(colour[c]) / 255.0);
    }
    (sum.map(|value| value / best.0 as f32), best.0 as u16)
}

/// The connected regions of pixels that are set, each in order of discovery.
fn regions(set: &[bool], width: usize) -> Vec<Vec<usize>> {
    let mut seen: Vec<bool> = set.iter().map(|set| !set).collect();
    let mut regions = Vec::new();
    for first in 0..set.len() {
        if seen[first] {
            continue;
        }
        seen[first] = true;
        let mut region = vec![first];
        let mut next = 0;
        while next < region.len() {
            for pixel in neighbours(region[next], width, set.len()) {
                if !std::mem::replace(&mut seen[pixel], true) {
                    region.push(pixel);
                }
            }
            next += 1;
        }
        regions.push(region);
    }
    regions
}

/// The pixels to the right, left, below and above.
fn neighbours(pixel: usize, width: usize, count: usize) -> impl Iterator<Item = usize> {
    let column = pixel % width;
    [
        (column + 1 < width).then(|| pixel + 1),
        (column > 0).then(|| pixel - 1),
        (pixel + width < count).then(|| pixel + width),
        pixel.checked_sub(width),
    ]
    .into_iter()
    .flatten()
}

/// A region with what lies around it, and pairs of pixels across its border.
struct Grown {
    pixels: Vec<usize>,
    /// Inside, outside.
    pairs: Vec<(usize, usize)>,
}

impl Grown {
    fn around(region: &[usize], changed: &[bool], width: usize) -> Grown {
        let count = changed.len();
        let mut inside = std::collections::BTreeSet::from_iter(region.iter().copied());
        let mut pairs = Vec::new();
        for &pixel in region {
            let column = pixel % width;
            let reach = OUTLINE_REACH_PX;
            let across = [
                (column + reach < width).then(|| pixel + reach),
                (column >= reach).then(|| pixel - reach),
                (pixel + reach * width < count).then(|| pixel + reach * width),
                pixel.checked_sub(reach * width),
            ];
            // What has changed, too, tells nothing about the border of this region.
            pairs.extend(across.into_iter().flatten().filter(|other| !changed[*other]).map(|other| (pixel, other)));
        }
        for _ in 0..OUTLINE_REACH_PX {
            let around: Vec<usize> = inside.iter().flat_map(|pixel| neighbours(*pixel, width, count)).collect();
            inside.extend(around);
        }
        Grown { pixels: inside.into_iter().collect(), pairs }
    }

    /// Mean difference across the border.
    fn contrast(&self, inside: &[[f32; 3]], outside: &[[f32; 3]]) -> f64 {
        let difference =
            |(p, q): &(usize, usize)| (0..3).map(|c| f64::from((inside[*p][c] - outside[*q][c]).abs())).sum::<f64>();
        self.pairs.iter().map(difference).sum::<f64>() / self.pairs.len().max(1) as f64
    }
}

/// Fills unknown pixels with the mean of their known neighbours, from their border inwards.
fn fill(colours: &mut [[f32; 3]], mut known: Vec<bool>, width: usize) {
    let mut left: Vec<usize> = (0..known.len()).filter(|pixel| !known[*pixel]).collect();
    while !left.is_empty() {
        let mean = |pixel: usize| {
            let around: Vec<usize> = neighbours(pixel, width, known.len()).filter(|other| known[*other]).collect();
            let sum = |c: usize| around.iter().map(|other| colours[*other][c]).sum::<f32>() / around.len() as f32;
            (!around.is_empty()).then(|| [sum(0), sum(1), sum(2)])
        };
        let filled: Vec<(usize, [f32; 3])> = left.iter().filter_map(|pixel| Some((*pixel, mean(*pixel)?))).collect();
        if filled.is_empty() {
            // No pixel is known at all: they stay as they are.
            return;
        }
        for (pixel, colour) in filled {
            colours[pixel] = colour;
            known[pixel] = true;
        }
        left.retain(|pixel| !known[*pixel]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 60;
    const HEIGHT: usize = 40;

    /// A floor with a pattern, a little noise, and a dark disc with a shadow to its right, at (x, y) where it is shown.
    fn frame(index: usize, disc: Option<(f32, f32)>) -> Frame {
        let mut state = index as u64 + 1;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1 << 24) as f32 - 0.5
        };
        let rgb = (0..WIDTH * HEIGHT).flat_map(|i| {
            let (x, y) = ((i % WIDTH) as f32, (i / WIDTH) as f32);
            let mut colour = floor(i);
            if let Some((cx, cy)) = disc {
                let shadow = (1.0 - (x - cx - 6.0).hypot(y - cy - 3.0) / 9.0).clamp(0.0, 0.5);
                colour = colour.map(|value| value * (1.0 - shadow));
                if (x - cx).hypot(y - cy) < 5.0 {
                    colour = [0.2, 0.25, 0.5];
                }
            }
            colour.map(|value| ((value + 0.02 * random()) * 255.0).round() as u8)
        });
        Frame { index, width: WIDTH, height: HEIGHT, rgb: rgb.collect() }
    }

    fn floor(i: usize) -> [f32; 3] {
        let (x, y) = (i % WIDTH, i / WIDTH);
        let tile = if (x / 10 + y / 10).is_multiple_of(2) { 0.1 } else { 0.0 };
        [0.6 + tile, 0.55 + tile, 0.5]
    }

    fn worst(scene: &EmptyScene) -> f32 {
        let pairs = scene.picture.rgb.chunks_exact(3).enumerate();
        pairs.flat_map(|(i, rgb)| (0..3).map(move |c| (rgb[c] - floor(i)[c]).abs())).fold(0.0, f32::max)
    }

    #[test]
    fn an_object_that_is_held_then_falls_then_rests_leaves_no_trace() {
        // A third of the film held, some frames of fall, half of the film at rest.
        let place = |n: usize| match n {
            0..10 => (12.0, 8.0),
            10..16 => (12.0 + 3.5 * (n - 9) as f32, 8.0 + 3.5 * (n - 9) as f32),
            _ => (36.0, 31.0),
        };
        let samples: Vec<Frame> = (0..32).map(|n| frame(n, Some(place(n)))).collect();
        let scene = EmptyScene::from_samples(&samples);
        assert!(worst(&scene) < 0.04, "off by {}", worst(&scene));
        assert!(scene.taken_out > 50, "{} pixels", scene.taken_out);
    }

    #[test]
    fn an_object_that_comes_late_or_leaves_early_is_taken_out_and_nothing_else_is() {
        let late: Vec<Frame> = (0..30).map(|n| frame(n, (n >= 9).then_some((30.0, 20.0)))).collect();
        let early: Vec<Frame> = (0..30).map(|n| frame(n, (n < 21).then_some((30.0, 20.0)))).collect();
        for samples in [late, early] {
            let scene = EmptyScene::from_samples(&samples);
            assert!(worst(&scene) < 0.04, "off by {}", worst(&scene));
        }
        let empty: Vec<Frame> = (0..12).map(|n| frame(n, None)).collect();
        let scene = EmptyScene::from_samples(&empty);
        assert!(worst(&scene) < 0.04 && (scene.never_free, scene.taken_out) == (0, 0));
    }

    #[test]
    fn pixels_that_are_never_free_are_counted_and_filled_from_around() {
        // A light of another colour in each frame.
        let samples: Vec<Frame> = (0..12)
            .map(|n| {
                let mut frame = frame(n, None);
                for y in 15..18 {
                    for x in 23..26 {
                        let at = 3 * (y * WIDTH + x);
                        frame.rgb[at..at + 3].copy_from_slice(&[(n * 20) as u8, 255 - (n * 20) as u8, 0]);
                    }
                }
                frame
            })
            .collect();
        let scene = EmptyScene::from_samples(&samples);
        assert_eq!(scene.never_free, 9);
        assert!(worst(&scene) < 0.12, "off by {}: a tile, at most", worst(&scene));
    }
}
