//! The state of a training run on disk, so that a run that was killed continues where it was.

use std::path::Path;

use gic_files::FileError;
use gic_optimize::Moments;
use serde::{Deserialize, Serialize};

use super::state::{Best, Learned, Mean, State};
use crate::base::fit::{BaseFit, PoseMoments};
use crate::gaussians::density::ScreenGradients;
use crate::gaussians::parameters::{ParameterMoments, Parameters, rest_per_gaussian};
use crate::gaussians::smoothing::SmoothingGraph;
use crate::tensor_file::{self, TensorFile};
use crate::{BaseMotion, Domain, GaussianShape, MotionError, MotionNetwork, TrainSettings};

const FILE: &str = "checkpoint.safetensors";

/// What is no tensor, and what tells whether the checkpoint belongs to this run.
#[derive(Serialize, Deserialize)]
struct Header {
    seed: u64,
    settings: TrainSettings,
    step: usize,
    domain: Domain,
    spacing: f64,
    network_steps: usize,
    base: Option<BaseHeader>,
    anchors: usize,
    mean_loss: Option<f64>,
    lowest_loss: Option<f64>,
    stale: usize,
    gaussians: usize,
    /// Steps in the mean.
    averaged: Option<usize>,
    best: Option<(f64, usize)>,
    best_base: Option<BaseMotion>,
}

/// What of [`BaseFit`] is no tensor.
#[derive(Serialize, Deserialize)]
struct BaseHeader {
    motion: BaseMotion,
    explained: usize,
    /// Adam's steps of the map, the bend and the shade, per frame.
    steps: Vec<[usize; 3]>,
}

/// Saves the state into `folder`, which is made if it is missing.
pub(crate) fn save(folder: &Path, state: &State, settings: &TrainSettings, seed: u64) -> Result<(), MotionError> {
    std::fs::create_dir_all(folder).map_err(FileError::write(folder))?;
    let header = Header {
        seed,
        settings: settings.clone(),
        step: state.step,
        domain: state.domain,
        spacing: state.spacing,
        network_steps: state.network_steps,
        base: state.base.as_ref().map(|base| BaseHeader {
            motion: base.motion.clone(),
            explained: base.explained,
            steps: base.fits.iter().map(|fit| [fit.map_steps, fit.bend_steps, fit.shade_steps]).collect(),
        }),
        anchors: state.smoothing_graph.positions().len(),
        mean_loss: state.mean_loss.is_finite().then_some(state.mean_loss),
        lowest_loss: state.lowest_loss,
        stale: state.stale,
        gaussians: state.parameters.len(),
        averaged: state.mean.as_ref().map(|mean| mean.steps),
        best: state.best.as_ref().map(|best| (best.psnr, best.learned.parameters.len())),
        best_base: state.best.as_ref().and_then(|best| best.base.clone()),
    };
    let base = state.base.as_ref().map(|base| &base.motion);
    let best_base = state.best.as_ref().and_then(|best| best.base.as_ref());
    let field = |base: Option<&BaseMotion>, of: fn(&BaseMotion) -> &Vec<Vec<[f32; 3]>>| {
        base.map_or(Vec::new(), |base| of(base).concat())
    };
    let (bends, shades) = (field(base, |base| &base.bends), field(base, |base| &base.shades));
    let (best_bends, best_shades) = (field(best_base, |base| &base.bends), field(best_base, |base| &base.shades));
    let mut tensors: Vec<(String, usize, &[f32])> = vec![
        ("bends".into(), 3, bends.as_flattened()),
        ("shades".into(), 3, shades.as_flattened()),
        ("best.bends".into(), 3, best_bends.as_flattened()),
        ("best.shades".into(), 3, best_shades.as_flattened()),
    ];
    for (frame, fit) in state.base.iter().flat_map(|base| &base.fits).enumerate() {
        push_moments(&mut tensors, &format!("map.{frame}"), &fit.map);
        push_moments(&mut tensors, &format!("bend.{frame}"), &fit.bend);
        push_moments(&mut tensors, &format!("shade.{frame}"), &fit.shade);
    }
    push_parameters(&mut tensors, "", &state.parameters);
    tensors.push(("network".into(), 1, &state.network.parameters));
    push_moments(&mut tensors, "network", &state.network_moments);
    push_moments(&mut tensors, "positions", &state.moments.positions);
    push_moments(&mut tensors, "log_scales", &state.moments.log_scales);
    push_moments(&mut tensors, "rotations", &state.moments.rotations);
    push_moments(&mut tensors, "opacity_logits", &state.moments.opacity_logits);
    push_moments(&mut tensors, "features", &state.moments.sh_dc);
    push_moments(&mut tensors, "details", &state.moments.sh_rest);
    tensors.push(("anchors".into(), 3, state.smoothing_graph.positions().as_flattened()));
    tensors.push(("screen.sum".into(), 1, &state.screen.sum));
    tensors.push(("screen.views".into(), 1, &state.screen.views));
    let mean = state.mean.as_ref().map(|mean| ("mean.", &mean.learned));
    let best = state.best.as_ref().map(|best| ("best.", &best.learned));
    for (prefix, learned) in mean.into_iter().chain(best) {
        push_parameters(&mut tensors, prefix, &learned.parameters);
        tensors.push((format!("{prefix}network"), 1, &learned.network));
    }
    tensor_file::write(&folder.join(FILE), &tensors, &header)
}

/// The state saved in `folder`; `None` when there is none.
///
/// # Errors
/// When the checkpoint cannot be read, or belongs to other settings or another seed.
pub(crate) fn load(
    folder: &Path,
    settings: &TrainSettings,
    seed: u64,
    sh_degree: usize,
) -> Result<Option<State>, MotionError> {
    let path = folder.join(FILE);
    if !path.exists() {
        return Ok(None);
    }
    let file = TensorFile::open(&path)?;
    let header: Header = file.text()?;
    if header.settings != *settings || header.seed != seed {
        let reason =
            "was made with other settings or another seed; give the same ones, or remove the file to start anew";
        return Err(MotionError::content(&path, reason));
    }
    let mut network = MotionNetwork::zeros(settings.network);
    let weights = network.parameters.len();
    network.parameters = file.numbers_exactly("network", weights)?;
    let n = header.gaussians;
    let details = n * rest_per_gaussian(sh_degree);
    let (axes, turned) = axes_and_rotations(settings.shape);
    let kind = (sh_degree, settings.shape);
    let base = header.base.map(|base| restored(&file, base)).transpose()?;
    let best_base = match header.best_base {
        Some(mut motion) => {
            file.fields("best.", &mut motion)?;
            Some(motion)
        }
        None => None,
    };
    let learned = |prefix: &str, n: usize| {
        let parameters = parameters(&file, prefix, n, kind)?;
        Ok::<_, MotionError>(Learned {
            parameters,
            network: file.numbers_exactly(&format!("{prefix}network"), weights)?,
        })
    };
    let best = match header.best {
        Some((psnr, n)) => Some(Best { psnr, learned: learned("best.", n)?, base: best_base }),
        None => None,
    };
    let mean = match header.averaged {
        Some(steps) => Some(Mean { learned: learned("mean.", n)?, steps }),
        None => None,
    };
    Ok(Some(State {
        step: header.step,
        domain: header.domain,
        spacing: header.spacing,
        parameters: parameters(&file, "", n, kind)?,
        moments: ParameterMoments {
            positions: moments(&file, "positions", 3 * n)?,
            log_scales: moments(&file, "log_scales", axes * n)?,
            rotations: moments(&file, "rotations", 4 * turned * n)?,
            opacity_logits: moments(&file, "opacity_logits", n)?,
            sh_dc: moments(&file, "features", 3 * n)?,
            sh_rest: moments(&file, "details", 3 * details)?,
        },
        network,
        network_moments: moments(&file, "network", weights)?,
        network_steps: header.network_steps,
        screen: ScreenGradients {
            sum: file.numbers_exactly("screen.sum", n)?,
            views: file.numbers_exactly("screen.views", n)?,
        },
        base,
        smoothing_graph: SmoothingGraph::new(file.triples("anchors", header.anchors)?, header.spacing),
        mean_loss: header.mean_loss.unwrap_or(f64::NAN),
        lowest_loss: header.lowest_loss,
        mean,
        best,
        stale: header.stale,
    }))
}

fn restored(file: &TensorFile, header: BaseHeader) -> Result<BaseFit, MotionError> {
    let BaseHeader { mut motion, explained, steps } = header;
    file.fields("", &mut motion)?;
    let fit = |(frame, &[map_steps, bend_steps, shade_steps]): (usize, &[usize; 3])| {
        let map = moments(file, &format!("map.{frame}"), 12)?;
        let bend = moments(file, &format!("bend.{frame}"), 3 * motion.lattice.nodes())?;
        let shade = moments(file, &format!("shade.{frame}"), 3 * motion.lattice.nodes())?;
        Ok(PoseMoments { map, map_steps, bend, bend_steps, shade, shade_steps })
    };
    let fits = steps.iter().enumerate().map(fit).collect::<Result<_, MotionError>>()?;
    Ok(BaseFit::new(motion, fits, explained))
}

fn push_parameters<'a>(tensors: &mut Vec<(String, usize, &'a [f32])>, prefix: &str, p: &'a Parameters) {
    let mut push = |name: &str, columns, data| tensors.push((format!("{prefix}{name}"), columns, data));
    push("positions", 3, p.positions.as_flattened());
    push("log_scales", 1, p.log_scales.as_slice());
    push("rotations", 4, p.rotations.as_flattened());
    push("opacity_logits", 1, p.opacity_logits.as_slice());
    push("features", 3, p.sh_dc.as_flattened());
    push("details", 3, p.sh_rest.as_flattened());
}

/// Scales and rotations per Gaussian.
fn axes_and_rotations(shape: GaussianShape) -> (usize, usize) {
    match shape {
        GaussianShape::Isotropic => (1, 0),
        GaussianShape::Anisotropic => (3, 1),
    }
}

fn parameters(
    file: &TensorFile,
    prefix: &str,
    n: usize,
    (sh_degree, shape): (usize, GaussianShape),
) -> Result<Parameters, MotionError> {
    let name = |name: &str| format!("{prefix}{name}");
    let (axes, turned) = axes_and_rotations(shape);
    let rotations = file.numbers_exactly(&name("rotations"), 4 * turned * n)?;
    Ok(Parameters {
        positions: file.triples(&name("positions"), n)?,
        log_scales: file.numbers_exactly(&name("log_scales"), axes * n)?,
        rotations: rotations.as_chunks().0.to_vec(),
        opacity_logits: file.numbers_exactly(&name("opacity_logits"), n)?,
        sh_dc: file.triples(&name("features"), n)?,
        sh_rest: file.triples(&name("details"), n * rest_per_gaussian(sh_degree))?,
        sh_degree,
    })
}

fn push_moments<'a>(tensors: &mut Vec<(String, usize, &'a [f32])>, name: &str, moments: &'a Moments) {
    tensors.push((format!("{name}.first"), 1, &moments.first));
    tensors.push((format!("{name}.second"), 1, &moments.second));
}

fn moments(file: &TensorFile, name: &str, len: usize) -> Result<Moments, MotionError> {
    Ok(Moments {
        first: file.numbers_exactly(&format!("{name}.first"), len)?,
        second: file.numbers_exactly(&format!("{name}.second"), len)?,
    })
}
