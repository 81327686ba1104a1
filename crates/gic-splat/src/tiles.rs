//! Which splats touch which tile of the picture, front to back.

use std::ops::Range;

use rayon::prelude::*;

use crate::limits::GAUSSIANS_PER_TASK;
use crate::projection::{Projected, Splat};

/// Side of a tile [pixels].
pub(crate) const TILE_SIDE: usize = 16;

/// A tile that at least one splat touches.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tile {
    /// Column and row of its first pixel.
    pub(crate) origin: [u32; 2],
    /// Its part of [`Tiles::entries`].
    pub(crate) first: u32,
    pub(crate) last: u32,
}

/// Lists of splats per tile; tiles that nothing touches are not there.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tiles {
    pub(crate) tiles: Vec<Tile>,
    /// Positions in the depth-ordered splats, tile after tile, front to back in each.
    pub(crate) entries: Vec<u32>,
    /// For every splat, where its entries are, row by row of tiles: `slots[slot_starts[k]..slot_starts[k + 1]]`.
    pub(crate) slots: Vec<u32>,
    pub(crate) slot_starts: Vec<u32>,
}

/// The splats among the outcomes, front to back; equal depths by index. Depths are positive, so their bits order as
/// they do.
pub(crate) fn front_to_back(outcomes: &[Projected]) -> Vec<Splat> {
    let key = |(i, outcome): (usize, &Projected)| match outcome {
        Projected::Drawn(splat) => Some(u64::from(splat.depth.to_bits()) << 32 | i as u64),
        Projected::Hidden | Projected::Rejected => None,
    };
    let mut keys: Vec<u64> = outcomes.iter().enumerate().filter_map(key).collect();
    keys.sort_unstable();
    let splat = |key: &u64| match &outcomes[*key as u32 as usize] {
        Projected::Drawn(splat) => *splat,
        Projected::Hidden | Projected::Rejected => unreachable!("only what is drawn has a key"),
    };
    keys.par_iter().with_min_len(GAUSSIANS_PER_TASK).map(splat).collect()
}

impl Tiles {
    /// The tiles in a row of tiles.
    pub(crate) fn in_row(&self, row: usize) -> Range<usize> {
        let end = |row: usize| self.tiles.partition_point(|tile| (tile.origin[1] as usize) < row * TILE_SIDE);
        end(row)..end(row + 1)
    }

    /// Sorts depth-ordered splats into the tiles of a picture. A counting sort, so the order inside a tile stays.
    pub(crate) fn new(splats: &[Splat], width: usize, height: usize) -> Tiles {
        let across = width.div_ceil(TILE_SIDE);
        let mut counts = vec![0u32; across * height.div_ceil(TILE_SIDE)];
        let mut slot_starts = Vec::with_capacity(splats.len() + 1);
        slot_starts.push(0);
        let mut total = 0u32;
        for s in splats {
            for_each_tile(s, across, |tile| {
                counts[tile] += 1;
                total += 1;
            });
            slot_starts.push(total);
        }
        let mut tiles = Vec::new();
        let mut next = 0;
        // From here on, `counts` holds where the next entry of each tile goes.
        for (tile, count) in counts.iter_mut().enumerate() {
            let (first, last) = (next, next + *count);
            if first < last {
                let origin = [(tile % across * TILE_SIDE) as u32, (tile / across * TILE_SIDE) as u32];
                tiles.push(Tile { origin, first, last });
            }
            next = last;
            *count = first;
        }
        let mut entries = vec![0u32; total as usize];
        let mut slots = Vec::with_capacity(total as usize);
        for (k, s) in splats.iter().enumerate() {
            for_each_tile(s, across, |tile| {
                entries[counts[tile] as usize] = k as u32;
                slots.push(counts[tile]);
                counts[tile] += 1;
            });
        }
        Tiles { tiles, entries, slots, slot_starts }
    }
}

fn for_each_tile(s: &Splat, across: usize, mut visit: impl FnMut(usize)) {
    let tile = TILE_SIDE as u32;
    for row in s.rows[0] / tile..s.rows[1].div_ceil(tile) {
        for column in s.columns[0] / tile..s.columns[1].div_ceil(tile) {
            visit(row as usize * across + column as usize);
        }
    }
}
