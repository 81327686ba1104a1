//! From Gaussians in the world to ellipses in the picture, and back with gradients: EWA splatting (Zwicker et al. 2001)
//! as 3DGS has it (Kerbl et al. 2023, eq. 5).
//!
//! With W the world-to-camera rotation and J the Jacobian of the perspective at the centre, the covariance `Sigma = R
//! S^2 R^T` becomes `Sigma' = J W Sigma W^T J^T`. In f64 and once per Gaussian; what is done once per pixel lives in
//! [`crate::raster`].

use gic_scene::Camera;
use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::limits::{ALPHA_MIN, FRUSTUM_MARGIN, SHORTEST_QUATERNION};
use crate::{Gaussians, RenderSettings, Shape, sh};

/// A Gaussian as one camera sees it. With `d = pixel - mean`,
/// ln alpha = `log_opacity + quadratic[0] dx^2 + quadratic[1] dx dy + quadratic[2] dy^2`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Splat {
    /// Projected centre [pixels].
    pub(crate) mean: [f32; 2],
    pub(crate) quadratic: [f32; 3],
    pub(crate) log_opacity: f32,
    /// Colour towards the camera.
    pub(crate) color: [f32; 3],
    /// Depth of the centre along the optical axis [m].
    pub(crate) depth: f32,
    /// First and one past the last column and row where alpha can reach 1/255.
    pub(crate) columns: [u32; 2],
    pub(crate) rows: [u32; 2],
    /// Which Gaussian.
    pub(crate) index: u32,
}

/// Gradient of the loss with respect to a [`Splat`], summed over its pixels: with g = d loss / d ln alpha,
/// the sums of g, g dx, g dy, g dx^2, g dx dy, g dy^2, then colour and depth.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SplatGradient {
    pub(crate) moments: [f64; 6],
    pub(crate) color: [f64; 3],
    pub(crate) depth: f64,
}

/// Gradient with respect to the attributes of one Gaussian, without its spherical harmonics and what they add to the
/// position.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct AttributeGradient {
    pub(crate) position: [f32; 3],
    pub(crate) opacity: f32,
    /// Only the first for isotropic shapes.
    pub(crate) scale: [f32; 3],
    /// (w, x, y, z).
    pub(crate) rotation: [f32; 4],
    /// Norm of the gradient with respect to the projected centre.
    pub(crate) screen: f32,
}

/// A symmetric 2x2 matrix: xx, xy, yy.
#[derive(Clone, Copy, Debug)]
struct Sym2 {
    xx: f64,
    xy: f64,
    yy: f64,
}

/// A Gaussian with a wider projected standard deviation than this [pixels] is not drawn: f32 pixels could not follow
/// it.
const MAX_SIGMA_PX: f64 = 1e6;

/// Colour coefficients and depths [m] beyond this are taken for damage: sums of them and their gradients would leave
/// f32.
const MAX_VALUE: f64 = 1e9;

impl Sym2 {
    fn determinant(self) -> f64 {
        self.xx * self.yy - self.xy * self.xy
    }

    fn inverse(self) -> Sym2 {
        let scale = 1.0 / self.determinant();
        Sym2 { xx: self.yy * scale, xy: -self.xy * scale, yy: self.xx * scale }
    }

    /// `self g self`.
    fn sandwich(self, g: Sym2) -> Sym2 {
        let (px, py) = (self.xx * g.xx + self.xy * g.xy, self.xx * g.xy + self.xy * g.yy);
        let (qx, qy) = (self.xy * g.xx + self.yy * g.xy, self.xy * g.xy + self.yy * g.yy);
        Sym2 { xx: px * self.xx + py * self.xy, xy: px * self.xy + py * self.yy, yy: qx * self.xy + qy * self.yy }
    }

    fn is_finite(self) -> bool {
        self.xx.is_finite() && self.xy.is_finite() && self.yy.is_finite()
    }
}

/// The square root `A` of a covariance in the camera frame, `Sigma = A A^T`.
#[derive(Clone, Copy, Debug)]
enum CovarianceRoot {
    /// `scale` times the identity.
    Isotropic { scale: f64 },
    /// `axes diag(scales)`, where `axes` turns local axes into camera axes.
    Anisotropic { axes: DMat3, scales: DVec3 },
}

impl CovarianceRoot {
    fn new(gaussians: &Gaussians, i: usize, camera_from_world: DMat3) -> CovarianceRoot {
        match &gaussians.shape {
            Shape::Isotropic { scales } => CovarianceRoot::Isotropic { scale: scales[i].into() },
            Shape::Anisotropic { scales, rotations } => CovarianceRoot::Anisotropic {
                axes: camera_from_world * DMat3::from_quat(unit_quaternion(rotations[i]).0),
                scales: DVec3::from_array(scales[i].map(f64::from)),
            },
        }
    }

    /// `A^T row`: a row of the Jacobian times the root.
    fn apply(self, row: DVec3) -> DVec3 {
        match self {
            CovarianceRoot::Isotropic { scale } => row * scale,
            CovarianceRoot::Anisotropic { axes, scales } => (axes.transpose() * row) * scales,
        }
    }

    /// `A v`.
    fn apply_transposed(self, v: DVec3) -> DVec3 {
        match self {
            CovarianceRoot::Isotropic { scale } => v * scale,
            CovarianceRoot::Anisotropic { axes, scales } => axes * (v * scales),
        }
    }

    /// Whether every standard deviation is a number that is not negative.
    fn is_valid(self) -> bool {
        match self {
            CovarianceRoot::Isotropic { scale } => scale >= 0.0 && scale.is_finite(),
            CovarianceRoot::Anisotropic { axes, scales } => {
                scales.min_element() >= 0.0 && scales.is_finite() && axes.is_finite()
            }
        }
    }
}

/// A quaternion (w, x, y, z) made a rotation, and its length. Not finite if it is too short.
fn unit_quaternion(q: [f32; 4]) -> (DQuat, f64) {
    let [w, x, y, z] = q.map(f64::from);
    let length = (w * w + x * x + y * y + z * z).sqrt();
    let length = if length < SHORTEST_QUATERNION { 0.0 } else { length };
    (DQuat::from_xyzw(x / length, y / length, z / length, w / length), length)
}

/// One camera's share of the projection, computed once per picture.
#[derive(Clone, Debug)]
pub(crate) struct CameraProjection<'a> {
    camera: &'a Camera,
    settings: &'a RenderSettings,
    camera_from_world: DMat3,
    /// Limits of (x/z, y/z) for the affine approximation.
    low: DVec2,
    high: DVec2,
    with_color: bool,
    sh_degree: usize,
}

/// What became of a Gaussian.
pub(crate) enum Projected {
    /// It is drawn.
    Drawn(Splat),
    /// It is out of sight.
    Hidden,
    /// An attribute is not finite, or a scale or opacity negative, or colour or depth beyond all reason.
    Rejected,
}

/// The geometric part of a projection.
struct Geometry {
    p: DVec3,
    uv: DVec2,
    /// `uv` inside the limits; slope 0 where it was moved.
    limited: DVec2,
    slope: DVec2,
    root: CovarianceRoot,
    /// `A^T J^T`: the projected covariance is its Gram matrix.
    a: [DVec3; 2],
    bare: Sym2,
    conic: Sym2,
    compensation: f64,
}

impl<'a> CameraProjection<'a> {
    pub(crate) fn new(gaussians: &Gaussians, camera: &'a Camera, settings: &'a RenderSettings) -> CameraProjection<'a> {
        let size = DVec2::new(camera.width as f64, camera.height as f64);
        CameraProjection {
            camera,
            settings,
            camera_from_world: camera.world_from_camera.transpose(),
            low: (-FRUSTUM_MARGIN * size - camera.principal) / camera.focal,
            high: ((1.0 + FRUSTUM_MARGIN) * size - camera.principal) / camera.focal,
            with_color: settings.channels.color(),
            sh_degree: gaussians.sh_degree.min(settings.max_sh_degree),
        }
    }

    fn position(gaussians: &Gaussians, i: usize) -> DVec3 {
        DVec3::from_array(gaussians.positions[i].map(f64::from))
    }

    fn root(&self, gaussians: &Gaussians, i: usize) -> CovarianceRoot {
        CovarianceRoot::new(gaussians, i, self.camera_from_world)
    }

    /// The Jacobian's rows without their factor focal / z.
    fn rows(limited: DVec2) -> [DVec3; 2] {
        [DVec3::new(1.0, 0.0, -limited.x), DVec3::new(0.0, 1.0, -limited.y)]
    }

    /// `None` where the Gaussian cannot be projected: not in front of the near plane, without extent, or boundless.
    fn geometry(&self, position: DVec3, root: CovarianceRoot) -> Option<Geometry> {
        let p = self.camera_from_world * (position - self.camera.centre);
        let in_front = p.z >= self.settings.near.into() && p.z > 0.0;
        if !in_front {
            return None;
        }
        let uv = DVec2::new(p.x, p.y) / p.z;
        let limited = uv.clamp(self.low, self.high);
        let slope = DVec2::new(f64::from(limited.x == uv.x), f64::from(limited.y == uv.y));
        let f = self.camera.focal / p.z;
        let [r0, r1] = Self::rows(limited);
        let a = [root.apply(r0) * f.x, root.apply(r1) * f.y];
        let bare = Sym2 { xx: a[0].length_squared(), xy: a[0].dot(a[1]), yy: a[1].length_squared() };
        let dilation = f64::from(self.settings.dilation);
        let dilated = Sym2 { xx: bare.xx + dilation, xy: bare.xy, yy: bare.yy + dilation };
        let determinant = dilated.determinant();
        let conic = dilated.inverse();
        let regular =
            determinant > 0.0 && conic.is_finite() && dilated.xx.max(dilated.yy) < MAX_SIGMA_PX * MAX_SIGMA_PX;
        if !regular {
            return None;
        }
        let compensation =
            if self.settings.compensate { (bare.determinant().max(0.0) / determinant).sqrt() } else { 1.0 };
        Some(Geometry { p, uv, limited, slope, root, a, bare, conic, compensation })
    }

    /// Projects Gaussian `i`.
    pub(crate) fn project(&self, gaussians: &Gaussians, i: usize) -> Projected {
        let (position, opacity, root) = (Self::position(gaussians, i), gaussians.opacities[i], self.root(gaussians, i));
        if !(position.is_finite() && opacity >= 0.0 && opacity.is_finite() && root.is_valid()) {
            return Projected::Rejected;
        }
        let Some(g) = self.geometry(position, root) else { return Projected::Hidden };
        let opacity = f64::from(opacity) * g.compensation;
        // alpha >= 1/255 inside the ellipse d^T conic d <= level; its box has half-sizes sqrt(level * variance).
        let level = 2.0 * (opacity / ALPHA_MIN).ln();
        let reaches = level >= 0.0;
        if !reaches {
            return Projected::Hidden;
        }
        let mean = self.camera.focal * g.uv + self.camera.principal;
        let dilation = f64::from(self.settings.dilation);
        let columns = pixel_range(mean.x, (level * (g.bare.xx + dilation)).sqrt(), self.camera.width);
        let rows = pixel_range(mean.y, (level * (g.bare.yy + dilation)).sqrt(), self.camera.height);
        if columns[0] >= columns[1] || rows[0] >= rows[1] {
            return Projected::Hidden;
        }
        let sum = if self.with_color { self.color_sum(gaussians, i).0 } else { DVec3::ZERO };
        let depth = g.p.z as f32;
        let reasonable = f64::from(depth) < MAX_VALUE && (!self.with_color || self.has_color(gaussians, i));
        if !reasonable {
            return Projected::Rejected;
        }
        Projected::Drawn(Splat {
            mean: mean.as_vec2().to_array(),
            quadratic: [-0.5 * g.conic.xx, -g.conic.xy, -0.5 * g.conic.yy].map(|v| v as f32),
            log_opacity: opacity.ln() as f32,
            color: sum.max(DVec3::ZERO).as_vec3().to_array(),
            depth,
            columns,
            rows,
            index: i as u32,
        })
    }

    /// Whether the spherical harmonics in use are numbers within reason. The sum would not tell: a harmonic that is
    /// zero in this direction has a gradient all the same.
    fn has_color(&self, gaussians: &Gaussians, i: usize) -> bool {
        let first = i * gaussians.sh_per_gaussian();
        let used = &gaussians.sh[first..first + (self.sh_degree + 1).pow(2)];
        used.as_flattened().iter().all(|c| f64::from(c.abs()) < MAX_VALUE)
    }

    /// Gradient with respect to the attributes of the Gaussian that was drawn as `splat`.
    pub(crate) fn project_backward(
        &self,
        gaussians: &Gaussians,
        splat: &Splat,
        gradient: &SplatGradient,
    ) -> AttributeGradient {
        let i = splat.index as usize;
        let Some(g) = self.geometry(Self::position(gaussians, i), self.root(gaussians, i)) else {
            return AttributeGradient::default();
        };
        let [s, sx, sy, sxx, sxy, syy] = gradient.moments;

        // ln alpha = ln(opacity compensation) - d^T conic d / 2
        let d_opacity = s / f64::from(gaussians.opacities[i]);
        let d_mean = DVec2::new(g.conic.xx * sx + g.conic.xy * sy, g.conic.xy * sx + g.conic.yy * sy);
        let d_conic = Sym2 { xx: -0.5 * sxx, xy: -0.5 * sxy, yy: -0.5 * syy };
        let mut d_bare = g.conic.sandwich(d_conic);
        d_bare = Sym2 { xx: -d_bare.xx, xy: -d_bare.xy, yy: -d_bare.yy };
        if self.settings.compensate {
            // d ln compensation = (bare^-1 - dilated^-1) / 2
            let bare_inverse = g.bare.inverse();
            d_bare.xx += 0.5 * s * (bare_inverse.xx - g.conic.xx);
            d_bare.xy += 0.5 * s * (bare_inverse.xy - g.conic.xy);
            d_bare.yy += 0.5 * s * (bare_inverse.yy - g.conic.yy);
        }

        // bare = (A^T J^T)^T (A^T J^T)
        let d_a = [
            2.0 * (d_bare.xx * g.a[0] + d_bare.xy * g.a[1]), //
            2.0 * (d_bare.xy * g.a[0] + d_bare.yy * g.a[1]),
        ];
        let f = self.camera.focal / g.p.z;
        let d_rows = [g.root.apply_transposed(d_a[0]) * f.x, g.root.apply_transposed(d_a[1]) * f.y];
        let (scale, rotation) = self.root_backward(gaussians, i, &g, [d_a[0] * f.x, d_a[1] * f.y]);

        // a ~ 1/z; rows = (1, 0, -u), (0, 1, -v); mean = focal uv + principal
        let d_z = -(d_a[0].dot(g.a[0]) + d_a[1].dot(g.a[1])) / g.p.z + gradient.depth;
        let d_uv = self.camera.focal * d_mean - DVec2::new(d_rows[0].z, d_rows[1].z) * g.slope;
        let d_p = DVec3::new(d_uv.x, d_uv.y, -d_uv.dot(g.uv)) / g.p.z + DVec3::new(0.0, 0.0, d_z);
        AttributeGradient {
            position: (self.camera.world_from_camera * d_p).as_vec3().to_array(),
            opacity: d_opacity as f32,
            scale: scale.as_vec3().to_array(),
            rotation: rotation.map(|v| v as f32),
            screen: d_mean.length() as f32,
        }
    }

    /// `d_a` is the gradient with respect to the two vectors `A^T row`.
    /// Returns the gradient with respect to scales and rotation.
    fn root_backward(&self, gaussians: &Gaussians, i: usize, g: &Geometry, d_a: [DVec3; 2]) -> (DVec3, [f64; 4]) {
        let rows = Self::rows(g.limited);
        match (g.root, &gaussians.shape) {
            (CovarianceRoot::Anisotropic { axes, scales }, Shape::Anisotropic { rotations, .. }) => {
                // A^T row = diag(scales) axes^T row
                let to_local = axes.transpose();
                let d_scale = d_a[0] * (to_local * rows[0]) + d_a[1] * (to_local * rows[1]);
                // d axes = row (scales d_a)^T; axes = W R, so d R = W^T d axes.
                let (u, v) = (self.camera.world_from_camera * rows[0], self.camera.world_from_camera * rows[1]);
                let pairs = [(u, d_a[0] * scales), (v, d_a[1] * scales)];
                (d_scale, quaternion_backward(rotations[i], pairs))
            }
            // A^T row = scale row
            _ => (DVec3::new(d_a[0].dot(rows[0]) + d_a[1].dot(rows[1]), 0.0, 0.0), [0.0; 4]),
        }
    }

    /// 0.5 + sum_k sh_k Y_k, whose part above 0 is the colour towards the camera; with the direction and its length.
    fn color_sum(&self, gaussians: &Gaussians, i: usize) -> (DVec3, DVec3, f64) {
        let offset = Self::position(gaussians, i) - self.camera.centre;
        let distance = offset.length();
        let direction = offset / distance;
        let basis = sh::basis(self.sh_degree, direction.to_array());
        let used = (self.sh_degree + 1).pow(2);
        let first = i * gaussians.sh_per_gaussian();
        let sum = gaussians.sh[first..first + used]
            .iter()
            .zip(&basis)
            .fold(DVec3::splat(0.5), |sum, (c, y)| sum + DVec3::from_array(c.map(f64::from)) * *y);
        (sum, direction, distance)
    }

    /// The colour's part of the backward pass, for a Gaussian that was drawn: writes the gradient with respect to its
    /// spherical harmonics to `d_sh` [(degree + 1)^2] and adds that with respect to its position.
    pub(crate) fn color_backward(
        &self,
        gaussians: &Gaussians,
        i: usize,
        d_color: [f32; 3],
        d_sh: &mut [[f32; 3]],
        d_position: &mut [f32; 3],
    ) {
        let d_color = DVec3::from_array(d_color.map(f64::from));
        let (sum, direction, distance) = self.color_sum(gaussians, i);
        let d_sum = DVec3::from_array(std::array::from_fn(|c| if sum[c] > 0.0 { d_color[c] } else { 0.0 }));
        let basis = sh::basis(self.sh_degree, direction.to_array());
        let used = (self.sh_degree + 1).pow(2);
        let first = i * gaussians.sh_per_gaussian();
        let mut weights = [0.0; sh::MAX_COEFFICIENTS];
        for k in 0..used {
            let coefficient = DVec3::from_array(gaussians.sh[first + k].map(f64::from));
            d_sh[k] = (d_sum * basis[k]).as_vec3().to_array();
            weights[k] = d_sum.dot(coefficient);
        }
        let d_direction = DVec3::from_array(sh::basis_gradient(self.sh_degree, direction.to_array(), &weights));
        let across = (d_direction - direction * direction.dot(d_direction)) / distance;
        for axis in 0..3 {
            d_position[axis] += across[axis] as f32;
        }
    }
}

/// Columns (or rows) whose pixel centres lie within `half` of `centre`; a hundredth more, against rounding in the
/// raster.
fn pixel_range(centre: f64, half: f64, count: usize) -> [u32; 2] {
    let half = half + 0.01;
    // Casts from f64 saturate, and send NaN to 0: an empty range.
    let first = (centre - half - 0.5).ceil().max(0.0) as u32;
    let last = ((centre + half - 0.5).floor() + 1.0).clamp(0.0, count as f64) as u32;
    [first, last]
}

/// Gradient with respect to a quaternion (w, x, y, z) of any length, given `d loss / d R = sum u a^T`.
fn quaternion_backward(q: [f32; 4], pairs: [(DVec3, DVec3); 2]) -> [f64; 4] {
    let (unit, length) = unit_quaternion(q);
    let (w, v) = (unit.w, DVec3::new(unit.x, unit.y, unit.z));
    // u^T R(q) a = u.a (w^2 - v.v) + 2 (v.u)(v.a) + 2 w u.(v x a), as a function of q (|q| = 1 to first order).
    let (mut d_w, mut d_v) = (0.0, DVec3::ZERO);
    for (u, a) in pairs {
        d_w += 2.0 * (w * u.dot(a) + u.dot(v.cross(a)));
        d_v += 2.0 * (u * v.dot(a) + a * v.dot(u) - v * u.dot(a) + w * a.cross(u));
    }
    let along = d_w * w + d_v.dot(v);
    [d_w - along * w, d_v.x - along * v.x, d_v.y - along * v.y, d_v.z - along * v.z].map(|d| d / length)
}
