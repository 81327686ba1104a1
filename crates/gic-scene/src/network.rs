//! Masks from a matting network that the user gives as an ONNX file (cargo feature `onnx`).
//!
//! The network has one input, shape [1, 3, height, width], red, green, blue scaled to [-1, 1] (as MODNet takes it), and
//! gives the object's coverage in [0, 1] as its first output, shape [1, 1, h, w] or [1, h, w]. A network with a fixed
//! input size sees the picture resized to it; any other sees it resized to the next multiples of 32 pixels, which
//! encoders need.

#[cfg(feature = "onnx")]
pub(crate) use runtime::Network;
#[cfg(not(feature = "onnx"))]
pub(crate) use stub::Network;

#[cfg(not(feature = "onnx"))]
mod stub {
    use std::convert::Infallible;
    use std::path::Path;

    use crate::error::SceneError;
    use crate::picture::{Mask, Picture};

    /// Without the feature there is none.
    #[derive(Clone, Debug)]
    pub(crate) struct Network(Infallible);

    impl Network {
        pub(crate) fn open(path: &Path) -> Result<Network, SceneError> {
            let reason = "this build cannot run matting networks; build gic with `--features onnx`, or make the \
                          masks with another tool and store them as mask files";
            Err(SceneError::Matting { path: path.to_owned(), reason: reason.to_owned() })
        }

        pub(crate) fn matte(&self, _: &Picture) -> Result<Mask, SceneError> {
            match self.0 {}
        }
    }
}

#[cfg(feature = "onnx")]
mod runtime {
    use std::collections::BTreeMap;
    use std::path::{Path, PathBuf};
    use std::sync::{Arc, Mutex, PoisonError};

    use tract_onnx::prelude::*;
    use tract_onnx::tract_hir::infer::Factoid;
    use tract_onnx::tract_hir::internal::DimLike;

    use crate::error::SceneError;
    use crate::picture::{Mask, Picture};

    /// Sizes of pictures are rounded up to this [pixels] where the network leaves the size open.
    const STRIDE: usize = 32;

    /// A loaded network, with a plan for each input size met so far.
    #[derive(Clone)]
    pub(crate) struct Network {
        path: PathBuf,
        model: Arc<InferenceModel>,
        /// Width and height of the input, if the network fixes them.
        fixed: Option<(usize, usize)>,
        plans: Arc<Mutex<BTreeMap<(usize, usize), Arc<TypedRunnableModel>>>>,
    }

    impl std::fmt::Debug for Network {
        fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            f.debug_struct("Network").field("path", &self.path).field("fixed", &self.fixed).finish_non_exhaustive()
        }
    }

    impl Network {
        /// Loads the network, and refuses one with another kind of input.
        pub(crate) fn open(path: &Path) -> Result<Network, SceneError> {
            let failed = |reason: String| SceneError::Matting { path: path.to_owned(), reason };
            let model = tract_onnx::onnx().model_for_path(path).map_err(|error| failed(format!("{error:#}")))?;
            let inputs = model.input_outlets().map_err(|error| failed(format!("{error:#}")))?.len();
            if inputs != 1 {
                return Err(failed(format!("the network has {inputs} inputs; one picture is what it will get")));
            }
            let fact = model.input_fact(0).map_err(|error| failed(format!("{error:#}")))?;
            let sides: Vec<Option<usize>> =
                fact.shape.dims().map(|dim| dim.concretize().and_then(|dim| dim.to_usize().ok())).collect();
            let fixed = match sides[..] {
                [_, Some(3), Some(height), Some(width)] => Some((width, height)),
                [_, Some(3) | None, _, _] | [] => None,
                _ => return Err(failed("the input must have the shape [1, 3, height, width]".to_owned())),
            };
            Ok(Network { path: path.to_owned(), model: Arc::new(model), fixed, plans: Arc::default() })
        }

        /// The object's coverage in a picture.
        pub(crate) fn matte(&self, picture: &Picture) -> Result<Mask, SceneError> {
            let size = self
                .fixed
                .unwrap_or_else(|| (picture.width.next_multiple_of(STRIDE), picture.height.next_multiple_of(STRIDE)));
            let failed = |reason: String| SceneError::Matting { path: self.path.clone(), reason };
            let small = self.run(picture, size).map_err(|error| failed(format!("{error:#}")))?;
            // Positive phrasing: NaN fails.
            if !small.coverage.iter().all(|&value| (-0.01..=1.01).contains(&value)) {
                return Err(failed("the first output is no coverage between 0 and 1".to_owned()));
            }
            let (scale_x, scale_y) =
                (small.width as f64 / picture.width as f64, small.height as f64 / picture.height as f64);
            let coverage = (0..picture.width * picture.height)
                .map(|i| {
                    let (x, y) = ((i % picture.width) as f64 + 0.5, (i / picture.width) as f64 + 0.5);
                    small.sample(x * scale_x, y * scale_y).clamp(0.0, 1.0)
                })
                .collect();
            Ok(Mask { width: picture.width, height: picture.height, coverage })
        }

        fn run(&self, picture: &Picture, (width, height): (usize, usize)) -> TractResult<Mask> {
            let (scale_x, scale_y) = (picture.width as f64 / width as f64, picture.height as f64 / height as f64);
            let mut planes = vec![0.0_f32; 3 * width * height];
            for y in 0..height {
                for x in 0..width {
                    let at = ((x as f64 + 0.5) * scale_x, (y as f64 + 0.5) * scale_y);
                    let colour = picture.sample(at.0, at.1).unwrap_or_default();
                    for channel in 0..3 {
                        planes[(channel * height + y) * width + x] = 2.0 * colour[channel] - 1.0;
                    }
                }
            }
            let input = Tensor::from_shape(&[1, 3, height, width], &planes)?;
            let outputs = self.plan(width, height)?.run(tvec!(input.into()))?;
            let view = outputs[0].to_plain_array_view::<f32>()?;
            let shape = view.shape();
            match *shape {
                [1, 1, height, width] | [1, height, width] => {
                    Ok(Mask { width, height, coverage: view.iter().copied().collect() })
                }
                _ => {
                    Err(TractError::msg(format!("the first output has the shape {shape:?}, not [1, 1, height, width]")))
                }
            }
        }

        fn plan(&self, width: usize, height: usize) -> TractResult<Arc<TypedRunnableModel>> {
            let mut plans = self.plans.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(plan) = plans.get(&(width, height)) {
                return Ok(plan.clone());
            }
            let fact = f32::fact([1, 3, height, width]).into();
            let plan =
                InferenceModel::clone(&self.model).with_input_fact(0, fact)?.into_optimized()?.into_runnable()?;
            plans.insert((width, height), plan.clone());
            Ok(plan)
        }
    }
}
