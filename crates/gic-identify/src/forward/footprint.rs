//! Isotropic Gaussians as a camera sees them: where their pixels are and how they fall off.

use gic_scene::Camera;
use gic_simd::{Lanes, MAX_LANES};

use crate::tuning::{CUTOFF_SIGMAS, STEP_VARIANCE};

/// Particles as they are drawn.
#[derive(Clone, Copy, Debug)]
pub(crate) struct IsotropicGaussians<'a> {
    /// Positions [m], shape [n].
    pub positions: &'a [[f32; 3]],
    /// Opacity at the centre, shape [n].
    pub opacities: &'a [f32],
    /// Standard deviation [m], shape [n].
    pub scales: &'a [f32],
    /// Factor on every standard deviation.
    pub factor: f32,
}

/// One Gaussian as a camera sees it: what both passes over the pixels need.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Footprint {
    /// Camera coordinates [m].
    pub camera: glam::Vec3,
    /// Centre [pixels].
    pub centre: (f32, f32),
    /// Projected variance [pixels^2].
    pub variance: f32,
    /// Alpha at the centre.
    pub peak: f32,
    /// Columns and rows that it covers, from the first up to, not including, the second.
    pub columns: (usize, usize),
    pub rows: (usize, usize),
}

/// World-to-camera in single precision.
pub(crate) struct Projection {
    pub turn: glam::Mat3,
    centre: glam::Vec3,
    pub focal: glam::Vec2,
    /// Geometric mean of the focal lengths [pixels].
    mean_focal: f32,
    principal: glam::Vec2,
    size: (usize, usize),
}

impl Projection {
    pub(crate) fn new(camera: &Camera) -> Projection {
        let focal = camera.focal.as_vec2();
        Projection {
            turn: camera.world_from_camera.as_mat3().transpose(),
            centre: camera.centre.as_vec3(),
            focal,
            mean_focal: (focal.x * focal.y).sqrt(),
            principal: camera.principal.as_vec2(),
            size: (camera.width, camera.height),
        }
    }

    /// The particles from `first` on, as many as there are lanes, or fewer at the end. A NaN position is not drawn; a
    /// Gaussian around the camera itself has no silhouette.
    #[inline(always)]
    pub(crate) fn footprints<L: Lanes<Scalar = f32>>(
        &self,
        gaussians: &IsotropicGaussians,
        first: usize,
    ) -> Footprints {
        let end = (first + L::LANES).min(gaussians.positions.len());
        let mut world = [[f32::NAN; MAX_LANES]; 3];
        for (lane, p) in gaussians.positions[first..end].iter().enumerate() {
            for axis in 0..3 {
                world[axis][lane] = p[axis];
            }
        }
        let [x, y, z] = [
            L::load(&world[0]) - L::of(self.centre.x),
            L::load(&world[1]) - L::of(self.centre.y),
            L::load(&world[2]) - L::of(self.centre.z),
        ];
        let rows = [self.turn.row(0), self.turn.row(1), self.turn.row(2)];
        let camera = [dot([x, y, z], rows[0]), dot([x, y, z], rows[1]), dot([x, y, z], rows[2])];
        let sigma_m = L::load_partial(&gaussians.scales[first..end], 0.0) * L::of(gaussians.factor);
        let in_front = L::and((L::of(CUTOFF_SIGMAS) * sigma_m).lt(camera[2]), L::of(1e-3).lt(camera[2]));

        let per_depth = L::one() / camera[2];
        let centre = [
            (camera[0] * per_depth).mul_add(L::of(self.focal.x), L::of(self.principal.x)),
            (camera[1] * per_depth).mul_add(L::of(self.focal.y), L::of(self.principal.y)),
        ];
        let sigma = L::of(self.mean_focal) * sigma_m * per_depth;
        let squared = sigma * sigma;
        let variance = squared + L::of(STEP_VARIANCE);
        let radius = L::of(CUTOFF_SIGMAS) * variance.sqrt();
        // The low pass widens the Gaussian; its peak falls so that its integral stays.
        let peak = L::load_partial(&gaussians.opacities[first..end], 0.0) * squared / variance;
        let (columns, rows) = (Span::new(centre[0], radius, self.size.0), Span::new(centre[1], radius, self.size.1));
        Footprints {
            seen: L::bits(L::and(in_front, L::and(columns.inside, rows.inside))),
            camera: camera.map(list),
            centre: centre.map(list),
            variance: list(variance),
            peak: list(peak),
            columns: [list(columns.first), list(columns.end)],
            rows: [list(rows.first), list(rows.end)],
        }
    }
}

/// Those of as many particles as there are lanes.
pub(crate) struct Footprints {
    /// Which of them are in the picture.
    seen: u32,
    camera: [[f32; MAX_LANES]; 3],
    centre: [[f32; MAX_LANES]; 2],
    variance: [f32; MAX_LANES],
    peak: [f32; MAX_LANES],
    columns: [[f32; MAX_LANES]; 2],
    rows: [[f32; MAX_LANES]; 2],
}

impl Footprints {
    /// Those in the picture, each with its lane.
    #[inline(always)]
    pub(crate) fn seen(&self) -> impl Iterator<Item = (usize, Footprint)> {
        let is_seen = |lane: &usize| self.seen & (1 << lane) != 0;
        (0..MAX_LANES).filter(is_seen).map(|lane| (lane, self.at(lane)))
    }

    #[inline(always)]
    fn at(&self, k: usize) -> Footprint {
        Footprint {
            camera: self.camera.map(|axis| axis[k]).into(),
            centre: (self.centre[0][k], self.centre[1][k]),
            variance: self.variance[k],
            peak: self.peak[k],
            columns: (self.columns[0][k] as usize, self.columns[1][k] as usize),
            rows: (self.rows[0][k] as usize, self.rows[1][k] as usize),
        }
    }
}

#[inline(always)]
fn dot<L: Lanes<Scalar = f32>>([x, y, z]: [L; 3], row: glam::Vec3) -> L {
    x.mul_add(L::of(row.x), y.mul_add(L::of(row.y), z * L::of(row.z)))
}

#[inline(always)]
fn list<L: Lanes<Scalar = f32>>(lanes: L) -> [f32; MAX_LANES] {
    let mut all = [0.0; MAX_LANES];
    lanes.store(&mut all);
    all
}

/// Pixels whose centres lie within a radius, clipped to the picture.
struct Span<L: Lanes<Scalar = f32>> {
    first: L,
    end: L,
    /// Whether there are any.
    inside: L::Mask,
}

impl<L: Lanes<Scalar = f32>> Span<L> {
    #[inline(always)]
    fn new(at: L, radius: L, length: usize) -> Span<L> {
        let first = -(radius + L::of(0.5) - at).floor();
        let end = (at + radius + L::of(0.5)).floor();
        let (first, end) = (first.max(L::zero()), end.min(L::of(length as f32)));
        // The second condition is false where `at` is no number.
        Span { first, end, inside: L::and(first.lt(end), at.le(at)) }
    }
}

impl Footprint {
    /// Writes exp(-d^2 / 2 variance) of each column to the beginning of `row`, zeros behind them up to a whole number
    /// of lanes, and returns how many numbers these are.
    #[inline(always)]
    pub(crate) fn column_falloff<L: Lanes<Scalar = f32>>(&self, row: &mut [f32]) -> usize {
        self.falloff::<L>(self.columns, self.centre.0, 1.0, row)
    }

    /// The same of each row, times the alpha at the centre.
    #[inline(always)]
    pub(crate) fn row_falloff<L: Lanes<Scalar = f32>>(&self, column: &mut [f32]) -> usize {
        self.falloff::<L>(self.rows, self.centre.1, self.peak, column)
    }

    #[inline(always)]
    fn falloff<L: Lanes<Scalar = f32>>(
        &self,
        (first, end): (usize, usize),
        centre: f32,
        peak: f32,
        to: &mut [f32],
    ) -> usize {
        let half = L::of(-0.5 / self.variance);
        let lanes = L::lane_index();
        let whole = (end - first).next_multiple_of(L::LANES);
        for at in (0..whole).step_by(L::LANES) {
            let d = lanes + L::of((first + at) as f32 + 0.5 - centre);
            let value = L::of(peak) * (half * d * d).exp();
            let drawn = lanes.lt(L::of((end - first - at) as f32));
            L::select(drawn, value, L::zero()).store(&mut to[at..]);
        }
        whole
    }
}
