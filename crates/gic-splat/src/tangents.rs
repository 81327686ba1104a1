//! Forward-mode derivatives of the alpha picture along given motions of the Gaussians.
//!
//! With A = 1 - prod (1 - alpha_i), dA = T_end sum_i d alpha_i / (1 - alpha_i): one pass for any number of tangents,
//! and the order does not matter. `d alpha_i = alpha_i d ln alpha_i`, and d ln alpha_i is a quadratic in the pixel's
//! offset.

use gic_scene::Camera;
use gic_simd::{Kernel, Lanes, dispatch};
use rayon::prelude::*;

use crate::limits::{ALPHA_MAX, GAUSSIANS_PER_TASK};
use crate::projection::{CameraProjection, LogAlphaTangent, Splat};
use crate::raster::{Blended, PixelPlane, Pixels, TILE_PIXELS, TileInput, ZERO_PLANE, blend, narrow};
use crate::render::{input, rows_of, splats};
use crate::tiles::Tiles;
use crate::{Channels, Gaussians, RenderSettings};

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
/// `tangents[k][i]` is d position of Gaussian i [m] per unit of parameter k, shape [n, 3]. Scales and opacities stay.
/// The channels in `settings` are not looked at.
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
    let view = CameraProjection::new(gaussians, camera, settings);
    let mut projected = vec![LogAlphaTangent::default(); splats.len() * count];
    if count > 0 {
        projected.par_chunks_mut(count).with_min_len(GAUSSIANS_PER_TASK).zip(&splats).for_each(|(out, splat)| {
            let moves = tangents.iter().map(|t| t[splat.index as usize]);
            view.project_tangents(gaussians, splat.index as usize, moves, out);
        });
    }
    let drawn: Vec<([f32; TILE_PIXELS], Vec<[f32; TILE_PIXELS]>)> = tiles
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
    type Output = ([f32; TILE_PIXELS], Vec<[f32; TILE_PIXELS]>);

    #[inline(always)]
    fn run<L: Lanes<Scalar = f32>>(self) -> Self::Output {
        let DrawTangents { input, tangents, count } = self;
        let mut sums = TangentSums { tangents, count, planes: vec![ZERO_PLANE; count] };
        let left = narrow(&blend::<L, _>(input, &mut sums));
        let finish = |plane: &PixelPlane| {
            let sum = narrow(plane);
            std::array::from_fn(|i| sum[i] * left[i])
        };
        (left.map(|t| 1.0 - t), sums.planes.iter().map(finish).collect())
    }
}

/// For every tangent, sum of d alpha / (1 - alpha) over the splats.
struct TangentSums<'a> {
    tangents: &'a [LogAlphaTangent],
    count: usize,
    planes: Vec<PixelPlane>,
}

impl<'a, L: Lanes<Scalar = f32>> Blended<L> for TangentSums<'a> {
    type Share = &'a [LogAlphaTangent];

    #[inline(always)]
    fn share(&self, _: usize, entry: usize, _: &Splat) -> &'a [LogAlphaTangent] {
        &self.tangents[entry * self.count..(entry + 1) * self.count]
    }

    #[inline(always)]
    fn add(&mut self, tangents: &&'a [LogAlphaTangent], pixels: Pixels<L>) {
        let Pixels { row, column, dx, dy, alpha, .. } = pixels;
        // At the cap, alpha no longer follows the Gaussian.
        let share = L::select(alpha.lt(L::splat(ALPHA_MAX)), alpha / (L::one() - alpha), L::zero());
        for (sum, s) in self.planes.iter_mut().zip(*tangents) {
            let constant = L::of(s[0] + (s[2] + s[5] * dy) * dy);
            let d_log = dx.mul_add(L::of(s[3]), L::of(s[1] + s[4] * dy)).mul_add(dx, constant);
            share.mul_add(d_log, L::load(&sum[row][column..])).store(&mut sum[row][column..]);
        }
    }
}
