//! Masks of a scene: written, judged by the hull of the others, and never over what a hand made.

mod common;

use std::io::Write;
use std::path::{Path, PathBuf};

use common::{ffmpeg, has_ffmpeg};
use gic_film::{Align, ImportRequest, MasksRequest, import, make_masks};
use gic_scene::Mask;
use gic_twin::Interrupt;
use gic_twin::events::Events;
use serde_json::json;

const SIZE: usize = 96;
const FOCAL: f64 = 120.0;

/// Four cameras around the origin, 1 m away, level; camera-to-world for OpenGL's axes.
fn pose(camera: usize) -> [[f64; 4]; 4] {
    let (sin, cos) = (camera as f64 * std::f64::consts::FRAC_PI_2).sin_cos();
    [[-sin, 0.0, cos, cos], [cos, 0.0, sin, sin], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
}

/// A blue ball at the origin before a grey wall: pictures, empty backgrounds, and the list.
fn scene(folder: &Path) {
    for part in ["images", "backgrounds"] {
        std::fs::create_dir_all(folder.join(part)).unwrap();
    }
    let mut frames = Vec::new();
    for camera in 0..4 {
        let paint = |ball: bool| {
            image::RgbImage::from_fn(SIZE as u32, SIZE as u32, |x, y| {
                let middle = SIZE as f64 / 2.0;
                let inside = (x as f64 + 0.5 - middle).hypot(y as f64 + 0.5 - middle) < FOCAL * 0.2;
                let noise = ((x * 7 + y * 13 + u32::from(ball) * 5) % 4) as u8;
                if ball && inside {
                    image::Rgb([30, 40, 150])
                } else {
                    image::Rgb([140 + noise, 140, 135 + (y / 8) as u8])
                }
            })
        };
        paint(false).save(folder.join(format!("backgrounds/c{camera}.png"))).unwrap();
        for frame in 0..2 {
            let file = format!("images/c{camera}_{frame}.png");
            paint(true).save(folder.join(&file)).unwrap();
            frames.push(json!({"file_path": file, "camera_label": format!("c{camera}"), "time": 0.04 * frame as f64,
                "transform_matrix": pose(camera), "background_path": format!("backgrounds/c{camera}.png")}));
        }
    }
    let all = json!({"w": SIZE, "h": SIZE, "fl_x": FOCAL, "fl_y": FOCAL, "frames": frames});
    std::fs::write(folder.join("transforms.json"), all.to_string()).unwrap();
}

fn request(scene: &Path) -> MasksRequest {
    MasksRequest { scene: scene.to_owned(), out: None, network: None, boxes: Vec::new() }
}

fn make(request: &MasksRequest) -> gic_film::Result<gic_film::Masks> {
    make_masks(request, &Events::silent(), &Interrupt::default())
}

fn save(mask: impl Fn(f64) -> bool, path: &Path) {
    let grey = image::GrayImage::from_fn(SIZE as u32, SIZE as u32, |x, y| {
        let middle = SIZE as f64 / 2.0;
        let radius = (x as f64 + 0.5 - middle).hypot(y as f64 + 0.5 - middle);
        image::Luma([if mask(radius) { 255 } else { 0 }])
    });
    grey.save(path).unwrap();
}

#[test]
fn corrected_masks_win_and_wrong_ones_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    scene(root);
    let made = make(&request(root)).unwrap();
    assert_eq!(made.views.len(), 8);
    for view in &made.views {
        assert!(!view.is_doubtful && view.source == "difference" && view.overlap.unwrap() > 0.9, "{view:?}");
        let true_area = std::f64::consts::PI * (FOCAL * 0.2).powi(2);
        assert!((view.area_px / true_area - 1.0).abs() < 0.03, "{view:?}");
    }
    assert!(root.join("masks/contact_sheet.png").is_file() && root.join("masks/masks.json").is_file());

    // By hand: one far too small, one far too large.
    std::fs::create_dir(root.join("masks_corrected")).unwrap();
    let small = root.join("masks_corrected/c1_0.png");
    save(|radius| radius < FOCAL * 0.1, &small);
    save(|radius| radius < FOCAL * 0.3, &root.join("masks_corrected/c2_1.png"));
    let before = std::fs::read(&small).unwrap();
    let made = make(&request(root)).unwrap();
    let doubtful: Vec<&str> =
        made.views.iter().filter(|view| view.is_doubtful).map(|view| view.file.as_str()).collect();
    assert_eq!(doubtful, ["c1_0.png", "c2_1.png"]);
    assert_eq!(made.views[1].source, "corrected");
    assert_eq!(std::fs::read(&small).unwrap(), before);
    assert!(Mask::read(&root.join("masks/c1_0.png")).unwrap().area() < 600.0);

    // What somebody changed in masks/ is not written over.
    save(|_| false, &root.join("masks/c3_0.png"));
    let refused = make(&request(root)).unwrap_err();
    assert!(
        refused.to_string().contains("c3_0.png") && refused.hint().unwrap().contains("masks_corrected"),
        "{refused}"
    );
    let elsewhere = MasksRequest { out: Some(root.join("other")), ..request(root) };
    assert_eq!(make(&elsewhere).unwrap().views.len(), 8);
}

#[test]
fn a_box_keeps_the_mask_inside() {
    let folder = tempfile::tempdir().unwrap();
    scene(folder.path());
    let boxes = vec!["c0:0,0,48,96".parse().unwrap()];
    let made = make(&MasksRequest { boxes, ..request(folder.path()) }).unwrap();
    let half = made.views.iter().find(|view| view.camera == "c0").unwrap().area_px;
    assert!((half / made.views[1].area_px - 0.5).abs() < 0.05, "{half}");
    let unknown = make(&MasksRequest { boxes: vec!["x:0,0,1,1".parse().unwrap()], ..request(folder.path()) });
    assert!(unknown.unwrap_err().to_string().contains("c0, c1, c2, c3"));
}

/// A ball that falls and bounces before four cameras that have run for some frames before, as films of four kinds: the
/// empty scene from the films themselves, and masks against it.
#[test]
fn masks_of_a_film_by_its_own_background_overlap_the_true_ones() {
    const BEFORE: usize = 12;
    let truth = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/film_ball/retimed"));
    if !truth.is_dir() {
        let _ = writeln!(std::io::stderr(), "SKIPPED: {} is not there", truth.display());
        return;
    }
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let mut films: Vec<PathBuf> = Vec::new();
    let gif = ["-filter_complex", "split[a][b];[a]palettegen[p];[b][p]paletteuse"];
    for (camera, ending) in ["mp4", "mov", "mkv", "gif"].into_iter().enumerate() {
        let pictures = folder.path().join(format!("pictures_{camera}"));
        std::fs::create_dir(&pictures).unwrap();
        for n in 0..BEFORE + 10 {
            let shown = n as i64 - BEFORE as i64;
            let from = truth.join(format!("data/r_{camera}_{}.png", shown.max(-1)));
            std::fs::copy(from, pictures.join(format!("{n:02}.png"))).unwrap();
        }
        let codec: &[&str] = if ending == "gif" { &gif } else { &["-c:v", "libx264", "-crf", "16"] };
        films.push(folder.path().join(format!("{camera}.{ending}")));
        let source = ["-framerate", "50", "-i", pictures.join("%02d.png").to_str().unwrap()].map(str::to_owned);
        let inputs: Vec<&str> = source.iter().map(String::as_str).collect();
        ffmpeg(&[&inputs[..], codec].concat(), &films[camera]);
    }
    let scene = folder.path().join("scene");
    let request = ImportRequest {
        films,
        scene: scene.clone(),
        start_s: Some(0.02 * BEFORE as f64),
        frames: None,
        every: 1,
        frame_rate_hz: None,
        calibration: Some(truth.to_owned()),
        align: Align::Auto,
    };
    assert_eq!(import(&request, &Events::silent(), &Interrupt::default()).unwrap().frames, 10);
    let made = make(&self::request(&scene)).unwrap();
    let mut overlaps: Vec<(f64, &str)> = Vec::new();
    for view in &made.views {
        let mask = Mask::read(&scene.join("masks").join(&view.file)).unwrap();
        let expected = Mask::read(&truth.join(format!("data/a_{}_{}.png", view.camera, view.frame))).unwrap();
        let pairs = mask.coverage.iter().zip(&expected.coverage).map(|(a, b)| (*a >= 0.5, *b >= 0.5));
        let (both, either) = pairs.fold((0, 0), |(i, u), (a, b)| (i + u32::from(a && b), u + u32::from(a || b)));
        overlaps.push((f64::from(both) / f64::from(either), &view.file));
    }
    overlaps.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mean = overlaps.iter().map(|(overlap, _)| overlap).sum::<f64>() / overlaps.len() as f64;
    println!("mean {mean:.4}, worst {:?}", &overlaps[..8]);
    assert!(mean >= 0.9 && overlaps[0].0 >= 0.75, "mean {mean}, worst {:?}", overlaps[0]);
}
