//! `gic view` from outside, and in a browser where there is one.

mod common;
#[path = "common/falling_box.rs"]
mod falling_box;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

use common::gic;
use falling_box::falling_box;

/// The page of three frames of a falling box.
fn page() -> (TempDir, PathBuf) {
    let folder = falling_box(0.2);
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let output = gic(&["view", &path("frames"), "-o", &path("page.html")]);
    assert!(output.status.success(), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stdout).contains("3 frames"), "{output:?}");
    let page = path("page.html").into();
    (folder, page)
}

#[test]
fn a_page_opens_without_network() {
    let (_folder, page) = page();
    let text = fs::read_to_string(page).unwrap();
    assert!(!text.contains("http://") && !text.contains("https://"), "the page must need no network");
    assert!(!text.contains("{{") && !text.contains("{%"), "everything was filled in");
    assert!(text.contains("\"frames\":3") && text.contains("gic: elastic twin"));
}

#[test]
fn a_folder_without_frames_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let output = gic(&["view", folder.path().to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("gic simulate"), "{output:?}");
}

#[test]
fn a_rerun_recording_is_written_where_gic_was_built_for_it() {
    let (folder, _) = page();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let output = gic(&["view", &path("frames"), "--rerun", &path("twin.rrd")]);
    if cfg!(feature = "rerun") {
        assert!(output.status.success(), "{output:?}");
        let bytes = fs::read(path("twin.rrd")).unwrap();
        assert!(bytes.starts_with(b"RRF"), "{:?}", &bytes[..8]);
        for entity in ["/world/twin/stress", "Points3D"] {
            assert!(bytes.windows(entity.len()).any(|w| w == entity.as_bytes()), "no {entity}");
        }
    } else {
        assert_eq!(output.status.code(), Some(1));
        assert!(String::from_utf8_lossy(&output.stderr).contains("--features rerun"), "{output:?}");
        assert!(!Path::new(&path("twin.rrd")).exists());
    }
}

/// A screenshot of the page, if a headless Chromium is installed.
fn screenshot(page: &Path, state: &str, picture: &Path) -> Option<image::RgbImage> {
    let url = format!("file://{}#{state}", page.display());
    let shot = format!("--screenshot={}", picture.display());
    let flags = ["--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];
    let window = ["--window-size=480,400", "--hide-scrollbars", "--virtual-time-budget=2000"];
    Command::new("chromium").args(flags).args(window).args([&shot, &url]).output().ok()?;
    Some(image::open(picture).expect("chromium made a picture").to_rgb8())
}

#[test]
fn a_browser_shows_the_box_falling_onto_the_floor() {
    let (folder, page) = page();
    let picture = folder.path().join("shot.png");
    // Box pixels are saturated: blue to red, on greys.
    let coloured = |state: &str| -> Option<Vec<u32>> {
        let shot = screenshot(&page, state, &picture)?;
        // Between the colour bar, the panel and the player.
        let stage = shot.enumerate_pixels().filter(|(x, y, _)| (30..280).contains(x) && (110..290).contains(y));
        let vivid = stage.filter(|(.., p)| p.0.iter().max().unwrap() - p.0.iter().min().unwrap() > 60);
        Some(vivid.map(|(_, y, _)| y).collect())
    };
    let Some(start) = coloured("frame=0&colour=speed&draw=points") else {
        eprintln!("skipped: the program `chromium` is not installed");
        return;
    };
    let end = coloured("frame=2&colour=speed").unwrap();
    let mean = |rows: &[u32]| f64::from(rows.iter().sum::<u32>()) / rows.len() as f64;
    assert!(start.len() > 2000 && end.len() > 2000, "{} and {} coloured pixels", start.len(), end.len());
    assert!(mean(&end) > mean(&start) + 20.0, "it falls: {} {}", mean(&start), mean(&end));
}
