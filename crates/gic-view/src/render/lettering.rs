//! Text in pictures: letters of strokes, which stay sharp at any size.

use gic_scene::Picture;

/// Height of a capital in units of the letters' grid.
const CAPITAL: f32 = 6.0;
/// Space between letters, and the width of a space, in units of the grid.
const GAP: f32 = 1.7;
const SPACE: f32 = 2.5;
/// Half of a stroke's width, and of that of the dark rim around it, in units of the grid.
const STROKE: f32 = 0.42;
const RIM: f32 = 1.05;
const RIM_OPACITY: f32 = 0.7;

/// The strokes of a letter: points as two digits (x from the left, y from a capital's top; the line is at 6), strokes
/// apart by spaces. A single point twice is a dot.
fn strokes(letter: char) -> Option<&'static str> {
    Some(match letter {
        '0' => "103041453616050110",
        '1' => "112026 1636",
        '2' => "01103041420646",
        '3' => "01103041423323 334445361605",
        '4' => "36300444",
        '5' => "400002324345361605",
        '6' => "3011030516364544331304",
        '7' => "004016",
        '8' => "13020110304142331304051636454433",
        '9' => "4233130201103041433516",
        'a' => "4246 4332120305163645",
        'b' => "0006 0312324345361605",
        'c' => "4332120305163645",
        'd' => "4046 4332120305163645",
        'e' => "04444332120305163645",
        'f' => "30201116 0232",
        'g' => "4247381807 4332120305163645",
        'h' => "0006 0312324346",
        'i' => "0000 0206",
        'j' => "1010 121708",
        'k' => "0006 320436",
        'l' => "0006",
        'm' => "0206 03122326 23324346",
        'n' => "0206 0312324346",
        'o' => "123243453616050312",
        'p' => "0208 0312324345361605",
        'q' => "4248 4332120305163645",
        'r' => "0206 031232",
        's' => "4212031434453606",
        't' => "10152636 0232",
        'u' => "0205163645 4246",
        'v' => "022642",
        'w' => "0216233642",
        'x' => "0246 4206",
        'y' => "0226 4218",
        'z' => "02420646",
        'G' => "41301001051636454323",
        'M' => "0600234046",
        'N' => "06004640",
        'P' => "06003041423303",
        '.' => "0606",
        ',' => "0607",
        '-' => "0333",
        '+' => "0343 2125",
        '/' => "0640",
        ':' => "0303 0606",
        '[' => "10000616",
        ']' => "00101606",
        _ => return None,
    })
}

/// A stroke's straight pieces, in units of the grid.
fn segments(text: &str) -> (Vec<[f32; 4]>, f32) {
    let (mut segments, mut left) = (Vec::new(), 0.0);
    for letter in text.chars() {
        let Some(strokes) = strokes(letter) else {
            left += SPACE;
            continue;
        };
        let mut right: f32 = 0.0;
        for stroke in strokes.split(' ') {
            let digit = |byte: u8| f32::from(byte - b'0');
            let points: Vec<(f32, f32)> =
                stroke.as_bytes().chunks_exact(2).map(|p| (digit(p[0]), digit(p[1]))).collect();
            right = points.iter().fold(right, |right, p| right.max(p.0));
            let pieces = points.windows(2).map(|pair| [left + pair[0].0, pair[0].1, left + pair[1].0, pair[1].1]);
            segments.extend(pieces);
            if let [dot] = points[..] {
                segments.push([left + dot.0, dot.1, left + dot.0, dot.1]);
            }
        }
        left += right + GAP;
    }
    (segments, (left - GAP).max(0.0))
}

/// Width of a text whose capitals are `height` pixels high [pixels].
pub(super) fn width_of(text: &str, height: f32) -> f32 {
    segments(text).1 * height / CAPITAL
}

/// Writes white letters with a dark rim; `corner` is the upper left one of the first capital [pixels], `height` that of
/// a capital.
pub(super) fn write(picture: &mut Picture, text: &str, corner: (f32, f32), height: f32) {
    let unit = height / CAPITAL;
    let (segments, width) = segments(text);
    let reach = RIM * unit + 1.0;
    let columns = range(corner.0 - reach, corner.0 + width * unit + reach, picture.width);
    let rows = range(corner.1 - reach, corner.1 + 8.0 * unit + reach, picture.height);
    for y in rows {
        for x in columns.clone() {
            let (u, v) = ((x as f32 + 0.5 - corner.0) / unit, (y as f32 + 0.5 - corner.1) / unit);
            let distance = segments.iter().map(|s| distance_to(*s, u, v)).fold(f32::INFINITY, f32::min);
            // Full inside, none a pixel farther out.
            let share = |half: f32| ((half - distance) * unit + 0.5).clamp(0.0, 1.0);
            blend(picture, x, y, [0.0; 3], RIM_OPACITY * share(RIM));
            blend(picture, x, y, [1.0; 3], share(STROKE.max(0.55 / unit)));
        }
    }
}

/// Whole pixels between two places.
fn range(from: f32, to: f32, count: usize) -> std::ops::Range<usize> {
    (from.max(0.0) as usize).min(count)..(to.max(0.0).ceil() as usize).min(count)
}

/// Mixes a colour into a pixel.
pub(super) fn blend(picture: &mut Picture, x: usize, y: usize, color: [f32; 3], share: f32) {
    let at = 3 * (y * picture.width + x);
    for (value, new) in picture.rgb[at..at + 3].iter_mut().zip(color) {
        *value += share * (new - *value);
    }
}

/// Distance of a point to a segment (x, y, x, y).
fn distance_to([x0, y0, x1, y1]: [f32; 4], x: f32, y: f32) -> f32 {
    let (dx, dy) = (x1 - x0, y1 - y0);
    let squared = dx * dx + dy * dy;
    let along = if squared > 0.0 { (((x - x0) * dx + (y - y0) * dy) / squared).clamp(0.0, 1.0) } else { 0.0 };
    (x - x0 - along * dx).hypot(y - y0 - along * dy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_are_bright_where_their_strokes_are() {
        let mut picture = Picture { width: 40, height: 40, rgb: vec![0.5; 3 * 40 * 40] };
        write(&mut picture, "1l", (4.0, 8.0), 18.0);
        // The stem of the 1 stands two units from the left, each of three pixels.
        assert!(picture.at(10, 18)[0] > 0.95, "{:?}", picture.at(10, 18));
        assert!(picture.at(12, 18)[0] < 0.5, "a dark rim: {:?}", picture.at(12, 18));
        assert_eq!(picture.at(38, 38), [0.5; 3]);
    }

    #[test]
    fn every_letter_of_the_labels_is_there() {
        let labels = [
            "von Mises stress [kPa]",
            "speed [m/s]",
            "0.542 s, predicted",
            "1.5e-3 MPa GPa mm/s 26789",
            "10 x slower: 4 N",
        ];
        for letter in labels.join(" ").chars().filter(|c| *c != ' ') {
            assert!(strokes(letter).is_some(), "{letter}");
        }
        assert!(width_of("mm", 6.0) > width_of("ll", 6.0));
    }

    #[test]
    fn text_may_leave_the_picture() {
        let mut picture = Picture { width: 8, height: 8, rgb: vec![0.5; 3 * 64] };
        write(&mut picture, "0.5 s", (-20.0, 6.0), 12.0);
    }
}
