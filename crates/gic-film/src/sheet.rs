//! Sheets of small pictures with times or names below them.

use gic_scene::{Mask, Picture, sheet as tiles};
use gic_twin::Interrupt;

use crate::error::Result;
use crate::film::Film;
use crate::tuning::SHEET_COLUMNS;

/// Small pictures of films (rows) over all of their length, with the time of each [s], for choosing what to cut out.
///
/// # Errors
/// Frames that cannot be decoded.
pub fn thumbnails(films: &[Film], interrupt: &Interrupt) -> Result<Picture> {
    let mut rows = Vec::new();
    for film in films {
        let count = film.times_s.len();
        let mut selection = film.all();
        selection.every = count.div_ceil(SHEET_COLUMNS);
        let mut row = Vec::new();
        for frame in film.frames(&selection)? {
            let frame = frame?;
            row.push(Some(labelled(&frame.picture(), None, &format!("{:.2}", film.times_s[frame.index]))));
            interrupt.check("some pictures")?;
        }
        rows.push(row);
    }
    Ok(tiles::assemble(&rows))
}

/// A small picture with the outline of a mask and a number in its corner.
pub(crate) fn labelled(picture: &Picture, mask: Option<&Mask>, number: &str) -> Picture {
    let nothing = || Mask { width: picture.width, height: picture.height, coverage: vec![0.0; picture.rgb.len() / 3] };
    let mut tile = match mask {
        Some(mask) => tiles::tile(picture, mask),
        None => tiles::tile(picture, &nothing()),
    };
    write(&mut tile, number);
    tile
}

/// Rows of a digit, of three dots each, the first the highest bit.
fn dots(digit: char) -> [u8; 5] {
    match digit {
        '0' => [0b111, 0b101, 0b101, 0b101, 0b111],
        '1' => [0b010, 0b110, 0b010, 0b010, 0b111],
        '2' => [0b111, 0b001, 0b111, 0b100, 0b111],
        '3' => [0b111, 0b001, 0b111, 0b001, 0b111],
        '4' => [0b101, 0b101, 0b111, 0b001, 0b001],
        '5' => [0b111, 0b100, 0b111, 0b001, 0b111],
        '6' => [0b111, 0b100, 0b111, 0b101, 0b111],
        '7' => [0b111, 0b001, 0b010, 0b010, 0b010],
        '8' => [0b111, 0b101, 0b111, 0b101, 0b111],
        '9' => [0b111, 0b101, 0b111, 0b001, 0b111],
        '.' => [0, 0, 0, 0, 0b010],
        '-' => [0, 0, 0b111, 0, 0],
        '?' => [0b111, 0b001, 0b010, 0, 0b010],
        _ => [0; 5],
    }
}

/// Writes digits into the lower left corner, white on black.
fn write(tile: &mut Picture, text: &str) {
    const DOT_PX: usize = 2;
    let (width, height) = (4 * DOT_PX * text.len() + DOT_PX, 7 * DOT_PX);
    let top = tile.height.saturating_sub(height);
    for y in 0..height.min(tile.height) {
        for x in 0..width.min(tile.width) {
            let (column, row) = (x / DOT_PX, y / DOT_PX);
            let digit = (column > 0).then(|| text.chars().nth((column - 1) / 4)).flatten();
            let is_set = digit.is_some_and(|digit| {
                let place = (column - 1) % 4;
                (1..6).contains(&row) && place < 3 && dots(digit)[row - 1] >> (2 - place) & 1 == 1
            });
            let at = 3 * ((y + top) * tile.width + x);
            tile.rgb[at..at + 3].fill(if is_set { 1.0 } else { 0.0 });
        }
    }
}
