//! Adam on the base motion's maps.

use serde::{Deserialize, Serialize};

use crate::adam::Moments;
use crate::{Affine, BaseMotion};

/// Adam's state of one map's twelve numbers, the shift counted in widths of the object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct AffineFit {
    first: Vec<f32>,
    second: Vec<f32>,
    steps: usize,
}

/// A base motion while it is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Base {
    pub(crate) motion: BaseMotion,
    fits: Vec<AffineFit>,
    /// The first so many frames look as the canonical Gaussians do when they are only mapped.
    pub(crate) explained: usize,
}

impl AffineFit {
    pub(crate) fn new() -> AffineFit {
        AffineFit { first: vec![0.0; 12], second: vec![0.0; 12], steps: 0 }
    }

    /// One step down `slope`; the object is `size` metres wide, which is what one unit of the rate stands for.
    pub(crate) fn update(&mut self, map: &mut Affine, slope: &Affine, rate: f64, size: f64) {
        // Per width of the object, times that width, which Adam does not notice.
        let gradient: Vec<f32> = slope.matrix.iter().map(|g| g / size).chain(slope.shift).map(|g| g as f32).collect();
        // Rounded to f32 are only the steps, not the map.
        let mut step = vec![0.0f32; 12];
        let mut moments = Moments { first: self.first.clone(), second: self.second.clone() };
        self.steps += 1;
        moments.update(&mut step, &gradient, rate, self.steps);
        (self.first, self.second) = (moments.first, moments.second);
        map.matrix.iter_mut().zip(&step[..9]).for_each(|(m, s)| *m += f64::from(*s));
        map.shift.iter_mut().zip(&step[9..]).for_each(|(m, s)| *m += f64::from(*s) * size);
    }
}

impl Base {
    pub(crate) fn new(motion: BaseMotion, explained: usize) -> Base {
        let fits = vec![AffineFit::new(); motion.maps.len()];
        Base { motion, fits, explained }
    }

    /// One step of the map of `frame`; the first frame's stays, because the canonical Gaussians are what is seen there.
    pub(crate) fn update(&mut self, frame: usize, slope: &Affine, rate: f64, size: f64) {
        if frame > 0 {
            self.fits[frame].update(&mut self.motion.maps[frame], slope, rate, size);
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::adam::decayed;

    #[test]
    fn finds_the_map_between_two_clouds() {
        let points: Vec<[f32; 3]> =
            (0..60).map(|i| core::array::from_fn(|k| ((i * (3 + k)) as f32 * 0.7 + k as f32).sin() * 0.2)).collect();
        let matrix = DMat3::from_rotation_y(0.2) * DMat3::from_diagonal(DVec3::new(1.1, 0.9, 1.0));
        let truth = Affine { matrix: matrix.to_cols_array(), shift: [0.03, -0.05, 0.01] };
        let motion = BaseMotion { origin: [0.02, 0.0, 0.01], times: vec![0.0, 1.0], maps: vec![truth; 2] };
        let (mut map, mut fit) = (Affine::IDENTITY, AffineFit::new());
        for step in 0..400 {
            let slope: Vec<[f32; 4]> = points
                .iter()
                .map(|&x| {
                    let (is, should) = (motion.moved(&map, x), motion.moved(&truth, x));
                    [is[0] - should[0], is[1] - should[1], is[2] - should[2], 0.0]
                })
                .collect();
            let slope = motion.pull_back(&map, &points, &slope, &mut vec![[0.0; 3]; 60]);
            fit.update(&mut map, &slope, decayed((1.5e-2, 1.5e-3), step as f64 / 400.0), 0.4);
        }
        for &x in &points {
            let (is, should) = (motion.moved(&map, x), motion.moved(&truth, x));
            assert!((0..3).all(|k| (is[k] - should[k]).abs() < 1e-3), "{is:?} against {should:?}");
        }
    }

    #[test]
    fn the_first_frame_stays() {
        let motion = BaseMotion { origin: [0.0; 3], times: vec![0.0, 1.0], maps: vec![Affine::IDENTITY; 2] };
        let mut base = Base::new(motion, 2);
        let slope = Affine { matrix: [1.0; 9], shift: [1.0; 3] };
        base.update(0, &slope, 0.1, 1.0);
        base.update(1, &slope, 0.1, 1.0);
        assert_eq!(base.motion.maps[0], Affine::IDENTITY);
        assert!(base.motion.maps[1].shift.iter().all(|s| (s + 0.1).abs() < 1e-6));
    }
}
