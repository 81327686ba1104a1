//! Grey pictures: what a still camera sees of a still board, averaged over its film.

use gic_film::Frame;

/// A grey picture, row by row. Pixel centres lie at +0.5.
#[derive(Clone, Debug, PartialEq)]
pub struct Grey {
    /// Width [pixels].
    pub width: usize,
    /// Height [pixels].
    pub height: usize,
    /// Brightness, 0 to 255, shape [height * width].
    pub values: Vec<f32>,
}

impl Grey {
    /// The mean of a frame's colours.
    pub fn of(frame: &Frame) -> Grey {
        let values = frame.rgb.chunks_exact(3).map(|rgb| rgb.iter().map(|&v| f32::from(v)).sum::<f32>() / 3.0);
        Grey { width: frame.width, height: frame.height, values: values.collect() }
    }

    /// The mean over frames of each pixel's middle half: noise goes, and so does what moves past. `None` for no frames.
    pub fn still(frames: &[Grey]) -> Option<Grey> {
        let first = frames.first()?;
        let mut sorted = vec![0.0f32; frames.len()];
        let outer = frames.len() / 4;
        let middle = |pixel: usize| {
            sorted.iter_mut().zip(frames).for_each(|(value, frame)| *value = frame.values[pixel]);
            sorted.sort_unstable_by(f32::total_cmp);
            let kept = &sorted[outer..frames.len() - outer];
            kept.iter().sum::<f32>() / kept.len() as f32
        };
        Some(Grey { values: (0..first.values.len()).map(middle).collect(), ..*first })
    }
}
