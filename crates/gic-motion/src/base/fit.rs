//! Adam on the base motion's poses.

use gic_optimize::Moments;

use crate::base::{BaseMotion, Lattice, PoseGradient};
use crate::gaussians::smoothing::NeighbourGraph;
use crate::tuning::LATTICE_SMOOTHING_CELLS;

/// Adam's state of one pose.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PoseMoments {
    /// Of the map's twelve numbers, the shift counted in widths of the object.
    pub(crate) map: Moments,
    pub(crate) map_steps: usize,
    /// Of the bend.
    pub(crate) bend: Moments,
    pub(crate) bend_steps: usize,
    pub(crate) shade: Moments,
    pub(crate) shade_steps: usize,
}

/// What of a pose is fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Freedom {
    /// The affine map alone.
    Map,
    /// The bend as well.
    MapAndBend,
}

/// A base motion while it is trained.
#[derive(Clone, Debug)]
pub(crate) struct BaseFit {
    pub(crate) motion: BaseMotion,
    pub(crate) fits: Vec<PoseMoments>,
    /// The first so many frames look as the canonical Gaussians do when they are only mapped.
    pub(crate) explained: usize,
    nodes: NeighbourGraph,
}

impl PoseMoments {
    pub(crate) fn new(lattice: &Lattice) -> PoseMoments {
        let field = Moments::zeros(3 * lattice.nodes());
        PoseMoments {
            map: Moments::zeros(12),
            map_steps: 0,
            bend: field.clone(),
            bend_steps: 0,
            shade: field,
            shade_steps: 0,
        }
    }
}

impl BaseFit {
    pub(crate) fn new(motion: BaseMotion, fits: Vec<PoseMoments>, explained: usize) -> BaseFit {
        let nodes = NeighbourGraph::new(&motion.lattice.positions(), motion.lattice.cell);
        BaseFit { motion, fits, explained, nodes }
    }

    /// Adds a frame that starts from the pose to which the last two lead, shifted to where its pictures show it [m].
    pub(crate) fn push(&mut self, shift: glam::DVec3) {
        let last = self.motion.pose(self.motion.maps.len() - 1);
        let before = self.motion.pose(self.motion.maps.len().saturating_sub(2));
        self.motion.maps.push(last.map.extrapolated(&before.map, shift));
        self.motion.bends.push(last.bend);
        self.motion.shades.push(last.shade);
        self.fits.push(PoseMoments::new(&self.motion.lattice));
    }

    /// One step of the pose of `frame` down `slope`; the object is `size` metres wide, which is what one unit of the
    /// rate stands for. While there are only maps, the first frame's stays: the canonical Gaussians are what is seen
    /// there. Once everything bends, no frame is better than another, and the canonical Gaussians need not serve the
    /// first at the others' cost.
    pub(crate) fn update(&mut self, frame: usize, mut slope: PoseGradient, freedom: Freedom, (rate, size): (f64, f64)) {
        if frame == 0 && freedom == Freedom::Map {
            return;
        }
        let fit = &mut self.fits[frame];
        let map = &mut self.motion.maps[frame];
        // Per width of the object, times that width, which Adam does not notice.
        let gradient: Vec<f32> =
            slope.map.matrix.iter().map(|g| g / size).chain(slope.map.shift).map(|g| g as f32).collect();
        // Rounded to f32 are only the steps, not the map.
        let mut step = vec![0.0f32; 12];
        fit.map_steps += 1;
        fit.map.update(&mut step, &gradient, rate, fit.map_steps);
        map.matrix.iter_mut().zip(&step[..9]).for_each(|(m, s)| *m += f64::from(*s));
        map.shift.iter_mut().zip(&step[9..]).for_each(|(m, s)| *m += f64::from(*s) * size);
        if freedom == Freedom::MapAndBend {
            self.nodes.smooth(LATTICE_SMOOTHING_CELLS, &mut slope.bend);
            let bend = self.motion.bends[frame].as_flattened_mut();
            fit.bend_steps += 1;
            fit.bend.update_alike(bend, slope.bend.as_flattened(), rate * size, fit.bend_steps);
        }
    }

    /// One step of the shade of `frame` down `slope`.
    pub(crate) fn update_shade(&mut self, frame: usize, mut slope: Vec<[f32; 3]>, rate: f64) {
        let fit = &mut self.fits[frame];
        self.nodes.smooth(LATTICE_SMOOTHING_CELLS, &mut slope);
        fit.shade_steps += 1;
        let shade = self.motion.shades[frame].as_flattened_mut();
        fit.shade.update_alike(shade, slope.as_flattened(), rate, fit.shade_steps);
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::Affine;
    use crate::base::Pose;
    use gic_optimize::decayed;

    fn points() -> Vec<[f32; 3]> {
        (0..200).map(|i| core::array::from_fn(|k| ((i * (3 + k)) as f32 * 0.7 + k as f32).sin() * 0.2)).collect()
    }

    /// The largest distance [m] to `truth` after some steps of a fit to it.
    fn fitted(truth: &dyn Fn([f32; 3]) -> [f32; 3], freedom: Freedom) -> f32 {
        let points = points();
        let motion = BaseMotion::still(DVec3::new(0.02, 0.0, 0.01), vec![0.0, 1.0], Lattice::around(&points));
        let first = PoseMoments::new(&motion.lattice);
        let mut base = BaseFit::new(motion, vec![first], 1);
        base.push(DVec3::ZERO);
        let moved =
            |base: &BaseFit, pose: &Pose| points.iter().map(|&x| base.motion.moved(pose, x)).collect::<Vec<_>>();
        for step in 0..400 {
            let pose = base.motion.pose(1);
            let difference = |(is, &x): (&[f32; 3], &[f32; 3])| {
                let should = truth(x);
                [is[0] - should[0], is[1] - should[1], is[2] - should[2], 0.0]
            };
            let slope: Vec<[f32; 4]> = moved(&base, &pose).iter().zip(&points).map(difference).collect();
            let slope = base.motion.pull_back(&pose, &points, &slope, &mut vec![[0.0; 3]; points.len()]);
            base.update(1, slope, freedom, (decayed((1.5e-2, 1.5e-4), step as f64 / 400.0), 0.4));
        }
        let end = moved(&base, &base.motion.pose(1));
        let errors = end.iter().zip(&points).flat_map(|(is, &x)| {
            let should = truth(x);
            (0..3).map(move |k| (is[k] - should[k]).abs())
        });
        errors.fold(0.0, f32::max)
    }

    #[test]
    fn finds_a_map_and_a_bend() {
        let matrix = DMat3::from_rotation_y(0.2) * DMat3::from_diagonal(DVec3::new(1.1, 0.9, 1.0));
        let turned = |x: [f32; 3]| {
            let x = DVec3::from_array(x.map(f64::from));
            (matrix * x + DVec3::new(0.03, -0.05, 0.01)).as_vec3().to_array()
        };
        let bent = |x: [f32; 3]| {
            let [a, b, c] = turned(x);
            [a, b + 0.02 * (12.0 * x[0]).sin(), c]
        };
        let (map, map_of_bent) = (fitted(&turned, Freedom::Map), fitted(&bent, Freedom::Map));
        let bend = fitted(&bent, Freedom::MapAndBend);
        assert!(map < 1e-3, "{map} m");
        assert!(bend < 3e-3 && bend < 0.3 * map_of_bent, "{bend} m, {map_of_bent} m with a map alone");
    }

    #[test]
    fn the_first_frame_stays_until_everything_bends() {
        let motion = BaseMotion::still(DVec3::ZERO, vec![0.0, 1.0], Lattice::around(&points()));
        let slope = Pose {
            map: Affine { matrix: [1.0; 9], shift: [1.0; 3] },
            bend: vec![[1.0; 3]; motion.lattice.nodes()],
            shade: Vec::new(),
        };
        let still = motion.pose(0);
        let first = PoseMoments::new(&motion.lattice);
        let mut base = BaseFit::new(motion, vec![first], 1);
        base.push(DVec3::ZERO);
        for frame in 0..2 {
            base.update(frame, slope.clone(), Freedom::Map, (0.1, 1.0));
        }
        assert_eq!(base.motion.pose(0), still);
        assert!(base.motion.maps[1].shift.iter().all(|s| (s + 0.1).abs() < 1e-6));
        base.update(0, slope, Freedom::MapAndBend, (0.1, 1.0));
        assert!(base.motion.bends[0].iter().flatten().all(|s| (s + 0.1).abs() < 1e-3));
    }
}
