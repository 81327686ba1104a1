//! Boards on paper: a PDF with rectangles at their true size, written by hand (PDF 1.4, one path a page).

use std::fmt::Write;
use std::path::{Path, PathBuf};

use gic_twin::atomic;

use crate::board::Board;
use crate::error::{CalibrateError, Result};

/// PDF's points in a metre.
const POINTS_PER_M: f64 = 72.0 / 0.0254;
/// White at the paper's edge, which printers leave [m].
const MARGIN_M: f64 = 0.008;
/// Height of the ruler with its words below the board [m].
const RULER_M: f64 = 0.016;
/// Length of the ruler [m].
const RULER_LENGTH_M: f64 = 0.1;

/// Sizes of paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Paper {
    /// 210 x 297 mm.
    A4,
    /// 297 x 420 mm.
    A3,
    /// 8.5 x 11 inches.
    Letter,
}

impl Paper {
    /// Width and height, upright [m].
    pub fn size_m(self) -> [f64; 2] {
        match self {
            Paper::A4 => [0.21, 0.297],
            Paper::A3 => [0.297, 0.42],
            Paper::Letter => [0.2159, 0.2794],
        }
    }
}

/// A board to print.
#[derive(Clone, Debug)]
pub struct PrintRequest {
    /// The board.
    pub board: Board,
    /// Side of a tag [m]; by default as large as the paper has room for, in whole millimetres.
    pub tag_size_m: Option<f64>,
    /// The paper.
    pub paper: Paper,
    /// Number of pages, for boards of several.
    pub pages: usize,
    /// The file.
    pub file: PathBuf,
}

/// Writes a board as a PDF at its true size, and returns the side of a tag [m].
///
/// # Errors
/// A board that does not fit on the paper; a file that cannot be written.
pub fn print_board(request: &PrintRequest) -> Result<f64> {
    let (side_m, is_turned) = layout(request)?;
    let mut paper = request.paper.size_m();
    if is_turned {
        paper.reverse();
    }
    let pages = match request.board {
        Board::Sheets { .. } => request.pages,
        Board::Kalibr { .. } | Board::Charuco { .. } => 1,
    };
    let filled: Vec<String> = (0..pages)
        .filter(|sheet| !request.board.tags(*sheet, side_m).is_empty())
        .map(|sheet| page(request.board, sheet, side_m, paper))
        .collect();
    let bytes = document(&filled, paper);
    if let Some(folder) = request.file.parent().filter(|folder| *folder != Path::new("")) {
        atomic::create_folder(folder)?;
    }
    atomic::write(&request.file, &bytes)?;
    Ok(side_m)
}

/// The side of a tag [m], and whether the paper lies on its side.
fn layout(request: &PrintRequest) -> Result<(f64, bool)> {
    let [width, height] = request.paper.size_m();
    // Extent grows with the tags.
    let unit = request.board.extent(1.0);
    let largest = |[width, height]: [f64; 2]| {
        ((width - 2.0 * MARGIN_M) / unit[0]).min((height - 2.0 * MARGIN_M - RULER_M) / unit[1])
    };
    let (upright, turned) = (largest([width, height]), largest([height, width]));
    let most = upright.max(turned);
    let side_m = match request.tag_size_m {
        Some(side) => side,
        // Bits of a tag below a millimetre are no use.
        None => (most * 1000.0 + 1e-9).floor() / 1000.0,
    };
    if !(side_m > 0.0 && side_m <= most * (1.0 + 1e-9)) {
        return Err(CalibrateError::usage(
            format!("the board {} does not fit on this paper with tags of {:.1} mm", request.board, side_m * 1000.0),
            format!(
                "there is room for tags of {:.1} mm; give --tag-size-m, a larger --paper, or fewer columns and rows",
                most * 1000.0
            ),
        ));
    }
    Ok((side_m, upright < turned))
}

/// What a page draws, in points from its lower left corner.
fn page(board: Board, sheet: usize, side_m: f64, [width, height]: [f64; 2]) -> String {
    let middle = [width / 2.0, (height + RULER_M) / 2.0];
    let mut drawn = String::from("0 g\n");
    let mut rectangle = |corner: [f64; 2], sides: [f64; 2]| {
        let [x, y, w, h] = [corner[0], corner[1], sides[0], sides[1]].map(|length| length * POINTS_PER_M);
        let _ = writeln!(drawn, "{x:.4} {y:.4} {w:.4} {h:.4} re");
    };
    for black in board.black(sheet, side_m) {
        rectangle([middle[0] + black.corner[0], middle[1] + black.corner[1]], black.sides);
    }
    let (left, base) = (width / 2.0 - RULER_LENGTH_M / 2.0, MARGIN_M + 0.006);
    rectangle([left, base], [RULER_LENGTH_M, 0.0003]);
    for tick in 0..=10 {
        let tall = if tick % 5 == 0 { 0.003 } else { 0.002 };
        rectangle([left + 0.01 * f64::from(tick) - 0.000_15, base], [0.0003, tall]);
    }
    let words = format!(
        "{board}, page {}, tag {:.1} mm. This line is 100 mm long; else measure a tag and give that to --tag-size-m.",
        sheet + 1,
        side_m * 1000.0
    );
    let (x, y) = ((width / 2.0 - 0.075) * POINTS_PER_M, (MARGIN_M + 0.001) * POINTS_PER_M);
    let _ = write!(drawn, "f\nBT /F1 8 Tf {x:.3} {y:.3} Td ({words}) Tj ET\n");
    drawn
}

/// A PDF of pages: catalogue, page tree, font, and two objects a page.
fn document(pages: &[String], paper: [f64; 2]) -> Vec<u8> {
    let [width, height] = paper.map(|length| length * POINTS_PER_M);
    let kids: String = (0..pages.len()).map(|n| format!("{} 0 R ", 4 + 2 * n)).collect();
    let mut objects = vec![
        "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>".to_owned(),
        format!("<< /Type /Pages /Kids [{kids}] /Count {} >>", pages.len()),
        "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>".to_owned(),
    ];
    for (n, drawn) in pages.iter().enumerate() {
        objects.push(format!(
            "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.3} {height:.3}] /Contents {} 0 R /Resources << /Font \
             << /F1 3 0 R >> >> >>",
            5 + 2 * n
        ));
        objects.push(format!("<< /Length {} >>\nstream\n{drawn}endstream", drawn.len()));
    }
    let mut bytes = b"%PDF-1.4\n".to_vec();
    let mut places = Vec::new();
    for (n, object) in objects.iter().enumerate() {
        places.push(bytes.len());
        bytes.extend(format!("{} 0 obj\n{object}\nendobj\n", n + 1).bytes());
    }
    let table = bytes.len();
    bytes.extend(format!("xref\n0 {}\n0000000000 65535 f \n", objects.len() + 1).bytes());
    places.iter().for_each(|place| bytes.extend(format!("{place:010} 00000 n \n").bytes()));
    let size = objects.len() + 1;
    bytes.extend(format!("trailer\n<< /Size {size} /Root 1 0 R >>\nstartxref\n{table}\n%%EOF\n").bytes());
    bytes
}
