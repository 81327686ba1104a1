//! Boards: what is printed, and where its tags lie.
//!
//! A board's frame has x to the right and y up on the paper, z out of it; its origin is the board's middle.

use std::fmt;
use std::str::FromStr;

use crate::detect::{DATA_MODULES, dark_modules};
use crate::error::CalibrateError;

/// Numbers that the family 36h11 has.
pub(crate) const FAMILY_TAGS: usize = 587;

/// A board of AprilTags 36h11, as `--board` names it.
///
/// `sheets:4x6,gap=0.5`: pages of columns and rows of tags, `gap` tags apart, that lie anywhere on one plane; their
/// places are measured. Page n begins with tag 24 n in its upper left corner. `tags` are pages of one tag.
/// `kalibr:6x6,gap=0.3`: Kalibr's grid, numbered by rows from the lower left, with black squares between the tags.
/// `charuco:8x6,tag=0.75`: a chessboard with tags in its white squares, `tag` of a square wide (OpenCV 4.6 and later).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Board {
    /// Pages anywhere on one plane.
    Sheets {
        /// Columns and rows of a page.
        size: [usize; 2],
        /// Distance between neighbours, as a share of a tag's side.
        gap: f64,
    },
    /// Kalibr's grid.
    Kalibr {
        /// Columns and rows.
        size: [usize; 2],
        /// Distance between neighbours, as a share of a tag's side.
        gap: f64,
    },
    /// A chessboard with tags.
    Charuco {
        /// Columns and rows of squares.
        size: [usize; 2],
        /// A tag's side as a share of a square's.
        tag: f64,
    },
}

/// A tag on a plane: the place of its middle [m] and its turn against the clock [rad].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TagPlace {
    /// Its number.
    pub id: u32,
    /// x and y [m].
    pub centre: [f64; 2],
    /// Turn [rad].
    pub angle: f64,
}

/// A black rectangle on the paper: lower left corner and sides [m].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Black {
    /// Lower left corner [m].
    pub corner: [f64; 2],
    /// Width and height [m].
    pub sides: [f64; 2],
}

impl TagPlace {
    /// The corners [m] of a tag with sides of `side_m`, from the lower left one against the clock.
    pub fn corners(&self, side_m: f64) -> [[f64; 2]; 4] {
        let (sin, cos) = self.angle.sin_cos();
        CORNERS.map(|[x, y]| {
            let (x, y) = (x * side_m, y * side_m);
            [self.centre[0] + cos * x - sin * y, self.centre[1] + sin * x + cos * y]
        })
    }
}

/// Corners of a tag in tags, from the lower left one against the clock.
pub(crate) const CORNERS: [[f64; 2]; 4] = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];

impl Board {
    /// The page that a tag belongs to; `None` for a tag that is not of this board.
    pub(crate) fn sheet_of(&self, id: u32) -> Option<usize> {
        let id = id as usize;
        match self {
            Board::Sheets { size, .. } => Some(id / (size[0] * size[1])),
            Board::Kalibr { size, .. } => (id < size[0] * size[1]).then_some(0),
            Board::Charuco { size, .. } => (id < size[0] * size[1] / 2).then_some(0),
        }
    }

    /// Where the tags of a page lie on it. All but `sheets` have one page.
    pub fn tags(&self, sheet: usize, side_m: f64) -> Vec<TagPlace> {
        let place = |id: usize, [x, y]: [f64; 2]| TagPlace { id: id as u32, centre: [x, y], angle: 0.0 };
        match *self {
            Board::Sheets { size: [columns, rows], gap } => {
                let at =
                    |n: usize| middle([n % columns, rows - 1 - n / columns], [columns, rows], side_m * (1.0 + gap));
                let first = sheet * columns * rows;
                (0..columns * rows).filter(|n| first + n < FAMILY_TAGS).map(|n| place(first + n, at(n))).collect()
            }
            Board::Kalibr { size: [columns, rows], gap } => {
                let at = |n: usize| middle([n % columns, n / columns], [columns, rows], side_m * (1.0 + gap));
                (0..columns * rows).map(|n| place(n, at(n))).collect()
            }
            Board::Charuco { size: [columns, rows], tag } => {
                let white = (0..columns * rows).filter(|n| (n % columns + n / columns) % 2 == 1);
                let at = |n: usize| middle([n % columns, rows - 1 - n / columns], [columns, rows], side_m / tag);
                white.enumerate().map(|(id, n)| place(id, at(n))).collect()
            }
        }
    }

    /// Width and height of what is black on a page [m].
    pub fn extent(&self, side_m: f64) -> [f64; 2] {
        let grid = |size: [usize; 2], gap: f64, more: f64| size.map(|n| side_m * (n as f64 * (1.0 + gap) - gap + more));
        match *self {
            Board::Sheets { size, gap } => grid(size, gap, 0.0),
            Board::Kalibr { size, gap } => grid(size, gap, 2.0 * gap),
            Board::Charuco { size, tag } => size.map(|n| n as f64 * side_m / tag),
        }
    }

    /// What is black on a page.
    pub fn black(&self, sheet: usize, side_m: f64) -> Vec<Black> {
        let mut black = Vec::new();
        for tag in self.tags(sheet, side_m) {
            black_of_tag(&tag, side_m, self.border(), &mut black);
        }
        match *self {
            Board::Kalibr { size: [columns, rows], gap } => {
                let (pitch, side) = (side_m * (1.0 + gap), side_m * gap);
                for n in 0..(columns + 1) * (rows + 1) {
                    let centre = middle([n % (columns + 1), n / (columns + 1)], [columns + 1, rows + 1], pitch);
                    black.push(Black { corner: centre.map(|c| c - side / 2.0), sides: [side; 2] });
                }
            }
            Board::Charuco { size: [columns, rows], tag } => {
                let side = side_m / tag;
                for n in (0..columns * rows).filter(|n| (n % columns + n / columns) % 2 == 0) {
                    let centre = middle([n % columns, rows - 1 - n / columns], [columns, rows], side);
                    black.push(Black { corner: centre.map(|c| c - side / 2.0), sides: [side; 2] });
                }
            }
            Board::Sheets { .. } => {}
        }
        black
    }

    /// Width of the black border of a tag [modules].
    pub(crate) fn border(&self) -> usize {
        if matches!(self, Board::Kalibr { .. }) { 2 } else { 1 }
    }
}

/// Middle [m] of the cell [column, row] from the lower left of a grid around the origin.
fn middle(cell: [usize; 2], size: [usize; 2], pitch_m: f64) -> [f64; 2] {
    [0, 1].map(|axis| (cell[axis] as f64 - (size[axis] as f64 - 1.0) / 2.0) * pitch_m)
}

/// The black of an upright tag: its border, and the dark modules in it as runs along rows.
fn black_of_tag(tag: &TagPlace, side_m: f64, border: usize, black: &mut Vec<Black>) {
    let Some(dark) = dark_modules(tag.id) else { return };
    let modules = DATA_MODULES + 2 * border;
    let module = side_m / modules as f64;
    let is_dark = |x: usize, row: usize| {
        let inner = border..border + DATA_MODULES;
        !(inner.contains(&x) && inner.contains(&row)) || dark[row - border][x - border]
    };
    for row in 0..modules {
        let mut x = 0;
        while x < modules {
            let run = (x..modules).take_while(|&x| is_dark(x, row)).count();
            if run > 0 {
                let left = tag.centre[0] - side_m / 2.0 + x as f64 * module;
                let low = tag.centre[1] + side_m / 2.0 - (row + 1) as f64 * module;
                black.push(Black { corner: [left, low], sides: [run as f64 * module, module] });
            }
            x += run.max(1);
        }
    }
}

impl fmt::Display for Board {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Board::Sheets { size: [1, 1], .. } => write!(f, "tags"),
            Board::Sheets { size: [x, y], gap } => write!(f, "sheets:{x}x{y},gap={gap}"),
            Board::Kalibr { size: [x, y], gap } => write!(f, "kalibr:{x}x{y},gap={gap}"),
            Board::Charuco { size: [x, y], tag } => write!(f, "charuco:{x}x{y},tag={tag}"),
        }
    }
}

impl FromStr for Board {
    type Err = CalibrateError;

    fn from_str(text: &str) -> Result<Board, CalibrateError> {
        parse(text).and_then(Board::checked).map_err(|problem| {
            CalibrateError::usage(
                format!("board {text}: {problem}"),
                "write sheets:COLUMNSxROWS,gap=SHARE, kalibr:COLUMNSxROWS,gap=SHARE, charuco:COLUMNSxROWS,tag=SHARE or tags",
            )
        })
    }
}

/// A board, or what is wrong with its name.
fn parse(text: &str) -> Result<Board, String> {
    let (kind, rest) = text.split_once(':').unwrap_or((text, ""));
    let (mut size, mut gap, mut share) = (None, None, None);
    for word in rest.split(',').filter(|word| !word.is_empty()) {
        let number = |value: &str| value.parse::<f64>().map_err(|_| format!("{value} is no number"));
        match word.split_once('=') {
            None => size = Some(cells(word).ok_or_else(|| format!("{word} is not COLUMNSxROWS"))?),
            Some(("gap", value)) if kind != "charuco" => gap = Some(number(value)?),
            Some(("tag", value)) if kind == "charuco" => share = Some(number(value)?),
            Some(("family" | "dictionary", value)) if value.to_lowercase().ends_with("36h11") => {}
            Some(("family" | "dictionary", value)) => {
                return Err(format!("tags of {value} are not read, those of AprilTag 36h11 are"));
            }
            Some((key, _)) => return Err(format!("{key} is nothing that it has")),
        }
    }
    let gap_or = |usual: f64| gap.unwrap_or(usual);
    let size = match (kind, size) {
        ("tags", None) => [1, 1],
        ("tags", Some(_)) => return Err("single tags have no columns and rows".into()),
        ("sheets" | "kalibr" | "charuco", Some(size)) => size,
        ("sheets" | "kalibr" | "charuco", None) => return Err("its columns and rows are missing".into()),
        (other, _) => return Err(format!("{other} is no kind of board")),
    };
    Ok(match kind {
        "kalibr" => Board::Kalibr { size, gap: gap_or(0.3) },
        "charuco" => Board::Charuco { size, tag: share.unwrap_or(0.75) },
        _ => Board::Sheets { size, gap: gap_or(0.5) },
    })
}

/// COLUMNSxROWS, as far as the family reaches.
fn cells(word: &str) -> Option<[usize; 2]> {
    let (columns, rows) = word.split_once('x')?;
    let cells = [columns.parse().ok()?, rows.parse().ok()?];
    cells.iter().all(|n| (1..=2 * FAMILY_TAGS).contains(n)).then_some(cells)
}

impl Board {
    fn checked(self) -> Result<Board, String> {
        // A module of white around a tag is what its detection needs.
        let least = 1.0 / (DATA_MODULES + 2 * self.border()) as f64;
        match self {
            Board::Sheets { gap, .. } | Board::Kalibr { gap, .. } if !(gap >= least && gap <= 10.0) => {
                return Err(format!("the gap has to be {least} to 10 tags"));
            }
            Board::Charuco { tag, .. } if !(tag > 0.2 && tag <= 1.0 / (1.0 + 2.0 * least)) => {
                return Err(format!("a tag has to be .2 to {} of a square", 1.0 / (1.0 + 2.0 * least)));
            }
            _ => {}
        }
        let cells = |size: [usize; 2]| size[0] * size[1];
        let tags = match self {
            Board::Sheets { size, .. } | Board::Kalibr { size, .. } => cells(size),
            Board::Charuco { size, .. } => cells(size) / 2,
        };
        if !(1..=FAMILY_TAGS).contains(&tags) {
            return Err(format!("it would have {tags} tags, the family has 1 to {FAMILY_TAGS}"));
        }
        Ok(self)
    }
}
