//! The surface, carried through a motion that particles make.
//!
//! A place goes where the affine map takes it that fits the motion of the particles around it best (moving least
//! squares: Schaefer, McPhail & Warren 2006): `F = sum w b a^T (sum w a a^T)^-1`, where `a` and `b` are the particles'
//! positions before and after, from their weighted means.

use gic_geometry::{Neighbours, Pose, TriangleMesh};
use glam::{DMat3, DVec3};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// Particles that tell how a place moves. Derived: those of the 2x2x2 cells of the grid around it, which is what a
/// simulated motion can vary by.
const NEIGHBOURS: usize = 16;

/// The surface of the first moment, and how it hangs on the particles.
pub(super) struct TrackedSurface {
    pub(super) mesh: TriangleMesh,
    /// Vertices beside each vertex.
    pub(super) adjacent: Vec<Vec<usize>>,
    anchors: Anchors,
}

/// What points of the first moment hang on.
pub(super) struct Anchors(Vec<Anchor>);

/// What a point hangs on.
struct Anchor {
    particles: [usize; NEIGHBOURS],
    weights: [f64; NEIGHBOURS],
    /// The particles from their mean, times their weights and the inverse of their second moments [1/m].
    dual: [DVec3; NEIGHBOURS],
    /// The point from their mean [m].
    offset: DVec3,
}

/// The surface in another moment, as the motion has it.
pub(super) struct CarriedSurface<'a> {
    triangles: &'a [[u32; 3]],
    vertices: Vec<DVec3>,
    outward: Vec<DVec3>,
    deformation: Vec<f64>,
    centre: DVec3,
}

/// The surface in another moment, under a pose.
pub(super) struct MovedSurface {
    /// The same triangles.
    pub(super) mesh: TriangleMesh,
    /// Where one metre along the first moment's normal has gone, of each vertex.
    pub(super) outward: Vec<DVec3>,
    /// How far each vertex is from where the body would be if it had kept its shape [m].
    pub(super) deformation: Vec<f64>,
    /// The mean of its vertices [m].
    pub(super) centre: DVec3,
}

impl TrackedSurface {
    pub(super) fn new(mesh: TriangleMesh, body: &[DVec3], spacing: f64) -> TrackedSurface {
        let anchors = Anchors::new(&mesh.vertices, body, spacing);
        TrackedSurface { adjacent: adjacent(&mesh), anchors, mesh }
    }

    /// The surface in a moment with its particles at `positions` [m].
    pub(super) fn carried(&self, positions: &[DVec3]) -> CarriedSurface<'_> {
        let moved = self.anchors.moved(positions).zip(&self.mesh.normals);
        let moved = moved.map(|((point, map), normal)| (point, map * *normal));
        let (vertices, outward): (Vec<DVec3>, Vec<DVec3>) = moved.unzip();
        let centre = vertices.iter().sum::<DVec3>() / vertices.len().max(1) as f64;
        let deformation = deformation(&self.mesh.vertices, &vertices);
        CarriedSurface { triangles: &self.mesh.triangles, vertices, outward, deformation, centre }
    }
}

impl CarriedSurface<'_> {
    /// The same under a pose.
    pub(super) fn moved(&self, pose: &Pose) -> MovedSurface {
        let vertices: Vec<DVec3> = self.vertices.iter().map(|vertex| pose.moved(*vertex, self.centre)).collect();
        let outward = self.outward.iter().map(|outward| pose.turn * *outward).collect();
        let normals = normals(&vertices, self.triangles);
        let mesh = TriangleMesh { vertices, normals, triangles: self.triangles.to_vec() };
        MovedSurface { mesh, outward, deformation: self.deformation.clone(), centre: self.centre + pose.shift }
    }
}

impl Anchors {
    /// Of `points` in a body whose particles are `spacing` apart [m].
    pub(super) fn new(points: &[DVec3], body: &[DVec3], spacing: f64) -> Anchors {
        let tree = Neighbours::new(body, spacing);
        Anchors(points.par_iter().map(|point| Anchor::new(*point, &tree, body, spacing)).collect())
    }

    /// Where the points are in a moment with its particles at `positions` [m], and the affine map around each.
    pub(super) fn moved(&self, positions: &[DVec3]) -> impl IndexedParallelIterator<Item = (DVec3, DMat3)> {
        self.0.par_iter().map(|anchor| anchor.moved(positions))
    }
}

impl Anchor {
    fn new(point: DVec3, tree: &Neighbours, body: &[DVec3], spacing: f64) -> Anchor {
        let nearest = tree.nearest::<NEIGHBOURS>(point).map(|(squared, i)| (squared, i.min(body.len() - 1)));
        let weights =
            nearest.map(|(squared, _)| if squared.is_finite() { (squared.sqrt() + spacing).powi(-2) } else { 0.0 });
        let total: f64 = weights.iter().sum();
        let weights = weights.map(|weight| weight / total);
        let particles = nearest.map(|(_, i)| i);
        let mean: DVec3 = particles.iter().zip(weights).map(|(i, weight)| weight * body[*i]).sum();
        let outer = |a: DVec3| DMat3::from_cols(a * a.x, a * a.y, a * a.z);
        let moments = particles.iter().zip(weights).map(|(i, weight)| outer(body[*i] - mean) * weight);
        // A thousandth of a spacing squared, so that particles in a plane have an inverse, too.
        let least = DMat3::from_diagonal(DVec3::splat(1e-3 * spacing * spacing));
        let inverse = moments.fold(least, |sum, moment| sum + moment).inverse();
        let dual = std::array::from_fn(|k| inverse * (body[particles[k]] - mean) * weights[k]);
        Anchor { particles, weights, dual, offset: point - mean }
    }

    /// Where the point is, and the affine map around it.
    fn moved(&self, positions: &[DVec3]) -> (DVec3, DMat3) {
        let at = |k: usize| positions[self.particles[k]];
        let mean: DVec3 = (0..NEIGHBOURS).map(|k| self.weights[k] * at(k)).sum();
        let mut map = DMat3::ZERO;
        for k in 0..NEIGHBOURS {
            let (b, dual) = (at(k) - mean, self.dual[k]);
            map += DMat3::from_cols(b * dual.x, b * dual.y, b * dual.z);
        }
        (mean + map * self.offset, map)
    }
}

/// How far points are from where the rigid motion takes them that fits theirs best (Kabsch 1976) [m].
pub(super) fn deformation(before: &[DVec3], after: &[DVec3]) -> Vec<f64> {
    let mean = |points: &[DVec3]| points.iter().sum::<DVec3>() / points.len().max(1) as f64;
    let (a, b) = (mean(before), mean(after));
    let outer = |(p, q): (&DVec3, &DVec3)| {
        let (p, q) = (*p - a, *q - b);
        Matrix3::from_fn(|row, column| q[row] * p[column])
    };
    let svd = before.iter().zip(after).map(outer).sum::<Matrix3<f64>>().svd(true, true);
    let (Some(u), Some(v)) = (svd.u, svd.v_t) else { return vec![0.0; before.len()] };
    let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v).determinant().signum()));
    let turn = u * mirror * v;
    let turned = |p: DVec3| DVec3::from_array((turn * Vector3::from(p.to_array())).into());
    before.iter().zip(after).map(|(p, q)| (turned(*p - a) - (*q - b)).length()).collect()
}

/// Vertices that share an edge with each vertex.
fn adjacent(mesh: &TriangleMesh) -> Vec<Vec<usize>> {
    let mut adjacent = vec![Vec::new(); mesh.vertices.len()];
    for &[a, b, c] in &mesh.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            adjacent[from as usize].push(to as usize);
            adjacent[to as usize].push(from as usize);
        }
    }
    adjacent.iter_mut().for_each(|around| {
        around.sort_unstable();
        around.dedup();
    });
    adjacent
}

/// Unit normals of vertices, those of the triangles around weighted by area.
fn normals(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; vertices.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|i| vertices[i as usize]);
        let area = (b - a).cross(c - a);
        triangle.iter().for_each(|i| normals[*i as usize] += area);
    }
    normals.into_iter().map(DVec3::normalize_or_zero).collect()
}

#[cfg(test)]
mod tests {
    use glam::DQuat;
    use proptest::prelude::*;

    use super::*;
    use crate::Filling;

    const SPACING: f64 = 0.01;

    fn ball() -> (TrackedSurface, Vec<DVec3>) {
        let (low, high) = (DVec3::splat(-0.15), DVec3::splat(0.15));
        let filling = Filling::of_body((low, high), 0.01, 0.02, |p| p.length() - 0.1).expect("a small grid");
        let axis = |i: usize| SPACING * (i as f64 - 10.0);
        let cube = (0..21usize.pow(3)).map(|i| DVec3::new(axis(i % 21), axis(i / 21 % 21), axis(i / 441)));
        let body: Vec<DVec3> = cube.filter(|p| p.length() < 0.096).collect();
        (TrackedSurface::new(filling.surface_mesh(), &body, SPACING), body)
    }

    proptest! {
        /// An affine motion of the particles is followed exactly, but for the guard of flat bodies.
        #[test]
        fn affine_motions_are_followed(
            turn in -3.0f64..3.0, stretch in 0.7f64..1.4, shear in -0.4f64..0.4, shift in -1.0f64..1.0
        ) {
            let (surface, body) = ball();
            let map = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), turn))
                * DMat3::from_cols(DVec3::X * stretch, DVec3::new(shear, 1.0, 0.0), DVec3::Z);
            let image = |p: DVec3| map * p + shift * DVec3::Y;
            let positions: Vec<DVec3> = body.iter().map(|p| image(*p)).collect();
            let moved = surface.carried(&positions).moved(&Pose::default());
            for (i, (point, normal)) in surface.mesh.vertices.iter().zip(&surface.mesh.normals).enumerate() {
                prop_assert!(moved.mesh.vertices[i].distance(image(*point)) < 2e-4);
                prop_assert!((stretch - 1.0).abs() + shear.abs() > 1e-2 || moved.deformation[i] < 2e-3);
                prop_assert!(moved.outward[i].distance(map * *normal) < 0.02);
            }
        }
    }
}
