//! Masks made from pictures: against the empty background, against a copy over white.
//!
//! [`difference_matte`] weighs for each pixel how likely the background gives its colour, lit or in shadow
//! (`background`), against how likely the object does (`colours`); the labels that are most likely together are a
//! minimum cut (`cut`); `outline` finds the coverage along their border.

mod background;
mod colours;
mod cut;
mod denoise;
mod outline;
mod pixel_set;
mod tuning;

use rayon::prelude::*;

use self::background::{Background, noise};
use self::colours::Colours;
use self::cut::Grid;
use self::denoise::denoised;
use self::outline::Outline;
use self::pixel_set::PixelSet;
use crate::picture::{Mask, Picture, PixelBox};

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
/// Each pixel x is background (lit or in shadow) or object. The labels minimise
///
/// ```text
/// sum_x -ln p(I(x) | label(x)) + sum_xy contrast(I(x), I(y)) [label(x) != label(y)]
/// ```
///
/// over neighbours x, y, exactly, as a minimum cut, in pictures without their noise. Noise, the tint of shadows and the
/// object's colours are estimated from the picture: the noise by what a quarter of the pixels exceed, because fewer are
/// object; the tint from pixels that are likely in shadow; the colours from the labels of the cut before. Of several
/// regions the one stays that shows the largest body; small gaps and holes close. Across the outline, coverage a solves
/// I = a F + (1 - a) S with F the colours just inside and S the background in the shadow just outside.
pub fn difference_matte(picture: &Picture, background: &Picture) -> Mask {
    difference_matte_within(picture, background, None)
}

/// The same for an object within a window.
pub(crate) fn difference_matte_within(picture: &Picture, background: &Picture, window: Option<PixelBox>) -> Mask {
    let (width, height) = (picture.width.min(background.width), picture.height.min(background.height));
    let pixel = |i: usize| (i % width, i / width);
    let filmed = [picture, background]
        .map(|picture| -> Vec<[f32; 3]> { (0..width * height).map(|i| picture.at(pixel(i).0, pixel(i).1)).collect() });
    let noise = noise(&filmed[0], &filmed[1]);
    let [image, empty] = filmed.map(|pixels| denoised(&pixels, width, noise));
    let model = Background::fit(&image, &empty);
    let shades = model.shades(&image, &empty);

    let mut object = PixelSet { width, height, inside: vec![false; width * height] };
    let mut colours = Colours::unknown();
    for _ in 0..tuning::COLOUR_FITS {
        let is_outside = |i: usize| window.is_some_and(|window| !window.contains(i % width, i / width));
        let pull = |i: usize| if is_outside(i) { f32::MIN } else { shades[i].cost - colours.cost(image[i]) };
        let pulls: Vec<f32> = (0..width * height).into_par_iter().map(pull).collect();
        object.inside = Grid::new(width, &pulls, &image, &model.noise).cut();
        object.keep_largest();
        colours = Colours::of(&image, &object.inside);
    }
    object.close(2);
    object.fill_holes(0.01);

    let (core, reach) = (object.eroded(), object.dilated());
    let at_edge = Outline { picture, background, shades: &shades, tint: model.tint, core: &core, reach: &reach };
    let coverage = (0..width * height).map(|i| {
        if core.inside[i] {
            return 1.0;
        }
        if !reach.inside[i] {
            return 0.0;
        }
        at_edge.coverage(pixel(i).0, pixel(i).1).unwrap_or(f32::from(u8::from(object.inside[i])))
    });
    Mask { width, height, coverage: coverage.collect() }
}
