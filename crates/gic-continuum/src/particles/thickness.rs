//! Which parts of a body are thin: those that no ball of a given size reaches (an opening: Matheron 1975).

use gic_geometry::Neighbours;
use glam::DVec3;
use rayon::prelude::*;

use crate::Filling;

impl Filling {
    /// Share of `particles` [m] in parts of the body thinner than `thickness` [m]: those out of reach of all balls of
    /// that diameter that fit into it, to half a voxel. Right-angled edges lie sqrt(2) of a ball's radius from its
    /// centre, so they are no thin parts.
    pub fn thin_share(&self, particles: &[DVec3], thickness: f64) -> f64 {
        let (radius, field) = (0.5 * thickness, &self.field);
        let surface = Neighbours::new(&self.surface_mesh().vertices, field.spacing);
        let depth = radius - 0.5 * field.spacing;
        let is_core = |point: &DVec3| surface.nearest::<1>(*point)[0].0 >= depth * depth;
        let full = (0..field.len()).into_par_iter().filter(|i| f64::from(field.values[*i]) >= self.th_min);
        let core: Vec<DVec3> = full.map(|i| field.centre(field.voxel(i))).filter(is_core).collect();
        let core = Neighbours::new(&core, radius);
        let reach = std::f64::consts::SQRT_2 * radius;
        let is_thin = |point: &&DVec3| core.nearest::<1>(**point)[0].0 > reach * reach;
        particles.par_iter().filter(is_thin).count() as f64 / particles.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A block 16 cm across with a plate of 2 cm that stands out from it by 10 cm.
    fn block_with_plate(p: DVec3) -> f64 {
        let box_of = |centre: DVec3, half: DVec3| ((p - centre).abs() - half).max_element();
        box_of(DVec3::ZERO, DVec3::splat(0.08)).min(box_of(DVec3::new(0.13, 0.0, 0.0), DVec3::new(0.05, 0.08, 0.01)))
    }

    #[test]
    fn plates_are_thin_and_edges_of_blocks_are_not() {
        let corners = (DVec3::splat(-0.1), DVec3::new(0.2, 0.1, 0.1));
        let body = Filling::of_body(corners, 0.005, 0.01, block_with_plate).expect("a small grid");
        let axis = |i: usize, n: usize| 0.01 * (i as f64 - 0.5 * n as f64) + 0.005;
        let all = (0..40 * 20 * 20).map(|i| DVec3::new(axis(i % 40, 40), axis(i / 40 % 20, 20), axis(i / 800, 20)));
        let particles: Vec<DVec3> = all.filter(|p| block_with_plate(*p) < 0.0).collect();
        let plate = particles.iter().filter(|p| p.x > 0.08).count() as f64 / particles.len() as f64;
        let found = body.thin_share(&particles, 0.04);
        println!("{found} of {plate}");
        // The root of the plate is within reach of the block.
        assert!(found > 0.6 * plate && found <= plate, "{found} of {plate}");
        assert_eq!(body.thin_share(&particles, 0.01), 0.0, "nothing is thinner than half the plate");
    }
}
