//! A scene folder from films, and its cameras later.

mod common;

use std::path::{Path, PathBuf};

use common::{ffmpeg, has_ffmpeg};
use gic_film::{Align, ImportRequest, import};
use gic_scene::{MaskChoice, Scene, SceneSettings};
use gic_twin::Interrupt;
use gic_twin::events::Events;
use serde_json::{Value, json};

const SIZE: [usize; 2] = [64, 48];

/// A patterned floor, a red square that falls and rests in the last third; the second camera sees it mirrored.
fn pictures(folder: &Path, camera: &str, count: usize) {
    std::fs::create_dir_all(folder.join(camera)).unwrap();
    for n in 0..count {
        let picture = image::RgbImage::from_fn(SIZE[0] as u32, SIZE[1] as u32, |x, y| {
            let x = if camera == "right" { SIZE[0] as u32 - 1 - x } else { x };
            let top = (2 * n.min(2 * count / 3)) as u32;
            let inside = (20..32).contains(&x) && (top..top + 12).contains(&y);
            let noise = ((x * 31 + y * 17 + n as u32 * 13) % 5) as u8;
            if inside { image::Rgb([200, 40, 40 + noise]) } else { image::Rgb([90 + noise, 110, 100 + (y as u8)]) }
        });
        picture.save(folder.join(camera).join(format!("{n:03}.png"))).unwrap();
    }
}

fn request(films: &[PathBuf], scene: &Path) -> ImportRequest {
    ImportRequest {
        films: films.to_vec(),
        scene: scene.to_owned(),
        start_s: None,
        frames: None,
        every: 1,
        frame_rate_hz: Some(50.0),
        calibration: None,
        align: Align::Auto,
    }
}

fn run(request: &ImportRequest) -> gic_film::Result<gic_film::Imported> {
    import(request, &Events::silent(), &Interrupt::default())
}

/// Two cameras that look at each other across the origin.
fn calibration(folder: &Path) -> PathBuf {
    let camera = |name: &str, sign: f64| {
        json!({"name": name, "width_px": SIZE[0], "height_px": SIZE[1], "fx_px": 60.0, "fy_px": 60.0, "cx_px": 32.0,
            "cy_px": 24.0, "distortion": {"k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0},
            "world_from_camera": [[sign, 0.0, 0.0, 0.0], [0.0, 0.0, sign, -sign], [0.0, -1.0, 0.0, 0.0]]})
    };
    let file = folder.join("calibration.json");
    let all = json!({"schema": "gic.calibration/1", "cameras": [camera("left", 1.0), camera("right", -1.0)],
        "up": [0.0, 0.0, 1.0], "ground": {"point": [0.0, 0.0, -0.4], "normal": [0.0, 0.0, 1.0]}, "metric": true});
    std::fs::write(&file, all.to_string()).unwrap();
    file
}

#[test]
fn films_become_a_scene_and_cameras_come_later() {
    let folder = tempfile::tempdir().unwrap();
    let (films, scene) = (folder.path().join("films"), folder.path().join("scene"));
    pictures(&films, "left", 24);
    pictures(&films, "right", 24);
    let cut = ImportRequest { start_s: Some(0.1), frames: Some(5), every: 2, ..request(&[films], &scene) };
    let imported = run(&cut).unwrap();
    assert_eq!((imported.frames, imported.is_calibrated, imported.aligned_by), (5, false, Align::None));
    for camera in &imported.cameras {
        assert_eq!(camera.never_free_px, Some(0), "{}", camera.name);
        // The square at rest is not burnt in.
        let empty = image::open(scene.join(format!("backgrounds/{}.png", camera.name))).unwrap().into_rgb8();
        assert!(empty.pixels().all(|pixel| pixel[0] < 120), "{}", camera.name);
    }
    let list: Value = serde_json::from_slice(&std::fs::read(scene.join("transforms.json")).unwrap()).unwrap();
    let frames = list["frames"].as_array().unwrap();
    assert_eq!(frames.len(), 10);
    assert_eq!(frames[1]["film_frame"], json!(7));
    assert!((frames[1]["time"].as_f64().unwrap() - 0.04).abs() < 1e-9);
    assert!(scene.join("contact.png").is_file());

    // Cameras by name, without the films; the pictures stay as they are.
    let written = std::fs::metadata(scene.join("images/left_0000.png")).unwrap().modified().unwrap();
    let later = ImportRequest { films: vec![], calibration: Some(calibration(folder.path())), ..cut.clone() };
    assert!(run(&later).unwrap().is_calibrated);
    let again = std::fs::metadata(scene.join("images/left_0000.png")).unwrap().modified().unwrap();
    assert_eq!(written, again);
    let settings = SceneSettings { masks: MaskChoice::Difference, ..SceneSettings::default() };
    let read = Scene::open_with(&scene, &settings).unwrap();
    assert_eq!(read.camera_names, ["left", "right"]);
    assert_eq!((read.times.len(), read.views.len()), (5, 10));
    assert!(read.world.metric && (read.world.ground.unwrap().point.z + 0.4).abs() < 1e-12);
    assert!((read.cameras[0].world_from_camera.z_axis.y - 1.0).abs() < 1e-9, "looks along y");
    let masks = read.load_masks(read.views_at(0)).unwrap();
    masks.iter().for_each(|mask| assert!((mask.area() - 144.0).abs() < 10.0, "{}", mask.area()));

    // The same import again does nothing; another one is refused.
    assert!(!run(&ImportRequest { calibration: None, ..cut.clone() }).unwrap().cameras.is_empty());
    let other = run(&ImportRequest { every: 3, ..cut }).unwrap_err();
    assert!(other.to_string().contains("another import") && other.hint().is_some(), "{other}");
}

#[test]
fn what_does_not_fit_is_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let (films, scene) = (folder.path().join("films"), folder.path().join("scene"));
    pictures(&films, "left", 6);
    pictures(&films, "middle", 6);
    let calibrated = ImportRequest {
        calibration: Some(calibration(folder.path())),
        ..request(std::slice::from_ref(&films), &scene)
    };
    let unknown = run(&calibrated).unwrap_err();
    assert!(unknown.to_string().contains("no camera middle; it knows left, right"), "{unknown}");
    assert!(!scene.exists());
    let full = run(&request(std::slice::from_ref(&films), folder.path())).unwrap_err();
    assert!(full.to_string().contains("not empty"), "{full}");
    let long = ImportRequest { frames: Some(7), ..request(std::slice::from_ref(&films), &scene) };
    assert!(run(&long).unwrap_err().is_usage() && !scene.exists());
    let late = ImportRequest { start_s: Some(9.0), ..request(&[films], &folder.path().join("late")) };
    assert!(run(&late).unwrap_err().to_string().contains("0.000 to 0.100 s"));
    let nothing = ImportRequest { films: vec![], ..request(&[], folder.path()) };
    assert!(run(&nothing).unwrap_err().to_string().contains("no imported scene"));
}

/// Two films of one motion at other rates and containers, the second beginning later: each picture keeps its time.
#[test]
fn cameras_that_run_apart_keep_their_own_times() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let films = folder.path().join("films");
    std::fs::create_dir(&films).unwrap();
    for (name, moment) in [("a.mkv", 0.31), ("b.mov", 0.2)] {
        let picture = format!("testsrc2=s=64x48:r=50:d=1.2,eq=brightness='-0.4+0.4*gte(t,{moment})':eval=frame");
        let sound = format!("aevalsrc='0.8*exp(-80*(t-{moment}))*gte(t,{moment})*sin(5000*t)':s=48000:d=1.2");
        let codecs = ["-c:v", "mpeg4", "-c:a", "pcm_s16le"];
        let inputs = ["-f", "lavfi", "-i", &picture, "-f", "lavfi", "-i", &sound];
        ffmpeg(&[&inputs[..], &codecs].concat(), &films.join(name));
    }
    let scene = folder.path().join("scene");
    let imported = run(&ImportRequest { frames: Some(8), ..request(&[films], &scene) }).unwrap();
    assert_eq!(imported.aligned_by, Align::Clap);
    assert!((imported.cameras[1].offset_s - 0.11).abs() < 1e-3, "{}", imported.cameras[1].offset_s);
    let list: Value = serde_json::from_slice(&std::fs::read(scene.join("transforms.json")).unwrap()).unwrap();
    let time = |n: usize| list["frames"][n]["time"].as_f64().unwrap();
    // b lies half a frame apart from a, and its pictures are 20 ms apart.
    assert!(((time(8) - time(0)).abs() - 0.01).abs() < 1.5e-3, "{} {}", time(0), time(8));
    assert!((time(15) - time(8) - 0.14).abs() < 1e-6);
}
