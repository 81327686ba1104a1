//! What a small motion cannot show: particles that lie behind opaque pixels alone.
//!
//! A pixel that is opaque, with all eight around it, stays opaque when no particle moves by a pixel. Such pixels need
//! not be drawn again for the neighbours of a motion, nor particles that reach no other pixel: most of a body's inside.

/// The pixels of a drawing that stay opaque.
pub(crate) struct Occlusion {
    width: usize,
    /// Whether a pixel may not stay opaque, row-major.
    is_open: Vec<bool>,
    /// How many of these are above and to the left of a corner of pixels, shape [height + 1, width + 1].
    open_before: Vec<u32>,
}

impl Occlusion {
    /// Of a picture of coverage, `width` pixels wide. What lies beyond its border is not seen.
    pub(crate) fn of(coverage: &[f32], width: usize) -> Occlusion {
        let is_open: Vec<bool> = coverage.iter().map(|c| *c < 1.0).collect();
        let mut beside = is_open.clone();
        for (from, to) in is_open.chunks_exact(width.max(1)).zip(beside.chunks_exact_mut(width.max(1))) {
            for x in 1..width {
                to[x] |= from[x - 1];
                to[x - 1] |= from[x];
            }
        }
        let mut around = beside.clone();
        for at in width..beside.len() {
            around[at] |= beside[at - width];
            around[at - width] |= beside[at];
        }
        let mut open_before = vec![0; width + 1];
        for (y, row) in around.chunks_exact(width.max(1)).enumerate() {
            let mut in_row = 0;
            open_before.push(0);
            for (x, is_open) in row.iter().enumerate() {
                in_row += u32::from(*is_open);
                open_before.push(open_before[y * (width + 1) + x + 1] + in_row);
            }
        }
        Occlusion { width, is_open: around, open_before }
    }

    /// Which light is left of a row-major picture before anything is drawn: none where pixels stay opaque.
    pub(crate) fn transmittance(&self) -> impl Iterator<Item = f32> {
        self.is_open.iter().map(|is_open| f32::from(u8::from(*is_open)))
    }

    /// Whether all pixels of columns and rows, from the first up to, not including, the second, stay opaque.
    pub(crate) fn hides(&self, columns: (usize, usize), rows: (usize, usize)) -> bool {
        let before = |x: usize, y: usize| self.open_before[y * (self.width + 1) + x];
        before(columns.1, rows.1) + before(columns.0, rows.0) == before(columns.1, rows.0) + before(columns.0, rows.1)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn hidden_is_what_has_only_opaque_pixels_around(
            width in 1usize..9,
            height in 1usize..9,
            opaque in prop::collection::vec(prop::bool::weighted(0.9), 64),
            corners in prop::array::uniform4(0usize..9),
        ) {
            let covered = |x: usize, y: usize| x >= width || y >= height || opaque[y * width + x];
            let coverage: Vec<f32> =
                (0..width * height).map(|at| if opaque[at] { 1.0 } else { 0.999 }).collect();
            let occlusion = Occlusion::of(&coverage, width);
            let stays = |x: usize, y: usize| {
                (x.saturating_sub(1)..x + 2).all(|u| (y.saturating_sub(1)..y + 2).all(|v| covered(u, v)))
            };
            for (at, transmittance) in occlusion.transmittance().enumerate() {
                prop_assert_eq!(transmittance == 0.0, stays(at % width, at / width));
            }
            let span = |a: usize, b: usize, length: usize| (a.min(b).min(length), a.max(b).min(length));
            let (columns, rows) = (span(corners[0], corners[1], width), span(corners[2], corners[3], height));
            let hidden = (columns.0..columns.1).all(|x| (rows.0..rows.1).all(|y| stays(x, y)));
            prop_assert_eq!(occlusion.hides(columns, rows), hidden);
        }
    }
}
