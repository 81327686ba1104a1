//! AprilTags of the family 36h11 in a picture, by the AprilTag 3 library (Olson 2011; Wang and Olson 2016).

use std::ffi::c_int;
use std::ptr;

use apriltag_sys as c;
use image::{ImageBuffer, Luma, imageops};

use crate::grey::Grey;
use crate::tuning::{LARGEST_ENLARGED_PX, LEAST_DECISION_MARGIN, MOST_ENLARGED, MOST_WRONG_BITS};

/// A tag in a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Sighting {
    /// Its number in the family.
    pub id: u32,
    /// The corners of its black square [pixels], from its lower left one against the clock.
    pub corners: [[f64; 2]; 4],
    /// Width of its black border, in modules.
    pub border: usize,
}

/// Side of a tag's data [modules].
pub(crate) const DATA_MODULES: usize = 6;

/// A tag family of the library; freed with it.
struct Family {
    pointer: *mut c::apriltag_family_t,
    free: unsafe extern "C" fn(*mut c::apriltag_family_t),
}

impl Family {
    /// 36h11 with a black border of one module (AprilTag) or two (Kalibr).
    fn tag36h11(border: u32) -> Family {
        // SAFETY: the library hands out a family of its own with `nbits` places; moving them to the inner square of a
        // wider border keeps every place inside the tag.
        let pointer = unsafe {
            let family = c::tag36h11_create();
            let wider = border - 1;
            (*family).width_at_border += 2 * wider as c_int;
            (*family).total_width += 2 * wider as c_int;
            for bit in 0..(*family).nbits as usize {
                *(*family).bit_x.add(bit) += wider;
                *(*family).bit_y.add(bit) += wider;
            }
            family
        };
        Family { pointer, free: c::tag36h11_destroy }
    }
}

impl Drop for Family {
    fn drop(&mut self) {
        // SAFETY: the pointer comes from the creator that belongs to `free`, and no detector is left that has it.
        unsafe { (self.free)(self.pointer) };
    }
}

/// The dark modules of tag `id` inside its border, rows from the top, shape [6][6]; `None` for a number that the family
/// does not have.
pub(crate) fn dark_modules(id: u32) -> Option<[[bool; DATA_MODULES]; DATA_MODULES]> {
    let family = Family::tag36h11(1);
    let mut dark = [[true; DATA_MODULES]; DATA_MODULES];
    // SAFETY: the library's tables have `ncodes` codes and `nbits` places.
    unsafe {
        let table = &*family.pointer;
        if id >= table.ncodes {
            return None;
        }
        let code = *table.codes.add(id as usize);
        for bit in 0..table.nbits as usize {
            let (x, y) = (*table.bit_x.add(bit) as usize - 1, *table.bit_y.add(bit) as usize - 1);
            dark[y][x] = code >> (table.nbits as usize - 1 - bit) & 1 == 0;
        }
    }
    Some(dark)
}

/// Finds tags of 36h11 with a black border of one module, or of two as Kalibr has them; a number that is seen twice is
/// left out.
pub fn find_tags(picture: &Grey, border: usize) -> Vec<Sighting> {
    let families = [Family::tag36h11(border as u32)];
    // Tags of another border look like some of these with a wrong bit.
    let wrong_bits = if border == 1 { MOST_WRONG_BITS } else { 0 };
    let mut tags = find(picture, &families, wrong_bits, false);
    if border > 1 {
        // Kalibr's tags touch the squares between them; a little more white parts them.
        let parted = find(picture, &families, wrong_bits, true);
        let new = parted.into_iter().filter(|tag| tags.iter().all(|other| other.id != tag.id));
        let new: Vec<Sighting> = new.collect();
        tags.extend(new);
        tags.sort_by_key(|tag| tag.id);
    }
    tags
}

/// The name of another family whose tags are in the picture.
pub(crate) fn other_family(picture: &Grey, border: usize) -> Option<&'static str> {
    // SAFETY: creators have no conditions.
    let others = unsafe {
        [
            ("36h11 with a black border of another width", Family::tag36h11(3 - border as u32)),
            ("25h9", Family { pointer: c::tag25h9_create(), free: c::tag25h9_destroy }),
            ("Standard41h12", Family { pointer: c::tagStandard41h12_create(), free: c::tagStandard41h12_destroy }),
        ]
    };
    let found =
        others.into_iter().find(|(_, family)| !find(picture, std::slice::from_ref(family), 0, false).is_empty());
    found.map(|(name, _)| name)
}

fn find(picture: &Grey, families: &[Family], wrong_bits: u32, has_more_white: bool) -> Vec<Sighting> {
    let factor = (LARGEST_ENLARGED_PX / picture.width.max(picture.height)).clamp(1, MOST_ENLARGED);
    let mut bytes = enlarged(picture, factor);
    if has_more_white {
        bytes = with_more_white(&bytes, picture.width * factor);
    }
    let (width, height) = ((picture.width * factor) as c_int, (picture.height * factor) as c_int);
    let mut found = Vec::new();
    // SAFETY: the picture's bytes and the families outlive the detector, which only reads them; lists and detections
    // are freed as the library demands, the detector after its families are taken from it.
    unsafe {
        let detector = c::apriltag_detector_create();
        for family in families {
            c::apriltag_detector_add_family_bits(detector, family.pointer, wrong_bits as c_int);
        }
        (*detector).quad_decimate = 1.0;
        (*detector).nthreads = 1;
        (*detector).refine_edges = true;
        let mut view = c::image_u8 { width, height, stride: width, buf: bytes.as_mut_ptr() };
        let list = c::apriltag_detector_detect(detector, ptr::from_mut(&mut view).cast());
        let entries = (*list).data.cast::<*mut c::apriltag_detection_t>();
        for n in 0..(*list).size as usize {
            let detection = &**entries.add(n);
            if detection.decision_margin > LEAST_DECISION_MARGIN {
                found.push(Sighting {
                    id: detection.id as u32,
                    corners: detection.p.map(|corner| corner.map(|value| value / factor as f64)),
                    border: ((*detection.family).width_at_border as usize - DATA_MODULES) / 2,
                });
            }
        }
        c::apriltag_detections_destroy(list);
        c::apriltag_detector_clear_families(detector);
        c::apriltag_detector_destroy(detector);
    }
    let is_single = |tag: &Sighting| found.iter().filter(|other| other.id == tag.id).count() == 1;
    let mut single: Vec<Sighting> = found.iter().filter(|tag| is_single(tag)).cloned().collect();
    single.sort_by_key(|tag| tag.id);
    single
}

/// The picture's bytes, `factor` times as large: Lanczos' filter keeps modules of two pixels apart.
fn enlarged(picture: &Grey, factor: usize) -> Vec<u8> {
    let (width, height) = (picture.width as u32, picture.height as u32);
    // The filter keeps its values within 0 and 1.
    let shares: Vec<f32> = picture.values.iter().map(|value| value / 255.0).collect();
    let Some(grey) = ImageBuffer::<Luma<f32>, _>::from_raw(width, height, shares) else { return Vec::new() };
    let larger = match factor {
        1 => grey,
        _ => imageops::resize(&grey, width * factor as u32, height * factor as u32, imageops::FilterType::Lanczos3),
    };
    larger.into_raw().into_iter().map(|value| (value * 255.0).round().clamp(0.0, 255.0) as u8).collect()
}

/// Each pixel as bright as the brightest around it.
fn with_more_white(bytes: &[u8], width: usize) -> Vec<u8> {
    let height = bytes.len() / width;
    let around = |n: usize, size: usize| n.saturating_sub(1)..(n + 2).min(size);
    let brightest = |n: usize| {
        let rows = around(n / width, height).flat_map(|y| around(n % width, width).map(move |x| y * width + x));
        rows.map(|at| bytes[at]).max().unwrap_or_default()
    };
    (0..bytes.len()).map(brightest).collect()
}
