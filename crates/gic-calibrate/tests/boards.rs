//! Names of boards, and their geometry on paper.

use gic_calibrate::{Board, Paper, PrintRequest, print_board};

#[test]
fn a_boards_name_is_read_and_wrong_ones_are_refused_in_words() {
    for name in ["tags", "sheets:4x6,gap=0.5", "kalibr:6x6,gap=0.3", "charuco:8x6,tag=0.75"] {
        assert_eq!(name.parse::<Board>().unwrap().to_string(), name);
    }
    assert_eq!("kalibr:6x6".parse::<Board>().unwrap().to_string(), "kalibr:6x6,gap=0.3");
    assert!("charuco:5x4,dictionary=DICT_APRILTAG_36h11".parse::<Board>().is_ok());
    for (name, word) in [
        ("charuco:5x4,dictionary=DICT_4X4_50", "36h11"),
        ("checker:5x4", "no kind"),
        ("kalibr", "columns"),
        ("kalibr:6", "COLUMNSxROWS"),
        ("kalibr:40x40", "1600 tags"),
        ("sheets:4x6,gap=0.01", "gap"),
        ("sheets:4x6,gap=nan", "gap"),
        ("sheets:4x6,tag=0.5", "tag is nothing"),
        ("charuco:8x6,tag=0.95", "square"),
        ("tags:3x3", "single tags"),
    ] {
        let error = name.parse::<Board>().unwrap_err();
        assert!(error.is_usage() && error.hint().is_some(), "{name}");
        assert!(error.to_string().contains(word), "{name}: {error}");
    }
}

#[test]
fn tags_lie_where_the_boards_makers_put_them() {
    let kalibr: Board = "kalibr:3x2,gap=0.25".parse().unwrap();
    let tags = kalibr.tags(0, 0.04);
    assert_eq!(tags.len(), 6);
    // Rows from the lower left; the pitch is a tag and a gap.
    assert!((tags[1].centre[0] - tags[0].centre[0] - 0.05).abs() < 1e-12);
    assert!(tags[3].centre[1] > tags[0].centre[1] && (tags[0].centre[1] + 0.025).abs() < 1e-12);
    let sheet: Board = "sheets:3x2,gap=0.25".parse().unwrap();
    let tags = sheet.tags(2, 0.04);
    assert_eq!(tags[0].id, 12);
    assert!(tags[3].centre[1] < tags[0].centre[1], "rows from the upper left");
    // The square in the upper left corner is black, its right neighbour has tag 0.
    let charuco: Board = "charuco:4x3,tag=0.5".parse().unwrap();
    let tags = charuco.tags(0, 0.02);
    assert_eq!(tags.len(), 6);
    assert!((tags[0].centre[0] + 0.02).abs() < 1e-12 && (tags[0].centre[1] - 0.04).abs() < 1e-12);
    let ink: f64 = charuco.black(0, 0.02).iter().filter(|b| b.sides[0] > 0.03).map(|b| b.sides[0] * b.sides[1]).sum();
    assert!((ink - 6.0 * 0.04 * 0.04).abs() < 1e-12, "six black squares");
}

/// Rectangles of a page, in points.
fn rectangles(pdf: &str) -> Vec<[f64; 4]> {
    let numbers = |line: &str| line.split(' ').filter_map(|word| word.parse().ok()).collect::<Vec<f64>>();
    let lines = pdf.lines().filter(|line| line.ends_with(" re"));
    lines.map(|line| numbers(line).try_into().expect("four numbers")).collect()
}

#[test]
fn a_page_has_its_true_size_and_a_ruler() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("board.pdf");
    let request = PrintRequest {
        board: "kalibr:6x6".parse().unwrap(),
        tag_size_m: Some(0.02),
        paper: Paper::A4,
        pages: 1,
        file: file.clone(),
    };
    assert_eq!(print_board(&request).unwrap(), 0.02);
    let pdf = std::fs::read_to_string(&file).unwrap();
    assert!(pdf.starts_with("%PDF-1.4") && pdf.contains("/MediaBox [0 0 595.276 841.890]"));
    let all = rectangles(&pdf);
    let point = 0.0254 / 72.0;
    // 49 squares of .3 tags between the tags.
    let corners = all.iter().filter(|r| (r[2] * point - 0.006).abs() < 1e-6 && (r[3] * point - 0.006).abs() < 1e-6);
    assert_eq!(corners.count(), 49);
    // The first row of a tag is black over all of its width.
    assert!(all.iter().any(|r| (r[2] * point - 0.02).abs() < 1e-6 && (r[3] * point - 0.002).abs() < 1e-6));
    assert!(all.iter().any(|r| (r[2] * point - 0.1).abs() < 1e-6), "a ruler of 100 mm");
    let (low, high) = all.iter().fold((f64::MAX, f64::MIN), |(l, h), r| (l.min(r[0]), h.max(r[0] + r[2])));
    assert!(((high - low) * point - (6.0 * 0.026 + 0.006)).abs() < 1e-6, "six tags, gaps and corner squares");
    assert!(low > 0.0 && high < 595.3);
    // Readers find the objects where the table says.
    let table: usize = pdf.rsplit("startxref\n").next().unwrap().lines().next().unwrap().parse().unwrap();
    assert!(pdf[table..].starts_with("xref\n"));
    let third: usize = pdf[table..].lines().nth(5).unwrap()[..10].parse().unwrap();
    assert!(pdf[third..].starts_with("3 0 obj"));

    let large = PrintRequest { tag_size_m: Some(0.05), ..request.clone() };
    let error = print_board(&large).unwrap_err();
    assert!(error.is_usage() && error.hint().unwrap().contains("room for tags of"), "{error}");
    let pages = PrintRequest { board: "sheets:4x6".parse().unwrap(), tag_size_m: None, pages: 3, ..request };
    let side = print_board(&pages).unwrap();
    assert!((0.028..0.035).contains(&side), "{side}");
    let pdf = std::fs::read_to_string(&file).unwrap();
    assert!(pdf.contains("/Count 3") && pdf.matches("/MediaBox").count() == 3);
}
