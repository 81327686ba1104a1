//! What a scene may not hold: numbers beyond all reason, names that lead out of its folder, files that are no files.

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use gic_scene::{Problem, Scene, SceneError, SceneSettings};
use serde_json::{Value, json};

/// What is said of a scene that cannot be opened, and its causes.
fn refusal(root: &Path) -> String {
    let error = Scene::open(root).map(drop).expect_err("the scene opened");
    let said = std::iter::successors(Some(&error as &dyn std::error::Error), |error| error.source());
    said.map(|error| error.to_string()).collect::<Vec<_>>().join(": ")
}

#[track_caller]
fn assert_refused(root: &Path, parts: &[&str]) {
    let text = refusal(root);
    assert!(parts.iter().all(|part| text.contains(part)), "{parts:?} are not all in: {text}");
}

fn edit(path: PathBuf, change: impl FnOnce(&mut Value)) {
    let mut value = serde_json::from_slice(&fs::read(&path).expect("readable")).expect("JSON");
    change(&mut value);
    fs::write(path, value.to_string()).expect("written");
}

#[test]
fn numbers_out_of_range_are_named_with_file_and_field() {
    let nerfstudio = |key: &str, value: Value| {
        let scene = common::copy("nerfstudio");
        edit(scene.path().join("transforms.json"), |all| {
            all["frames"].as_array_mut().expect("frames").iter_mut().for_each(|frame| {
                frame.as_object_mut().expect("a frame").remove(key);
            });
            all[key] = value;
        });
        scene
    };
    for (key, value, field) in [
        ("fl_x", json!(1e308), "focal length [pixels]"),
        ("cx", json!(-1e9), "principal point [pixels]"),
        ("w", json!(1e12), "side of the picture [pixels]"),
        ("k1", json!(1e300), "lens coefficient"),
        ("k2", json!([]), "`k2` must be a number"),
    ] {
        assert_refused(nerfstudio(key, value).path(), &["transforms.json", field]);
    }
    let scene = common::copy("nerfstudio");
    edit(scene.path().join("transforms.json"), |all| all["frames"][0]["transform_matrix"][0][3] = 1e16.into());
    assert_refused(scene.path(), &["coordinate of the camera", "10000000000000000"]);
}

#[test]
fn colmap_sizes_and_points_are_checked() {
    let scene = common::copy("colmap_text");
    let [cameras, points] = ["cameras.txt", "points3D.txt"].map(|name| scene.path().join("sparse/0").join(name));
    let text = fs::read_to_string(&points).expect("readable");
    fs::write(&points, format!("{text}\n999 NaN 0 0 1 1 1 0.1\n")).expect("written");
    assert_refused(scene.path(), &["coordinate is NaN"]);
    fs::write(&points, text).expect("written");
    let text = fs::read_to_string(&cameras).expect("readable");
    let line = text.lines().find(|line| !line.starts_with('#')).expect("a camera").to_owned();
    let mut fields: Vec<&str> = line.split_whitespace().collect();
    (fields[2], fields[3]) = ("0", "0");
    fs::write(&cameras, text.replace(&line, &fields.join(" "))).expect("written");
    assert_refused(scene.path(), &["side of the picture [pixels] is 0"]);
}

#[test]
fn colmap_images_without_their_second_lines_are_not_halved() {
    let scene = common::copy("colmap_text");
    let images = scene.path().join("sparse/0/images.txt");
    let text = fs::read_to_string(&images).expect("readable");
    let of_images = |line: &&str| line.split_whitespace().last().is_some_and(|field| field.contains('.'));
    let first: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).filter(of_images).collect();
    fs::write(&images, first.join("\n")).expect("written");
    assert_refused(scene.path(), &["images.txt", "line 2", "observations"]);
}

#[test]
fn a_scene_names_no_file_outside_its_folder() {
    for name in ["../secret.png", "images/../../secret.png", "/etc/secret.png"] {
        let scene = common::copy("nerfstudio");
        edit(scene.path().join("transforms.json"), |all| all["frames"][0]["file_path"] = name.into());
        assert_refused(scene.path(), &["secret.png", "lies outside the scene"]);
    }
    let scene = common::copy("nerfstudio");
    edit(scene.path().join("transforms.json"), |all| all["frames"][0]["mask_path"] = "../secret.png".into());
    assert_refused(scene.path(), &["lies outside the scene"]);
}

#[test]
fn a_photograph_that_is_cut_off_is_refused() {
    let scene = common::copy("pac_nerf");
    let picture = scene.path().join("data/r_0_-1.png");
    let photograph = image::open(&picture).expect("a picture").to_rgb8();
    let mut bytes = std::io::Cursor::new(Vec::new());
    photograph.write_to(&mut bytes, image::ImageFormat::Jpeg).expect("encoded");
    let bytes = bytes.into_inner();
    fs::write(&picture, &bytes).expect("written");
    let opened = Scene::open(scene.path()).expect("the name does not decide on the format");
    opened.load_background(0).expect("whole");
    fs::write(&picture, &bytes[..2 * bytes.len() / 3]).expect("written");
    let refused = opened.load_background(0).expect_err("it is cut").to_string();
    assert!(refused.contains("r_0_-1.png") && refused.contains("cut off"), "{refused}");
}

#[test]
fn frame_rates_beyond_reason_are_refused() {
    for rate in [1e-320, 0.0, -1.0, f64::NAN, f64::INFINITY, 1e300] {
        let settings = SceneSettings { frame_rate_hz: Some(rate), ..SceneSettings::default() };
        let refused = Scene::open_with(common::data("pac_nerf"), &settings).expect_err("opened");
        assert!(matches!(refused, SceneError::Setting { name: "frame_rate_hz", .. }), "{rate}: {refused}");
    }
}

#[test]
fn a_list_that_is_a_folder_is_called_one() {
    let scene = tempfile::tempdir().expect("a folder");
    fs::create_dir(scene.path().join("transforms_train.json")).expect("made");
    assert_refused(scene.path(), &["transforms_train.json", "it is a folder"]);
}

#[cfg(unix)]
#[test]
fn pipes_are_refused_at_once() {
    let scene = tempfile::tempdir().expect("a folder");
    let pipe = |name: &str| {
        let made = std::process::Command::new("mkfifo").arg(scene.path().join(name)).status().expect("mkfifo");
        assert!(made.success());
    };
    pipe("transforms.json");
    assert_refused(scene.path(), &["transforms.json", "pipe"]);
    let scene = common::copy("pac_nerf");
    let picture = scene.path().join("data/r_0_0.png");
    fs::remove_file(&picture).expect("removed");
    assert!(std::process::Command::new("mkfifo").arg(&picture).status().expect("mkfifo").success());
    let Err(SceneError::Invalid(problems)) = Scene::open(scene.path()) else { panic!("opened") };
    assert!(matches!(&problems[..], [Problem::MissingPicture { .. }]), "{problems:?}");
}
