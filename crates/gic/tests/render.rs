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
fn pictures_tell_time_and_stress_unless_asked_not_to() {
    let folder = falling_box(0.1);
    let frames = folder.path().join("frames");
    let drawn = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let args = ["render", text(&frames), "-o", text(&out), "--size", "320x240", "--background", "black"];
        let output = gic(&[&args[..], more].concat());
        assert!(output.status.success(), "{output:?}");
        (String::from_utf8(output.stdout).unwrap(), image::open(out.join("frame_0000.png")).unwrap().to_rgb8())
    };
    let (said, labelled) = drawn("labelled", &[]);
    let (_, bare) = drawn("bare", &["--no-labels"]);
    assert!(said.contains("von Mises stress, blue 0 to red") && said.contains("Pa and more"), "{said}");
    let lit = |picture: &image::RgbImage, rows: std::ops::Range<u32>| {
        rows.flat_map(|y| (0..100).map(move |x| (x, y))).filter(|(x, y)| picture.get_pixel(*x, *y).0[1] > 100).count()
    };
    assert!(lit(&labelled, 0..40) > 200, "the colour bar");
    assert!(lit(&labelled, 215..240) > 20, "the time");
    assert_eq!((lit(&bare, 0..40), lit(&bare, 215..240)), (0, 0));
    // Before the floor is met, no stress is worth a colour: the box is blue.
    let red = bare.pixels().filter(|p| p.0[0] > p.0[2]).count();
    assert_eq!(red, 0, "the noise of a flight is not red");
    // The body fills the picture: it is as high as half of it at least.
    let rows: Vec<u32> = bare.enumerate_pixels().filter(|(.., p)| p.0[2] > 60).map(|(_, y, _)| y).collect();
    assert!(rows.iter().max().unwrap() - rows.iter().min().unwrap() > 100, "{} rows", rows.len());
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

/// A folder like a run's: matter with colours beside it, and its motion in `prediction`.
fn run_like(folder: &Path, height_m: f64) {
    use gic_appearance::{Light, LitGaussians};
    let motion = falling_box(height_m);
    fs::create_dir_all(folder).unwrap();
    fs::copy(motion.path().join("frames/particles_0000.ply"), folder.join("twin.ply")).unwrap();
    let twin = fs::read_to_string(motion.path().join("twin.json")).unwrap();
    let mut twin: serde_json::Value = serde_json::from_str(&twin).unwrap();
    twin["continuum"] = "twin.ply".into();
    fs::write(folder.join("twin.json"), twin.to_string()).unwrap();
    let positions = gic_twin::matter::read_particles(&folder.join("twin.ply")).unwrap().positions;
    let points: Vec<[f32; 3]> = positions.iter().map(|p| p.as_vec3().to_array()).collect();
    let count = points.len();
    let gaussians = gic_splat::Gaussians::colorless(points, vec![0.9; count], vec![0.01; count]);
    let lit = LitGaussians { gaussians, light: Light::default() };
    gic_view::skinned_gaussians::SkinnedGaussians::save(&lit, 0.02, folder).unwrap();
    let (twin, out) = (folder.join("twin.json"), folder.join("prediction"));
    let output = gic(&["simulate", twin.to_str().unwrap(), "-o", out.to_str().unwrap()]);
    assert!(output.status.success(), "{output:?}");
}

#[test]
fn a_moved_run_is_drawn_in_its_own_colours_and_never_in_others() {
    let folder = tempfile::tempdir().unwrap();
    let [made, moved, other] = ["made", "moved", "other"].map(|name| folder.path().join(name));
    run_like(&made, 0.2);
    run_like(&other, 0.4);
    fs::rename(&made, &moved).unwrap();
    let pictures = folder.path().join("pictures");
    let render = ["render", moved.to_str().unwrap(), "-o", pictures.to_str().unwrap(), "--color", "appearance"];
    let output = gic(&render);
    assert!(output.status.success(), "{output:?}");
    // Matter of the same size at another place is not what was simulated.
    fs::copy(other.join("twin.ply"), moved.join("twin.ply")).unwrap();
    let output = gic(&render);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("twin.ply is not the matter that was simulated"), "{message}");
}
