//! One tile, pixel by pixel: blending front to back, and its gradient back to front.
//!
//! `C = sum_i T_i alpha_i c_i` with `T_i = prod_{j < i} (1 - alpha_j)` (paper eq. 2), and the same for depth; `A = 1 -
//! T`.
//!
//! The kernels run over the splats of a tile and, for each, over the pixels in its box, [`Lanes`] at a time. All that
//! is known per pixel lives in small arrays ([`PixelPlane`]) in the first-level cache.

use gic_simd::{Kernel, Lanes, Level, MAX_LANES, dispatch};

use crate::Channels;
use crate::limits::{ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN};
use crate::projection::Splat;
use crate::tiles::{TILE_SIDE, Tile};

/// Lanes may start at any pixel of a row, so rows are longer than a tile by the widest lanes; nothing is drawn there.
const ROW_STRIDE: usize = TILE_SIDE + MAX_LANES;
/// Pixels of a tile.
const TILE_PIXELS: usize = TILE_SIDE * TILE_SIDE;
/// After so many splats, rows whose pixels are all finished are taken out.
const SPLATS_PER_CHECK: usize = 16;
/// Alpha this low is a logarithm no splat reaches: the way to leave a lane out.
const UNREACHED_LOG_ALPHA: f64 = -1e30;

/// A number per pixel of a tile.
type PixelPlane = [[f32; ROW_STRIDE]; TILE_SIDE];

/// All zero.
const ZERO_PLANE: PixelPlane = [[0.0; ROW_STRIDE]; TILE_SIDE];

/// A tile after blending; pixels row by row. What is outside the picture has transmittance 0.
#[derive(Clone, Debug)]
pub(crate) struct TilePixels {
    /// Transmittance left.
    pub(crate) transmittance: [f32; TILE_PIXELS],
    /// One more than the position of the last of the tile's entries that counts in the pixel; 0 if none does.
    pub(crate) last: [f32; TILE_PIXELS],
    /// sum T alpha color, if asked for.
    pub(crate) color: Option<Box<[[f32; TILE_PIXELS]; 3]>>,
    /// sum T alpha depth, if asked for.
    pub(crate) depth: Option<Box<[f32; TILE_PIXELS]>>,
}

/// Derivative of the loss with respect to the pictures in one tile; zero outside the picture.
#[derive(Clone, Debug)]
pub(crate) struct TileLoss {
    pub(crate) color: [[f32; TILE_PIXELS]; 3],
    pub(crate) alpha: [f32; TILE_PIXELS],
    pub(crate) depth: [f32; TILE_PIXELS],
    /// d loss / d colour times the background: what a pixel gains from what is left of the light.
    pub(crate) background: [f32; TILE_PIXELS],
}

impl TileLoss {
    pub(crate) const ZERO: TileLoss = TileLoss {
        color: [[0.0; TILE_PIXELS]; 3],
        alpha: [0.0; TILE_PIXELS],
        depth: [0.0; TILE_PIXELS],
        background: [0.0; TILE_PIXELS],
    };
}

/// Sums over the pixels of a tile for one splat: six moments of d loss / d ln alpha (see
/// [`crate::projection::SplatGradient`]), depth, nothing, colour, nothing.
pub(crate) type EntryGradient = [f32; 12];

/// The tile a kernel works on.
#[derive(Clone, Copy)]
pub(crate) struct TileInput<'a> {
    pub(crate) splats: &'a [Splat],
    /// The tile's entries, front to back.
    pub(crate) entries: &'a [u32],
    pub(crate) tile: Tile,
    /// Columns and rows of the tile inside the picture.
    pub(crate) inside: [usize; 2],
}

fn widen(pixels: &[f32; TILE_PIXELS]) -> PixelPlane {
    let mut plane = ZERO_PLANE;
    for row in 0..TILE_SIDE {
        plane[row][..TILE_SIDE].copy_from_slice(&pixels[row * TILE_SIDE..(row + 1) * TILE_SIDE]);
    }
    plane
}

fn narrow(plane: &PixelPlane) -> [f32; TILE_PIXELS] {
    let mut pixels = [0.0; TILE_PIXELS];
    for row in 0..TILE_SIDE {
        pixels[row * TILE_SIDE..(row + 1) * TILE_SIDE].copy_from_slice(&plane[row][..TILE_SIDE]);
    }
    pixels
}

/// Transmittance before anything is drawn: 1 inside the picture, 0 elsewhere.
fn open_plane(inside: [usize; 2]) -> PixelPlane {
    let mut plane = ZERO_PLANE;
    for row in 0..inside[1] {
        plane[row][..inside[0]].fill(1.0);
    }
    plane
}

/// A splat seen from one tile.
struct TileSplat<L> {
    rows: [usize; 2],
    columns: [usize; 2],
    /// Pixel centre minus the splat's centre, of the tile's first row, and of the lanes that start in its first column.
    dy: f32,
    dx: L,
    a: L,
    b: f32,
    c: f32,
    log_opacity: f32,
}

impl<L: Lanes<Scalar = f32>> TileSplat<L> {
    #[inline(always)]
    fn new(s: &Splat, tile: &Tile) -> TileSplat<L> {
        let inside = |range: [u32; 2], origin: u32| {
            [range[0].saturating_sub(origin) as usize, ((range[1] - origin) as usize).min(TILE_SIDE)]
        };
        TileSplat {
            rows: inside(s.rows, tile.origin[1]),
            columns: inside(s.columns, tile.origin[0]),
            dy: tile.origin[1] as f32 + 0.5 - s.mean[1],
            dx: L::lane_index() + L::of(tile.origin[0] as f32 + 0.5 - s.mean[0]),
            a: L::of(s.quadratic[0]),
            b: s.quadratic[1],
            c: s.quadratic[2],
            log_opacity: s.log_opacity,
        }
    }
}

/// Draws a tile.
pub(crate) fn draw(level: Level, input: TileInput<'_>, channels: Channels) -> TilePixels {
    match channels {
        Channels::ColorAlphaDepth => dispatch(level, Draw::<true, true>(input)),
        Channels::ColorAlpha => dispatch(level, Draw::<true, false>(input)),
        Channels::AlphaDepth => dispatch(level, Draw::<false, true>(input)),
        Channels::Alpha => dispatch(level, Draw::<false, false>(input)),
    }
}

struct Draw<'a, const COLOR: bool, const DEPTH: bool>(TileInput<'a>);

impl<const COLOR: bool, const DEPTH: bool> Kernel for Draw<'_, COLOR, DEPTH> {
    type Output = TilePixels;

    #[inline(always)]
    fn run<L: Lanes<Scalar = f32>>(self) -> TilePixels {
        let TileInput { splats, entries, tile, inside } = self.0;
        let mut transmittance = open_plane(inside);
        let mut last: PixelPlane = ZERO_PLANE;
        let mut color: [PixelPlane; 3] = [ZERO_PLANE; 3];
        let mut depth: PixelPlane = ZERO_PLANE;
        let mut open = [true; TILE_SIDE];
        let (log_min, max) = (L::splat(ALPHA_MIN.ln()), L::splat(ALPHA_MAX));
        let (transmittance_min, unreached) = (L::splat(TRANSMITTANCE_MIN), L::splat(UNREACHED_LOG_ALPHA));

        for (k, &entry) in entries.iter().enumerate() {
            if k % SPLATS_PER_CHECK == 0 && k > 0 && !close_rows::<L>(&transmittance, &mut open) {
                break;
            }
            let s = &splats[entry as usize];
            let local = TileSplat::<L>::new(s, &tile);
            let count = L::splat((k + 1) as f64);
            let s_color: [L; 3] = s.color.map(L::of);
            let s_depth: L = L::of(s.depth);
            for row in local.rows[0]..local.rows[1] {
                if !open[row] {
                    continue;
                }
                let dy = local.dy + row as f32;
                let base: L = L::of(local.c * dy * dy + local.log_opacity);
                let slope: L = L::of(local.b * dy);
                let mut next = local.columns[0];
                while next < local.columns[1] {
                    let at = next;
                    next += L::LANES;
                    let dx = local.dx + L::of(at as f32);
                    let t = L::load(&transmittance[row][at..]);
                    let log_alpha = dx.mul_add(local.a, slope).mul_add(dx, base);
                    let log_alpha = L::select(transmittance_min.le(t), log_alpha, unreached);
                    let drawn = log_min.le(log_alpha);
                    if !L::any(drawn) {
                        continue;
                    }
                    let alpha = L::select(drawn, log_alpha.exp().min(max), L::zero());
                    let weight = t * alpha;
                    (t - weight).store(&mut transmittance[row][at..]);
                    L::select(drawn, count, L::load(&last[row][at..])).store(&mut last[row][at..]);
                    if COLOR {
                        for c in 0..3 {
                            weight.mul_add(s_color[c], L::load(&color[c][row][at..])).store(&mut color[c][row][at..]);
                        }
                    }
                    if DEPTH {
                        weight.mul_add(s_depth, L::load(&depth[row][at..])).store(&mut depth[row][at..]);
                    }
                }
            }
        }
        TilePixels {
            transmittance: narrow(&transmittance),
            last: narrow(&last),
            color: COLOR.then(|| Box::new([narrow(&color[0]), narrow(&color[1]), narrow(&color[2])])),
            depth: DEPTH.then(|| Box::new(narrow(&depth))),
        }
    }
}

/// Closes the rows whose pixels are all finished; whether any is still open.
#[inline(always)]
fn close_rows<L: Lanes<Scalar = f32>>(transmittance: &PixelPlane, open: &mut [bool; TILE_SIDE]) -> bool {
    let min = L::splat(TRANSMITTANCE_MIN);
    let mut any = false;
    for row in 0..TILE_SIDE {
        if open[row] {
            let mut most = L::zero();
            let mut column = 0;
            while column < TILE_SIDE {
                most = most.max(L::load(&transmittance[row][column..]));
                column += L::LANES;
            }
            open[row] = L::any(min.le(most));
            any |= open[row];
        }
    }
    any
}

/// The sum over the lanes of each of four numbers, in a fixed order.
#[inline(always)]
fn sums_of_lanes<L: Lanes<Scalar = f32>>(numbers: [L; 4]) -> [f32; 4] {
    let [a, b, c, d] = L::transpose(numbers);
    let mut groups = [0.0; MAX_LANES];
    ((a + b) + (c + d)).store(&mut groups);
    std::array::from_fn(|q| (0..L::GROUPS).map(|g| groups[4 * g + q]).sum())
}

/// Gradient of a tile: fills `out`, one for each of the tile's entries.
pub(crate) fn draw_backward(
    level: Level,
    input: TileInput<'_>,
    channels: Channels,
    pixels: &TilePixels,
    loss: &TileLoss,
    out: &mut [EntryGradient],
) {
    match channels {
        Channels::ColorAlphaDepth => dispatch(level, DrawBackward::<true, true> { input, pixels, loss, out }),
        Channels::ColorAlpha => dispatch(level, DrawBackward::<true, false> { input, pixels, loss, out }),
        Channels::AlphaDepth => dispatch(level, DrawBackward::<false, true> { input, pixels, loss, out }),
        Channels::Alpha => dispatch(level, DrawBackward::<false, false> { input, pixels, loss, out }),
    }
}

struct DrawBackward<'a, const COLOR: bool, const DEPTH: bool> {
    input: TileInput<'a>,
    pixels: &'a TilePixels,
    loss: &'a TileLoss,
    out: &'a mut [EntryGradient],
}

impl<const COLOR: bool, const DEPTH: bool> Kernel for DrawBackward<'_, COLOR, DEPTH> {
    type Output = ();

    /// Back to front. With v = d loss / d (what one unit of light that ends at this splat adds), and B the same for the
    /// light that passes it, averaged over where it ends: d loss / d alpha = T (v - B), and in front of the splat B <-
    /// alpha v + (1 - alpha) B. Without colour and depth, v is the same for all, and T (v - B) = v T_end / (1 - alpha).
    #[inline(always)]
    fn run<L: Lanes<Scalar = f32>>(self) {
        let TileInput { splats, entries, tile, .. } = self.input;
        let replay = COLOR || DEPTH;
        let last = widen(&self.pixels.last);
        let mut transmittance = widen(&self.pixels.transmittance);
        let mut behind = widen(&self.loss.background);
        let d_color: [PixelPlane; 3] =
            if COLOR { [0, 1, 2].map(|c| widen(&self.loss.color[c])) } else { [ZERO_PLANE; 3] };
        let d_depth: PixelPlane = if DEPTH { widen(&self.loss.depth) } else { ZERO_PLANE };
        let mut d_alpha = widen(&self.loss.alpha);
        if !replay {
            d_alpha.as_flattened_mut().iter_mut().zip(transmittance.as_flattened()).for_each(|(d, t)| *d *= t);
        }
        // The last entry that counts in each row.
        let mut row_last = [0usize; TILE_SIDE];
        for row in 0..TILE_SIDE {
            let most = last[row][..TILE_SIDE].iter().fold(0.0f32, |m, &v| m.max(v));
            row_last[row] = most as usize;
        }
        let end = row_last.iter().copied().max().unwrap_or(0);
        self.out[end..].fill([0.0; 12]);
        let (log_min, max, one) = (L::splat(ALPHA_MIN.ln()), L::splat(ALPHA_MAX), L::one());
        let unreached = L::splat(UNREACHED_LOG_ALPHA);

        for k in (0..end).rev() {
            let s = &splats[entries[k] as usize];
            let local = TileSplat::<L>::new(s, &tile);
            let count = L::splat((k + 1) as f64);
            let s_color: [L; 3] = s.color.map(L::of);
            let s_depth: L = L::of(s.depth);
            let mut moments = [L::zero(); 6];
            let mut sum_color = [L::zero(); 3];
            let mut sum_depth = L::zero();
            for row in local.rows[0]..local.rows[1] {
                if row_last[row] <= k {
                    continue;
                }
                let dy = local.dy + row as f32;
                let base: L = L::of(local.c * dy * dy + local.log_opacity);
                let slope: L = L::of(local.b * dy);
                let mut sums = [L::zero(); 3];
                let mut next = local.columns[0];
                while next < local.columns[1] {
                    let at = next;
                    next += L::LANES;
                    let dx = local.dx + L::of(at as f32);
                    let log_alpha = dx.mul_add(local.a, slope).mul_add(dx, base);
                    let log_alpha = L::select(count.le(L::load(&last[row][at..])), log_alpha, unreached);
                    let drawn = log_min.le(log_alpha);
                    if !L::any(drawn) {
                        continue;
                    }
                    let alpha = L::select(drawn, log_alpha.exp().min(max), L::zero());
                    let clear = one / (one - alpha);
                    let d = if replay {
                        let t = L::load(&transmittance[row][at..]) * clear;
                        t.store(&mut transmittance[row][at..]);
                        let mut value = L::load(&d_alpha[row][at..]);
                        let weight = t * alpha;
                        if COLOR {
                            for c in 0..3 {
                                let g = L::load(&d_color[c][row][at..]);
                                value = g.mul_add(s_color[c], value);
                                sum_color[c] = g.mul_add(weight, sum_color[c]);
                            }
                        }
                        if DEPTH {
                            let g = L::load(&d_depth[row][at..]);
                            value = g.mul_add(s_depth, value);
                            sum_depth = g.mul_add(weight, sum_depth);
                        }
                        let b = L::load(&behind[row][at..]);
                        let gain = value - b;
                        gain.mul_add(alpha, b).store(&mut behind[row][at..]);
                        gain * weight
                    } else {
                        L::load(&d_alpha[row][at..]) * clear * alpha
                    };
                    // At the cap, alpha no longer follows the splat.
                    let d = L::select(alpha.lt(max), d, L::zero());
                    let d_dx = d * dx;
                    sums[0] += d;
                    sums[1] += d_dx;
                    sums[2] = d_dx.mul_add(dx, sums[2]);
                }
                let dy: L = L::of(dy);
                let sum_dy = sums[0] * dy;
                moments[0] += sums[0];
                moments[1] += sums[1];
                moments[2] += sum_dy;
                moments[3] += sums[2];
                moments[4] = sums[1].mul_add(dy, moments[4]);
                moments[5] = sum_dy.mul_add(dy, moments[5]);
            }
            let [m0, m1, m2, m3, m4, m5] = moments;
            let [c0, c1, c2] = sum_color;
            let zero = L::zero();
            let mut entry = [0.0; 12];
            entry[..4].copy_from_slice(&sums_of_lanes([m0, m1, m2, m3]));
            entry[4..8].copy_from_slice(&sums_of_lanes([m4, m5, sum_depth, zero]));
            if COLOR {
                entry[8..].copy_from_slice(&sums_of_lanes([c0, c1, c2, zero]));
            }
            self.out[k] = entry;
        }
    }
}
