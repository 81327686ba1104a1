//! Coarse-to-fine filling: Algorithm 1 of the paper, a function per group of lines.
//!
//! The structure is the paper's: internal particles are kept where every view's rendered depth lies in front of them and its mask
//! covers them; a density field is upsampled, mean-filtered and reassigned level by level. Four things differ, each because what
//! is made of the body downstream (its mass, its contact time) needs its volume without bias:
//!
//! 1. *Densities are shares, not flags.* A voxel that holds any particle gets density 1 in the paper, which makes the body half a
//!    voxel too large all around. Here the particles are stratified, eight to a voxel of the finest level, each with a weight
//!    that ramps across the surface, and a voxel's density is their mean: the level 0.5 then lies where the surface lies, to a
//!    small part of a voxel.
//! 2. *Certainly empty is reassigned too.* Where a mask or several depth maps say empty, reassigning writes zero as well as
//!    writing one inside. What is left to the interpolated and filtered field is what is in doubt: where only one depth map
//!    sees past the surface and another one sees matter, as it does through a gap between Gaussians.
//! 3. *Undersides.* What no view sees is filled, but not down to the last ray that grazes the body: the boundary that no view sees is
//!    smooth, and the body keeps its volume (see [`crate::Unseen`]). A body that is its own mirror image is then completed by it
//!    ([`crate::Completion`]).
//! 4. *Depths know of the Gaussians' sizes.* Where a surface is drawn by large ones, it lies further in front of their centres.

mod internal;
mod unseen;

use gic_geometry::{DensityField, TetMesh, TriangleMesh, marching_cubes};
use gic_scene::Camera;
use gic_splat::{Gaussians, Shape};
use glam::DVec3;
use rayon::prelude::*;

use self::internal::{InternalParticles, internal_particles};
use self::unseen::place_unseen;
use crate::evidence::Evidence;
use crate::{ContinuumError, FillSettings, MaskedView, Symmetry};

/// Fewer Gaussians than this are no body.
const MIN_GAUSSIANS: usize = 8;
/// A Gaussian is outside a mask where the coverage at its centre is below this.
const OUTSIDE: f32 = 0.05;

/// A Gaussian with fewer others within [`REACH`] voxels of level [`FLECK_LEVELS`] is a fleck: how far Gaussians lie from each other does not
/// depend on how many levels are filled.
const NEIGHBOURS: usize = 2;
/// See [`NEIGHBOURS`].
const REACH: usize = 2;
/// See [`NEIGHBOURS`].
const FLECK_LEVELS: usize = 4;

/// The density field of one frame, and what it was made from.
#[derive(Clone, Debug)]
pub struct Filling {
    /// F(t) at the finest level.
    pub field: DensityField,
    /// How much the matter in each voxel of the field is in doubt, in [0, 1]: 1 at a boundary that no view sees, 0 well below it;
    /// empty where nothing is.
    pub doubt: Vec<f32>,
    /// The level of the body's boundary in the field, the paper's th_min.
    pub th_min: f64,
    /// Upper density of the surface, the paper's th_max.
    pub th_max: f64,
    /// Gaussians that counted.
    pub gaussians_used: usize,
    /// Gaussians given.
    pub gaussians_given: usize,
    /// Views that had a mask.
    pub views_used: usize,
}

impl Filling {
    /// A body that is known: `distance` is the signed distance from its surface [m], negative inside, in the box from `low` to `high` [m].
    /// The density ramps from 1 to 0 over `ramp` [m] across the surface; nothing is in doubt, and no Gaussians were used.
    ///
    /// # Errors
    /// Those of [`DensityField::covering`].
    pub fn of_body(
        (low, high): (DVec3, DVec3),
        spacing: f64,
        ramp: f64,
        distance: impl Fn(DVec3) -> f64,
    ) -> Result<Filling, ContinuumError> {
        let mut field = DensityField::covering(low, high, spacing, 1)?;
        for i in 0..field.len() {
            field.values[i] = (0.5 - distance(field.centre(field.voxel(i))) / ramp).clamp(0.0, 1.0) as f32;
        }
        let doubt = Vec::new();
        Ok(Filling { field, doubt, th_min: 0.5, th_max: 0.8, gaussians_used: 0, gaussians_given: 0, views_used: 0 })
    }

    /// Volume of the body [m^3]: where the interpolated field is at least th_min.
    pub fn volume(&self) -> f64 {
        self.field.volume(self.th_min)
    }

    /// The surface at level th_min as a closed triangle mesh.
    pub fn surface_mesh(&self) -> TriangleMesh {
        marching_cubes(&self.field, self.th_min)
    }

    /// Tetrahedra that fill the level set th_min, with edges of about `edge` [m].
    ///
    /// # Errors
    /// Those of [`gic_geometry::tetrahedra`].
    pub fn tetrahedra(&self, edge: f64) -> Result<TetMesh, ContinuumError> {
        Ok(gic_geometry::tetrahedra(&self.field, self.th_min, edge)?)
    }

    /// P~(t) of Algorithm 1, line 16: centres of the voxels of at least th_min [m].
    pub fn continuum_voxels(&self) -> Vec<DVec3> {
        self.positions(self.th_min, f64::INFINITY)
    }

    /// S~(t) of Algorithm 1, line 17: centres of the voxels between th_min and th_max [m].
    pub fn surface_voxels(&self) -> Vec<DVec3> {
        self.positions(self.th_min, self.th_max)
    }

    /// How much the body's boundary at a point of it [m] is in doubt, in [0, 1]: 1 where no view sees it, falling to 0 some voxels away from
    /// there.
    pub fn doubt_of_surface(&self, point: DVec3) -> f32 {
        // The voxel that holds the point may lie outside, where nothing is in doubt.
        let voxels = self.field.discretize(point).into_iter().flat_map(|i| self.field.around(i));
        voxels.filter_map(|i| self.doubt.get(i)).copied().fold(0.0, f32::max)
    }

    /// GetPosition of the paper.
    fn positions(&self, low: f64, high: f64) -> Vec<DVec3> {
        let inside = |v: f32| f64::from(v) >= low && f64::from(v) <= high;
        (0..self.field.len())
            .filter(|&i| inside(self.field.values[i]))
            .map(|i| self.field.centre(self.field.voxel(i)))
            .collect()
    }
}

/// Algorithm 1: the density field of one frame from its Gaussians and masks.
pub fn fill(gaussians: &Gaussians, views: &[MaskedView], settings: &FillSettings) -> Result<Filling, ContinuumError> {
    settings.validate()?;
    let usable = usable_gaussians(gaussians, &Evidence::gather(views, None)?, settings)?;
    let [small, scale] = quartiles_of_scale(&usable);
    let evidence = Evidence::gather(views, Some((&usable, scale)))?;
    let inset = settings.depth_inset * small + settings.depth_offset;
    body(&usable, &evidence, inset, settings).map(|body| Filling { gaussians_given: gaussians.positions.len(), ..body })
}

/// What outlines alone leave of a body whose mirror planes they show: the mirror images of all views see it, too, and none of the Gaussians'
/// depths count. The views may be of several moments, with cameras moved to where they would have seen the body in this one.
pub fn fill_outlines(
    gaussians: &Gaussians,
    views: &[MaskedView],
    symmetry: &Symmetry,
    settings: &FillSettings,
) -> Result<Filling, ContinuumError> {
    settings.validate()?;
    let outlines = Evidence::gather(views, None)?;
    let views_used = outlines.len();
    let mirrored: Vec<Vec<Camera>> = outlines.iter().map(|view| symmetry.cameras(view.camera)).collect();
    let evidence = with_images(outlines, &mirrored);
    let usable = usable_gaussians(gaussians, &evidence, settings)?;
    let body = body(&usable, &evidence, 0.0, settings)?;
    Ok(Filling { gaussians_given: gaussians.positions.len(), views_used, ..body })
}

/// The views and all that their `mirrored` cameras see: the same pictures.
fn with_images<'a>(mut views: Vec<Evidence<'a>>, mirrored: &'a [Vec<Camera>]) -> Vec<Evidence<'a>> {
    for k in 0..views.len() {
        for camera in &mirrored[k] {
            views.push(Evidence { camera, ..views[k].clone() });
        }
    }
    views
}

/// Lines 5 to 15: the body that views leave, whose depths lie `inset` [m] below the surface.
fn body(
    usable: &Gaussians,
    evidence: &[Evidence],
    inset: f64,
    settings: &FillSettings,
) -> Result<Filling, ContinuumError> {
    let grid = initialize_field(usable, settings)?;
    let particles = internal_particles(&grid, evidence, inset, settings);
    let mut field = coarse_to_fine(&particles, usable, settings);
    let doubt = place_unseen(&mut field, evidence, inset, settings);
    smooth(&mut field);
    if !field.values.iter().any(|&v| f64::from(v) >= settings.th_min) {
        return Err(ContinuumError::Empty);
    }
    Ok(Filling {
        field,
        doubt,
        th_min: settings.th_min,
        th_max: settings.th_max,
        gaussians_used: usable.positions.len(),
        gaussians_given: usable.positions.len(),
        views_used: evidence.len(),
    })
}

/// The Gaussians that count: finite, opaque enough, outside no mask, and no flecks.
fn usable_gaussians(
    gaussians: &Gaussians,
    masks: &[Evidence],
    settings: &FillSettings,
) -> Result<Gaussians, ContinuumError> {
    let counts = |i: usize| {
        let p = gaussians.positions[i];
        let point = DVec3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2]));
        gaussians.opacities[i] >= settings.min_opacity
            && scale(gaussians, i) > 0.0
            && point.is_finite()
            && settings.ground.is_none_or(|g| g.height(point) >= -settings.finest_spacing())
            && masks.iter().all(|view| view.look(point).is_none_or(|seen| seen.coverage >= OUTSIDE))
    };
    let total = gaussians.positions.len();
    let enough = |kept: usize| match kept {
        MIN_GAUSSIANS.. => Ok(()),
        _ => Err(ContinuumError::TooFewGaussians { total, kept, needed: MIN_GAUSSIANS }),
    };
    let kept: Vec<usize> = (0..total).into_par_iter().filter(|&i| counts(i)).collect();
    enough(kept.len())?;
    let usable = select(gaussians, &kept);
    let flecks = FillSettings { levels: FLECK_LEVELS, ..*settings };
    let usable = drop_isolated(&usable, &initialize_field(&usable, &flecks)?);
    enough(usable.positions.len())?;
    Ok(usable)
}

/// Without the Gaussians that have fewer than [`NEIGHBOURS`] others in the voxels of `grid` around them. A fleck that hovers inside the
/// hull agrees with every image, since each view that could call it empty draws the fleck itself; but matter has neighbours.
fn drop_isolated(gaussians: &Gaussians, grid: &DensityField) -> Gaussians {
    let voxels: Vec<Option<usize>> = gaussians
        .positions
        .iter()
        .map(|p| grid.discretize(DVec3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2]))))
        .collect();
    let mut held = vec![0usize; grid.len()];
    for &i in voxels.iter().flatten() {
        held[i] += 1;
    }
    let around = |index: usize| -> usize {
        let [x, y, z] = grid.voxel(index);
        let range = |c: usize, n: usize| c.saturating_sub(REACH)..(c + REACH + 1).min(n);
        range(z, grid.size[2])
            .map(|z| {
                let row = |y| range(x, grid.size[0]).map(|x| held[grid.index(x, y, z)]).sum::<usize>();
                range(y, grid.size[1]).map(row).sum::<usize>()
            })
            .sum()
    };
    let kept: Vec<usize> =
        (0..voxels.len()).into_par_iter().filter(|&i| voxels[i].is_some_and(|v| around(v) > NEIGHBOURS)).collect();
    select(gaussians, &kept)
}

/// Some of the Gaussians, without their colours.
fn select(gaussians: &Gaussians, kept: &[usize]) -> Gaussians {
    let pick = |v: &Vec<[f32; 3]>| kept.iter().map(|&i| v[i]).collect();
    Gaussians {
        positions: pick(&gaussians.positions),
        opacities: kept.iter().map(|&i| gaussians.opacities[i]).collect(),
        shape: match &gaussians.shape {
            Shape::Isotropic { scales } => Shape::Isotropic { scales: kept.iter().map(|&i| scales[i]).collect() },
            Shape::Anisotropic { scales, rotations } => {
                Shape::Anisotropic { scales: pick(scales), rotations: kept.iter().map(|&i| rotations[i]).collect() }
            }
        },
        // Only alpha and depth are drawn: one colour coefficient each is enough.
        sh_degree: 0,
        sh: vec![[0.0; 3]; kept.len()],
    }
}

/// Standard deviation of a Gaussian [m]; of an anisotropic one the geometric mean.
pub(crate) fn scale(gaussians: &Gaussians, i: usize) -> f32 {
    match &gaussians.shape {
        Shape::Isotropic { scales } => scales[i],
        Shape::Anisotropic { scales, .. } => scales[i].iter().product::<f32>().cbrt(),
    }
}

/// The lower quartile and the median of the scales [m].
fn quartiles_of_scale(gaussians: &Gaussians) -> [f64; 2] {
    let mut scales: Vec<f32> = (0..gaussians.positions.len()).map(|i| scale(gaussians, i)).collect();
    scales.sort_by(f32::total_cmp);
    [scales.len() / 4, scales.len() / 2].map(|i| f64::from(scales[i]))
}

/// Line 7: a field of zeros over the bounding box of the Gaussians, at the spacing of the last level; coarser levels pool its
/// voxels. The box is widened by the Gaussians' reach and by two voxels of air.
fn initialize_field(gaussians: &Gaussians, settings: &FillSettings) -> Result<DensityField, ContinuumError> {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for p in &gaussians.positions {
        let point = DVec3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2]));
        low = low.min(point);
        high = high.max(point);
    }
    let [_, scale] = quartiles_of_scale(gaussians);
    let margin = 3.0 * scale + 3.0 * settings.finest_spacing();
    let multiple = 1 << (settings.levels - 1);
    Ok(DensityField::covering(low - margin, high + margin, settings.finest_spacing(), multiple)?)
}

/// Lines 8 to 15: from the coarsest to the finest level, upsample, mean-filter and reassign.
fn coarse_to_fine(particles: &InternalParticles, gaussians: &Gaussians, settings: &FillSettings) -> DensityField {
    let mut levels = vec![(particles.inside.clone(), particles.doubtful.clone())];
    for _ in 1..settings.levels {
        let (inside, doubtful) = &levels[levels.len() - 1];
        levels.push((inside.pool(), doubtful.pool()));
    }
    let mut field: Option<DensityField> = None;
    for (inside, doubtful) in levels.iter().rev() {
        // On the first level nothing is known yet of what is in doubt: as likely as not.
        let mut current =
            field.map_or_else(|| DensityField { values: vec![0.5; inside.len()], ..*inside }, |f| f.upsample());
        reassign(&mut current, inside, doubtful, gaussians, settings);
        for _ in 0..settings.filter_rounds {
            current.mean_filter(1.0 / 3.0);
            reassign(&mut current, inside, doubtful, gaussians, settings);
        }
        field = Some(current);
    }
    field.expect("there is at least one level")
}

/// Lines 11 and 14: the share that is certainly inside counts fully, the share in doubt at the field's own density, the rest
/// not at all. Voxels that hold a Gaussian where nothing else is dense get density 1: parts thinner than a voxel.
fn reassign(
    field: &mut DensityField,
    inside: &DensityField,
    doubtful: &DensityField,
    gaussians: &Gaussians,
    settings: &FillSettings,
) {
    for ((value, &inside), &doubtful) in field.values.iter_mut().zip(&inside.values).zip(&doubtful.values) {
        *value = inside + doubtful * *value;
    }
    let thin: Vec<usize> = gaussians
        .positions
        .par_iter()
        .filter_map(|p| field.discretize(DVec3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2]))))
        .filter(|&i| !dense_nearby(field, i, settings.th_min as f32))
        .collect();
    for i in thin {
        field.values[i] = 1.0;
    }
}

/// Whether any voxel of the 3x3x3 around one reaches a density.
fn dense_nearby(field: &DensityField, index: usize, density: f32) -> bool {
    field.around(index).any(|i| field.values[i] >= density)
}

/// A last gentle filter, so that the level set is smooth; parts so thin that they would vanish keep their density.
pub(crate) fn smooth(field: &mut DensityField) {
    let before = field.values.clone();
    field.mean_filter(0.25);
    let lost: Vec<usize> =
        (0..before.len()).into_par_iter().filter(|&i| before[i] >= 0.5 && !dense_nearby(field, i, 0.5)).collect();
    for i in lost {
        field.values[i] = before[i];
    }
}
