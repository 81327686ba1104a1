//! Simulated against extracted surfaces: signed point-to-plane distances in both directions (a smooth form of paper eq.
//! 8's chamfer).
//!
//! The chamfer distance has a kink at zero and a bias: particles lie half a spacing inside the surface that the
//! pictures show. The residuals used by Gauss-Newton are therefore signed, and measured relative to the distance at
//! time 0.

use gic_geometry::Neighbours;
use glam::DVec3;

use crate::forward::surface_membership::{faded, memberships};
use crate::forward::trajectories::Trajectories;
use crate::observe::extracted_surface::{ObservedSurface, directed, shares, signed_distance};
use crate::solve::residual_block::{Modality, ResidualBlock};
use crate::tuning::SurfaceTuning;
use crate::{Input, Tuning};

/// What comparing surfaces needs besides the surfaces.
#[derive(Clone, Debug)]
pub(crate) struct SurfaceComparison {
    /// Points within `margin` of an obstacle are in contact and do not count (as the release does for the ground).
    colliders: Vec<gic_mpm::Collider>,
    margin: f64,
    tuning: SurfaceTuning,
    /// Beyond this the nearest particle, not the plane through it, is what pulls an extracted point, and a distance at
    /// the first frame is no offset [m].
    plane_reach: f64,
    /// Radius within which a particle's neighbours decide whether it is on the surface [m].
    radius: f64,
    /// Share of the particles that take part. Always the same ones do: a choice that depended on the hypothesis would
    /// change the cost by more than what is looked for.
    sampled: f64,
    /// Signed distance of each particle from the first extracted surface, outward positive [m]; NaN for inner
    /// particles.
    rest_offsets: Vec<f64>,
    /// Their median [m].
    median_rest_offset: f64,
    /// Residuals beyond this count linearly [m].
    knee: f64,
}

impl SurfaceComparison {
    /// Calibrates the offset between particles and extracted surface on the first frame.
    pub(crate) fn new(input: &Input, first: Option<&ObservedSurface>, tuning: &Tuning) -> SurfaceComparison {
        let tuning = tuning.surfaces.clone();
        let mut comparison = SurfaceComparison {
            colliders: input.colliders.clone(),
            margin: tuning.contact_margin_cells * input.grid_spacing_m,
            plane_reach: tuning.plane_radius_cells * input.grid_spacing_m,
            radius: tuning.neighbourhood_spacings * input.particle_volume_m3.cbrt(),
            sampled: 1.0,
            rest_offsets: vec![f64::NAN; input.positions.len()],
            median_rest_offset: 0.0,
            knee: tuning.huber_knee_cells * input.grid_spacing_m,
            tuning,
        };
        let positions: Vec<[f32; 3]> = input.positions.iter().map(|p| p.as_vec3().to_array()).collect();
        let memberships = memberships(&positions, comparison.radius, &comparison.tuning);
        let count = memberships.iter().filter(|membership| membership.is_surface()).count();
        comparison.sampled = comparison.sampled_share(count);
        let Some(first) = first else { return comparison };
        let mut known = Vec::new();
        for (i, membership) in memberships.iter().enumerate().filter(|(_, membership)| membership.is_surface()) {
            let (distance, normal, _) = signed_distance(first, input.positions[i], membership.outward);
            if distance.abs() < comparison.plane_reach && normal.is_finite() {
                comparison.rest_offsets[i] = distance;
                known.push(distance);
            }
        }
        known.sort_by(f64::total_cmp);
        comparison.median_rest_offset = known.get(known.len() / 2).copied().unwrap_or(0.0);
        comparison
    }

    pub(crate) fn margin(&self) -> f64 {
        self.margin
    }

    /// Indices of the particles on the surface that touch nothing.
    pub(crate) fn surface_particles(&self, positions: &[[f32; 3]], time: f64) -> Vec<usize> {
        let memberships = memberships(positions, self.radius, &self.tuning);
        (0..positions.len())
            .filter(|i| memberships[*i].is_surface() && !self.in_contact(point(positions[*i]), time))
            .collect()
    }

    /// Distance at which particle `i` belongs when the hypothesis is right.
    fn rest_offset(&self, i: usize) -> f64 {
        if self.rest_offsets[i].is_nan() { self.median_rest_offset } else { self.rest_offsets[i] }
    }

    /// The same for motions of only the particles `ids`, `factor` times as far apart.
    pub(crate) fn thinned(&self, ids: &[usize], factor: f64) -> SurfaceComparison {
        let rest_offsets: Vec<f64> = ids.iter().map(|i| self.rest_offsets[*i]).collect();
        let sampled = self.sampled_share(rest_offsets.iter().filter(|distance| distance.is_finite()).count());
        SurfaceComparison { rest_offsets, sampled, radius: factor * self.radius, ..self.clone() }
    }

    /// Whether a point is so near to an obstacle that it does not count.
    pub(crate) fn in_contact(&self, p: DVec3, time: f64) -> bool {
        self.clear_share(p, time) < 0.5
    }

    /// How far a point is clear of all obstacles: 0 in contact, 1 out of it, one half at the margin.
    fn clear_share(&self, p: DVec3, time: f64) -> f64 {
        let nearest = self.colliders.iter().map(|c| c.signed_distance(p, time)).fold(f64::INFINITY, f64::min);
        faded(nearest, self.margin, self.tuning.fade)
    }

    /// Share of `count` points that makes about as many as take part at most.
    fn sampled_share(&self, count: usize) -> f64 {
        (self.tuning.most_points as f64 / count.max(1) as f64).min(1.0)
    }

    /// Whether a particle is one of those that take part: spread evenly over their numbers, whatever the order these
    /// follow.
    fn takes_part(&self, i: usize) -> bool {
        const GOLDEN: f64 = 0.618_033_988_749_894_9;
        (i as f64 * GOLDEN).fract() < self.sampled
    }

    /// Normal equations of one frame; correspondences are those of the base motion.
    pub(crate) fn block(
        &self,
        (o, time): (usize, f64),
        observed: &ObservedSurface,
        trajectories: &Trajectories,
        perturbed: &[&Trajectories],
        steps: &[f64],
    ) -> ResidualBlock {
        let frame = FrameResiduals { comparison: self, o, trajectories, perturbed, steps };
        let base: Vec<DVec3> = trajectories.positions[o].iter().map(|p| point(*p)).collect();
        let memberships = memberships(&trajectories.positions[o], self.radius, &self.tuning);
        let mut block = ResidualBlock::new(Modality::Surface, o, None, steps.len());
        let surface: Vec<usize> = (0..base.len()).filter(|i| memberships[*i].share > 0.0).collect();
        for &i in surface.iter().filter(|i| self.takes_part(**i)) {
            let weight = memberships[i].share * self.clear_share(base[i], time);
            if weight > 0.0 {
                let (distance, normal, confidence) = signed_distance(observed, base[i], memberships[i].outward);
                frame.add(&mut block, &[(i, 1.0)], normal, distance, weight * confidence);
            }
        }
        let simulated: Vec<DVec3> = surface.iter().map(|i| base[*i]).collect();
        let tree = Neighbours::new(&simulated, self.margin);
        let stride = observed.points.len().div_ceil(self.tuning.most_points).max(1);
        for k in (0..observed.points.len()).step_by(stride) {
            let (y, n) = (observed.points[k], observed.normals[k]);
            let weight = self.clear_share(y, time) * observed.confidences[k];
            if weight > 0.0 && !surface.is_empty() {
                let near = shares(tree.nearest(y), |k| memberships[surface[k]].share);
                let particles: Vec<(usize, f64)> = near.iter().map(|(k, share)| (surface[*k], *share)).collect();
                let mean = |of: &dyn Fn(usize) -> DVec3| particles.iter().map(|(i, share)| *share * of(*i)).sum();
                let (place, outward): (DVec3, DVec3) = (mean(&|i| base[i]), mean(&|i| memberships[i].outward));
                let (distance, normal) = directed(place - y, n, outward, self.plane_reach);
                frame.add(&mut block, &particles, normal, distance, weight);
            }
        }
        block.finish()
    }
}

/// What the residuals of one frame are made of.
struct FrameResiduals<'a> {
    comparison: &'a SurfaceComparison,
    /// Index of the observation.
    o: usize,
    trajectories: &'a Trajectories,
    perturbed: &'a [&'a Trajectories],
    steps: &'a [f64],
}

impl FrameResiduals<'_> {
    /// Adds the distance of some particles, with shares that sum to one, from the surface along `normal`, relative to
    /// where they belong.
    ///
    /// Huber's loss, `weight` times: quadratic up to the knee, linear beyond.
    fn add(&self, block: &mut ResidualBlock, particles: &[(usize, f64)], normal: DVec3, distance: f64, weight: f64) {
        if weight == 0.0 {
            return;
        }
        let outward_displacement = |trajectories: &Trajectories, i: usize| {
            trajectories.outward_displacements.get(i).map_or(0.0, |s| f64::from(*s))
        };
        let mut row = vec![0.0; self.steps.len()];
        let mut residual = distance;
        for &(i, share) in particles {
            let (p, own) = (point(self.trajectories.positions[self.o][i]), outward_displacement(self.trajectories, i));
            residual -= share * (self.comparison.rest_offset(i) + own);
            for ((slot, moved), step) in row.iter_mut().zip(self.perturbed).zip(self.steps) {
                let way = normal.dot(point(moved.positions[self.o][i]) - p) - (outward_displacement(moved, i) - own);
                *slot += share * way / step;
            }
        }
        let (size, knee) = (residual.abs(), self.comparison.knee);
        block.add(residual, &row, weight * (knee / size.max(knee)).min(1.0));
        // `ResidualBlock::add` counts weight r^2 / 2; Huber's cost beyond the knee is knee (|r| - knee / 2).
        if size > knee {
            block.cost += weight * 0.5 * knee * (size - knee);
        }
    }
}

fn point(p: [f32; 3]) -> DVec3 {
    glam::Vec3::from_array(p).as_dvec3()
}

#[cfg(test)]
mod tests {
    use gic_mpm::{Collider, Contact};

    use super::*;
    use crate::forward::drawing::Drawing;

    /// Particles of a block, 10 mm apart, 20 x 16 x 12, whose lowest are 5 mm above the plane y = 0.
    fn block() -> Vec<DVec3> {
        let place = |i: usize| DVec3::new((i % 20) as f64, (i / 20 % 16) as f64 + 0.5, (i / 320) as f64);
        (0..20 * 16 * 12).map(|i| 0.01 * place(i)).collect()
    }

    fn single(points: &[DVec3]) -> Vec<[f32; 3]> {
        points.iter().map(|p| p.as_vec3().to_array()).collect()
    }

    /// Surface particles of the block moved out by 5 mm: what pictures would show of it.
    fn shown(positions: &[DVec3]) -> Vec<DVec3> {
        let memberships = memberships(&single(positions), 0.022, &SurfaceTuning::default());
        positions.iter().zip(memberships).filter(|(_, f)| f.is_surface()).map(|(p, f)| *p + 0.005 * f.outward).collect()
    }

    fn comparison_of(particles: usize) -> SurfaceComparison {
        SurfaceComparison {
            colliders: vec![Collider::plane(DVec3::ZERO, DVec3::Y, Contact::Sticky)],
            margin: 0.02,
            plane_reach: 0.02,
            radius: 0.022,
            tuning: SurfaceTuning::default(),
            sampled: 0.5,
            rest_offsets: vec![-0.005; particles],
            median_rest_offset: -0.005,
            knee: 0.01,
        }
    }

    fn trajectories(positions: &[DVec3]) -> Trajectories {
        let n = positions.len();
        Trajectories {
            positions: vec![single(positions)],
            scales: vec![vec![0.005; n]],
            velocities: vec![],
            drawing: Drawing::of_factor(1.0),
            outward_displacements: vec![],
        }
    }

    #[test]
    fn the_cost_has_no_steps() {
        let rest = block();
        let observed = ObservedSurface::new(&shown(&rest), 0.02, &SurfaceTuning::default());
        let comparison = comparison_of(rest.len());
        // Sheared, stretched and shifted more and more: particles pass one another's nearest points and the margin of
        // the plane.
        let cost = |k: usize| {
            let t = 1e-4 * k as f64;
            let bent = |p: &DVec3| *p + t * DVec3::new(1.0 + 10.0 * p.y, 0.7 + 8.0 * p.x, 0.4 - 9.0 * p.z);
            let moved: Vec<DVec3> = rest.iter().map(bent).collect();
            comparison.block((0, 0.0), &observed, &trajectories(&moved), &[], &[]).cost
        };
        let costs: Vec<f64> = (0..60).map(cost).collect();
        let range = costs.iter().copied().fold(0.0, f64::max);
        let bends = costs.windows(3).map(|c| (c[0] - 2.0 * c[1] + c[2]).abs() / range);
        let worst = bends.fold(0.0, f64::max);
        assert!(worst < 2e-3, "{worst}: {costs:?}");
    }

    #[test]
    fn what_no_view_sees_does_not_count() {
        let (rest, shown) = (block(), shown(&block()));
        let moved = trajectories(&rest.iter().map(|p| *p + DVec3::new(0.003, 0.002, -0.001)).collect::<Vec<_>>());
        let cost = |doubts: Vec<f32>| {
            let mut observed = ObservedSurface::new(&shown, 0.02, &SurfaceTuning::default());
            observed.discount_doubtful(&doubts);
            comparison_of(rest.len()).block((0, 0.0), &observed, &moved, &[], &[]).cost
        };
        let below = |p: &DVec3| f32::from(u8::from(p.y < 0.08));
        let (all, half) = (cost(Vec::new()), cost(shown.iter().map(below).collect()));
        assert!(half > 0.3 * all && half < 0.7 * all, "{half} of {all}");
        assert_eq!(cost(vec![1.0; shown.len()]), 0.0);
        assert_eq!(cost(vec![0.0; shown.len()]), all);
    }

    #[test]
    fn the_gradient_is_that_of_the_cost() {
        let rest = block();
        let observed = ObservedSurface::new(&shown(&rest), 0.02, &SurfaceTuning::default());
        let comparison = comparison_of(rest.len());
        let at = |t: f64| trajectories(&rest.iter().map(|p| *p + DVec3::new(0.002, t, -0.001)).collect::<Vec<_>>());
        let step = 1e-4;
        let block = |t: f64| comparison.block((0, 0.0), &observed, &at(t), &[&at(t + step)], &[step]);
        for t in [-0.004, 0.002, 0.006] {
            let difference = (block(t + step).cost - block(t - step).cost) / (2.0 * step);
            let found = block(t).gradient[0];
            assert!((found / difference - 1.0).abs() < 0.1, "{t}: {found} instead of {difference}");
        }
    }
}
