//! Whether a JPEG file is whole: decoders fill what is missing with grey, and say nothing.

const START: u8 = 0xd8;
const END: u8 = 0xd9;
const SCAN: u8 = 0xda;

/// Whether the bytes begin as a JPEG file does.
pub(crate) fn is_jpeg(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0xff, START, 0xff])
}

/// Whether a JPEG file goes on to its end: walks its segments, and after each start of a scan its coded bytes, until
/// the end of the picture. Pictures inside of segments, such as previews, are passed over.
pub(crate) fn is_whole(bytes: &[u8]) -> bool {
    let mut at = 2;
    while let Some((marker, behind)) = next_marker(bytes, at) {
        match marker {
            END => return true,
            START | 0x01 | 0xd0..=0xd7 => at = behind,
            _ => {
                let Some(length) = bytes.get(behind..behind + 2) else { return false };
                at = behind + usize::from(u16::from_be_bytes([length[0], length[1]]));
                if marker == SCAN {
                    at = end_of_scan(bytes, at);
                }
            }
        }
    }
    false
}

/// The next marker from `at` on, and where its content begins; fill bytes may stand before it.
fn next_marker(bytes: &[u8], at: usize) -> Option<(u8, usize)> {
    let start = at + bytes.get(at..)?.iter().position(|&byte| byte == 0xff)?;
    let code = start + bytes[start..].iter().position(|&byte| byte != 0xff)?;
    Some((bytes[code], code + 1))
}

/// Where the coded bytes of a scan end: at a marker that is neither a stuffed byte nor a restart.
fn end_of_scan(bytes: &[u8], at: usize) -> usize {
    let coded = bytes.get(at..).unwrap_or_default();
    let is_end = |pair: &[u8]| pair[0] == 0xff && !matches!(pair[1], 0x00 | 0xd0..=0xd7 | 0xff);
    coded.windows(2).position(is_end).map_or(bytes.len(), |offset| at + offset)
}

#[cfg(test)]
mod tests {
    use image::{ExtendedColorType, ImageEncoder};

    use super::*;

    #[test]
    fn every_cut_is_seen() {
        let pixels: Vec<u8> = (0..64 * 48 * 3).map(|i| (i * 7 % 251) as u8).collect();
        let mut bytes = Vec::new();
        let encoder = image::codecs::jpeg::JpegEncoder::new(&mut bytes);
        encoder.write_image(&pixels, 64, 48, ExtendedColorType::Rgb8).unwrap();
        assert!(is_jpeg(&bytes) && is_whole(&bytes));
        assert!(is_whole(&[&bytes[..], b"trailing"].concat()));
        for length in 0..bytes.len() {
            assert!(!is_whole(&bytes[..length]), "{length} of {} bytes", bytes.len());
        }
    }
}
