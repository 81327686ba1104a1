//! Contact sheets: small pictures of some cameras (rows) at some frames (columns), with the masks' outlines.

use crate::picture::{Mask, Picture};
use crate::scene::Scene;

/// Width and height of a tile [pixels].
const TILE_SIDE: usize = 160;
/// Most rows and columns of a sheet.
const MAX_ROWS: usize = 12;
const MAX_COLUMNS: usize = 8;
/// The colour of outlines and of the frame of missing tiles.
const OUTLINE_COLOUR: [f32; 3] = [1.0, 0.15, 0.55];
const SHEET_COLOUR: [f32; 3] = [0.12; 3];

/// Which views go on the sheet, as indices into the views of the scene: rows of columns; `None` where a view is
/// missing.
pub fn layout(scene: &Scene) -> Vec<Vec<Option<usize>>> {
    if scene.has_fixed_cameras() {
        let frames = evenly_spaced(scene.times.len(), MAX_COLUMNS);
        let tile = |camera: usize, frame: usize| {
            scene.views.iter().position(|view| (view.camera, view.frame) == (camera, frame))
        };
        let row = |camera: usize| frames.iter().map(|&frame| tile(camera, frame)).collect();
        return evenly_spaced(scene.cameras.len(), MAX_ROWS).into_iter().map(row).collect();
    }
    let views = evenly_spaced(scene.views.len(), MAX_COLUMNS * MAX_ROWS / 2);
    views.chunks(MAX_COLUMNS).map(|row| row.iter().copied().map(Some).collect()).collect()
}

/// At most `most` of `count` indices, evenly spaced, with the first and the last.
pub fn evenly_spaced(count: usize, most: usize) -> Vec<usize> {
    if count <= most {
        return (0..count).collect();
    }
    (0..most).map(|i| (i * (count - 1) + (most - 1) / 2) / (most - 1)).collect()
}

/// A small copy of a picture, centred in a square tile, with the outline of the mask.
pub fn tile(picture: &Picture, mask: &Mask) -> Picture {
    let scale = picture.width.max(picture.height) as f64 / TILE_SIDE as f64;
    let (width, height) = ((picture.width as f64 / scale) as usize, (picture.height as f64 / scale) as usize);
    let (left, top) = ((TILE_SIDE - width.min(TILE_SIDE)) / 2, (TILE_SIDE - height.min(TILE_SIDE)) / 2);
    let mut tile = Picture { width: TILE_SIDE, height: TILE_SIDE, rgb: SHEET_COLOUR.repeat(TILE_SIDE * TILE_SIDE) };
    let covered = |x: usize, y: usize| mask.sample((x as f64 + 0.5) * scale, (y as f64 + 0.5) * scale) >= 0.5;
    for y in 0..height.min(TILE_SIDE) {
        for x in 0..width.min(TILE_SIDE) {
            let beside = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
            let inside = covered(x, y);
            let outline = inside && beside.iter().any(|&(x, y)| x < width && y < height && !covered(x, y));
            let colour = if outline { OUTLINE_COLOUR } else { average(picture, x, y, scale) };
            let at = 3 * ((y + top) * TILE_SIDE + x + left);
            tile.rgb[at..at + 3].copy_from_slice(&colour);
        }
    }
    tile
}

/// The mean colour of the pixels that a pixel of the tile stands for.
fn average(picture: &Picture, x: usize, y: usize, scale: f64) -> [f32; 3] {
    let range = |i: usize, size: usize| {
        let first = ((i as f64 * scale) as usize).min(size - 1);
        first..(((i + 1) as f64 * scale).ceil() as usize).clamp(first + 1, size)
    };
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for row in range(y, picture.height) {
        for column in range(x, picture.width) {
            let colour = picture.at(column, row);
            (0..3).for_each(|c| sum[c] += colour[c]);
            count += 1.0;
        }
    }
    sum.map(|value| value / count)
}

/// Puts rows of tiles together; `None` leaves a place free.
pub fn assemble(rows: &[Vec<Option<Picture>>]) -> Picture {
    let gap = 4;
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let (width, height) = (columns * (TILE_SIDE + gap) + gap, rows.len() * (TILE_SIDE + gap) + gap);
    let mut sheet = Picture { width, height, rgb: SHEET_COLOUR.repeat(width * height) };
    for (row, tiles) in rows.iter().enumerate() {
        for (column, tile) in tiles.iter().enumerate() {
            let Some(tile) = tile else { continue };
            for y in 0..TILE_SIDE {
                let to = 3 * ((gap + row * (TILE_SIDE + gap) + y) * width + gap + column * (TILE_SIDE + gap));
                sheet.rgb[to..to + 3 * TILE_SIDE]
                    .copy_from_slice(&tile.rgb[3 * y * TILE_SIDE..3 * (y + 1) * TILE_SIDE]);
            }
        }
    }
    sheet
}
