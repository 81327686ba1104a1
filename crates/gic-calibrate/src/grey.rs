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

    /// Brightness at a place [pixels], bilinear, the border's beyond it.
    pub fn sample(&self, x: f64, y: f64) -> f64 {
        let place = |value: f64, size: usize| {
            let value = (value - 0.5).clamp(0.0, (size - 1) as f64);
            let low = (value as usize).min(size.saturating_sub(2));
            (low, (low + 1).min(size - 1), value - low as f64)
        };
        let ((x0, x1, fx), (y0, y1, fy)) = (place(x, self.width), place(y, self.height));
        let at = |x: usize, y: usize| f64::from(self.values[y * self.width + x]);
        let row = |y: usize| at(x0, y) * (1.0 - fx) + at(x1, y) * fx;
        row(y0) * (1.0 - fy) + row(y1) * fy
    }
}
