//! Gaussian splatting.

use std::path::PathBuf;
use std::sync::Arc;

use gic_scene::Camera;
use gic_splat::{Channels, Gaussians, ImageGradients, RenderSettings, Shape, backward};
use glam::{DMat3, DVec2, DVec3};
use numpy::{PyArrayDyn, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyReadonlyArrayDyn};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::shaped;
use crate::waiting::wait_briefly;

/// Attributes of n Gaussians: positions [n, 3], opacities [n], scales [n] or [n, 3], rotations [n, 4] with the latter,
/// spherical harmonics [n, k, 3].
type Attributes<'py> = (
    PyReadonlyArray2<'py, f32>,
    PyReadonlyArray1<'py, f32>,
    PyReadonlyArrayDyn<'py, f32>,
    Option<PyReadonlyArray2<'py, f32>>,
    Option<PyReadonlyArray3<'py, f32>>,
);

/// Width, height, focal lengths, principal point, rotation (world from camera, by rows), centre.
type CameraNumbers = (usize, usize, [f64; 2], [f64; 2], [[f64; 3]; 3], [f64; 3]);

/// A picture of Gaussians and what its gradient needs.
#[pyclass(frozen, module = "gic._gic")]
pub(crate) struct Rendered(Arc<View>);

struct View {
    gaussians: Gaussians,
    camera: Camera,
    settings: RenderSettings,
    rendered: gic_splat::Rendered,
}

/// Draws Gaussians; `channels` is one of `color_alpha_depth`, `color_alpha`, `alpha_depth`, `alpha`.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub(crate) fn render(
    py: Python<'_>,
    attributes: Attributes<'_>,
    camera: CameraNumbers,
    background: [f32; 3],
    channels: &str,
    dilation: f32,
    compensate: bool,
    near: f32,
    max_sh_degree: usize,
) -> PyResult<Rendered> {
    let gaussians = gaussians(attributes)?;
    let camera = pinhole(camera);
    let channels = match channels {
        "color_alpha_depth" => Channels::ColorAlphaDepth,
        "color_alpha" => Channels::ColorAlpha,
        "alpha_depth" => Channels::AlphaDepth,
        "alpha" => Channels::Alpha,
        _ => return Err(PyValueError::new_err(format!("channels cannot be {channels}"))),
    };
    let settings =
        RenderSettings { background, channels, dilation, compensate, near, max_sh_degree, ..RenderSettings::default() };
    let view = wait_briefly(py, move || {
        gaussians.validate()?;
        let rendered = gic_splat::render(&gaussians, &camera, &settings);
        Ok(View { gaussians, camera, settings, rendered })
    })?;
    Ok(Rendered(Arc::new(view)))
}

#[pymethods]
impl Rendered {
    /// Colour [height, width, 3], alpha [height, width] and depth [height, width]; what was not asked for is missing.
    fn pictures<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let View { camera, rendered, .. } = &*self.0;
        let [height, width] = [camera.height, camera.width];
        let pictures = PyDict::new(py);
        if !rendered.color.is_empty() {
            pictures.set_item("color", shaped(py, rendered.color.as_flattened().to_vec(), &[height, width, 3])?)?;
        }
        pictures.set_item("alpha", shaped(py, rendered.alpha.clone(), &[height, width])?)?;
        if !rendered.depth.is_empty() {
            pictures.set_item("depth_m", shaped(py, rendered.depth.clone(), &[height, width])?)?;
        }
        pictures.set_item("rejected", rendered.rejected)?;
        Ok(pictures)
    }

    /// Derivatives of a loss with respect to the Gaussians' attributes; the arguments are its derivatives with respect
    /// to the pictures.
    fn backward<'py>(
        &self,
        py: Python<'py>,
        color: Option<PyReadonlyArray3<'py, f32>>,
        alpha: Option<PyReadonlyArray2<'py, f32>>,
        depth: Option<PyReadonlyArray2<'py, f32>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let mut loss = ImageGradients::default();
        if let Some(color) = color {
            loss.color = color.as_slice()?.as_chunks().0.to_vec();
        }
        if let Some(alpha) = alpha {
            loss.alpha = alpha.as_slice()?.to_vec();
        }
        if let Some(depth) = depth {
            loss.depth = depth.as_slice()?.to_vec();
        }
        let view = self.0.clone();
        let n = view.gaussians.len();
        let found = wait_briefly(py, move || {
            let View { gaussians, camera, settings, rendered } = &*view;
            Ok(backward(gaussians, camera, settings, rendered, &loss))
        })?;
        let dict = attributes(py, found.positions, found.opacities, found.shape, found.sh)?;
        dict.set_item("screen", shaped(py, found.screen, &[n])?)?;
        Ok(dict)
    }
}

/// Gaussians of a PLY file in the 3DGS convention, and what was left out.
#[pyfunction]
pub(crate) fn read_ply(py: Python<'_>, path: PathBuf) -> PyResult<(Bound<'_, PyDict>, Vec<String>)> {
    let read = wait_briefly(py, move || Ok(gic_splat::read_ply(&path)?))?;
    let Gaussians { positions, opacities, shape, sh, .. } = read.gaussians;
    Ok((attributes(py, positions, opacities, shape, sh)?, read.dropped))
}

/// Writes such a file; returns what was changed to fit it.
#[pyfunction]
pub(crate) fn write_ply(py: Python<'_>, path: PathBuf, attributes: Attributes<'_>) -> PyResult<Vec<String>> {
    let gaussians = gaussians(attributes)?;
    wait_briefly(py, move || Ok(gic_splat::write_ply(&path, &gaussians)?))
}

fn attributes(
    py: Python<'_>,
    positions: Vec<[f32; 3]>,
    opacities: Vec<f32>,
    shape: Shape,
    sh: Vec<[f32; 3]>,
) -> PyResult<Bound<'_, PyDict>> {
    let n = positions.len();
    let dict = PyDict::new(py);
    dict.set_item("positions_m", shaped(py, positions.into_flattened(), &[n, 3])?)?;
    dict.set_item("opacities", shaped(py, opacities, &[n])?)?;
    let (scales, rotations): (Bound<'_, PyArrayDyn<f32>>, _) = match shape {
        Shape::Isotropic { scales } => (shaped(py, scales, &[n])?, None),
        Shape::Anisotropic { scales, rotations } => {
            let rotations = shaped(py, rotations.into_flattened(), &[n, 4])?;
            (shaped(py, scales.into_flattened(), &[n, 3])?, Some(rotations))
        }
    };
    dict.set_item("scales_m", scales)?;
    dict.set_item("rotations", rotations)?;
    let per_gaussian = sh.len() / n.max(1);
    let sh = (!sh.is_empty()).then(|| shaped(py, sh.into_flattened(), &[n, per_gaussian, 3])).transpose()?;
    dict.set_item("sh", sh)?;
    Ok(dict)
}

fn gaussians((positions, opacities, scales, rotations, sh): Attributes<'_>) -> PyResult<Gaussians> {
    let shape = match rotations {
        None => Shape::Isotropic { scales: scales.as_slice()?.to_vec() },
        Some(rotations) => Shape::Anisotropic {
            scales: scales.as_slice()?.as_chunks().0.to_vec(),
            rotations: rotations.as_slice()?.as_chunks().0.to_vec(),
        },
    };
    let per_gaussian = sh.as_ref().map_or(1, |sh| sh.as_array().shape()[1]);
    Ok(Gaussians {
        positions: positions.as_slice()?.as_chunks().0.to_vec(),
        opacities: opacities.as_slice()?.to_vec(),
        shape,
        sh_degree: per_gaussian.isqrt() - 1,
        sh: sh.map(|sh| sh.as_slice().map(|numbers| numbers.as_chunks().0.to_vec())).transpose()?.unwrap_or_default(),
    })
}

fn pinhole((width, height, focal, principal, rows, centre): CameraNumbers) -> Camera {
    Camera {
        width,
        height,
        focal: DVec2::from(focal),
        principal: DVec2::from(principal),
        world_from_camera: DMat3::from_cols_array_2d(&rows).transpose(),
        centre: DVec3::from(centre),
    }
}
