//! Everything that is wrong with a scene is listed at once, with the names of the files; and odd files that are fine
//! work.

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use common::{HEIGHT, WIDTH};
use gic_scene::{MaskSource, Problem, Scene, SceneError, SceneSettings, Severity, inspect};
use image::{DynamicImage, GrayImage, ImageBuffer, Luma, Rgb, RgbImage, RgbaImage};
use serde_json::Value;

fn problems(root: &Path) -> Vec<Problem> {
    match Scene::open(root) {
        Err(SceneError::Invalid(problems)) => problems,
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("the scene opened"),
    }
}

/// Checks that there is one problem, that it stops the scene, and that its text names the file; returns it.
fn only(root: &Path, names: &str) -> Problem {
    let problems = problems(root);
    assert_eq!(problems.len(), 1, "{problems:#?}");
    let text = problems[0].to_string();
    assert!(text.contains(names), "`{names}` is not in: {text}");
    assert_eq!(problems[0].severity(), Severity::Error);
    problems[0].clone()
}

fn edit(path: PathBuf, change: impl FnOnce(&mut Value)) {
    let mut value = serde_json::from_slice(&fs::read(&path).expect("readable")).expect("JSON");
    change(&mut value);
    fs::write(path, value.to_string()).expect("written");
}

fn decoded(path: PathBuf) -> DynamicImage {
    image::open(path).expect("a picture")
}

#[test]
fn a_missing_picture() {
    let scene = common::copy("pac_nerf");
    fs::remove_file(scene.path().join("data/r_1_0.png")).expect("removed");
    assert!(matches!(only(scene.path(), "r_1_0.png"), Problem::MissingPicture { .. }));
}

#[test]
fn a_missing_background() {
    let scene = common::copy("pac_nerf");
    fs::remove_file(scene.path().join("data/r_1_-1.png")).expect("removed");
    assert!(matches!(only(scene.path(), "r_1_-1.png"), Problem::MissingPicture { .. }));
}

#[test]
fn an_unreadable_picture() {
    let scene = common::copy("pac_nerf");
    fs::write(scene.path().join("data/r_2_1.png"), "not a picture").expect("written");
    assert!(matches!(only(scene.path(), "r_2_1.png"), Problem::Unreadable { .. }));
}

#[test]
fn a_picture_that_ends_early_is_found_when_its_pixels_are_read() {
    let scene = common::copy("pac_nerf");
    for name in ["r_2_1.png", "a_0_1.png"] {
        let path = scene.path().join("data").join(name);
        let bytes = fs::read(&path).expect("readable");
        fs::write(&path, &bytes[..bytes.len() / 2]).expect("written");
    }
    let opened = Scene::open(scene.path()).expect("the headers are whole");
    let found = opened.check_pixels();
    assert!(found.iter().all(|problem| matches!(problem, Problem::Unreadable { .. })), "{found:?}");
    let Err(SceneError::Invalid(inspected)) = inspect(&opened) else { panic!("inspected") };
    assert_eq!(inspected, found);
    let text = SceneError::Invalid(found).to_string();
    assert!(text.contains("2 problems") && text.contains("r_2_1.png") && text.contains("a_0_1.png"), "{text}");
    assert!(opened.load_view(2, 1).is_err() && opened.load_view(2, 0).is_ok());
}

#[test]
fn a_camera_without_pose() {
    let scene = common::copy("pac_nerf");
    edit(scene.path().join("all_data.json"), |list| drop(list[4].as_object_mut().expect("an entry").remove("c2w")));
    assert!(matches!(only(scene.path(), "c2w is missing"), Problem::NoPose { .. }));

    let scene = common::copy("pac_nerf");
    edit(scene.path().join("all_data.json"), |list| {
        (3..6).for_each(|entry| list[entry]["c2w"][0][0] = 7.0.into());
    });
    assert!(matches!(only(scene.path(), "not orthonormal"), Problem::NoPose { .. }));

    let scene = common::copy("spring_gaus");
    edit(scene.path().join("camera.json"), |list| list[2]["K"] = Value::Null);
    assert!(matches!(only(scene.path(), "camera_2"), Problem::NoPose { .. }));

    let scene = common::copy("blender");
    edit(scene.path().join("transforms_train.json"), |all| {
        drop(all["frames"][1].as_object_mut().expect("a frame").remove("transform_matrix"));
    });
    assert!(matches!(only(scene.path(), "r_001"), Problem::NoPose { .. }));

    let scene = common::copy("real_capture");
    edit(scene.path().join("dynamic/cameras_calib.json"), |all| {
        drop(all.as_object_mut().expect("a map").remove("C0787"))
    });
    assert!(matches!(only(scene.path(), "C0787"), Problem::NoPose { .. }));

    let scene = common::copy("nerfstudio");
    edit(scene.path().join("transforms.json"), |all| all["frames"][3]["transform_matrix"] = Value::Null);
    only(scene.path(), "frame_00003");

    let scene = common::copy("colmap_text");
    let images = scene.path().join("sparse/0/images.txt");
    let text = fs::read_to_string(&images).expect("readable").replace(" 2 photo 3.jpg", " 9 photo 3.jpg");
    fs::write(&images, text).expect("written");
    assert!(matches!(only(scene.path(), "camera 9 does not exist"), Problem::NoPose { .. }));
}

#[test]
fn sizes_that_differ() {
    let scene = common::copy("pac_nerf");
    GrayImage::new(WIDTH as u32 + 2, HEIGHT as u32).save(scene.path().join("data/a_3_1.png")).expect("saved");
    let problem = only(scene.path(), "a_3_1.png: 50x36 pixels");
    assert!(matches!(problem, Problem::WrongSize { expected: (WIDTH, HEIGHT), .. }));

    let scene = common::copy("pac_nerf");
    RgbImage::new(WIDTH as u32, 8).save(scene.path().join("data/r_3_-1.png")).expect("saved");
    only(scene.path(), "r_3_-1.png");
}

#[test]
fn a_frame_without_mask() {
    let scene = common::copy("pac_nerf");
    fs::remove_file(scene.path().join("data/a_0_1.png")).expect("removed");
    assert!(matches!(only(scene.path(), "r_0_1.png: no mask"), Problem::MissingMask { .. }));

    let scene = common::copy("colmap_binary");
    fs::remove_dir_all(scene.path().join("masks")).expect("removed");
    assert_eq!(problems(scene.path()).len(), 4);

    // Without any mask, the empty backgrounds make them.
    let scene = common::copy("pac_nerf");
    for (camera, frame) in [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1), (3, 0), (3, 1)] {
        fs::remove_file(scene.path().join(format!("data/a_{camera}_{frame}.png"))).expect("removed");
    }
    let opened = Scene::open(scene.path()).expect("matting");
    assert!(opened.views.iter().all(|view| view.mask == MaskSource::Difference));
    let (_, mask) = opened.load_view(1, 0).expect("a mask");
    let truth = Scene::open(common::data("pac_nerf")).expect("opens").load_view(1, 0).expect("a mask").1;
    assert!((mask.area() / truth.area() - 1.0).abs() < 0.05, "{} for {}", mask.area(), truth.area());
}

#[test]
fn one_camera_only() {
    let scene = common::copy("pac_nerf");
    edit(scene.path().join("all_data.json"), |list| list.as_array_mut().expect("a list").truncate(3));
    assert!(matches!(only(scene.path(), "only one camera position"), Problem::OneCamera { .. }));
}

#[test]
fn times_that_do_not_increase() {
    let scene = common::copy("pac_nerf");
    edit(scene.path().join("all_data.json"), |list| {
        // The second frame of every camera before its first.
        [2, 5, 8, 11].iter().for_each(|&entry| list[entry]["time"] = (-1.0).into());
    });
    let found = problems(scene.path());
    assert!(
        found.len() == 4 && found.iter().all(|problem| matches!(problem, Problem::TimesNotIncreasing { .. })),
        "{found:?}"
    );

    let scene = common::copy("spring_gaus");
    edit(scene.path().join("frame.json"), |list| list[1]["001"] = 0.0.into());
    assert!(problems(scene.path()).iter().any(|problem| matches!(problem, Problem::TimesNotIncreasing { .. })));

    // The order in the list does not matter.
    let scene = common::copy("pac_nerf");
    edit(scene.path().join("all_data.json"), |list| list.as_array_mut().expect("a list").reverse());
    let (reversed, straight) =
        (Scene::open(scene.path()).expect("opens"), Scene::open(common::data("pac_nerf")).expect("opens"));
    assert_eq!((&reversed.times, &reversed.cameras), (&straight.times, &straight.cameras));
}

#[test]
fn empty_masks() {
    let scene = common::copy("pac_nerf");
    let empty = |camera: usize, frame: usize| {
        let path = scene.path().join(format!("data/a_{camera}_{frame}.png"));
        GrayImage::new(WIDTH as u32, HEIGHT as u32).save(path).expect("saved");
    };
    empty(2, 0);
    let opened = Scene::open(scene.path()).expect("one empty mask is no reason to stop");
    let found = opened.check_pixels();
    assert!(matches!(&found[..], [Problem::EmptyMask { path }] if path.ends_with("data/a_2_0.png")), "{found:?}");
    let report = inspect(&opened).expect("a warning only");
    assert!(report.warnings.iter().any(|warning| warning.contains("a_2_0.png")), "{:?}", report.warnings);

    (0..4).for_each(|camera| empty(camera, 0));
    let found = opened.check_pixels();
    assert_eq!(found.len(), 5, "{found:?}");
    assert!(matches!(found[4], Problem::EmptyFrame { frame: 0, .. }) && found[4].severity() == Severity::Error);
    assert!(matches!(inspect(&opened), Err(SceneError::Invalid(_))));
}

#[test]
fn everything_wrong_is_listed_at_once() {
    let scene = common::copy("pac_nerf");
    let data = scene.path().join("data");
    fs::remove_file(data.join("r_1_0.png")).expect("removed");
    fs::write(data.join("r_2_1.png"), "not a picture").expect("written");
    fs::remove_file(data.join("a_0_1.png")).expect("removed");
    GrayImage::new(3, 3).save(data.join("a_3_1.png")).expect("saved");
    edit(scene.path().join("all_data.json"), |list| list[0]["time"] = Value::from("noon"));
    let text = Scene::open(scene.path()).expect_err("wrong").to_string();
    for name in ["r_1_0.png", "r_2_1.png", "r_0_1.png", "a_3_1.png", "r_0_-1.png", "5 problems"] {
        assert!(text.contains(name), "{name} is not in:\n{text}");
    }
}

#[test]
fn lists_that_make_no_sense() {
    let scene = common::copy("pac_nerf");
    edit(scene.path().join("all_data.json"), |list| *list = Value::Array(Vec::new()));
    assert!(matches!(only(scene.path(), "lists no pictures"), Problem::NoPictures { .. }));
    fs::write(scene.path().join("all_data.json"), "[{").expect("written");
    assert!(matches!(Scene::open(scene.path()), Err(SceneError::Malformed { .. })));
    edit_duplicate();
    // A camera that lacks a frame is usable.
    let scene = common::copy("pac_nerf");
    edit(scene.path().join("all_data.json"), |list| drop(list.as_array_mut().expect("a list").pop()));
    let opened = Scene::open(scene.path()).expect("a warning only");
    assert!(matches!(opened.warnings[..], [Problem::MissingFrame { frame: 1, .. }]), "{:?}", opened.warnings);
}

#[test]
fn a_camera_without_pictures() {
    let scene = common::copy("real_capture");
    edit(scene.path().join("dynamic/sequences/ball/0.json"), |list| list["C0787"] = Value::Array(Vec::new()));
    assert!(matches!(only(scene.path(), "has no pictures"), Problem::IdleCamera { .. }));
}

fn edit_duplicate() {
    let scene = common::copy("pac_nerf");
    edit(scene.path().join("all_data.json"), |list| {
        let again = list[1].clone();
        list.as_array_mut().expect("a list").push(again);
    });
    assert!(matches!(only(scene.path(), "r_0_0.png"), Problem::Duplicate { .. }));
}

#[test]
fn no_scene_at_all() {
    let empty = tempfile::tempdir().expect("a folder");
    let error = Scene::open(empty.path()).expect_err("nothing there");
    assert!(matches!(error, SceneError::UnknownFormat { .. }) && error.to_string().contains("all_data.json"));
    let error = Scene::open(empty.path().join("nowhere")).expect_err("nothing there");
    assert!(matches!(error, SceneError::NotFound { .. }));
    for rate in [0.0, -24.0, f64::NAN, f64::INFINITY] {
        let settings = SceneSettings { frame_rate_hz: Some(rate), ..SceneSettings::default() };
        let error = Scene::open_with(common::data("pac_nerf"), &settings).expect_err("no rate");
        assert!(matches!(error, SceneError::Setting { name: "frame_rate_hz", .. }), "{error}");
    }
}

#[test]
fn cameras_that_are_not_there() {
    let scene = Scene::open(common::data("pac_nerf")).expect("opens");
    for chosen in [&[][..], &[0, 1, 99], &[1, 1]] {
        let error = scene.with_cameras(chosen).expect_err("no such choice");
        assert!(matches!(error, SceneError::Setting { name: "cameras", .. }), "{error}");
        let last = scene.cameras.len() - 1;
        assert!(!chosen.contains(&99) || error.to_string().contains(&format!("{last} (")), "{error}");
    }
    let few = scene.with_cameras(&[2, 0]).expect("both are there");
    assert_eq!(few.cameras, [scene.cameras[2].clone(), scene.cameras[0].clone()]);
    assert_eq!(few.views.len(), 2 * scene.times.len());
    for frame in 0..scene.times.len() {
        let picture = |scene: &Scene, camera| scene.view(camera, frame).expect("a view").picture.clone();
        assert_eq!((picture(&few, 0), picture(&few, 1)), (picture(&scene, 2), picture(&scene, 0)));
    }
}

#[test]
fn colmap_models_that_cannot_be_used() {
    let scene = common::copy("colmap_text");
    let cameras = scene.path().join("sparse/0/cameras.txt");
    let text = fs::read_to_string(&cameras).expect("readable").replace(" OPENCV ", " THIN_PRISM_FISHEYE ");
    fs::write(&cameras, text + "0 0 0 0\n").expect("written");
    let found = problems(scene.path());
    assert!(found.iter().all(|p| matches!(p, Problem::UnsupportedCamera { .. })) && found.len() == 2, "{found:?}");
    assert!(found[0].to_string().contains("THIN_PRISM_FISHEYE"));

    let scene = common::copy("colmap_binary");
    for name in ["images.bin", "cameras.bin", "points3D.bin"] {
        let path = scene.path().join("sparse/0").join(name);
        let whole = fs::read(&path).expect("readable");
        for length in [0, 7, whole.len() / 2, whole.len() - 1] {
            fs::write(&path, &whole[..length]).expect("written");
            let error = Scene::open(scene.path()).expect_err("cut");
            assert!(matches!(error, SceneError::Malformed { .. }) && error.to_string().contains(name), "{error}");
        }
        // A count beyond all memory.
        fs::write(&path, [255; 64]).expect("written");
        assert!(Scene::open(scene.path()).is_err());
        fs::write(&path, whole).expect("written");
    }
    Scene::open(scene.path()).expect("whole again");
}

#[test]
fn other_kinds_of_pictures_work() {
    let scene = common::copy("pac_nerf");
    let data = scene.path().join("data");
    let truth = Scene::open(common::data("pac_nerf")).expect("opens");

    // 16 bits a channel.
    let colour = decoded(data.join("r_0_0.png")).to_rgb16();
    colour.save(data.join("r_0_0.png")).expect("saved");
    let grey: ImageBuffer<Luma<u16>, Vec<u16>> = decoded(data.join("a_0_0.png")).to_luma16();
    grey.save(data.join("a_0_0.png")).expect("saved");
    // RGBA masks, as matting networks write them; and black and white saved as opaque RGBA.
    let drawn = common::draw(&common::cameras()[1], 0, [0.0; 4]);
    drawn.save(data.join("a_1_0.png")).expect("saved");
    let opaque = RgbaImage::from_fn(WIDTH as u32, HEIGHT as u32, |x, y| {
        let a = drawn.get_pixel(x, y).0[3];
        image::Rgba([a, a, a, 255])
    });
    opaque.save(data.join("a_1_1.png")).expect("saved");
    // JPEG under the name of a PNG.
    let photograph = decoded(data.join("r_2_0.png")).to_rgb8();
    photograph.save_with_format(data.join("r_2_0.png"), image::ImageFormat::Jpeg).expect("saved");
    write_palette(&data.join("a_2_0.png"), &decoded(data.join("a_2_0.png")).to_luma8());
    // Only the copy over white.
    fs::remove_file(data.join("a_3_0.png")).expect("removed");
    let drawn = common::draw(&common::cameras()[3], 0, [0.0; 4]);
    let picture = decoded(data.join("r_3_0.png")).to_rgb8();
    let over_white = RgbImage::from_fn(WIDTH as u32, HEIGHT as u32, |x, y| {
        let a = f64::from(drawn.get_pixel(x, y).0[3]) / 255.0;
        Rgb(picture.get_pixel(x, y).0.map(|v| (a * f64::from(v) + (1.0 - a) * 255.0).round() as u8))
    });
    over_white.save(data.join("m_3_0.png")).expect("saved");

    let opened = Scene::open(scene.path()).unwrap_or_else(|error| panic!("{error}"));
    for (camera, frame, picture_limit, mask_limit) in
        [(0, 0, 1e-4, 1e-4), (1, 0, 1e-6, 1e-6), (2, 0, 0.5, 1e-6), (3, 0, 1e-6, 0.02)]
    {
        let (picture, mask) = opened.load_view(camera, frame).expect("pixels");
        let (true_picture, true_mask) = truth.load_view(camera, frame).expect("pixels");
        let largest = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let (p, m) = (largest(&picture.rgb, &true_picture.rgb), largest(&mask.coverage, &true_mask.coverage));
        assert!(p < picture_limit && m < mask_limit, "camera {camera}: {p}, {m}");
    }
    let expected = f64::from(drawn_area(&drawn_opaque(&opaque)));
    assert!((opened.load_view(1, 1).expect("pixels").1.area() - expected).abs() < 1e-2);
}

fn drawn_opaque(opaque: &RgbaImage) -> GrayImage {
    GrayImage::from_fn(opaque.width(), opaque.height(), |x, y| Luma([opaque.get_pixel(x, y).0[0]]))
}

fn drawn_area(mask: &GrayImage) -> f32 {
    mask.iter().map(|&v| f32::from(v) / 255.0).sum()
}

/// A grey picture as a PNG with a palette of 256 greys in reverse order.
fn write_palette(path: &Path, grey: &GrayImage) {
    let file = fs::File::create(path).expect("created");
    let mut encoder = png::Encoder::new(file, grey.width(), grey.height());
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_palette((0..=255_u8).rev().flat_map(|v| [v; 3]).collect::<Vec<u8>>());
    let indices: Vec<u8> = grey.iter().map(|&v| 255 - v).collect();
    encoder.write_header().expect("a header").write_image_data(&indices).expect("pixels");
}

#[test]
fn inspection_recognises_flipped_axes_and_an_outlier() {
    let report = |scene: &Scene| inspect(scene).expect("a report");
    let scene = Scene::open(common::data("pac_nerf")).expect("opens");
    let good = report(&scene);
    assert!(good.warnings.is_empty(), "{:?}", good.warnings);
    let hull = good.hull.expect("a hull");
    for axis in 0..3 {
        let middle = (hull.low_m[axis] + hull.high_m[axis]) / 2.0;
        assert!((middle - common::BALL[0][axis]).abs() < 0.02, "{hull:?}");
        assert!((0.28..0.42).contains(&hull.size_m[axis]), "{hull:?}");
    }

    // OpenCV axes where OpenGL ones are expected.
    let flipped = common::copy("pac_nerf");
    edit(flipped.path().join("all_data.json"), |list| {
        for entry in list.as_array_mut().expect("a list") {
            for row in entry["c2w"].as_array_mut().expect("rows") {
                (1..3).for_each(|column| row[column] = (-row[column].as_f64().expect("a number")).into());
            }
        }
    });
    let warnings = report(&Scene::open(flipped.path()).expect("opens")).warnings;
    assert!(warnings.iter().any(|w| w.contains("flipped") && w.contains("2nd and 3rd column")), "{warnings:?}");

    // One camera turned about its viewing direction.
    let mut turned = scene.clone();
    let x = turned.cameras[2].world_from_camera.x_axis;
    let y = turned.cameras[2].world_from_camera.y_axis;
    (turned.cameras[2].world_from_camera.x_axis, turned.cameras[2].world_from_camera.y_axis) = (y, -x);
    turned.cameras[2].principal.x += 6.0;
    let warnings = report(&turned).warnings;
    assert!(warnings.iter().any(|w| w.contains("camera 2 disagrees")), "{warnings:?}");
}

#[test]
fn a_matting_network_that_cannot_be_used() {
    let network = common::data("pac_nerf").join("all_data.json");
    let settings = SceneSettings { matting: Some(network), ..SceneSettings::default() };
    let error = Scene::open_with(common::data("pac_nerf"), &settings).expect_err("no network");
    assert!(matches!(error, SceneError::Matting { .. }) && error.to_string().contains("all_data.json"), "{error}");
}

#[test]
fn inspection_recognises_masks_that_are_none() {
    let scene = common::copy("spring_gaus");
    for frame in 0..2 {
        let path = scene.path().join(format!("camera_1/{frame:03}.png"));
        let mut picture = decoded(path.clone()).to_rgba8();
        picture.pixels_mut().for_each(|pixel| pixel.0[3] = 255);
        picture.save(path).expect("saved");
    }
    let warnings = inspect(&Scene::open(scene.path()).expect("opens")).expect("a report").warnings;
    assert!(warnings.iter().any(|w| w.contains("cover whole pictures (camera_1)")), "{warnings:?}");
}

#[test]
fn the_report_names_what_was_read() {
    let scene = Scene::open(common::data("real_capture")).expect("opens");
    let report = inspect(&scene).expect("a report");
    let text = report.to_string();
    for words in
        ["Spring-Gaus, real capture", "3 cameras, 2 frames", "30.00 frames/s", "C0801", "4 photographs", "48x36"]
    {
        assert!(text.contains(words), "`{words}` is not in:\n{text}");
    }
    let sheet = tempfile::tempdir().expect("a folder");
    report.contact_sheet.save_png(&sheet.path().join("sheet.png")).expect("saved");
    assert_eq!(decoded(sheet.path().join("sheet.png")).width() as usize, report.contact_sheet.width);
    assert!(report.contact_sheet.save_png(&sheet.path().join("no/where.png")).is_err());
}
