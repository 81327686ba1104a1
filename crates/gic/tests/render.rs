//! `gic render` from outside.

mod common;
#[path = "common/falling_box.rs"]
mod falling_box;

use std::fs;
use std::path::Path;

use image::AnimationDecoder;
use image::codecs::gif::GifDecoder;

use common::gic;
use falling_box::falling_box;

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn frames_become_pictures_and_a_film() {
    let folder = falling_box(0.1);
    let (frames, out) = (folder.path().join("frames"), folder.path().join("out"));
    let film = folder.path().join("film.gif");
    let args =
        ["render", text(&frames), "-o", text(&out), "--size", "96x64", "--background", "black", "--film", text(&film)];
    let output = gic(&args);
    assert!(output.status.success(), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stdout).contains("3 pictures"), "{output:?}");

    let bright = |index: usize| {
        let picture = image::open(out.join(format!("frame_{index:04}.png"))).unwrap().to_rgb8();
        assert_eq!(picture.dimensions(), (96, 64));
        let rows: Vec<u32> =
            picture.enumerate_pixels().filter(|(.., p)| p.0.iter().any(|&c| c > 60)).map(|(_, y, _)| y).collect();
        // The box is seen, and black around it.
        assert!(rows.len() > 96 * 64 / 50 && rows.len() < 96 * 64 / 2, "{} bright pixels", rows.len());
        f64::from(rows.iter().sum::<u32>()) / rows.len() as f64
    };
    assert!(bright(1) > bright(0), "it falls");
    let reader = std::io::BufReader::new(fs::File::open(&film).unwrap());
    assert_eq!(GifDecoder::new(reader).unwrap().into_frames().count(), 3);
    // The same bytes again.
    let first = fs::read(out.join("frame_0002.png")).unwrap();
    assert!(gic(&args).status.success());
    assert_eq!(fs::read(out.join("frame_0002.png")).unwrap(), first);
}

#[test]
fn mistakes_say_the_way_out() {
    let folder = falling_box(0.1);
    let (frames, out) = (folder.path().join("frames"), folder.path().join("out"));
    let refusal = |args: &[&str], code: i32| {
        let output = gic(&[&["render"], args, &["-o", text(&out)]].concat());
        assert_eq!(output.status.code(), Some(code), "{output:?}");
        String::from_utf8(output.stderr).unwrap()
    };
    assert!(refusal(&[text(folder.path())], 1).contains("gic simulate"));
    assert!(refusal(&[text(&frames), "--film", "film.avi"], 1).contains(".gif, .mp4 or .webp"));
    assert!(refusal(&[text(&frames), "--camera", "3"], 1).contains("--scene"));
    assert!(refusal(&[text(&frames), "--background", "picture"], 1).contains("--camera 0"));
    assert!(refusal(&[text(&frames), "--camera", "left"], 2).contains("orbit"));
    assert!(refusal(&[text(&frames), "--size", "0x4"], 2).contains("640x480"));
    assert!(!out.exists(), "nothing is written before all is known to be right");
}

#[test]
fn colours_that_were_never_trained_are_refused() {
    let folder = falling_box(0.1);
    let (frames, out) = (folder.path().join("frames"), folder.path().join("out"));
    let output = gic(&["render", text(&frames), "-o", text(&out), "--color", "appearance"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("gic run SCENE -o RUN"), "{output:?}");
}

#[test]
fn an_orbit_has_no_video_beside_it() {
    let folder = falling_box(0.1);
    let (frames, out) = (folder.path().join("frames"), folder.path().join("out"));
    let output = gic(&["render", text(&frames), "-o", text(&out), "--beside-video"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("--camera 0"), "{output:?}");
}

#[test]
fn ffmpeg_makes_the_other_films_where_it_is_installed() {
    let folder = falling_box(0.1);
    let (frames, out) = (folder.path().join("frames"), folder.path().join("out"));
    let installed = std::process::Command::new("ffmpeg").arg("-version").output().is_ok();
    for (name, marker) in [("film.webp", &b"ANIM"[..]), ("film.mp4", &b"ftyp"[..])] {
        let film = folder.path().join(name);
        let output = gic(&["render", text(&frames), "-o", text(&out), "--size", "96x64", "--film", text(&film)]);
        if installed {
            assert!(output.status.success(), "{output:?}");
            let bytes = fs::read(&film).unwrap();
            assert!(bytes.windows(4).take(64).any(|w| w == marker), "{name}");
        } else {
            assert!(String::from_utf8_lossy(&output.stderr).contains("ffmpeg"), "{output:?}");
        }
    }
}
