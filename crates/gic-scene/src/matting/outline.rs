//! Coverage between 0 and 1 along the object's outline.

use super::background::Shade;
use super::pixel_set::PixelSet;
use crate::picture::Picture;

/// What is known on both sides of the object's outline.
pub(super) struct Outline<'a> {
    pub(super) picture: &'a Picture,
    pub(super) background: &'a Picture,
    /// How deep each pixel lies in shadow, were it background.
    pub(super) shades: &'a [Shade],
    /// What a shadow does to the channels.
    pub(super) tint: [f32; 3],
    /// Pixels certainly inside.
    pub(super) core: &'a PixelSet,
    /// Pixels not certainly outside.
    pub(super) reach: &'a PixelSet,
}

impl Outline<'_> {
    /// Coverage of the pixel in column `x`, row `y`; `None` without pixels inside near by, or where the object has the
    /// background's colour.
    pub(super) fn coverage(&self, x: usize, y: usize) -> Option<f32> {
        let (mut front, mut front_count) = ([0.0; 3], 0.0);
        for radius in [2, 4] {
            self.core.near(x, y, radius, |x, y, inside| {
                if inside {
                    let colour = self.picture.at(x, y);
                    (0..3).for_each(|c| front[c] += colour[c]);
                    front_count += 1.0;
                }
            });
            if front_count > 0.0 {
                break;
            }
        }
        if front_count == 0.0 {
            return None;
        }
        let (mut depth, mut count) = (0.0, 0.0);
        self.reach.near(x, y, 3, |x, y, inside| {
            if !inside {
                depth += self.shades[y * self.reach.width + x].depth;
                count += 1.0;
            }
        });
        let depth = if count > 0.0 { depth / count } else { 0.0 };
        let (image, behind) = (self.picture.at(x, y), self.background.at(x, y));
        let (mut product, mut square) = (0.0, 0.0);
        for c in 0..3 {
            let back = behind[c] * (1.0 - depth * self.tint[c]);
            let step = front[c] / front_count - back;
            product += (image[c] - back) * step;
            square += step * step;
        }
        (square > 1e-4).then(|| (product / square).clamp(0.0, 1.0))
    }
}
