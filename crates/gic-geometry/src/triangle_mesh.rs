//! A triangle mesh, and points on it.

use glam::DVec3;

/// A triangle mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Positions [m].
    pub vertices: Vec<DVec3>,
    /// Unit normals, outward, from the gradient of the field; one per vertex.
    pub normals: Vec<DVec3>,
    /// Corners of each triangle, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// A point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Position [m].
    pub position: DVec3,
    /// Outward unit normal.
    pub normal: DVec3,
}

impl TriangleMesh {
    /// Enclosed volume by the divergence theorem [m^3].
    pub fn volume(&self) -> f64 {
        self.triangles.iter().map(|&t| self.corners(t)).map(|[a, b, c]| a.dot(b.cross(c))).sum::<f64>() / 6.0
    }

    /// Surface area [m^2].
    pub fn area(&self) -> f64 {
        self.triangles.iter().map(|&t| self.corners(t)).map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum()
    }

    /// Whether every edge is passed exactly once in each direction: closed, consistently oriented, and manifold along
    /// edges.
    pub fn is_watertight(&self) -> bool {
        let mut edges: Vec<(u32, u32)> =
            self.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
        edges.sort_unstable();
        let distinct = edges.windows(2).all(|w| w[0] != w[1]);
        distinct && edges.iter().all(|&(a, b)| edges.binary_search(&(b, a)).is_ok())
    }

    /// One point per `spacing`^2 of area, at random with a fixed seed, uniform over the surface: what chamfer
    /// distances look at.
    pub fn sample(&self, spacing: f64, seed: u64) -> Vec<SurfacePoint> {
        use rand::{RngExt, SeedableRng};
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut points = Vec::new();
        // Systematic sampling along the cumulated area: evenly many points everywhere.
        let mut due: f64 = random.random();
        for &t in &self.triangles {
            let [a, b, c] = self.corners(t);
            due += 0.5 * (b - a).cross(c - a).length() / (spacing * spacing);
            while due >= 1.0 {
                due -= 1.0;
                let (mut u, mut v): (f64, f64) = (random.random(), random.random());
                if u + v > 1.0 {
                    (u, v) = (1.0 - u, 1.0 - v);
                }
                let [na, nb, nc] = t.map(|i| self.normals[i as usize]);
                points.push(SurfacePoint {
                    position: a + u * (b - a) + v * (c - a),
                    normal: (na + u * (nb - na) + v * (nc - na)).normalize_or(na),
                });
            }
        }
        points
    }

    fn corners(&self, triangle: [u32; 3]) -> [DVec3; 3] {
        triangle.map(|i| self.vertices[i as usize])
    }
}
