//! The oracle: splatting in plain scalar f64, forward beside backward, one Gaussian and one pixel at a time.
//!
//! Written to be read and to be trusted, not to be fast: everything here follows from paper eq. 1 and 2, the backward
//! pass is textbook reverse mode over the same steps, and finite differences check it attribute by attribute. The fast
//! path is tested against this twin, so the two share the definition's constants and nothing of its derivation.
//!
//! The definition. A Gaussian with centre `x`, covariance `Sigma = R S^2 R^T` and opacity `o` has camera coordinates `p
//! = W (x - c)`, image centre `m = (fx p_x/p_z + cx, fy p_y/p_z + cy)` and projected covariance `Sigma' = J W Sigma W^T
//! J^T + dilation I`. In a pixel at `u` its alpha is `o exp(-(u - m)^T Sigma'^-1 (u - m) / 2)`, nothing below 1/255 and
//! at most 0.99. Gaussians are blended in the order of the depth of their centres (ties: by index), until the
//! transmittance is below 1e-4.

use gic_scene::Camera;
use glam::{DMat2, DMat3, DVec2, DVec3};

use crate::limits::{ALPHA_MAX, ALPHA_MIN, FRUSTUM_MARGIN, TRANSMITTANCE_MIN};
use crate::{GaussianGradients, Gaussians, ImageGradients, RenderSettings, Shape, sh};

/// [`Gaussians`], or a gradient with respect to them, in f64. Isotropic ones have three equal scales.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GaussiansF64 {
    /// Centres [m], shape [n].
    pub positions: Vec<DVec3>,
    /// Opacities, shape [n].
    pub opacities: Vec<f64>,
    /// Standard deviations [m], shape [n].
    pub scales: Vec<DVec3>,
    /// Quaternions (w, x, y, z), shape [n]; normalised when used.
    pub rotations: Vec<[f64; 4]>,
    /// Degree of the spherical harmonics.
    pub sh_degree: usize,
    /// Coefficients, shape [n, (degree + 1)^2].
    pub sh: Vec<DVec3>,
    /// In a gradient: d loss / d projected centre [per pixel], shape [n]. Otherwise empty.
    pub screen: Vec<DVec2>,
}

impl From<&Gaussians> for GaussiansF64 {
    fn from(g: &Gaussians) -> GaussiansF64 {
        let (scales, rotations) = match &g.shape {
            Shape::Isotropic { scales } => {
                (scales.iter().map(|&s| DVec3::splat(s.into())).collect(), vec![[1.0, 0.0, 0.0, 0.0]; g.len()])
            }
            Shape::Anisotropic { scales, rotations } => {
                (scales.iter().map(to_dvec3).collect(), rotations.iter().map(|q| q.map(f64::from)).collect())
            }
        };
        GaussiansF64 {
            positions: g.positions.iter().map(to_dvec3).collect(),
            opacities: g.opacities.iter().map(|&o| o.into()).collect(),
            scales,
            rotations,
            sh_degree: g.sh_degree,
            sh: g.sh.iter().map(to_dvec3).collect(),
            screen: Vec::new(),
        }
    }
}

impl GaussiansF64 {
    /// A gradient of this set as the gradient of `gaussians`: the three lanes of an isotropic scale are added up.
    pub fn to_f32(&self, gaussians: &Gaussians) -> GaussianGradients {
        let array = |v: &DVec3| v.as_vec3().to_array();
        GaussianGradients {
            positions: self.positions.iter().map(array).collect(),
            opacities: self.opacities.iter().map(|&o| o as f32).collect(),
            shape: match gaussians.shape {
                Shape::Isotropic { .. } => {
                    Shape::Isotropic { scales: self.scales.iter().map(|s| s.element_sum() as f32).collect() }
                }
                Shape::Anisotropic { .. } => Shape::Anisotropic {
                    scales: self.scales.iter().map(array).collect(),
                    rotations: self.rotations.iter().map(|q| q.map(|v| v as f32)).collect(),
                },
            },
            sh: self.sh.iter().map(array).collect(),
            screen: self.screen.iter().map(|s| s.length() as f32).collect(),
        }
    }

    fn zeros_like(other: &GaussiansF64) -> GaussiansF64 {
        let n = other.positions.len();
        GaussiansF64 {
            positions: vec![DVec3::ZERO; n],
            opacities: vec![0.0; n],
            scales: vec![DVec3::ZERO; n],
            rotations: vec![[0.0; 4]; n],
            sh_degree: other.sh_degree,
            sh: vec![DVec3::ZERO; other.sh.len()],
            screen: vec![DVec2::ZERO; n],
        }
    }
}

fn to_dvec3(v: &[f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}

/// The three pictures, or the derivative of a loss with respect to them (empty: zero). Row-major from the top left.
#[derive(Clone, Debug, Default)]
pub struct PicturesF64 {
    /// Colour over the background, shape [height * width].
    pub color: Vec<DVec3>,
    /// Alpha, shape [height * width].
    pub alpha: Vec<f64>,
    /// Depth, sum T alpha d [m], shape [height * width].
    pub depth: Vec<f64>,
}

impl From<&ImageGradients> for PicturesF64 {
    fn from(g: &ImageGradients) -> PicturesF64 {
        let wide = |v: &[f32]| v.iter().map(|&x| x.into()).collect();
        PicturesF64 { color: g.color.iter().map(to_dvec3).collect(), alpha: wide(&g.alpha), depth: wide(&g.depth) }
    }
}

/// How the cut-offs of the definition are made.
///
/// The hard ones are the definition; their jumps have no derivative, so finite differences are taken with the smooth
/// ones, where each jump is a logistic step and each clamp a soft one. The one jump that stays is a change of the depth
/// order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cutoffs {
    /// As defined.
    Hard,
    /// Softened over a width relative to each threshold.
    Smooth {
        /// The relative width.
        width: f64,
    },
}

/// A value and its derivative with respect to its one argument.
type Dual = (f64, f64);

impl Cutoffs {
    /// 1 above `threshold`, 0 below.
    fn step(self, x: f64, threshold: f64) -> Dual {
        match self {
            Cutoffs::Hard => (if x >= threshold { 1.0 } else { 0.0 }, 0.0),
            Cutoffs::Smooth { width } => {
                let w = width * threshold;
                let s = logistic((x - threshold) / w);
                (s, s * (1.0 - s) / w)
            }
        }
    }

    /// `max(x, limit)`, softened over `width * scale`.
    fn at_least(self, x: f64, limit: f64, scale: f64) -> Dual {
        match self {
            Cutoffs::Hard => (x.max(limit), if x > limit { 1.0 } else { 0.0 }),
            Cutoffs::Smooth { width } => {
                let w = width * scale;
                (limit + w * softplus((x - limit) / w), logistic((x - limit) / w))
            }
        }
    }

    /// `min(x, limit)`, softened over `width * scale`.
    fn at_most(self, x: f64, limit: f64, scale: f64) -> Dual {
        let (value, slope) = self.at_least(-x, -limit, scale);
        (-value, slope)
    }

    /// `x` where it is at least 1/255, at most 0.99.
    fn alpha(self, x: f64) -> Dual {
        let (on, d_on) = self.step(x, ALPHA_MIN);
        let (capped, d_capped) = self.at_most(x, ALPHA_MAX, ALPHA_MAX);
        (on * capped, d_on * capped + on * d_capped)
    }

    /// `x` kept between two limits.
    fn between(self, x: f64, low: f64, high: f64) -> Dual {
        let scale = high - low;
        let (a, da) = self.at_least(x, low, scale);
        let (b, db) = self.at_most(a, high, scale);
        (b, da * db)
    }
}

fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

fn softplus(x: f64) -> f64 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

/// A Gaussian as one camera sees it.
#[derive(Clone, Copy, Debug)]
struct Splat {
    index: usize,
    mean: DVec2,
    conic: DMat2,
    opacity: f64,
    color: DVec3,
    depth: f64,
}

/// Derivative of the loss with respect to a [`Splat`].
#[derive(Clone, Copy, Debug)]
struct SplatGradient {
    mean: DVec2,
    /// Of the full matrix: both off-diagonal entries carry half of the derivative.
    conic: DMat2,
    opacity: f64,
    color: DVec3,
    depth: f64,
}

impl SplatGradient {
    const ZERO: SplatGradient =
        SplatGradient { mean: DVec2::ZERO, conic: DMat2::ZERO, opacity: 0.0, color: DVec3::ZERO, depth: 0.0 };
}

/// What the projection of one Gaussian computes on the way; its backward pass reads it again.
struct Projection {
    p: DVec3,
    /// p_x/p_z, p_y/p_z.
    uv: DVec2,
    /// The same kept inside the frustum and its margin, with slopes.
    u: Dual,
    v: Dual,
    /// Rows of the Jacobian of the affine approximation [pixels/m].
    jacobian: [DVec3; 2],
    /// R S in the world frame.
    root: DMat3,
    /// Covariance in the camera frame [m^2].
    camera_covariance: DMat3,
    /// Projected covariance before and after the low-pass filter [pixels^2].
    bare: DMat2,
    dilated: DMat2,
    /// Opacity factor of the low-pass filter.
    compensation: f64,
    /// 1 beyond the near plane, with slope.
    near: Dual,
}

fn project(
    set: &GaussiansF64,
    i: usize,
    camera: &Camera,
    settings: &RenderSettings,
    cut: Cutoffs,
) -> Option<Projection> {
    let p = camera.to_camera(set.positions[i]);
    let near = cut.step(p.z, settings.near.into());
    if !(p.z > 0.0 && near.0 > 1e-300) {
        return None;
    }
    let uv = DVec2::new(p.x, p.y) / p.z;
    let (f, c) = (camera.focal, camera.principal);
    let size = DVec2::new(camera.width as f64, camera.height as f64);
    let (low, high) = ((-FRUSTUM_MARGIN * size - c) / f, ((1.0 + FRUSTUM_MARGIN) * size - c) / f);
    let (u, v) = (cut.between(uv.x, low.x, high.x), cut.between(uv.y, low.y, high.y));
    let jacobian = [DVec3::new(f.x, 0.0, -f.x * u.0) / p.z, DVec3::new(0.0, f.y, -f.y * v.0) / p.z];

    let root = rotation_matrix(set.rotations[i]) * DMat3::from_diagonal(set.scales[i]);
    let camera_from_world = camera.world_from_camera.transpose();
    let camera_covariance = camera_from_world * root * root.transpose() * camera_from_world.transpose();
    let entry = |a: usize, b: usize| jacobian[a].dot(camera_covariance * jacobian[b]);
    let bare = DMat2::from_cols_array(&[entry(0, 0), entry(0, 1), entry(0, 1), entry(1, 1)]);
    let dilated = bare + DMat2::from_diagonal(DVec2::splat(settings.dilation.into()));
    let regular = dilated.determinant() > 0.0;
    if !regular {
        return None;
    }
    let compensation =
        if settings.compensate { (bare.determinant().max(0.0) / dilated.determinant()).sqrt() } else { 1.0 };
    Some(Projection { p, uv, u, v, jacobian, root, camera_covariance, bare, dilated, compensation, near })
}

/// Adds the gradient of the loss with respect to Gaussian `i`, given that with respect to what was projected.
fn project_backward(
    set: &GaussiansF64,
    i: usize,
    camera: &Camera,
    settings: &RenderSettings,
    projection: &Projection,
    g: &SplatGradient,
    out: &mut GaussiansF64,
) {
    let Projection { p, uv, u, v, jacobian, root, camera_covariance, .. } = projection;
    let f = camera.focal;

    // opacity' = opacity * compensation * near
    let (near, d_near) = projection.near;
    out.opacities[i] += g.opacity * projection.compensation * near;
    let mut d_p = DVec3::new(0.0, 0.0, g.opacity * set.opacities[i] * projection.compensation * d_near);
    let d_compensation = g.opacity * set.opacities[i] * near;

    // conic = dilated^-1, so d dilated = -conic^T (d conic) conic^T; compensation^2 = det bare / det dilated.
    let conic = projection.dilated.inverse();
    let mut d_bare = -(conic * g.conic * conic);
    if settings.compensate && projection.compensation > 0.0 {
        d_bare += 0.5 * d_compensation * projection.compensation * (projection.bare.inverse() - conic);
    }

    // bare = J V J^T
    let (j0, j1) = (jacobian[0], jacobian[1]);
    let d = |a: usize, b: usize| d_bare.col(b)[a];
    let (vj0, vj1) = (*camera_covariance * j0, *camera_covariance * j1);
    let d_j0 = 2.0 * (d(0, 0) * vj0 + d(0, 1) * vj1);
    let d_j1 = 2.0 * (d(1, 0) * vj0 + d(1, 1) * vj1);
    let d_v = d(0, 0) * outer(j0, j0) + d(0, 1) * (outer(j0, j1) + outer(j1, j0)) + d(1, 1) * outer(j1, j1);

    // J = [f_x (1, 0, -u), f_y (0, 1, -v)] / z
    d_p.z -= (d_j0.dot(j0) + d_j1.dot(j1)) / p.z;
    let mut d_uv = -DVec2::new(d_j0.z * u.1, d_j1.z * v.1) * f / p.z;

    // mean = f uv + c, uv = (x, y)/z, depth = z
    out.screen[i] += g.mean;
    d_uv += f * g.mean;
    d_p += DVec3::new(d_uv.x, d_uv.y, -d_uv.dot(*uv)) / p.z;
    d_p.z += g.depth;
    out.positions[i] += camera.world_from_camera * d_p;

    // V = W (R S) (R S)^T W^T
    let d_root = 2.0 * (camera.world_from_camera * d_v * camera.world_from_camera.transpose()) * *root;
    let r = rotation_matrix(set.rotations[i]);
    for axis in 0..3 {
        out.scales[i][axis] += d_root.col(axis).dot(r.col(axis));
    }
    let d_rotation = d_root * DMat3::from_diagonal(set.scales[i]);
    let d_q = rotation_matrix_backward(set.rotations[i], d_rotation);
    for k in 0..4 {
        out.rotations[i][k] += d_q[k];
    }
}

fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// Rotation of a quaternion (w, x, y, z) of any length but zero.
fn rotation_matrix(q: [f64; 4]) -> DMat3 {
    let norm = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    let [w, x, y, z] = q.map(|v| v / norm);
    DMat3::from_cols(
        DVec3::new(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        DVec3::new(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        DVec3::new(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
}

fn rotation_matrix_backward(q: [f64; 4], d_r: DMat3) -> [f64; 4] {
    let norm = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    let [w, x, y, z] = q.map(|v| v / norm);
    let d = |row: usize, column: usize| d_r.col(column)[row];
    let unit = [
        2.0 * (z * (d(1, 0) - d(0, 1)) + y * (d(0, 2) - d(2, 0)) + x * (d(2, 1) - d(1, 2))),
        2.0 * (y * (d(1, 0) + d(0, 1)) + z * (d(2, 0) + d(0, 2)) + w * (d(2, 1) - d(1, 2)))
            - 4.0 * x * (d(1, 1) + d(2, 2)),
        2.0 * (x * (d(1, 0) + d(0, 1)) + z * (d(2, 1) + d(1, 2)) + w * (d(0, 2) - d(2, 0)))
            - 4.0 * y * (d(0, 0) + d(2, 2)),
        2.0 * (x * (d(2, 0) + d(0, 2)) + y * (d(2, 1) + d(1, 2)) + w * (d(1, 0) - d(0, 1)))
            - 4.0 * z * (d(0, 0) + d(1, 1)),
    ];
    // Normalisation: only the part across q counts.
    let n = [w, x, y, z];
    let along: f64 = (0..4).map(|k| unit[k] * n[k]).sum();
    std::array::from_fn(|k| (unit[k] - along * n[k]) / norm)
}

/// Colour towards the camera: max(0, 0.5 + sum_k sh_k Y_k(direction)).
fn color(set: &GaussiansF64, i: usize, camera: &Camera, settings: &RenderSettings, cut: Cutoffs) -> DVec3 {
    let k = (set.sh_degree + 1).pow(2);
    let direction = (set.positions[i] - camera.centre).normalize();
    let basis = sh::basis(set.sh_degree.min(settings.max_sh_degree), direction.to_array());
    let sum: DVec3 = (0..k).map(|c| set.sh[i * k + c] * basis[c]).sum();
    (sum + 0.5).to_array().map(|c| cut.at_least(c, 0.0, 1.0).0).into()
}

fn color_backward(
    set: &GaussiansF64,
    i: usize,
    camera: &Camera,
    settings: &RenderSettings,
    cut: Cutoffs,
    d_color: DVec3,
    out: &mut GaussiansF64,
) {
    let k = (set.sh_degree + 1).pow(2);
    let degree = set.sh_degree.min(settings.max_sh_degree);
    let offset = set.positions[i] - camera.centre;
    let direction = offset.normalize();
    let basis = sh::basis(degree, direction.to_array());
    let sum: DVec3 = (0..k).map(|c| set.sh[i * k + c] * basis[c]).sum();
    let d_sum = d_color * DVec3::from((sum + 0.5).to_array().map(|c| cut.at_least(c, 0.0, 1.0).1));
    let mut weights = [0.0; sh::MAX_COEFFICIENTS];
    for c in 0..k {
        out.sh[i * k + c] += d_sum * basis[c];
        weights[c] = d_sum.dot(set.sh[i * k + c]);
    }
    let d_direction = DVec3::from(sh::basis_gradient(degree, direction.to_array(), &weights));
    out.positions[i] += (d_direction - direction * direction.dot(d_direction)) / offset.length();
}

/// The splats of a view, front to back.
fn splats(set: &GaussiansF64, camera: &Camera, settings: &RenderSettings, cut: Cutoffs) -> Vec<Splat> {
    let mut splats: Vec<Splat> = (0..set.positions.len())
        .filter_map(|index| {
            let p = project(set, index, camera, settings, cut)?;
            let with_color = settings.channels.color();
            Some(Splat {
                index,
                mean: camera.focal * p.uv + camera.principal,
                conic: p.dilated.inverse(),
                opacity: set.opacities[index] * p.compensation * p.near.0,
                color: if with_color { color(set, index, camera, settings, cut) } else { DVec3::ZERO },
                depth: p.p.z,
            })
        })
        .collect();
    splats.sort_by(|a, b| a.depth.total_cmp(&b.depth).then(a.index.cmp(&b.index)));
    splats
}

/// For every pixel, the positions in `splats` of those that can reach 1/255 there (all of them with smooth cut-offs).
fn pixel_lists(splats: &[Splat], camera: &Camera, cut: Cutoffs) -> Vec<Vec<u32>> {
    let (width, height) = (camera.width, camera.height);
    let mut lists = vec![Vec::new(); width * height];
    for (k, s) in splats.iter().enumerate() {
        let (mut x, mut y) = (0..width, 0..height);
        if cut == Cutoffs::Hard {
            // alpha >= 1/255 inside the ellipse d^T conic d <= 2 ln(255 opacity), whose box has these half-sizes.
            let level = 2.0 * (s.opacity / ALPHA_MIN).ln();
            let reaches = level >= 0.0;
            if !reaches {
                continue;
            }
            let covariance = s.conic.inverse();
            let half = DVec2::new((level * covariance.col(0).x).sqrt(), (level * covariance.col(1).y).sqrt());
            let pixels = |c: f64, h: f64, n: usize| {
                ((c - h - 1.0).clamp(0.0, n as f64) as usize)..((c + h + 1.0).clamp(0.0, n as f64) as usize)
            };
            (x, y) = (pixels(s.mean.x, half.x, width), pixels(s.mean.y, half.y, height));
        }
        for row in y {
            for column in x.clone() {
                lists[row * width + column].push(k as u32);
            }
        }
    }
    lists
}

/// One Gaussian in one pixel, on the way from front to back.
struct Step {
    splat: usize,
    /// The pixel seen from the centre of the Gaussian, u - m [pixels].
    offset: DVec2,
    /// exp(-q/2).
    falloff: f64,
    /// Alpha after the cut-offs in alpha, with its slope.
    alpha: Dual,
    /// The transmittance's cut-off, with its slope.
    open: Dual,
    /// Transmittance in front of this Gaussian.
    transmittance: f64,
}

impl Step {
    /// The share of the light that arrives here which this Gaussian takes.
    fn coverage(&self) -> f64 {
        self.alpha.0 * self.open.0
    }
}

/// Walks through the Gaussians of a pixel; returns the steps and the transmittance left at the end.
fn walk(splats: &[Splat], list: &[u32], pixel: DVec2, cut: Cutoffs) -> (Vec<Step>, f64) {
    let mut transmittance = 1.0;
    let mut steps = Vec::new();
    for &k in list {
        let s = &splats[k as usize];
        let offset = pixel - s.mean;
        let falloff = (-0.5 * offset.dot(s.conic * offset)).exp();
        let alpha = cut.alpha(s.opacity * falloff);
        let open = cut.step(transmittance, TRANSMITTANCE_MIN);
        let step = Step { splat: k as usize, offset, falloff, alpha, open, transmittance };
        if alpha.0 != 0.0 && open.0 != 0.0 {
            transmittance *= 1.0 - step.coverage();
            steps.push(step);
        }
    }
    (steps, transmittance)
}

fn pixel_centres(camera: &Camera) -> impl Iterator<Item = DVec2> + use<> {
    let width = camera.width;
    (0..camera.width * camera.height).map(move |i| DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5))
}

/// Draws the set (paper eq. 2).
pub fn render(set: &GaussiansF64, camera: &Camera, settings: &RenderSettings, cut: Cutoffs) -> PicturesF64 {
    let splats = splats(set, camera, settings, cut);
    let lists = pixel_lists(&splats, camera, cut);
    let background = DVec3::from_array(settings.background.map(f64::from));
    let mut out = PicturesF64::default();
    for (pixel, list) in pixel_centres(camera).zip(&lists) {
        let (steps, left) = walk(&splats, list, pixel, cut);
        let sum = |value: &dyn Fn(&Splat) -> DVec3| -> DVec3 {
            steps.iter().map(|s| value(&splats[s.splat]) * (s.transmittance * s.coverage())).sum()
        };
        if settings.channels.color() {
            out.color.push(sum(&|s| s.color) + background * left);
        }
        if settings.channels.depth() {
            out.depth.push(sum(&|s| DVec3::splat(s.depth)).x);
        }
        out.alpha.push(sum(&|_| DVec3::ONE).x);
    }
    out
}

/// Gradient of a loss on the pictures with respect to every attribute of the set.
pub fn backward(
    set: &GaussiansF64,
    camera: &Camera,
    settings: &RenderSettings,
    cut: Cutoffs,
    loss: &PicturesF64,
) -> GaussiansF64 {
    let splats = splats(set, camera, settings, cut);
    let lists = pixel_lists(&splats, camera, cut);
    let background = DVec3::from_array(settings.background.map(f64::from));
    let mut gradients = vec![SplatGradient::ZERO; splats.len()];
    for (i, (pixel, list)) in pixel_centres(camera).zip(&lists).enumerate() {
        let zero_unless = |drawn: bool, v: Option<f64>| if drawn { v.unwrap_or(0.0) } else { 0.0 };
        let d_color = match settings.channels.color() {
            true => loss.color.get(i).copied().unwrap_or(DVec3::ZERO),
            false => DVec3::ZERO,
        };
        let d_alpha = loss.alpha.get(i).copied().unwrap_or(0.0);
        let d_depth = zero_unless(settings.channels.depth(), loss.depth.get(i).copied());
        let (steps, _) = walk(&splats, list, pixel, cut);
        // Reverse of: pictures += T a (c, 1, d); T <- T (1 - a), with a = alpha open(T).
        let mut d_transmittance = d_color.dot(background);
        for step in steps.iter().rev() {
            let (s, g) = (&splats[step.splat], &mut gradients[step.splat]);
            let (t, a) = (step.transmittance, step.coverage());
            let value = d_color.dot(s.color) + d_alpha + d_depth * s.depth;
            g.color += d_color * (t * a);
            g.depth += d_depth * t * a;
            let d_a = t * (value - d_transmittance);
            d_transmittance = a * value + (1.0 - a) * d_transmittance + d_a * step.alpha.0 * step.open.1;
            // alpha = cut(opacity falloff), falloff = exp(-q/2), q = offset^T conic offset, offset = pixel - mean
            let d_raw = d_a * step.open.0 * step.alpha.1;
            g.opacity += d_raw * step.falloff;
            let d_q = -0.5 * d_raw * s.opacity * step.falloff;
            g.mean -= 2.0 * d_q * (s.conic * step.offset);
            g.conic += d_q * DMat2::from_cols(step.offset * step.offset.x, step.offset * step.offset.y);
        }
    }
    let mut out = GaussiansF64::zeros_like(set);
    for (s, g) in splats.iter().zip(&gradients) {
        let projection = project(set, s.index, camera, settings, cut).expect("it was projected before");
        project_backward(set, s.index, camera, settings, &projection, g, &mut out);
        if settings.channels.color() {
            color_backward(set, s.index, camera, settings, cut, g.color, &mut out);
        }
    }
    out
}
