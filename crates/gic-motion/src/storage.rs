//! Dynamic Gaussians on disk: `canonical.ply` that splat viewers open, and `motion.safetensors`.

use std::path::Path;

use gic_files::FileError;
use serde::{Deserialize, Serialize};

use crate::tensor_file::{self, TensorFile};
use crate::{Architecture, BaseMotion, Displacement, Domain, DynamicGaussians, MotionError, MotionNetwork};

const CANONICAL: &str = "canonical.ply";
const MOTION: &str = "motion.safetensors";

#[derive(Serialize, Deserialize)]
struct Header {
    schema: String,
    architecture: Architecture,
    domain: Domain,
    base: Option<BaseMotion>,
}

#[derive(Deserialize)]
struct Version {
    schema: String,
}

const SCHEMA: &str = "gic.motion/2";

impl DynamicGaussians {
    /// Writes `canonical.ply` and, for a moving scene, `motion.safetensors` into `folder`, which is made if it is
    /// missing.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn save(&self, folder: &Path) -> Result<(), MotionError> {
        std::fs::create_dir_all(folder).map_err(FileError::write(folder))?;
        let path = folder.join(CANONICAL);
        gic_splat::write_ply(&path, &self.canonical)?;
        let path = folder.join(MOTION);
        let Some(Displacement { network, domain, base }) = &self.motion else {
            // What a moving scene may have left there must not animate this one.
            return match std::fs::remove_file(&path) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                    Err(FileError::write(&path)(error).into())
                }
                _ => Ok(()),
            };
        };
        let header =
            Header { schema: SCHEMA.into(), architecture: network.architecture(), domain: *domain, base: base.clone() };
        let field =
            |of: fn(&BaseMotion) -> &Vec<Vec<[f32; 3]>>| base.as_ref().map_or(Vec::new(), |base| of(base).concat());
        let (bends, shades) = (field(|base| &base.bends), field(|base| &base.shades));
        let tensors = [
            ("parameters".into(), 1, network.parameters.as_slice()),
            ("bends".into(), 3, bends.as_flattened()),
            ("shades".into(), 3, shades.as_flattened()),
        ];
        tensor_file::write(&path, &tensors, &header)
    }

    /// Reads what [`DynamicGaussians::save`] wrote. Without `motion.safetensors` the Gaussians stand still.
    ///
    /// # Errors
    /// When a file cannot be read or is not what it should be.
    pub fn load(folder: &Path) -> Result<DynamicGaussians, MotionError> {
        let path = folder.join(CANONICAL);
        let canonical = gic_splat::read_ply(&path)?.gaussians;
        let path = folder.join(MOTION);
        if !path.exists() {
            return Ok(DynamicGaussians { canonical, motion: None });
        }
        let file = TensorFile::open(&path)?;
        // The version first: what else the text holds depends on it.
        let Version { schema } = file.text()?;
        if schema != SCHEMA {
            let reason = format!(
                "schema {schema:?} where {SCHEMA:?} is supported; use the gic that wrote it, or `gic reconstruct` again"
            );
            return Err(MotionError::content(&path, reason));
        }
        let mut header: Header = file.text()?;
        if let Some(base) = &mut header.base {
            file.fields("", base)?;
        }
        if let Some(complaint) = header.base.as_ref().and_then(BaseMotion::complaint) {
            return Err(MotionError::content(&path, format!("base motion: {complaint}; write the file anew")));
        }
        let mut network = MotionNetwork::zeros(header.architecture);
        network.parameters = file.numbers_exactly("parameters", network.parameters.len())?;
        Ok(DynamicGaussians {
            canonical,
            motion: Some(Displacement { network, domain: header.domain, base: header.base }),
        })
    }
}

#[cfg(test)]
mod tests {
    use gic_splat::{Gaussians, Shape};
    use glam::DMat3;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::{Affine, Lattice};

    fn model() -> DynamicGaussians {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let n = 20;
        let canonical = Gaussians {
            positions: (0..n).map(|_| core::array::from_fn(|_| rng.random_range(-0.2..0.2))).collect(),
            opacities: (0..n).map(|_| rng.random_range(0.05..0.95)).collect(),
            shape: Shape::Isotropic { scales: (0..n).map(|_| rng.random_range(0.002..0.02)).collect() },
            sh_degree: 1,
            sh: (0..4 * n).map(|_| core::array::from_fn(|_| rng.random_range(-1.0..1.0))).collect(),
        };
        let architecture = Architecture { width: 16, ..Architecture::default() };
        let domain = Domain { centre: [0.1, 0.0, -0.1], extent: 0.4, start: 0.0, duration: 0.5 };
        let network = MotionNetwork::random(architecture, &mut rng);
        let turned = DMat3::from_rotation_x(0.3).to_cols_array();
        let maps = vec![Affine::IDENTITY, Affine { matrix: turned, shift: [0.1, -0.2, 1.0 / 3.0] }];
        let lattice = Lattice { low: [-0.3; 3], cell: 0.2, size: [4; 3] };
        let bend = (0..64).map(|_| core::array::from_fn(|_| rng.random_range(-0.05..0.05))).collect();
        let bends = vec![vec![[0.0; 3]; 64], bend];
        let shades = bends.iter().rev().cloned().collect();
        let base = BaseMotion { origin: [0.1, 0.2, 0.3], times: vec![0.0, 0.5], maps, lattice, bends, shades };
        DynamicGaussians { canonical, motion: Some(Displacement { network, domain, base: Some(base) }) }
    }

    #[test]
    fn what_is_saved_moves_alike_when_loaded() {
        let folder = tempfile::tempdir().unwrap();
        let saved = model();
        saved.save(folder.path()).unwrap();
        let loaded = DynamicGaussians::load(folder.path()).unwrap();
        for time in [0.0, 0.21, 0.5] {
            let (a, b) = (saved.at(time), loaded.at(time));
            assert_eq!(a.positions, b.positions);
            assert_eq!(a.sh, b.sh);
            assert_eq!(a.sh == saved.canonical.sh, time == 0.5, "shaded at {time}");
            let (Shape::Isotropic { scales: a }, Shape::Isotropic { scales: b }) = (&a.shape, &b.shape) else {
                panic!("still isotropic")
            };
            // The file holds logarithms, so the scales come back rounded.
            assert!(a.iter().zip(b).all(|(a, b)| (a / b - 1.0).abs() < 1e-5));
        }
    }

    #[test]
    fn a_base_motion_that_cannot_be_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let mut model = model();
        model.motion.as_mut().unwrap().base.as_mut().unwrap().times = vec![0.5, 0.5];
        model.save(folder.path()).unwrap();
        let error = DynamicGaussians::load(folder.path()).unwrap_err().to_string();
        assert!(error.contains("times must ascend"), "{error}");
    }

    #[test]
    fn another_version_is_named() {
        let folder = tempfile::tempdir().unwrap();
        model().save(folder.path()).unwrap();
        let path = folder.path().join(MOTION);
        tensor_file::write(&path, &[], &serde_json::json!({ "schema": "gic.motion/1" })).unwrap();
        let error = DynamicGaussians::load(folder.path()).unwrap_err().to_string();
        assert!(error.contains("gic.motion/1") && error.contains("gic reconstruct"), "{error}");
    }

    #[test]
    fn saving_twice_gives_the_same_bytes() {
        let (one, two) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        model().save(one.path()).unwrap();
        model().save(two.path()).unwrap();
        for name in [CANONICAL, MOTION] {
            assert_eq!(std::fs::read(one.path().join(name)).unwrap(), std::fs::read(two.path().join(name)).unwrap());
        }
    }

    #[test]
    fn a_static_set_replaces_a_moving_one() {
        let folder = tempfile::tempdir().unwrap();
        let mut model = model();
        model.save(folder.path()).unwrap();
        model.motion = None;
        model.save(folder.path()).unwrap();
        assert!(DynamicGaussians::load(folder.path()).unwrap().motion.is_none());
    }

    #[test]
    fn damaged_files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let missing = DynamicGaussians::load(folder.path()).unwrap_err().to_string();
        assert!(missing.contains(CANONICAL), "{missing}");
        model().save(folder.path()).unwrap();
        let path = folder.path().join(MOTION);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        let cut = DynamicGaussians::load(folder.path()).unwrap_err().to_string();
        assert!(cut.contains(MOTION), "{cut}");
    }
}
