//! Simulated against extracted surfaces: signed point-to-plane distances in both directions (a smooth form of paper eq. 8's chamfer).
//!
//! The chamfer distance has a kink at zero and a bias: particles lie half a spacing inside the surface that the pictures show. The
//! residuals used by Gauss-Newton are therefore signed, and measured relative to the distance at time 0.

use glam::{DMat3, DVec3};

use crate::Input;
use crate::neighbours::Neighbours;
use crate::normal::{Cluster, Modality};
use crate::objective::Motion;

/// At most this many points take part per frame and direction.
const MOST_POINTS: usize = 1500;

/// An extracted surface with normals.
#[derive(Clone, Debug)]
pub(crate) struct ObservedSurface {
    /// Points [m].
    pub points: Vec<DVec3>,
    /// Unit normals of unknown sign.
    pub normals: Vec<DVec3>,
    tree: Neighbours,
    /// Beyond this the nearest point, not the plane through it, is what pulls [m].
    far: f64,
}

impl ObservedSurface {
    /// Normals from the neighbours within `radius` [m] by principal components.
    pub(crate) fn new(points: &[DVec3], radius: f64) -> ObservedSurface {
        let tree = Neighbours::new(points, 0.5 * radius);
        let normals = points.iter().map(|p| normal(&tree, *p, 0.5 * radius)).collect();
        ObservedSurface { points: points.to_vec(), normals, tree, far: 0.75 * radius }
    }
}

/// Direction of least spread of the points around `p`.
fn normal(tree: &Neighbours, p: DVec3, radius: f64) -> DVec3 {
    let (mut count, mut mean, mut square) = (0.0, DVec3::ZERO, DMat3::ZERO);
    tree.within(p, radius, |_, _, q| {
        let d = q - p;
        count += 1.0;
        mean += d;
        square += DMat3::from_cols(d * d.x, d * d.y, d * d.z);
    });
    let mean = mean / count;
    let spread = square * (1.0 / count) - DMat3::from_cols(mean * mean.x, mean * mean.y, mean * mean.z);
    let matrix = nalgebra::Matrix3::from_column_slice(&spread.to_cols_array());
    let eigen = matrix.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let n = eigen.eigenvectors.column(least);
    DVec3::new(n[0], n[1], n[2]).normalize_or(DVec3::Y)
}

/// What comparing surfaces needs besides the surfaces.
#[derive(Clone, Debug)]
pub(crate) struct Context {
    /// Points within `margin` of an obstacle are in contact and do not count (as the release does for the ground).
    colliders: Vec<gic_mpm::Collider>,
    margin: f64,
    /// Radius within which a particle's neighbours decide whether it is on the surface [m].
    radius: f64,
    /// Signed distance of each particle from the first extracted surface, outward positive [m]; NaN for inner particles.
    rest: Vec<f64>,
    /// Median of `rest`.
    typical: f64,
    /// Residuals beyond this count linearly [m].
    knee: f64,
}

impl Context {
    /// Calibrates the offset between particles and extracted surface on the first frame.
    pub(crate) fn new(input: &Input, first: Option<&ObservedSurface>) -> Context {
        let mut context = Context {
            colliders: input.colliders.clone(),
            margin: input.grid_spacing_m,
            radius: 1.1 * input.grid_spacing_m,
            rest: vec![f64::NAN; input.positions.len()],
            typical: 0.0,
            knee: 0.5 * input.grid_spacing_m,
        };
        let Some(first) = first else { return context };
        let positions: Vec<[f32; 3]> = input.positions.iter().map(|p| p.as_vec3().to_array()).collect();
        let outward = outward(&positions, context.radius);
        let mut known = Vec::new();
        for (i, direction) in outward.iter().enumerate() {
            let Some(direction) = direction else { continue };
            let (distance, normal) = signed_distance(first, input.positions[i], *direction);
            if distance.abs() < 2.0 * context.margin && normal.is_finite() {
                context.rest[i] = distance;
                known.push(distance);
            }
        }
        known.sort_by(f64::total_cmp);
        context.typical = known.get(known.len() / 2).copied().unwrap_or(0.0);
        context
    }

    pub(crate) fn margin(&self) -> f64 {
        self.margin
    }

    /// Indices of the particles on the surface that touch nothing.
    pub(crate) fn surface_particles(&self, positions: &[[f32; 3]], time: f64) -> Vec<usize> {
        let outward = outward(positions, self.radius);
        (0..positions.len()).filter(|i| outward[*i].is_some() && !self.in_contact(point(positions[*i]), time)).collect()
    }

    /// Distance at which particle `i` belongs when the hypothesis is right.
    fn rest_of(&self, i: usize) -> f64 {
        if self.rest[i].is_nan() { self.typical } else { self.rest[i] }
    }

    /// The same for motions of only the particles `ids`, `factor` times as far apart.
    pub(crate) fn thinned(&self, ids: &[usize], factor: f64) -> Context {
        Context { rest: ids.iter().map(|i| self.rest[*i]).collect(), radius: factor * self.radius, ..self.clone() }
    }

    /// Whether a point is so near to an obstacle that it does not count.
    pub(crate) fn in_contact(&self, p: DVec3, time: f64) -> bool {
        self.colliders.iter().any(|collider| collider.signed_distance(p, time) < self.margin)
    }

    /// Normal equations of one frame; correspondences are those of the base motion.
    pub(crate) fn cluster(
        &self,
        (o, time): (usize, f64),
        observed: &ObservedSurface,
        motion: &Motion,
        perturbed: &[Motion],
        steps: &[f64],
    ) -> Cluster {
        let mut cluster = Cluster::new(Modality::Surface, o, None, steps.len());
        let swollen = |motion: &Motion, i: usize| motion.swelling.get(i).map_or(0.0, |s| f64::from(*s));
        let compared = |i: usize, normal: DVec3, distance: f64, row: &mut [f64]| {
            let (p, own) = (point(motion.positions[o][i]), swollen(motion, i));
            for ((slot, moved), step) in row.iter_mut().zip(perturbed).zip(steps) {
                *slot = (normal.dot(point(moved.positions[o][i]) - p) - (swollen(moved, i) - own)) / step;
            }
            distance - self.rest_of(i) - own
        };
        let base = &motion.positions[o];
        let outward = outward(base, self.radius);
        let surface: Vec<usize> = (0..base.len()).filter(|i| outward[*i].is_some()).collect();
        let mut row = vec![0.0; steps.len()];
        let stride = surface.len().div_ceil(MOST_POINTS).max(1);
        for &i in surface.iter().step_by(stride) {
            let p = point(base[i]);
            if self.in_contact(p, time) {
                continue;
            }
            let direction = outward[i].unwrap_or(DVec3::Y);
            let (distance, normal) = signed_distance(observed, p, direction);
            let residual = compared(i, normal, distance, &mut row);
            self.add(&mut cluster, residual, &row);
        }
        if surface.is_empty() {
            return cluster;
        }
        let simulated: Vec<DVec3> = surface.iter().map(|i| point(base[*i])).collect();
        let tree = Neighbours::new(&simulated, self.margin);
        let stride = observed.points.len().div_ceil(MOST_POINTS).max(1);
        for (y, n) in observed.points.iter().zip(&observed.normals).step_by(stride) {
            if self.in_contact(*y, time) {
                continue;
            }
            let [(squared, k)] = tree.nearest::<1>(*y);
            if !squared.is_finite() {
                continue;
            }
            let i = surface[k];
            let p = simulated[k];
            let (distance, normal) = directed(p - *y, *n, outward[i].unwrap_or(*n), self.margin);
            let residual = compared(i, normal, distance, &mut row);
            self.add(&mut cluster, residual, &row);
        }
        cluster.finish()
    }

    /// Huber's loss: quadratic up to the knee, linear beyond.
    fn add(&self, cluster: &mut Cluster, residual: f64, row: &[f64]) {
        let size = residual.abs();
        let weight = (self.knee / size.max(self.knee)).min(1.0);
        cluster.add(residual, row, weight);
        // `add` counts weight r^2 / 2; Huber's cost beyond the knee is knee (|r| - knee / 2).
        if size > self.knee {
            cluster.cost += 0.5 * self.knee * (size - self.knee);
        }
    }
}

fn point(p: [f32; 3]) -> DVec3 {
    glam::Vec3::from_array(p).as_dvec3()
}

/// Distance of `p` from the surface, positive outward (along `outward`), and the direction in which it is measured.
fn signed_distance(surface: &ObservedSurface, p: DVec3, outward: DVec3) -> (f64, DVec3) {
    let [(squared, id)] = surface.tree.nearest::<1>(p);
    if !squared.is_finite() {
        return (0.0, DVec3::ZERO);
    }
    directed(p - surface.points[id], surface.normals[id], outward, surface.far)
}

/// Distance along the normal where the offset is mostly along it or short, along the offset itself elsewhere.
fn directed(offset: DVec3, normal: DVec3, outward: DVec3, far: f64) -> (f64, DVec3) {
    let normal = if normal.dot(outward) < 0.0 { -normal } else { normal };
    let distance = offset.length();
    if distance > far {
        let sign = if offset.dot(outward) < 0.0 { -1.0 } else { 1.0 };
        return (sign * distance, sign * offset / distance);
    }
    (offset.dot(normal), normal)
}

/// Outward direction of each particle on the surface: away from the centre of its neighbours, where these lie to one side.
pub(crate) fn outward(positions: &[[f32; 3]], radius: f64) -> Vec<Option<DVec3>> {
    let points: Vec<DVec3> = positions.iter().map(|p| point(*p)).collect();
    let tree = Neighbours::new(&points, radius);
    points
        .iter()
        .map(|p| {
            let (mut sum, mut count) = (DVec3::ZERO, 0.0);
            tree.within(*p, radius, |_, _, q| {
                sum += *p - q;
                count += 1.0;
            });
            let asymmetry = sum / (count * radius);
            // In the middle of a flat face the neighbours' centre is 3/8 of the radius away; inside it is at the particle.
            (asymmetry.length() > 0.2).then(|| asymmetry.normalize_or(DVec3::Y))
        })
        .collect()
}
