//! Time and colour bar in a picture.

use gic_scene::Picture;

use super::color_scale::{ColorScale, blue_to_red};
use super::lettering::{blend, width_of, write};
use crate::units::three_digits;

/// Height of a capital as a share of the picture's height, and at least [pixels].
const LETTER_SHARE: f32 = 0.026;
const LEAST_LETTER_PX: f32 = 8.0;
/// Pictures that are lower get no labels: they would hide it. [pixels]
const LEAST_HEIGHT_PX: usize = 160;
/// Length of the colour bar as a share of the picture's width.
const BAR_SHARE: f32 = 0.3;

/// When a picture is of.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moment {
    /// Time [s].
    pub(super) time_s: f64,
    /// Whether nothing was fitted to the film of that time.
    pub(super) predicted: bool,
}

/// Writes the moment at the bottom and, where colours measure something, their scale at the top.
pub(super) fn label(picture: &mut Picture, scale: Option<&ColorScale>, moment: Option<Moment>) {
    if picture.height < LEAST_HEIGHT_PX {
        return;
    }
    let letter = (LETTER_SHARE * picture.height as f32).max(LEAST_LETTER_PX);
    let margin = 1.4 * letter;
    if let Some(Moment { time_s, predicted }) = moment {
        let text = format!("{time_s:.3} s{}", if predicted { ", predicted" } else { "" });
        // Narrow pictures have smaller letters.
        let room = picture.width as f32 - 2.0 * margin;
        let letter = letter.min(letter * room / width_of(&text, letter));
        write(picture, &text, (margin, picture.height as f32 - margin - letter), letter);
    }
    if let Some((title, unit)) = scale.and_then(ColorScale::title) {
        let max_value = scale.map_or(1.0, ColorScale::max_value);
        write(picture, &format!("{title} [{}]", unit.name), (margin, margin), letter);
        let length = BAR_SHARE * picture.width as f32;
        bar(picture, (margin, margin + 1.8 * letter), (length, 0.9 * letter));
        let most = three_digits(max_value / unit.size);
        let below = margin + 3.3 * letter;
        write(picture, "0", (margin, below), letter);
        write(picture, &most, (margin + length - width_of(&most, letter), below), letter);
    }
}

/// The colours from blue to red, with a dark rim.
fn bar(picture: &mut Picture, (left, top): (f32, f32), (length, height): (f32, f32)) {
    for y in (top as usize).saturating_sub(1)..((top + height) as usize + 1).min(picture.height) {
        for x in (left as usize).saturating_sub(1)..((left + length) as usize + 1).min(picture.width) {
            let inside = (top as usize..(top + height) as usize).contains(&y)
                && (left as usize..(left + length) as usize).contains(&x);
            let color = if inside { blue_to_red((x as f32 + 0.5 - left) / length) } else { [0.1; 3] };
            blend(picture, x, y, color, 1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bar_runs_from_blue_to_red_and_small_pictures_stay_clean() {
        let scale = ColorScale::stress(5e4);
        let grey = |height: usize| Picture { width: 320, height, rgb: vec![0.5; 3 * 320 * height] };
        let mut picture = grey(240);
        let moment = |predicted| Some(Moment { time_s: 0.25, predicted });
        label(&mut picture, Some(&scale), moment(false));
        let vivid: Vec<(usize, [f32; 3])> = (0..320 * 240)
            .map(|i| (i % 320, picture.at(i % 320, i / 320)))
            .filter(|(_, c)| (c[0] - c[2]).abs() > 0.3)
            .collect();
        let (first, last) =
            (vivid.iter().min_by_key(|(x, _)| *x).unwrap(), vivid.iter().max_by_key(|(x, _)| *x).unwrap());
        assert!(first.1[2] > first.1[0] && last.1[0] > last.1[2], "{first:?} {last:?}");
        let bright_below =
            |picture: &Picture, from: usize| (200..240).any(|y| (from..320).any(|x| picture.at(x, y)[0] > 0.95));
        assert!(bright_below(&picture, 0) && !bright_below(&picture, 80), "the time alone");
        let mut predicted = grey(240);
        label(&mut predicted, Some(&scale), moment(true));
        assert!(bright_below(&predicted, 80), "that it is predicted");
        let mut small = grey(100);
        label(&mut small, Some(&scale), moment(true));
        assert_eq!(small, grey(100));
    }
}
