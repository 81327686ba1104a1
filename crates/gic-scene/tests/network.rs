//! Masks from an ONNX network: `cargo test -p gic-scene --features onnx --test network`. The network is written here,
//! byte by byte: a 1x1 convolution (red minus blue, times 8) and a sigmoid.
#![cfg(feature = "onnx")]

mod common;

use std::path::Path;

use gic_scene::{MaskSource, Scene, SceneError, SceneSettings};

/// A protobuf field with a length: bytes, strings and messages.
fn field(number: u8, content: &[u8]) -> Vec<u8> {
    let mut bytes = vec![number << 3 | 2];
    let mut length = content.len();
    while length >= 128 {
        bytes.push(length as u8 | 128);
        length >>= 7;
    }
    bytes.push(length as u8);
    bytes.extend(content);
    bytes
}

/// A protobuf field with a small number.
fn number(field: u8, value: u8) -> Vec<u8> {
    vec![field << 3, value]
}

fn node(operation: &str, inputs: &[&str], output: &str) -> Vec<u8> {
    let mut bytes: Vec<u8> = inputs.iter().flat_map(|name| field(1, name.as_bytes())).collect();
    bytes.extend(field(2, output.as_bytes()));
    bytes.extend(field(4, operation.as_bytes()));
    field(1, &bytes)
}

/// A named f32 tensor [1, channels, height, width] with open sides where `sides` is `None`.
fn value(name: &str, channels: u8, sides: Option<(u8, u8)>) -> Vec<u8> {
    let mut shape = field(1, &number(1, 1));
    shape.extend(field(1, &number(1, channels)));
    match sides {
        Some((height, width)) => shape.extend([field(1, &number(1, height)), field(1, &number(1, width))].concat()),
        None => shape.extend([field(1, &field(2, b"height")), field(1, &field(2, b"width"))].concat()),
    }
    let tensor = [number(1, 1), field(2, &shape)].concat();
    [field(1, name.as_bytes()), field(2, &field(1, &tensor))].concat()
}

fn write_network(path: &Path, sides: Option<(u8, u8)>, channels: u8) {
    let mut weights: Vec<u8> = [1, channels, 1, 1].iter().flat_map(|&side| number(1, side)).collect();
    weights.extend(number(2, 1));
    weights.extend(field(8, b"weights"));
    let values: Vec<f32> = (0..channels).map(|c| [8.0, 0.0, -8.0, 0.0][usize::from(c)]).collect();
    weights.extend(field(9, &values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>()));
    let graph = [
        node("Conv", &["picture", "weights"], "difference"),
        node("Sigmoid", &["difference"], "coverage"),
        field(2, b"red minus blue"),
        field(5, &weights),
        field(11, &value("picture", channels, sides)),
        field(12, &value("coverage", 1, sides)),
    ]
    .concat();
    let model = [number(1, 8), field(7, &graph), field(8, &number(2, 13))].concat();
    std::fs::write(path, model).expect("written");
}

fn open(network: &Path) -> Result<Scene, SceneError> {
    let settings = SceneSettings { matting: Some(network.to_owned()), ..SceneSettings::default() };
    Scene::open_with(common::data("pac_nerf"), &settings)
}

#[test]
fn the_network_makes_the_masks() {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, sides) in [("open.onnx", None), ("fixed.onnx", Some((36, 48)))] {
        let path = folder.path().join(name);
        write_network(&path, sides, 3);
        let scene = open(&path).unwrap_or_else(|error| panic!("{error}"));
        assert!(scene.views.iter().all(|view| view.mask == MaskSource::Network));
        let (picture, mask) = scene.load_view(0, 0).expect("a mask");
        assert_eq!((mask.width, mask.height), (picture.width, picture.height));
        // The upper half of the ball is red.
        assert!(mask.at(25, 13) > 0.99 && mask.at(25, 23) < 0.01, "{} {}", mask.at(25, 13), mask.at(25, 23));
        if sides.is_some() {
            for (i, &coverage) in mask.coverage.iter().enumerate() {
                let expected = 1.0 / (1.0 + (-16.0 * (picture.rgb[3 * i] - picture.rgb[3 * i + 2])).exp());
                assert!((coverage - expected).abs() < 1e-3, "pixel {i}: {coverage} for {expected}");
            }
        }
    }
}

#[test]
fn networks_for_something_else_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("four.onnx");
    write_network(&path, None, 4);
    let error = open(&path).expect_err("four channels");
    assert!(error.to_string().contains("[1, 3, height, width]"), "{error}");
    assert!(matches!(open(&folder.path().join("nowhere.onnx")), Err(SceneError::Matting { .. })));
}
