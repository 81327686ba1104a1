//! The fast renderer's front door: what to draw, the pictures, and their gradients.

use gic_scene::Camera;
use rayon::prelude::*;

use crate::limits::GAUSSIANS_PER_TASK;
use crate::projection::{AttributeGradient, CameraProjection, Projected, Splat, SplatGradient};
use crate::raster::{self, EntryGradient, TileInput, TileLoss, TilePixels};
use crate::tiles::{TILE_SIDE, Tile, Tiles, front_to_back};
use crate::{GaussianGradients, Gaussians, RenderSettings, Shape};

/// Pictures of one view, row-major from the top left, plus what the backward pass needs.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// Colour over the background, shape [height * width, 3]; empty if not asked for.
    pub color: Vec<[f32; 3]>,
    /// Accumulated alpha A(u), shape [height * width].
    pub alpha: Vec<f32>,
    /// Accumulated depth D(u) = sum T alpha d (not divided by alpha) [m], shape [height * width]; empty if not asked
    /// for.
    pub depth: Vec<f32>,
    /// Gaussians that were left out because an attribute was not finite, a scale or opacity negative, or a colour
    /// coefficient or depth [m] beyond 1e9. Such a Gaussian gets a zero gradient; [`Gaussians::validate`] names it.
    pub rejected: usize,
    /// What [`backward`] reads again.
    pub(crate) saved: ForwardPass,
}

/// The forward pass as the backward pass needs it.
#[derive(Clone, Debug)]
pub(crate) struct ForwardPass {
    /// Front to back.
    pub(crate) splats: Vec<Splat>,
    pub(crate) tiles: Tiles,
    /// One for each of the tiles.
    pub(crate) pixels: Vec<TilePixels>,
}

/// Derivative of a scalar loss with respect to the three pictures; an empty vector means zero.
#[derive(Clone, Debug, Default)]
pub struct ImageGradients {
    /// d loss / d colour, shape [height * width, 3] or empty.
    pub color: Vec<[f32; 3]>,
    /// d loss / d alpha, shape [height * width] or empty.
    pub alpha: Vec<f32>,
    /// d loss / d depth, shape [height * width] or empty.
    pub depth: Vec<f32>,
}

/// Draws the Gaussians as `camera` sees them (paper eq. 2).
///
/// A Gaussian with centre `x`, covariance `Sigma = R S^2 R^T` and opacity `o` has camera coordinates `p = W (x - c)`,
/// image centre `m` and projected covariance `Sigma' = J W Sigma W^T J^T + dilation I`. In a pixel at `u` its alpha is
/// `o exp(-(u - m)^T Sigma'^-1 (u - m) / 2)`: nothing below [`crate::ALPHA_MIN`], at most [`crate::ALPHA_MAX`].
/// Gaussians are blended in the order of the depth of their centres (rounded to f32; ties: by index), until the
/// transmittance is below [`crate::TRANSMITTANCE_MIN`]. [`crate::twin`] is the same in plain f64.
///
/// # Panics
/// If the arrays of `gaussians` do not belong together ([`Gaussians::validate`] tells), or colour is asked for without
/// `sh`.
pub fn render(gaussians: &Gaussians, camera: &Camera, settings: &RenderSettings) -> Rendered {
    let (splats, rejected) = splats(gaussians, camera, settings);
    let tiles = Tiles::new(&splats, camera.width, camera.height);
    let pixels = tiles
        .tiles
        .par_iter()
        .map(|tile| raster::draw(settings.level, input(&splats, &tiles, tile, camera), settings.channels))
        .collect();
    let mut rendered = Rendered {
        color: Vec::new(),
        alpha: vec![0.0; camera.width * camera.height],
        depth: Vec::new(),
        rejected,
        saved: ForwardPass { splats, tiles, pixels },
    };
    if settings.channels.color() {
        rendered.color = vec![settings.background; camera.width * camera.height];
    }
    if settings.channels.depth() {
        rendered.depth = vec![0.0; camera.width * camera.height];
    }
    rendered.assemble(camera, settings.background);
    rendered
}

/// Projects all Gaussians; those in sight front to back, and how many had to be rejected.
fn splats(gaussians: &Gaussians, camera: &Camera, settings: &RenderSettings) -> (Vec<Splat>, usize) {
    if let Err(error) = gaussians.check_lengths() {
        panic!("{error}");
    }
    let colorless = gaussians.sh.is_empty() && !gaussians.is_empty();
    assert!(
        !settings.channels.color() || !colorless,
        "Gaussians without spherical harmonics have no colour to draw: ask for Channels::AlphaDepth or Channels::Alpha"
    );
    let view = CameraProjection::new(gaussians, camera, settings);
    let outcomes: Vec<Projected> = (0..gaussians.len())
        .into_par_iter()
        .with_min_len(GAUSSIANS_PER_TASK)
        .map(|i| view.project(gaussians, i))
        .collect();
    let rejected = outcomes.iter().filter(|o| matches!(o, Projected::Rejected)).count();
    (front_to_back(&outcomes), rejected)
}

fn input<'a>(splats: &'a [Splat], tiles: &'a Tiles, tile: &Tile, camera: &Camera) -> TileInput<'a> {
    TileInput {
        splats,
        entries: &tiles.entries[tile.first as usize..tile.last as usize],
        tile: *tile,
        inside: inside(tile, camera),
    }
}

/// Columns and rows of a tile that lie inside the picture.
fn inside(tile: &Tile, camera: &Camera) -> [usize; 2] {
    [(camera.width - tile.origin[0] as usize).min(TILE_SIDE), (camera.height - tile.origin[1] as usize).min(TILE_SIDE)]
}

/// For each row of a tile inside the picture: where it starts in the tile, in the picture, and its length.
fn rows_of(tile: &Tile, camera: &Camera) -> impl Iterator<Item = (usize, usize, usize)> + use<> {
    let ([columns, rows], width, origin) = (inside(tile, camera), camera.width, tile.origin);
    (0..rows).map(move |row| (row * TILE_SIDE, (origin[1] as usize + row) * width + origin[0] as usize, columns))
}

impl Rendered {
    /// Puts the tiles into the pictures.
    fn assemble(&mut self, camera: &Camera, background: [f32; 3]) {
        let saved = &self.saved;
        fill(&mut self.alpha, saved, camera, |pixels, i| 1.0 - pixels.transmittance[i]);
        fill(&mut self.depth, saved, camera, |pixels, i| pixels.depth.as_ref().map_or(0.0, |depth| depth[i]));
        fill(&mut self.color, saved, camera, |pixels, i| {
            let (drawn, left) = (&pixels.color, pixels.transmittance[i]);
            std::array::from_fn(|c| drawn.as_ref().map_or(0.0, |color| color[c][i]) + background[c] * left)
        });
    }
}

/// Puts what `value` finds in each pixel of a tile into a picture, if there is one.
fn fill<T: Send>(
    picture: &mut [T],
    saved: &ForwardPass,
    camera: &Camera,
    value: impl Fn(&TilePixels, usize) -> T + Sync,
) {
    let row_of_tiles = (TILE_SIDE * camera.width).max(1);
    picture.par_chunks_mut(row_of_tiles).enumerate().for_each(|(row, picture)| {
        for k in saved.tiles.in_row(row) {
            let pixels = &saved.pixels[k];
            for (from, to, count) in rows_of(&saved.tiles.tiles[k], camera) {
                let to = to - row * row_of_tiles;
                for (i, out) in picture[to..to + count].iter_mut().enumerate() {
                    *out = value(pixels, from + i);
                }
            }
        }
    });
}

/// Gradient of a loss on the pictures with respect to every attribute of the Gaussians.
///
/// `rendered` is what [`render`] made of the same Gaussians, camera and settings; `loss` the derivative of the loss
/// with respect to its pictures. The sums are taken in a fixed order: the result does not depend on the number of
/// threads.
///
/// # Panics
/// If a picture in `loss` is neither empty nor of the camera's size.
pub fn backward(
    gaussians: &Gaussians,
    camera: &Camera,
    settings: &RenderSettings,
    rendered: &Rendered,
    loss: &ImageGradients,
) -> GaussianGradients {
    for length in [loss.color.len(), loss.alpha.len(), loss.depth.len()] {
        let fits = length == 0 || length == camera.width * camera.height;
        assert!(fits, "a picture's gradient has {length} pixels, the camera {}x{}", camera.width, camera.height);
    }
    let ForwardPass { splats, tiles, pixels } = &rendered.saved;
    let mut entries = vec![EntryGradient::default(); tiles.entries.len()];
    // Tiles own neighbouring parts of the entries.
    let mut rest = entries.as_mut_slice();
    let mut tasks = Vec::with_capacity(tiles.tiles.len());
    for (tile, pixels) in tiles.tiles.iter().zip(pixels) {
        let (part, others) = rest.split_at_mut((tile.last - tile.first) as usize);
        tasks.push((tile, pixels, part));
        rest = others;
    }
    tasks.into_par_iter().for_each(|(tile, pixels, part)| {
        let loss = tile_loss(tile, camera, settings, loss);
        let input = input(splats, tiles, tile, camera);
        raster::draw_backward(settings.level, input, settings.channels, pixels, &loss, part);
    });
    attributes_backward(gaussians, camera, settings, &rendered.saved, &entries)
}

/// One tile's part of the pictures' gradients.
fn tile_loss(tile: &Tile, camera: &Camera, settings: &RenderSettings, loss: &ImageGradients) -> TileLoss {
    let mut out = TileLoss::ZERO;
    let background = settings.background;
    for (to, from, count) in rows_of(tile, camera) {
        if !loss.alpha.is_empty() {
            out.alpha[to..to + count].copy_from_slice(&loss.alpha[from..from + count]);
        }
        if !loss.depth.is_empty() && settings.channels.depth() {
            out.depth[to..to + count].copy_from_slice(&loss.depth[from..from + count]);
        }
        if !loss.color.is_empty() && settings.channels.color() {
            for (k, color) in loss.color[from..from + count].iter().enumerate() {
                for c in 0..3 {
                    out.color[c][to + k] = color[c];
                }
                out.background[to + k] = color[0] * background[0] + color[1] * background[1] + color[2] * background[2];
            }
        }
    }
    out
}

/// From gradients per tile and splat to gradients per attribute.
fn attributes_backward(
    gaussians: &Gaussians,
    camera: &Camera,
    settings: &RenderSettings,
    saved: &ForwardPass,
    entries: &[EntryGradient],
) -> GaussianGradients {
    let view = CameraProjection::new(gaussians, camera, settings);
    let ForwardPass { splats, tiles, .. } = saved;
    let mut out = GaussianGradients::zeros(gaussians);
    // Front to back, the splats' entries lie one after the other in every tile; in any other order, each is a cache
    // miss.
    let attributes: Vec<(AttributeGradient, [f32; 3])> = splats
        .par_iter()
        .enumerate()
        .with_min_len(GAUSSIANS_PER_TASK)
        .map(|(k, splat)| {
            let [first, last] = [k, k + 1].map(|k| tiles.slot_starts[k] as usize);
            let sums = sum_entries(entries, &tiles.slots[first..last]);
            (view.project_backward(gaussians, splat, &sums), sums.color.map(|c| c as f32))
        })
        .collect();
    // What is not drawn has no colour gradient, and its direction to the camera may not even exist.
    let mut d_color: Vec<Option<[f32; 3]>> = vec![None; gaussians.len()];
    for (splat, (gradient, color)) in splats.iter().zip(&attributes) {
        let i = splat.index as usize;
        out.positions[i] = gradient.position;
        out.opacities[i] = gradient.opacity;
        out.screen[i] = gradient.screen;
        d_color[i] = Some(*color);
        match &mut out.shape {
            Shape::Isotropic { scales } => scales[i] = gradient.scale[0],
            Shape::Anisotropic { scales, rotations } => {
                scales[i] = gradient.scale;
                rotations[i] = gradient.rotation;
            }
        }
    }
    if settings.channels.color() {
        let sh = out.sh.par_chunks_mut(gaussians.sh_per_gaussian()).with_min_len(GAUSSIANS_PER_TASK);
        sh.zip(&mut out.positions).zip(&d_color).enumerate().for_each(|(i, ((sh, position), color))| {
            if let Some(color) = color {
                view.color_backward(gaussians, i, *color, sh, position);
            }
        });
    }
    out
}

/// Adds up a splat's tiles, in the order of the tiles.
fn sum_entries(entries: &[EntryGradient], slots: &[u32]) -> SplatGradient {
    let mut sums = [0.0f64; 12];
    for &slot in slots {
        for (sum, v) in sums.iter_mut().zip(&entries[slot as usize]) {
            *sum += f64::from(*v);
        }
    }
    let [m0, m1, m2, m3, m4, m5, depth, _, c0, c1, c2, _] = sums;
    SplatGradient { moments: [m0, m1, m2, m3, m4, m5], color: [c0, c1, c2], depth }
}
