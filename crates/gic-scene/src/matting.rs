//! Masks made from pictures: against the empty background, against a copy over white, by a network.

use std::path::Path;

use crate::error::SceneError;
use crate::picture::{Mask, Picture};

/// A matting network.
#[derive(Clone, Debug)]
pub(crate) struct Network;

impl Network {
    pub(crate) fn open(path: &Path) -> Result<Network, SceneError> {
        let reason = "this build cannot run matting networks; build with `--features onnx`".to_owned();
        Err(SceneError::Matting { path: path.to_owned(), reason })
    }

    pub(crate) fn matte(&self, _: &Picture) -> Result<Mask, SceneError> {
        unreachable!("cannot be opened")
    }
}

/// Coverage a from a picture I and its copy over white W = a I + (1 - a): least squares over the three channels.
pub(crate) fn from_white(picture: &Picture, over_white: &Picture) -> Mask {
    let pairs = picture.rgb.chunks_exact(3).zip(over_white.rgb.chunks_exact(3));
    let coverage = pairs
        .map(|(image, white)| {
            let (mut product, mut square) = (0.0, 0.0);
            for channel in 0..3 {
                product += (1.0 - white[channel]) * (1.0 - image[channel]);
                square += (1.0 - image[channel]) * (1.0 - image[channel]);
            }
            if square > 1e-6 { (product / square).clamp(0.0, 1.0) } else { 0.0 }
        })
        .collect();
    Mask { width: over_white.width, height: over_white.height, coverage }
}

/// The object's coverage in a picture, by comparing it with the picture of the empty background.
pub fn difference_matte(picture: &Picture, background: &Picture) -> Mask {
    let pairs = picture.rgb.chunks_exact(3).zip(background.rgb.chunks_exact(3));
    let coverage = pairs.map(|(a, b)| if (0..3).any(|c| (a[c] - b[c]).abs() > 0.1) { 1.0 } else { 0.0 }).collect();
    Mask { width: picture.width, height: picture.height, coverage }
}
