//! Forward-mode derivatives of the alpha picture along given motions of the Gaussians.
//!
//! With A = 1 - prod (1 - alpha_i), dA = T_end sum_i d alpha_i / (1 - alpha_i): one pass for any number of tangents, and the
//! order does not matter. `d alpha_i = alpha_i d ln alpha_i`, and d ln alpha_i is a quadratic in the pixel's offset.

use gic_scene::Camera;
use gic_simd::{Kernel, Lanes, dispatch};
use rayon::prelude::*;

use crate::projection::{LogAlphaTangent, View};
use crate::raster::{Local, NO_PLANE, NOWHERE, PIXELS, Plane, TileInput, close_rows, narrow};
use crate::render::{
    ALPHA_MAX, ALPHA_MIN, Channels, PER_TASK, RenderSettings, TRANSMITTANCE_MIN, input, rows_of, splats,
};
use crate::tiles::{TILE, Tiles};
use crate::{Gaussians, raster};

/// An alpha picture and its derivatives.
#[derive(Clone, Debug, PartialEq)]
pub struct AlphaTangents {
    /// The alpha picture, as [`crate::render`] draws it, shape [height * width].
    pub alpha: Vec<f32>,
    /// For every tangent, d alpha per unit of its parameter, shape [height * width].
    pub tangents: Vec<Vec<f32>>,
}

/// Draws the alpha picture together with its derivatives along motions of the Gaussians' centres.
///
/// `tangents[k][i]` is d position of Gaussian i [m] per unit of parameter k, shape [n, 3]. Scales and opacities stay. The
/// channels in `settings` are not looked at.
///
/// # Panics
/// If a tangent has another length than the Gaussians, or their arrays do not belong together.
pub fn alpha_tangents(
    gaussians: &Gaussians,
    camera: &Camera,
    settings: &RenderSettings,
    tangents: &[Vec<[f32; 3]>],
) -> AlphaTangents {
    for (k, tangent) in tangents.iter().enumerate() {
        assert!(
            tangent.len() == gaussians.len(),
            "tangent {k} moves {} Gaussians, there are {}",
            tangent.len(),
            gaussians.len()
        );
    }
    let settings = &RenderSettings { channels: Channels::Alpha, ..settings.clone() };
    let (splats, _) = splats(gaussians, camera, settings);
    let tiles = Tiles::new(&splats, camera.width, camera.height);
    let count = tangents.len();
    let view = View::new(gaussians, camera, settings);
    let mut projected = vec![LogAlphaTangent::default(); splats.len() * count];
    if count > 0 {
        projected.par_chunks_mut(count).with_min_len(PER_TASK).zip(&splats).for_each(|(out, splat)| {
            let moves = tangents.iter().map(|t| t[splat.index as usize]);
            view.project_tangents(gaussians, splat.index as usize, moves, out);
        });
    }
    let drawn: Vec<([f32; PIXELS], Vec<[f32; PIXELS]>)> = tiles
        .tiles
        .par_iter()
        .map(|tile| {
            let input = input(&splats, &tiles, tile, camera);
            dispatch(settings.level, DrawTangents { input, tangents: &projected, count })
        })
        .collect();

    let pixels = camera.width * camera.height;
    let mut out = AlphaTangents { alpha: vec![0.0; pixels], tangents: vec![vec![0.0; pixels]; count] };
    for (tile, (alpha, tangents)) in tiles.tiles.iter().zip(&drawn) {
        for (from, to, n) in rows_of(tile, camera) {
            out.alpha[to..to + n].copy_from_slice(&alpha[from..from + n]);
            for (picture, tangent) in out.tangents.iter_mut().zip(tangents) {
                picture[to..to + n].copy_from_slice(&tangent[from..from + n]);
            }
        }
    }
    out
}

struct DrawTangents<'a> {
    input: TileInput<'a>,
    /// `count` for every splat.
    tangents: &'a [LogAlphaTangent],
    count: usize,
}

impl Kernel for DrawTangents<'_> {
    type Output = ([f32; PIXELS], Vec<[f32; PIXELS]>);

    #[inline(always)]
    fn run<L: Lanes<Scalar = f32>>(self) -> Self::Output {
        let TileInput { splats, entries, tile, inside } = self.input;
        let mut transmittance = raster::open_plane(inside);
        let mut sums: Vec<Plane> = vec![NO_PLANE; self.count];
        let mut open = [true; TILE];
        let (log_min, max, one) = (L::splat(ALPHA_MIN.ln()), L::splat(ALPHA_MAX), L::one());
        let (transmittance_min, nowhere) = (L::splat(TRANSMITTANCE_MIN), L::splat(NOWHERE));

        for (k, &entry) in entries.iter().enumerate() {
            if k % raster::CHECK_EVERY == 0 && k > 0 && !close_rows::<L>(&transmittance, &mut open) {
                break;
            }
            let local = Local::<L>::new(&splats[entry as usize], &tile);
            let tangents = &self.tangents[entry as usize * self.count..(entry as usize + 1) * self.count];
            for row in local.rows[0]..local.rows[1] {
                if !open[row] {
                    continue;
                }
                let dy = local.dy + row as f32;
                let base = L::of(local.c * dy * dy + local.log_opacity);
                let slope = L::of(local.b * dy);
                let mut next = local.columns[0];
                while next < local.columns[1] {
                    let at = next;
                    next += L::LANES;
                    let dx = local.dx + L::of(at as f32);
                    let t = L::load(&transmittance[row][at..]);
                    let log_alpha = dx.mul_add(local.a, slope).mul_add(dx, base);
                    let log_alpha = L::select(transmittance_min.le(t), log_alpha, nowhere);
                    let drawn = log_min.le(log_alpha);
                    if !L::any(drawn) {
                        continue;
                    }
                    let alpha = L::select(drawn, log_alpha.exp().min(max), L::zero());
                    (t - t * alpha).store(&mut transmittance[row][at..]);
                    // At the cap, alpha no longer follows the Gaussian.
                    let share = L::select(alpha.lt(max), alpha / (one - alpha), L::zero());
                    for (sum, s) in sums.iter_mut().zip(tangents) {
                        let constant = L::of(s[0] + (s[2] + s[5] * dy) * dy);
                        let d_log = dx.mul_add(L::of(s[3]), L::of(s[1] + s[4] * dy)).mul_add(dx, constant);
                        share.mul_add(d_log, L::load(&sum[row][at..])).store(&mut sum[row][at..]);
                    }
                }
            }
        }
        let left = narrow(&transmittance);
        let finish = |sum: &Plane| {
            let sum = narrow(sum);
            std::array::from_fn(|i| sum[i] * left[i])
        };
        (left.map(|t| 1.0 - t), sums.iter().map(finish).collect())
    }
}
