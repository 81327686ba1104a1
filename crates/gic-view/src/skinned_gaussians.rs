//! The twin in its own colours: Gaussians finer than the simulated particles, each skinned to the nearest one.

use std::path::Path;

use gic_appearance::{Light, LitGaussians};
use gic_files::FileError;
use gic_geometry::{KdTree, outward_normals};
use gic_splat::Gaussians;
use gic_twin::TwinError;
use gic_twin::atomic;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::error::{Result, ViewError};

/// The files of the colours, inside a run folder: albedos of all Gaussians, the light on them, and what both make of
/// those that can be seen where the body starts, for splat viewers. gic reads the first two.
pub const FILES: [&str; 3] = ["appearance/albedo.ply", "appearance/light.json", "appearance/gaussians.ply"];
const SCHEMA: &str = "gic.light/1";
/// Least length of the outward normal of a Gaussian that can be seen. Shorter ones lie almost two spacings deep, behind
/// nearly opaque Gaussians.
pub(crate) const MIN_VISIBLE_NORMAL: f32 = 0.06;

/// Gaussians with colours, each moved by one particle of the simulation.
pub struct SkinnedGaussians {
    lit: LitGaussians,
    /// Distance of neighbouring points [m].
    spacing: f64,
    /// Index of the particle that moves each Gaussian.
    parents: Vec<u32>,
    /// From the particle to the point, at the first frame [m].
    offsets: Vec<DVec3>,
}

/// `light.json`.
#[derive(Serialize, Deserialize)]
struct LightFile {
    schema: String,
    /// Distance of neighbouring points [m].
    point_spacing_m: f64,
    #[serde(flatten)]
    light: Light,
}

impl SkinnedGaussians {
    /// Writes the colours of points that lie `spacing` metres apart.
    ///
    /// # Errors
    /// An unwritable folder.
    pub fn save(lit: &LitGaussians, spacing: f64, run: &Path) -> Result<()> {
        let [albedo, light, seen] = FILES.map(|file| run.join(file));
        atomic::create_folder(&run.join("appearance"))?;
        let write = |path: &Path, gaussians: &Gaussians| {
            gic_splat::write_ply(path, gaussians).map_err(ViewError::stage("writing the twin's colours"))
        };
        write(&albedo, &lit.gaussians)?;
        write(&seen, &visible(lit, &lit.gaussians.positions, spacing))?;
        let file = LightFile { schema: SCHEMA.into(), point_spacing_m: spacing, light: lit.light };
        Ok(atomic::write_json(&light, &file)?)
    }

    /// Whether there are colours beside a file of matter.
    pub(crate) fn beside(matter: &Path) -> bool {
        let run = matter.parent().unwrap_or(Path::new(""));
        FILES[..2].iter().all(|file| run.join(file).exists())
    }

    /// Reads the colours of a run and skins them to the particles `rest` [m] that its simulations start from; `None`
    /// where the run has no colours.
    ///
    /// # Errors
    /// Damaged files.
    pub fn load(run: &Path, rest: &[DVec3]) -> Result<Option<Self>> {
        let [albedo, light, _] = FILES.map(|file| run.join(file));
        if !albedo.exists() || !light.exists() {
            return Ok(None);
        }
        let file: LightFile = atomic::read_json(&light)?;
        if file.schema != SCHEMA {
            return Err(TwinError::File(FileError::Content {
                path: light,
                problem: format!("has schema {}, and this gic reads {SCHEMA}", file.schema),
                hint: Some("run `gic run` on the folder again".into()),
            })
            .into());
        }
        let gaussians = gic_splat::read_ply(&albedo).map_err(ViewError::stage("reading the twin's colours"))?.gaussians;
        let lit = LitGaussians { gaussians, light: file.light };
        Ok(Some(Self::skinned_to(lit, file.point_spacing_m, rest)))
    }

    /// Skins each Gaussian to the nearest particle.
    fn skinned_to(lit: LitGaussians, spacing: f64, rest: &[DVec3]) -> Self {
        let anchors: Vec<[f32; 3]> = rest.iter().map(|p| p.as_vec3().to_array()).collect();
        let tree = KdTree::new(&anchors);
        let points = &lit.gaussians.positions;
        let parents: Vec<u32> = points.iter().map(|&p| tree.nearest(p).map_or(0, |(i, _)| i as u32)).collect();
        let to_f64 = |p: [f32; 3]| DVec3::from_array(p.map(f64::from));
        let offsets =
            points.iter().zip(&parents).map(|(&p, &i)| to_f64(p) - rest.get(i as usize).copied().unwrap_or(to_f64(p)));
        Self { spacing, offsets: offsets.collect(), parents, lit }
    }

    /// Distance of neighbouring points [m].
    pub fn spacing(&self) -> f64 {
        self.spacing
    }

    /// Index of the particle that moves each Gaussian.
    pub fn parents(&self) -> &[u32] {
        &self.parents
    }

    /// From its particle to each Gaussian, at the first frame [m].
    pub(crate) fn offsets(&self) -> &[DVec3] {
        &self.offsets
    }

    /// The Gaussians where they began, with their colours before the light.
    pub(crate) fn albedo(&self) -> &Gaussians {
        &self.lit.gaussians
    }

    /// The light on them.
    pub(crate) fn light(&self) -> &Light {
        &self.lit.light
    }

    /// All Gaussians when the particles are at `moved` [m], in the order of those that they are skinned to.
    pub fn at(&self, moved: &[DVec3]) -> Gaussians {
        let positions = self.positions(moved);
        let normals = outward_normals(&positions, self.spacing);
        self.lit.at(positions, &normals)
    }

    /// Those of [`SkinnedGaussians::at`] that can be seen: without the ones that have matter all around.
    pub fn visible(&self, moved: &[DVec3]) -> Gaussians {
        visible(&self.lit, &self.positions(moved), self.spacing)
    }

    /// Which of [`SkinnedGaussians::at`] can be seen, ascending.
    pub fn visible_rows(&self, moved: &[DVec3]) -> Vec<usize> {
        outside(&outward_normals(&self.positions(moved), self.spacing))
    }

    fn positions(&self, moved: &[DVec3]) -> Vec<[f32; 3]> {
        let position = |(&i, &offset): (&u32, &DVec3)| (moved[i as usize] + offset).as_vec3().to_array();
        self.parents.iter().zip(&self.offsets).map(position).collect()
    }
}

/// Those of some Gaussians at `positions` [m], `spacing` [m] apart, that can be seen, in the light.
fn visible(lit: &LitGaussians, positions: &[[f32; 3]], spacing: f64) -> Gaussians {
    let normals = outward_normals(positions, spacing);
    let seen = outside(&normals);
    let lit = LitGaussians { gaussians: lit.gaussians.select(&seen), light: lit.light };
    lit.at(seen.iter().map(|&i| positions[i]).collect(), &seen.iter().map(|&i| normals[i]).collect::<Vec<_>>())
}

/// Which normals are those of points near the outside.
fn outside(normals: &[[f32; 3]]) -> Vec<usize> {
    (0..normals.len()).filter(|&i| is_longer(&normals[i], MIN_VISIBLE_NORMAL)).collect()
}

/// Whether a normal is longer than `least`.
pub(crate) fn is_longer(normal: &[f32; 3], least: f32) -> bool {
    normal.iter().map(|x| x * x).sum::<f32>() > least * least
}

/// RGB of Gaussians that [`SkinnedGaussians::at`] gave.
pub fn colors(drawn: &Gaussians) -> impl Iterator<Item = [f32; 3]> + '_ {
    drawn.sh.iter().map(|sh| sh.map(gic_splat::color_of_coefficient))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_come_back_from_disk_and_move_with_their_particles() {
        let folder = tempfile::tempdir().unwrap();
        let rest: Vec<DVec3> =
            (0..27).map(|i| DVec3::new((i % 3) as f64, (i / 3 % 3) as f64, (i / 9) as f64) * 0.01).collect();
        let points: Vec<[f32; 3]> = rest.iter().map(|p| (*p + DVec3::splat(0.002)).as_vec3().to_array()).collect();
        let mut gaussians = Gaussians::colorless(points.clone(), vec![0.9; 27], vec![0.005; 27]);
        gaussians.sh = vec![[0.3, -0.2, 0.1]; 27];
        let mut light = Light::default();
        light.coefficients[2] = [0.2; 3];
        assert!(SkinnedGaussians::load(folder.path(), &rest).unwrap().is_none());
        SkinnedGaussians::save(&LitGaussians { gaussians, light }, 0.01, folder.path()).unwrap();
        let skin = SkinnedGaussians::load(folder.path(), &rest).unwrap().unwrap();
        let shown = gic_splat::read_ply(&folder.path().join("appearance/gaussians.ply")).unwrap().gaussians;
        let visible = skin.visible(&rest);
        // All but the one in the middle, and not their albedos.
        assert_eq!((shown.positions.len(), shown.positions), (26, visible.positions));
        assert_eq!(shown.sh, visible.sh);
        assert!(shown.sh.iter().any(|sh| (sh[0] - 0.3).abs() > 0.1));
        let shift = DVec3::new(1.0, 2.0, 3.0);
        let drawn = skin.at(&rest.iter().map(|p| *p + shift).collect::<Vec<_>>());
        for (moved, point) in drawn.positions.iter().zip(&points) {
            for axis in 0..3 {
                assert!((moved[axis] - point[axis] - shift.as_vec3()[axis]).abs() < 1e-5);
            }
        }
        // The light comes from above: what lies on top is brighter than what lies below.
        let (top, bottom) = (drawn.sh[6 + 1][0], drawn.sh[1][0]);
        assert!(top > bottom + 0.1, "{top} {bottom}");
    }
}
