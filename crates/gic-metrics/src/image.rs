//! Pixel-wise metrics: PSNR of colours, intersection over union of masks.

use crate::MetricError;
use crate::error::same_length;

/// A rectangle of pixels: columns `left..right`, rows `top..bottom`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rectangle {
    /// First column.
    pub left: usize,
    /// First row.
    pub top: usize,
    /// One past the last column.
    pub right: usize,
    /// One past the last row.
    pub bottom: usize,
}

impl Rectangle {
    /// The whole image.
    pub fn whole(width: usize, height: usize) -> Rectangle {
        Rectangle { left: 0, top: 0, right: width, bottom: height }
    }

    /// The smallest rectangle that holds every pixel of a mask above zero, widened by `margin` pixels and clipped to
    /// the image; `None` when the mask is empty.
    pub fn around_mask(mask: &[f32], width: usize, height: usize, margin: usize) -> Option<Rectangle> {
        let mut found: Option<Rectangle> = None;
        for (y, row) in mask.chunks_exact(width.max(1)).enumerate().take(height) {
            let Some(first) = row.iter().position(|&m| m > 0.0) else { continue };
            let last = row.iter().rposition(|&m| m > 0.0).unwrap_or(first);
            let old = found.unwrap_or(Rectangle { left: first, top: y, right: last + 1, bottom: y + 1 });
            found = Some(Rectangle { left: old.left.min(first), right: old.right.max(last + 1), bottom: y + 1, ..old });
        }
        found.map(|r| Rectangle {
            left: r.left.saturating_sub(margin),
            top: r.top.saturating_sub(margin),
            right: (r.right + margin).min(width),
            bottom: (r.bottom + margin).min(height),
        })
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        self.right - self.left
    }

    /// Number of rows.
    pub fn height(&self) -> usize {
        self.bottom - self.top
    }

    /// The rectangle, or the whole image where none is given; checked to be inside an image of that size and not empty.
    pub(crate) fn resolve(region: Option<Rectangle>, width: usize, height: usize) -> Result<Rectangle, MetricError> {
        let r = region.unwrap_or(Rectangle::whole(width, height));
        if r.left < r.right && r.right <= width && r.top < r.bottom && r.bottom <= height {
            Ok(r)
        } else {
            let Rectangle { left, top, right, bottom } = r;
            Err(MetricError::Rectangle { left, right, top, bottom, width, height })
        }
    }
}

/// Peak signal-to-noise ratio [dB] for a peak of 1: `-10 log10(mean squared error)` over the pixels and channels of
/// `region` (the whole image if `None`); infinite where the images are equal.
pub fn psnr(
    image: &[[f32; 3]],
    reference: &[[f32; 3]],
    width: usize,
    height: usize,
    region: Option<Rectangle>,
) -> Result<f64, MetricError> {
    same_length("image", image.len(), width * height)?;
    same_length("reference image", reference.len(), width * height)?;
    let r = Rectangle::resolve(region, width, height)?;
    let mut sum = 0.0f64;
    for y in r.top..r.bottom {
        let row = y * width + r.left..y * width + r.right;
        for (a, b) in image[row.clone()].iter().zip(&reference[row]) {
            for c in 0..3 {
                let difference = f64::from(a[c]) - f64::from(b[c]);
                sum += difference * difference;
            }
        }
    }
    let mean = sum / (3 * r.width() * r.height()) as f64;
    if mean.is_finite() {
        Ok(-10.0 * mean.log10())
    } else {
        Err(MetricError::NotFinite { what: "mean squared error of the images", index: 0 })
    }
}

/// Intersection over union of two masks, a pixel being inside where its coverage is at least one half; 1 where both are
/// empty.
pub fn mask_iou(mask: &[f32], reference: &[f32]) -> Result<f64, MetricError> {
    same_length("mask", mask.len(), reference.len())?;
    let (mut both, mut either) = (0usize, 0usize);
    for (&a, &b) in mask.iter().zip(reference) {
        both += usize::from(a >= 0.5 && b >= 0.5);
        either += usize::from(a >= 0.5 || b >= 0.5);
    }
    Ok(if either == 0 { 1.0 } else { both as f64 / either as f64 })
}

/// Intersection over union of two antialiased masks without a threshold: sum of the smaller coverage over sum of the
/// larger; 1 where both are empty.
pub fn soft_iou(mask: &[f32], reference: &[f32]) -> Result<f64, MetricError> {
    same_length("mask", mask.len(), reference.len())?;
    let (mut both, mut either) = (0.0f64, 0.0f64);
    for (&a, &b) in mask.iter().zip(reference) {
        both += f64::from(a.min(b));
        either += f64::from(a.max(b));
    }
    Ok(if either > 0.0 { both / either } else { 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn psnr_of_a_known_error() {
        let a = vec![[0.5f32, 0.25, 0.75]; 12];
        let mut b = a.clone();
        for p in &mut b {
            p[0] += 0.125;
        }
        // Mean squared error = 0.125^2 / 3.
        let expected = -10.0 * (0.015625f64 / 3.0).log10();
        assert!((psnr(&a, &b, 4, 3, None).unwrap() - expected).abs() < 1e-9);
        assert_eq!(psnr(&a, &a, 4, 3, None).unwrap(), f64::INFINITY);
    }

    #[test]
    fn psnr_sees_only_the_rectangle() {
        let a = vec![[0.0f32; 3]; 12];
        let mut b = a.clone();
        b[0] = [1.0; 3];
        let r = Rectangle { left: 1, top: 1, right: 4, bottom: 3 };
        assert_eq!(psnr(&a, &b, 4, 3, Some(r)).unwrap(), f64::INFINITY);
        assert!(psnr(&a, &b, 4, 3, Some(Rectangle { right: 5, ..r })).is_err());
        assert!(psnr(&a, &b, 4, 2, None).is_err());
    }

    #[test]
    fn a_nan_pixel_is_an_error() {
        let a = vec![[0.0f32; 3]; 4];
        let mut b = a.clone();
        b[2][1] = f32::NAN;
        assert!(matches!(psnr(&a, &b, 2, 2, None), Err(MetricError::NotFinite { .. })));
    }

    #[test]
    fn iou_of_overlapping_halves() {
        let a = [1.0, 1.0, 0.6, 0.0];
        let b = [0.0, 1.0, 0.5, 0.4];
        assert_eq!(mask_iou(&a, &b).unwrap(), 2.0 / 3.0);
        assert_eq!(mask_iou(&[0.0; 3], &[0.0; 3]).unwrap(), 1.0);
        assert!((soft_iou(&a, &b).unwrap() - 1.5 / 3.0).abs() < 1e-6);
    }

    #[test]
    fn rectangle_around_a_mask() {
        let mut mask = vec![0.0f32; 30];
        mask[6 + 2] = 0.1; // row 1, column 2
        mask[18 + 4] = 1.0; // row 3, column 4
        let r = Rectangle::around_mask(&mask, 6, 5, 0).unwrap();
        assert_eq!(r, Rectangle { left: 2, top: 1, right: 5, bottom: 4 });
        let wide = Rectangle::around_mask(&mask, 6, 5, 10).unwrap();
        assert_eq!(wide, Rectangle::whole(6, 5));
        assert_eq!(Rectangle::around_mask(&[0.0; 30], 6, 5, 1), None);
    }
}
