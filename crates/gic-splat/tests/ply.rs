//! PLY files: round trips, the convention's byte layout, and bad files.

use std::fs;
use std::path::PathBuf;

use gic_files::FileError;
use gic_splat::{Gaussians, PlyError, Shape, read_ply, write_ply};
use proptest::prelude::*;

fn close(a: &[f32], b: &[f32]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-6 * (1.0 + a.abs()))
}

fn same(a: &Gaussians, b: &Gaussians) -> bool {
    let shapes = match (&a.shape, &b.shape) {
        (Shape::Isotropic { scales: a }, Shape::Isotropic { scales: b }) => close(a, b),
        (Shape::Anisotropic { scales: a, rotations: qa }, Shape::Anisotropic { scales: b, rotations: qb }) => {
            close(a.as_flattened(), b.as_flattened()) && qa == qb
        }
        _ => false,
    };
    shapes
        && a.positions == b.positions
        && close(&a.opacities, &b.opacities)
        && a.sh == b.sh
        && a.sh_degree == b.sh_degree
}

fn gaussians(n: usize, sh_degree: usize, isotropic: bool) -> impl Strategy<Value = Gaussians> {
    let row = (
        prop::array::uniform3(-10.0f32..10.0),
        0.001f32..0.999,
        prop::array::uniform3(1e-5f32..3.0),
        prop::array::uniform4(0.1f32..1.0),
        prop::collection::vec(prop::array::uniform3(-2.0f32..2.0), (sh_degree + 1).pow(2)),
    );
    prop::collection::vec(row, n).prop_map(move |rows| Gaussians {
        positions: rows.iter().map(|r| r.0).collect(),
        opacities: rows.iter().map(|r| r.1).collect(),
        shape: if isotropic {
            Shape::Isotropic { scales: rows.iter().map(|r| r.2[0]).collect() }
        } else {
            Shape::Anisotropic {
                scales: rows.iter().map(|r| r.2).collect(),
                rotations: rows.iter().map(|r| r.3).collect(),
            }
        },
        sh_degree,
        sh: rows.iter().flat_map(|r| r.4.clone()).collect(),
    })
}

fn any_gaussians() -> impl Strategy<Value = Gaussians> {
    (1usize..6, 0usize..=3, any::<bool>()).prop_flat_map(|(n, degree, isotropic)| gaussians(n, degree, isotropic))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn what_is_written_is_read(set in any_gaussians()) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("set.ply");
        prop_assert!(write_ply(&path, &set).expect("it writes").is_empty());
        let read = read_ply(&path).expect("it reads");
        prop_assert!(read.dropped.is_empty());
        prop_assert!(same(&set, &read.gaussians), "{set:?} {read:?}");
        prop_assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1, "nothing else is left there");
    }

    /// Cut anywhere, the file is an error that says so, and never a panic or a shorter set.
    #[test]
    fn a_truncated_file_is_an_error(set in any_gaussians(), part in 0.0f64..1.0) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("set.ply");
        write_ply(&path, &set).expect("it writes");
        let bytes = fs::read(&path).expect("it reads");
        fs::write(&path, &bytes[..(bytes.len() as f64 * part) as usize]).expect("it writes");
        let error = read_ply(&path).expect_err("it is cut").to_string();
        prop_assert!(error.contains("set.ply"), "{}", error);
    }

    #[test]
    fn noise_is_an_error(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("noise.ply");
        fs::write(&path, bytes).expect("it writes");
        prop_assert!(read_ply(&path).is_err());
    }
}

/// The bytes as a viewer expects them, written out by hand.
#[test]
fn the_layout_is_the_convention_s() {
    let sh = vec![[1.0, 2.0, 3.0], [0.1, 0.4, 0.7], [0.2, 0.5, 0.8], [0.3, 0.6, 0.9]];
    let set = Gaussians {
        positions: vec![[0.5, -1.5, 2.0]],
        opacities: vec![0.75],
        shape: Shape::Isotropic { scales: vec![0.25] },
        sh_degree: 1,
        sh,
    };
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("set.ply");
    write_ply(&path, &set).expect("it writes");
    let bytes = fs::read(&path).expect("it reads");
    let end = b"end_header\n";
    let start = bytes.windows(end.len()).position(|w| w == end).expect("a header") + end.len();
    let header = String::from_utf8(bytes[..start].to_vec()).expect("a header in ASCII");
    assert!(
        header.starts_with("ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\n"),
        "{header}"
    );
    let names: Vec<&str> = header.lines().filter_map(|l| l.strip_prefix("property float ")).collect();
    let expected = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 f_rest_0 f_rest_1 f_rest_2 f_rest_3 f_rest_4 f_rest_5 f_rest_6 \
                    f_rest_7 f_rest_8 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    assert_eq!(names.join(" "), expected);
    let values: Vec<f32> =
        bytes[start..].chunks(4).map(|b| f32::from_le_bytes(b.try_into().expect("four bytes"))).collect();
    let log = 0.25f32.ln();
    let expected = [
        0.5,
        -1.5,
        2.0,
        0.0,
        0.0,
        0.0,
        1.0,
        2.0,
        3.0,
        0.1,
        0.2,
        0.3,
        0.4,
        0.5,
        0.6,
        0.7,
        0.8,
        0.9,
        3f32.ln(),
        log,
        log,
        log,
        1.0,
        0.0,
        0.0,
        0.0,
    ];
    assert!(close(&values, &expected), "{values:?}");
}

fn ascii(name: &str, text: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(name);
    fs::write(&path, text).expect("it writes");
    (folder, path)
}

const PROPERTIES: &str =
    "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 confidence";

fn file(properties: &str, rows: &[&str]) -> String {
    let properties: String = properties.split_whitespace().map(|p| format!("property float {p}\n")).collect();
    let head = format!("ply\nformat ascii 1.0\ncomment made by hand\nelement vertex {}\n{properties}", rows.len());
    format!("{head}element face 1\nproperty list uchar int vertex_indices\nend_header\n{}\n3 0 0 0\n", rows.join("\n"))
}

#[test]
fn what_is_dropped_is_said() {
    let (_folder, path) = ascii("mixed.ply", &file(PROPERTIES, &["1 2 3 0 0 1 0 0 0 0 -1 -2 -1 1 0 0 0 5"]));
    let read = read_ply(&path).expect("it reads");
    assert_eq!(read.gaussians.len(), 1);
    assert_eq!(read.gaussians.opacities, [0.5]);
    assert_eq!(read.gaussians.validate(), Ok(()));
    let said = read.dropped.join("; ");
    for part in ["confidence", "1 elements `face`", "normals"] {
        assert!(said.contains(part), "`{part}` is not in: {said}");
    }
}

#[test]
fn numbers_that_cannot_be_drawn_are_named() {
    let whole = "1 2 3 0 0 1 0 0 0 0 -1 -2 -1 1 0 0 0 5";
    for (row, field) in [
        ("1 2 1e99 0 0 0 0 0 0 0 -1 -1 -1 1 0 0 0 5", "x, y, z"),
        ("1 2 3 0 0 0 0 0 0 0 -1 1000 -1 1 0 0 0 5", "scale_*"),
        ("1 2 3 0 0 0 0 0 0 0 -1 -1 -1 0 0 0 0 5", "rot_*"),
    ] {
        let (_folder, path) = ascii("damaged.ply", &file(PROPERTIES, &[whole, row]));
        let refused = read_ply(&path).expect_err("read").to_string();
        for part in ["damaged.ply", field, "vertex 1"] {
            assert!(refused.contains(part), "`{part}` is not in: {refused}");
        }
    }
}

/// Text has no word for it, bytes have.
#[test]
fn an_opacity_that_is_no_number_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("damaged.ply");
    let properties: String = PROPERTIES.split_whitespace().map(|p| format!("property float {p}\n")).collect();
    let head = format!("ply\nformat binary_little_endian 1.0\nelement vertex 1\n{properties}end_header\n");
    let row = [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, f32::NAN, -1.0, -1.0, -1.0, 1.0, 0.0, 0.0, 0.0, 5.0];
    let bytes = row.into_iter().flat_map(f32::to_le_bytes);
    fs::write(&path, head.into_bytes().into_iter().chain(bytes).collect::<Vec<u8>>()).expect("it writes");
    let refused = read_ply(&path).expect_err("read").to_string();
    for part in ["damaged.ply", "opacity", "vertex 0"] {
        assert!(refused.contains(part), "`{part}` is not in: {refused}");
    }
}

#[test]
fn other_files_are_named_for_what_they_lack() {
    let cases = [
        ("x y z", "lack f_dc_0"),
        (
            "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 f_rest_0",
            "1 properties f_rest_",
        ),
    ];
    for (properties, part) in cases {
        let row = properties.split_whitespace().map(|_| "0").collect::<Vec<_>>().join(" ");
        let (_folder, path) = ascii("other.ply", &file(properties, &[&row]));
        let error = read_ply(&path).expect_err("it is no set of Gaussians");
        assert!(matches!(error, PlyError::NotGaussians { .. }), "{error}");
        assert!(error.to_string().contains(part), "{error}");
    }
    let (folder, _) = ascii("any.ply", "");
    assert!(matches!(read_ply(&folder.path().join("absent.ply")), Err(PlyError::File(FileError::Read { .. }))));
}

#[test]
fn values_without_a_logarithm_are_moved_and_said() {
    let set = Gaussians::colorless(vec![[0.0; 3]; 3], vec![0.0, 0.5, 1.0], vec![0.0, 1.0, 2.0]);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("set.ply");
    let said = write_ply(&path, &set).expect("it writes").join("; ");
    for part in ["2 opacities", "1 scales", "3 Gaussians without colour"] {
        assert!(said.contains(part), "`{part}` is not in: {said}");
    }
    let read = read_ply(&path).expect("it reads").gaussians;
    assert!(close(&read.opacities, &set.opacities));
    assert_eq!(read.sh, vec![[0.0; 3]; 3]);
    let broken = Gaussians::colorless(vec![[f32::NAN; 3]], vec![0.5], vec![1.0]);
    assert!(matches!(write_ply(&path, &broken), Err(PlyError::Invalid { .. })));
    assert_eq!(read_ply(&path).expect("the old file is still there").gaussians.len(), 3);
}
