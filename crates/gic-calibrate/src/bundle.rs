//! Bundle adjustment: lenses, cameras, boards and pages together, by Levenberg and Marquardt's method.
//!
//! ```text
//! minimise  sum_i w_i |u_i - project(lens_c, R_c (B_m p_i - o_c))|^2 / s^2  +  sum_j ((q_j - prior_j) / sd_j)^2
//! ```
//!
//! over lenses, camera rotations R_c and centres o_c, board poses B_m and pages' places, which give p_i. Weights w are
//! Cauchy's, the noise s is measured; both settle in rounds. Priors q hold what pictures do not tell.

use gic_optimize::{DAMPING_FACTOR, FIRST_DAMPING, damped_step};
use nalgebra::{DMatrix, DVector, Matrix2x3, Point3, UnitQuaternion, Vector2, Vector3};

use crate::lens::LENS_UNKNOWNS;
use crate::rig::{Rig, View};
use crate::tuning::{
    ASPECT_SD, CAUCHY_NOISES, CONVERGED_GAIN, FOCAL_SD, K1_SD, K2_SD, LEAST_NOISE_PX, MANY_VIEWS, MOST_STEPS,
    NOISE_ROUNDS, OUTLIER_NOISES, PRINCIPAL_SD_WIDTHS, TANGENTIAL_SD, UNTOLD_SD,
};

/// Which unknowns there are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Freedom {
    /// Lenses are sought.
    pub(crate) lenses: bool,
    /// The moment whose board is the world's frame.
    pub(crate) reference: usize,
    /// fy / fx, which is 1 for square pixels.
    pub(crate) pixel_aspect: f64,
}

/// A corner of a tag in a picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Corner {
    /// Number of the view.
    pub(crate) view: usize,
    /// Its tag's place in the rig's list.
    pub(crate) tag: usize,
    /// Which corner, 0 to 3.
    pub(crate) corner: usize,
    /// Where it is seen [pixels].
    pub(crate) seen: Vector2<f64>,
    /// Whether it counts.
    pub(crate) is_kept: bool,
}

/// The adjustment and where it stands.
pub(crate) struct Bundle<'a> {
    pub(crate) rig: Rig,
    pub(crate) corners: Vec<Corner>,
    views: &'a [View],
    sizes: &'a [[usize; 2]],
    freedom: Freedom,
    /// Noise of a corner along each axis [pixels].
    pub(crate) noise_px: f64,
}

/// Seen minus predicted [pixels], and its derivative by single unknowns.
type Row = (Vector2<f64>, Vec<(usize, Vector2<f64>)>);

impl<'a> Bundle<'a> {
    /// The adjustment of a start.
    pub(crate) fn new(rig: Rig, views: &'a [View], sizes: &'a [[usize; 2]], freedom: Freedom) -> Bundle<'a> {
        let mut corners = Vec::new();
        for (number, view) in views.iter().enumerate() {
            for sighting in &view.tags {
                let Some(tag) = rig.tag(sighting.id) else { continue };
                corners.extend(sighting.corners.iter().enumerate().map(|(corner, seen)| Corner {
                    view: number,
                    tag,
                    corner,
                    seen: Vector2::from(*seen),
                    is_kept: true,
                }));
            }
        }
        Bundle { rig, corners, views, sizes, freedom, noise_px: 1.0 }
    }

    /// Adjusts until noise and weights settle; then leaves out corners that are far off, and adjusts without weights.
    pub(crate) fn adjust(&mut self) {
        for _ in 0..NOISE_ROUNDS {
            let squares: Vec<f64> = (0..self.corners.len()).map(|n| self.residual(n).norm_squared()).collect();
            let before = self.noise_px;
            self.noise_px = self.median_noise(&squares);
            let bound = (CAUCHY_NOISES * self.noise_px).powi(2);
            let weights: Vec<f64> = squares.iter().map(|square| 1.0 / (1.0 + square / bound)).collect();
            self.descend(&weights);
            if (before / self.noise_px - 1.0).abs() < 0.01 {
                break;
            }
        }
        for _ in 0..2 {
            let squares: Vec<f64> = (0..self.corners.len()).map(|n| self.residual(n).norm_squared()).collect();
            let bound = (OUTLIER_NOISES * self.median_noise(&squares)).powi(2);
            self.corners.iter_mut().zip(&squares).for_each(|(corner, square)| corner.is_kept = *square <= bound);
            let weights: Vec<f64> = self.corners.iter().map(|corner| f64::from(u8::from(corner.is_kept))).collect();
            self.descend(&weights);
            let left: f64 = (0..self.corners.len()).map(|n| weights[n] * self.residual(n).norm_squared()).sum();
            let freedom = (2.0 * weights.iter().sum::<f64>() - self.unknowns() as f64).max(1.0);
            self.noise_px = (left / freedom).sqrt().max(LEAST_NOISE_PX);
        }
    }

    /// Noise along an axis by the median of distances, which for normal noise is 1.177 of it.
    fn median_noise(&self, squares: &[f64]) -> f64 {
        let mut sorted = squares.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        let median = sorted.get(sorted.len() / 2).copied().unwrap_or_default();
        (median.sqrt() / 1.177).max(LEAST_NOISE_PX)
    }

    /// Steps with fixed weights and noise until they gain no more.
    fn descend(&mut self, weights: &[f64]) {
        let mut damping = FIRST_DAMPING;
        let mut cost = self.cost(weights);
        for _ in 0..MOST_STEPS {
            let (hessian, gradient) = self.normal_equations(weights);
            let Some(step) = damped_step(&hessian, &gradient, |own| damping * own + 1e-12) else {
                damping *= DAMPING_FACTOR;
                continue;
            };
            let there = self.rig.clone();
            self.move_by(&step);
            let new = self.cost(weights);
            if new < cost {
                let gain = (cost - new) / cost;
                (cost, damping) = (new, (damping / DAMPING_FACTOR).max(1e-9));
                if gain < CONVERGED_GAIN {
                    break;
                }
            } else {
                self.rig = there;
                damping *= DAMPING_FACTOR;
                if damping >= 1e9 {
                    break;
                }
            }
        }
    }

    /// Seen minus predicted [pixels].
    pub(crate) fn residual(&self, n: usize) -> Vector2<f64> {
        let corner = &self.corners[n];
        let view = &self.views[corner.view];
        let (camera, board) = (&self.rig.world_from_camera[view.camera], &self.rig.world_from_board[view.moment]);
        let place = camera.inverse() * (board * self.rig.corners(corner.tag)[corner.corner]);
        // Behind the camera: far off, whatever the direction.
        self.rig.lenses[view.camera].project(&place.coords).map_or(Vector2::repeat(1e3), |pixel| corner.seen - pixel)
    }

    fn cost(&self, weights: &[f64]) -> f64 {
        let own = |(n, weight): (usize, &f64)| weight * self.residual(n).norm_squared();
        let seen: f64 = weights.iter().enumerate().map(own).sum();
        let known: f64 = self.priors().into_iter().map(|(_, off, sd)| (off / sd).powi(2)).sum();
        seen / (self.noise_px * self.noise_px) + known
    }

    /// J^T J and J^T r of all residuals with the signs of predicted minus seen, shapes [n, n] and [n].
    fn normal_equations(&self, weights: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
        let count = self.unknowns();
        let (mut hessian, mut gradient) = (DMatrix::zeros(count, count), DVector::zeros(count));
        for (n, weight) in weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0) {
            let Some((residual, columns)) = self.row(n) else { continue };
            let share = weight / (self.noise_px * self.noise_px);
            for (i, a) in &columns {
                gradient[*i] -= share * a.dot(&residual);
                for (j, b) in &columns {
                    hessian[(*i, *j)] += share * a.dot(b);
                }
            }
        }
        for (unknown, off, sd) in self.priors() {
            hessian[(unknown, unknown)] += 1.0 / (sd * sd);
            gradient[unknown] += off / (sd * sd);
        }
        (hessian, gradient)
    }

    /// Standard deviations of the unknowns, from the inverse of the normal matrix, shape [n, n].
    pub(crate) fn covariance(&self) -> Option<DMatrix<f64>> {
        let weights: Vec<f64> = self.corners.iter().map(|corner| f64::from(u8::from(corner.is_kept))).collect();
        let mut hessian = self.normal_equations(&weights).0;
        // A board that no corner is left of has no place.
        (0..hessian.nrows()).for_each(|i| hessian[(i, i)] += 1e-9);
        hessian.cholesky().map(|factor| factor.inverse())
    }

    /// Where the unknowns of a lens begin.
    pub(crate) fn lens_at(&self, camera: usize) -> Option<usize> {
        self.freedom.lenses.then(|| camera * (LENS_UNKNOWNS + 6) + 6)
    }

    /// Where the turn and then the centre of a camera begin.
    pub(crate) fn camera_at(&self, camera: usize) -> usize {
        camera * (6 + if self.freedom.lenses { LENS_UNKNOWNS } else { 0 })
    }

    fn board_at(&self, moment: usize) -> Option<usize> {
        let first = self.camera_at(self.sizes.len());
        let reference = self.freedom.reference;
        (moment != reference).then(|| first + 6 * (moment - usize::from(moment > reference)))
    }

    /// Where the place and turn of a page begin; the first page is the board's frame.
    fn sheet_at(&self, sheet: usize) -> Option<usize> {
        let first = self.camera_at(self.sizes.len()) + 6 * (self.rig.world_from_board.len() - 1);
        (sheet > 0).then(|| first + 3 * (sheet - 1))
    }

    fn unknowns(&self) -> usize {
        let (moments, sheets) = (self.rig.world_from_board.len() - 1, self.rig.sheets.len().saturating_sub(1));
        self.camera_at(self.sizes.len()) + 6 * moments + 3 * sheets
    }

    /// Unknown, its distance from what is expected, and the standard deviation of that.
    fn priors(&self) -> Vec<(usize, f64, f64)> {
        let mut priors = Vec::new();
        for (camera, (lens, size)) in self.rig.lenses.iter().zip(self.sizes).enumerate() {
            let Some(first) = self.lens_at(camera) else { continue };
            let [width, height] = size.map(|n| n as f64);
            let expected = [width.ln(), self.freedom.pixel_aspect.ln(), width / 2.0, height / 2.0, 0.0, 0.0, 0.0, 0.0];
            let middle = PRINCIPAL_SD_WIDTHS * width;
            let views = self.views.iter().filter(|view| view.camera == camera).count();
            let [k2, p] = if views < MANY_VIEWS { [UNTOLD_SD; 2] } else { [K2_SD, TANGENTIAL_SD] };
            let sds = [FOCAL_SD, ASPECT_SD, middle, middle, K1_SD, k2, p, p];
            priors.extend((0..LENS_UNKNOWNS).map(|k| (first + k, lens.unknowns[k] - expected[k], sds[k])));
        }
        priors
    }

    /// A residual and the derivatives of the predicted pixel; `None` behind the camera.
    ///
    /// With q = B p the corner in the world and c = R (q - o) in the camera, for small turns w from the left:
    /// dc = w x c for R, -R do for o, R (w x (q - t)) and R dt for B, and R B dp for the page.
    fn row(&self, n: usize) -> Option<Row> {
        let Corner { view, tag, corner, seen, .. } = self.corners[n];
        let View { camera, moment, .. } = self.views[view];
        let (place, board) = (&self.rig.world_from_camera[camera], &self.rig.world_from_board[moment]);
        let on_board = self.rig.corners(tag)[corner];
        let in_world = board * on_board;
        let in_camera = place.inverse() * in_world;
        let (pixel, by_point, by_lens) = self.rig.lenses[camera].project_with_derivatives(&in_camera.coords)?;
        let by_world: Matrix2x3<f64> = by_point * place.rotation.inverse().to_rotation_matrix().matrix();
        let mut columns = Vec::with_capacity(23);
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let first = self.camera_at(camera);
        for (k, axis) in axes.iter().enumerate() {
            columns.push((first + k, by_point * axis.cross(&in_camera.coords)));
            columns.push((first + 3 + k, -by_world.column(k)));
        }
        if let Some(first) = self.lens_at(camera) {
            columns.extend((0..LENS_UNKNOWNS).map(|k| (first + k, by_lens.column(k).into())));
        }
        if let Some(first) = self.board_at(moment) {
            let arm = in_world.coords - board.translation.vector;
            for (k, axis) in axes.iter().enumerate() {
                columns.push((first + k, by_world * axis.cross(&arm)));
                columns.push((first + 3 + k, by_world.column(k).into()));
            }
        }
        let sheet = self.rig.tags[tag].0;
        if let Some(first) = self.sheet_at(sheet) {
            let [x, y] = self.rig.sheets[sheet].shift;
            let arm = on_board - Point3::new(x, y, 0.0);
            let moves = [Vector3::x(), Vector3::y(), Vector3::z().cross(&arm)];
            columns.extend((0..3).map(|k| (first + k, by_world * (board.rotation * moves[k]))));
        }
        Some((seen - pixel, columns))
    }

    fn move_by(&mut self, step: &DVector<f64>) {
        let vector = |first: usize| Vector3::new(step[first], step[first + 1], step[first + 2]);
        for camera in 0..self.sizes.len() {
            let first = self.camera_at(camera);
            let place = &mut self.rig.world_from_camera[camera];
            place.rotation *= UnitQuaternion::from_scaled_axis(-vector(first));
            place.translation.vector += vector(first + 3);
            if let Some(first) = self.lens_at(camera) {
                let unknowns = &mut self.rig.lenses[camera].unknowns;
                unknowns.iter_mut().enumerate().for_each(|(k, value)| *value += step[first + k]);
            }
        }
        for moment in 0..self.rig.world_from_board.len() {
            if let Some(first) = self.board_at(moment) {
                let board = &mut self.rig.world_from_board[moment];
                board.rotation = UnitQuaternion::from_scaled_axis(vector(first)) * board.rotation;
                board.translation.vector += vector(first + 3);
            }
        }
        for sheet in 0..self.rig.sheets.len() {
            if let Some(first) = self.sheet_at(sheet) {
                let place = &mut self.rig.sheets[sheet];
                (0..2).for_each(|axis| place.shift[axis] += step[first + axis]);
                place.angle += step[first + 2];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;

    use super::*;
    use crate::board::Board;
    use crate::detect::Sighting;
    use crate::lens::Lens;
    use crate::rig::SheetPlace;

    const SIZES: [[usize; 2]; 2] = [[640, 480], [640, 480]];

    /// Two cameras that see two pages at two moments, tags shifted by up to `off` pixels.
    fn scene(off: f64, distortion: [f64; 4]) -> (Rig, Vec<View>) {
        let board: Board = "sheets:2x2,gap=0.5".parse().unwrap();
        let camera = |x: f64| Isometry3::new(Vector3::new(x, 0.05, 0.5), Vector3::new(2.9, 0.3 * x, 0.2));
        let sheets = vec![
            SheetPlace { number: 0, shift: [0.0; 2], angle: 0.0 },
            SheetPlace { number: 1, shift: [0.1, 0.05], angle: 0.4 },
        ];
        let lens = |f: f64| Lens::new([f, f], [321.0, 239.0], distortion);
        let tags = Rig::tags_of(&board, &sheets, 0.03);
        let moved = Isometry3::new(Vector3::new(0.02, -0.03, 0.05), Vector3::new(0.2, -0.1, 0.3));
        let rig = Rig {
            lenses: vec![lens(500.0), lens(520.0)],
            world_from_camera: vec![camera(-0.1), camera(0.15)],
            world_from_board: vec![moved, Isometry3::identity()],
            sheets,
            tags,
            side_m: 0.03,
        };
        let mut views = Vec::new();
        for (camera, moment) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let sighting = |tag: usize| {
                let shift = off * (1.7 * tag as f64 + camera as f64).sin();
                let corners = rig.predict(camera, moment, tag)?.map(|[u, v]| [u + shift, v - shift]);
                Some(Sighting { id: rig.tags[tag].1.id, corners, border: 1 })
            };
            views.push(View { camera, moment, tags: (0..rig.tags.len()).filter_map(sighting).collect() });
        }
        assert!(views.iter().all(|view| view.tags.len() == 8), "all tags are seen");
        (rig, views)
    }

    fn freedom() -> Freedom {
        Freedom { lenses: true, reference: 1, pixel_aspect: 1.0 }
    }

    #[test]
    fn derivatives_of_all_unknowns_are_those_of_differences() {
        let (rig, views) = scene(0.3, [-0.1, 0.02, 0.001, 0.0]);
        let bundle = Bundle::new(rig.clone(), &views, &SIZES, freedom());
        let (count, h) = (bundle.unknowns(), 1e-6);
        assert_eq!(count, 2 * 14 + 6 + 3);
        let moved = |k: usize, by: f64| {
            let mut step = DVector::zeros(count);
            step[k] = by;
            let mut bundle = Bundle::new(rig.clone(), &views, &SIZES, freedom());
            bundle.move_by(&step);
            bundle
        };
        let mut told = vec![false; count];
        for k in 0..count {
            let (up, down) = (moved(k, h), moved(k, -h));
            for n in 0..bundle.corners.len() {
                // The residual falls where the prediction rises.
                let difference = (down.residual(n) - up.residual(n)) / (2.0 * h);
                let (_, columns) = bundle.row(n).unwrap();
                let own = columns.iter().find(|(i, _)| *i == k).map_or(Vector2::zeros(), |(_, column)| *column);
                assert!((difference - own).norm() < 1e-5 * (1.0 + own.norm()), "unknown {k}: {difference} {own}");
                told[k] |= own.norm() > 0.0;
            }
        }
        assert!(told.iter().all(|told| *told));
    }

    #[test]
    fn the_adjustment_finds_back_and_leaves_out_a_wrong_corner() {
        let (rig, mut views) = scene(0.0, [-0.1, 0.0, 0.0, 0.0]);
        views[2].tags[3].corners[1][0] += 8.0;
        let mut start = rig.clone();
        start.world_from_camera[1].translation.vector.x += 0.02;
        start.sheets[1].shift[0] += 0.005;
        start.lenses[0].unknowns[0] += 0.05;
        let mut bundle = Bundle::new(start, &views, &SIZES, freedom());
        bundle.adjust();
        let off =
            (bundle.rig.world_from_camera[1].translation.vector - rig.world_from_camera[1].translation.vector).norm();
        // The priors hold what is not noise here: distortion is zero to them.
        assert!(off < 1e-3, "{off} m");
        assert!((bundle.rig.lenses[0].unknowns[0] - rig.lenses[0].unknowns[0]).abs() < 5e-3);
        assert_eq!(bundle.corners.iter().filter(|corner| !corner.is_kept).count(), 1);
        assert!(bundle.covariance().is_some_and(|all| all.diagonal().iter().all(|variance| *variance > 0.0)));
    }
}
