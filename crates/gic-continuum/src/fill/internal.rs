//! Lines 1 to 6 of Algorithm 1: which share of each voxel is inside every mask and behind every rendered depth.

use gic_geometry::DensityField;
use glam::DVec3;
use rayon::prelude::*;

use crate::FillSettings;
use crate::evidence::{BoxBounds, Evidence, EvidencePyramid};

/// Side of the boxes that the views are asked about first [voxels], a power of two; each is halved as long as some view
/// is undecided about it. No result depends on it.
const LARGEST_BOX: usize = 8;

/// The shares of each voxel of the finest level that are certainly inside and in doubt; the rest is certainly empty.
pub(crate) struct InternalParticles {
    pub(crate) inside: DensityField,
    pub(crate) doubtful: DensityField,
}

/// Lines 1 to 6: particles sampled in the box of `grid`, kept where they are inside every mask and behind every
/// rendered depth; `inset` [m] is how far the rendered depths lie below the surface.
///
/// The sampling is stratified (2x2x2 to a voxel). A particle's weight ramps from 0 to 1 across the surface over its own
/// width, so that the mean over a voxel is the share of the voxel that is inside. Where all particles of a box have the
/// same weight, by the bounds of what its views say, none of them is looked at.
pub(crate) fn internal_particles(
    grid: &DensityField,
    views: &[Evidence],
    inset: f64,
    settings: &FillSettings,
) -> InternalParticles {
    let pyramids = EvidencePyramid::all(views);
    let sampling = Sampling::new(grid, inset, settings, views.len());
    let all: Vec<&EvidencePyramid> = pyramids.iter().collect();
    let mut inside = DensityField { values: vec![0.0; grid.len()], ..*grid };
    let mut doubtful = inside.clone();
    let slab = LARGEST_BOX * grid.size[0] * grid.size[1];
    inside.values.par_chunks_mut(slab).zip(doubtful.values.par_chunks_mut(slab)).enumerate().for_each(
        |(i, (inside, doubtful))| {
            let mut shares = Slab { first: LARGEST_BOX * i, inside, doubtful };
            for y in (0..grid.size[1]).step_by(LARGEST_BOX) {
                for x in (0..grid.size[0]).step_by(LARGEST_BOX) {
                    sampling.fill_box(
                        Block { low: [x, y, LARGEST_BOX * i], side: LARGEST_BOX },
                        &all,
                        BoxVotes::default(),
                        &mut shares,
                    );
                }
            }
        },
    );
    InternalParticles { inside, doubtful }
}

/// Votes beyond these are not counted.
const MOST_VOTES: usize = 4;

/// A cube of voxels.
#[derive(Clone, Copy)]
struct Block {
    low: [usize; 3],
    side: usize,
}

/// Layers of voxels from the `first` on, to be filled.
struct Slab<'a> {
    first: usize,
    inside: &'a mut [f32],
    doubtful: &'a mut [f32],
}

/// What views say about all points of a box.
#[derive(Clone, Copy, Default)]
struct BoxVotes {
    /// How many see it in front of the surface.
    empty: usize,
    /// Whether one of these sees that surface through no hole.
    clear: bool,
    /// Whether one sees matter there.
    matter: bool,
}

struct Sampling<'a> {
    grid: &'a DensityField,
    inset: f64,
    settings: &'a FillSettings,
    /// Width of a particle [m].
    width: f64,
    /// Views that must see in front of the surface where a point is certainly empty although another one sees matter
    /// there.
    votes_needed: usize,
}

impl Sampling<'_> {
    fn new<'a>(grid: &'a DensityField, inset: f64, settings: &'a FillSettings, views: usize) -> Sampling<'a> {
        let votes_needed = views.div_ceil(settings.tuning.filling.views_per_vote).clamp(1, MOST_VOTES);
        Sampling { grid, inset, settings, width: 0.5 * grid.spacing, votes_needed }
    }

    /// Fills the voxels of a box, which `views` are undecided about; others said what is in `votes`.
    fn fill_box(&self, block: Block, views: &[&EvidencePyramid], mut votes: BoxVotes, shares: &mut Slab) {
        let size = self.grid.size;
        if (0..3).any(|axis| block.low[axis] >= size[axis]) {
            return;
        }
        let side = self.grid.spacing * block.side as f64;
        let corner = self.grid.origin + self.grid.spacing * DVec3::from(block.low.map(|c| c as f64));
        let centre = corner + 0.5 * side;
        let height = self.settings.ground.map_or(f64::INFINITY, |ground| ground.height(centre));
        // The box within a ball.
        let radius = 0.5 * side * 3f64.sqrt();
        if height + radius <= -0.5 * self.width {
            return;
        }
        let mut undecided = Vec::with_capacity(views.len());
        for view in views {
            match view.bounds(centre, 0.5 * side) {
                BoxBounds::Unseen => {}
                BoxBounds::Seen { coverage, .. } if coverage[1] <= 0.0 => return,
                BoxBounds::Seen { coverage, behind, .. } if coverage[0] >= 1.0 && self.is_hidden(behind) => {}
                BoxBounds::Seen { coverage, behind, .. } if coverage[0] >= 1.0 && self.is_matter(behind) => {
                    votes.matter = true
                }
                BoxBounds::Seen { coverage, behind, through_hole } if coverage[0] >= 1.0 && self.is_empty(behind) => {
                    votes.empty += 1;
                    votes.clear |= !through_hole;
                }
                _ => undecided.push(*view),
            }
        }
        let decided = undecided.is_empty();
        if votes.empty >= self.votes_needed || decided && votes.clear && !votes.matter {
            return;
        }
        if decided && height - radius >= 0.5 * self.width {
            self.set(block, if votes.empty == 0 { (1.0, 0.0) } else { (0.0, 1.0) }, shares);
        } else if block.side == 1 {
            self.set(block, self.sample(centre, &undecided, votes), shares);
        } else {
            let half = block.side / 2;
            for k in 0..8 {
                let low = [0, 1, 2].map(|axis| block.low[axis] + half * (k >> axis & 1));
                self.fill_box(Block { low, side: half }, &undecided, votes, shares);
            }
        }
    }

    /// Whether all particles between two distances behind the surface [m] are too deep for a view to see anything
    /// there: what lies a voxel deep may be hidden by something else.
    fn is_hidden(&self, behind: [f64; 2]) -> bool {
        behind[0] + self.inset >= self.grid.spacing
    }

    /// Whether a view sees matter at all particles between two distances behind the surface [m].
    fn is_matter(&self, behind: [f64; 2]) -> bool {
        behind[0] + self.inset >= 0.5 * self.width && behind[1] + self.inset < self.grid.spacing
    }

    /// Whether all particles between two distances behind the surface [m] are empty.
    fn is_empty(&self, behind: [f64; 2]) -> bool {
        behind[1] + self.inset <= -0.5 * self.width
    }

    fn set(&self, Block { low, side }: Block, (inside, doubtful): (f32, f32), shares: &mut Slab) {
        let [nx, ny, nz] = self.grid.size;
        for z in low[2]..(low[2] + side).min(nz) {
            for y in low[1]..(low[1] + side).min(ny) {
                let row = nx * (y + ny * (z - shares.first));
                let row = row + low[0]..row + (low[0] + side).min(nx);
                shares.inside[row.clone()].fill(inside);
                shares.doubtful[row].fill(doubtful);
            }
        }
    }

    /// The shares (inside, in doubt) of the voxel around `centre`: means over its particles.
    fn sample(&self, centre: DVec3, views: &[&EvidencePyramid], votes: BoxVotes) -> (f32, f32) {
        let (mut inside, mut doubtful) = (0.0, 0.0);
        for k in 0..8u32 {
            let corner = DVec3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2)) - 0.5;
            let weight = self.filter_by_views(centre + self.width * corner, views, votes);
            inside += weight.0 / 8.0;
            doubtful += weight.1 / 8.0;
        }
        (inside, doubtful)
    }

    /// Line 5 for one particle: its weights (inside, doubtful). Views that are not given said what is in
    /// `votes`.
    fn filter_by_views(&self, point: DVec3, views: &[&EvidencePyramid], votes: BoxVotes) -> (f32, f32) {
        let mut covered = match self.settings.ground {
            Some(ground) => (0.5 + ground.height(point) / self.width).clamp(0.0, 1.0) as f32,
            None => 1.0,
        };
        // The emptiest few views, emptiest first.
        let mut emptiest = [0.0f32; MOST_VOTES];
        emptiest[..votes.empty].fill(1.0);
        let (mut matter, mut clear) = (votes.matter, f32::from(u8::from(votes.clear)));
        for pyramid in views {
            if covered <= 0.0 {
                return (0.0, 0.0);
            }
            let Some(seen) = pyramid.view.evidence_at(point) else { continue };
            covered = covered.min(seen.coverage);
            let behind = f64::from(seen.behind) + self.inset;
            matter |= behind > 0.0 && behind < self.grid.spacing;
            let mut empty = (0.5 - behind / self.width).clamp(0.0, 1.0) as f32;
            if !seen.through_hole {
                clear = clear.max(empty);
            }
            for slot in &mut emptiest {
                if empty > *slot {
                    std::mem::swap(slot, &mut empty);
                }
            }
        }
        let inside = covered.min(1.0 - emptiest[0]);
        let alone = if matter { 0.0 } else { clear };
        let empty = (1.0 - covered).max(emptiest[self.votes_needed - 1]).max(alone);
        (inside, (1.0 - inside - empty).max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use gic_scene::Camera;
    use glam::{DMat3, DVec2};

    use super::*;
    use gic_geometry::Plane;

    use crate::tuning::Tuning;

    /// A ball of radius 0.1 m before a camera at a distance of 1 m: mask and depth.
    fn ball(camera: &Camera) -> (Vec<f32>, Vec<f32>) {
        let pixel = |i: usize| {
            let at = DVec2::new((i % camera.width) as f64 + 0.5, (i / camera.width) as f64 + 0.5);
            let ray = (camera.unproject(at, 1.0) - camera.centre).normalize();
            let along = -camera.centre.dot(ray);
            let miss = (camera.centre + along * ray).length();
            let depth = along - (0.01 - miss * miss).max(0.0).sqrt();
            let z = depth * ray.dot(camera.world_from_camera.z_axis);
            (((0.1 - miss) / 0.004 + 0.5).clamp(0.0, 1.0) as f32, if miss < 0.1 { z as f32 } else { f32::INFINITY })
        };
        (0..camera.width * camera.height).map(pixel).unzip()
    }

    #[test]
    fn asking_boxes_first_changes_nothing() {
        let cameras: Vec<Camera> = (0..7)
            .map(|k| {
                let turn = DMat3::from_rotation_y(f64::from(k)) * DMat3::from_rotation_x(0.4 * f64::from(k % 3) - 0.2);
                // The last stands so far aside that the ball reaches out of its image.
                let aside = if k == 6 { 0.35 } else { 0.0 };
                let (width, height, focal, principal) = (64, 64, DVec2::splat(180.0), DVec2::splat(32.0));
                Camera {
                    width,
                    height,
                    focal,
                    principal,
                    world_from_camera: turn,
                    centre: turn * DVec3::new(aside, 0.0, -1.0),
                }
            })
            .collect();
        let pictures: Vec<(Vec<f32>, Vec<f32>)> = cameras.iter().map(ball).collect();
        let views: Vec<Evidence> = cameras
            .iter()
            .zip(&pictures)
            .map(|(camera, (mask, depth))| Evidence::with_depth(camera, mask, depth.clone(), &Tuning::default()))
            .collect();
        let grid = DensityField::covering(DVec3::splat(-0.17), DVec3::splat(0.17), 0.01, 2).unwrap();
        let ground = Plane { point: -0.06 * DVec3::Y, normal: DVec3::Y };
        for ground in [None, Some(ground)] {
            let settings = FillSettings { ground, ..FillSettings::for_size(0.2) };
            let found = internal_particles(&grid, &views, 0.002, &settings);
            let pyramids = EvidencePyramid::all(&views);
            let all: Vec<&EvidencePyramid> = pyramids.iter().collect();
            let sampling = Sampling::new(&grid, 0.002, &settings, views.len());
            let (mut whole, mut parts) = (0, 0);
            for i in 0..grid.len() {
                let (inside, doubtful) = sampling.sample(grid.centre(grid.voxel(i)), &all, BoxVotes::default());
                let off = (found.inside.values[i] - inside).abs().max((found.doubtful.values[i] - doubtful).abs());
                assert!(
                    off < 1e-5,
                    "{i}: {inside} {doubtful} became {} {}",
                    found.inside.values[i],
                    found.doubtful.values[i]
                );
                whole += u32::from(inside == 1.0);
                parts += u32::from(inside > 0.0 && inside < 1.0);
            }
            assert!(whole > 500 && parts > 500, "{whole} {parts}");
        }
    }

    #[test]
    fn one_view_empties_a_voxel_unless_another_sees_matter_there() {
        let (size, world_from_camera) = (32, DMat3::IDENTITY);
        let (focal, principal) = (DVec2::splat(200.0), DVec2::splat(16.0));
        let camera = Camera { width: size, height: size, focal, principal, world_from_camera, centre: -DVec3::Z };
        let mask = vec![1.0; size * size];
        let wall = |depth: f32| Evidence::with_depth(&camera, &mask, vec![depth; size * size], &Tuning::default());
        let settings = FillSettings::for_size(1.0);
        let grid = DensityField { origin: DVec3::splat(-0.005), spacing: 0.01, size: [1; 3], values: vec![0.0] };
        // The voxel is 1 m away. One view sees past it, the others a wall in front of it, so near that it may be this
        // wall or not.
        for (other, inside, doubtful) in [(0.5, 0.0, 0.0), (0.994, 0.0, 1.0)] {
            let mut views: Vec<Evidence> = (0..6).map(|_| wall(0.5)).collect();
            views.push(wall(other));
            let without = internal_particles(&grid, &views, 0.0, &settings);
            assert_eq!((without.inside.values[0], without.doubtful.values[0]), (1.0, 0.0));
            views.push(wall(1.2));
            let found = internal_particles(&grid, &views, 0.0, &settings);
            assert_eq!((found.inside.values[0], found.doubtful.values[0]), (inside, doubtful), "{other}");
        }
    }
}
