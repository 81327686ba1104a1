//! Films of several kinds are read with the times that they state.

mod common;

use std::path::PathBuf;

use common::{ffmpeg, has_ffmpeg};
use gic_files::FileError;
use gic_film::{Film, FilmError, Selection, open_films};

/// A grey that grows from frame to frame: frame n has the brightness 20 n.
const STEPS: &str = "color=c=black:s=64x48:r=25:d=0.4,geq=lum='20*N':cb=128:cr=128";

fn close(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len(), "{found:?}");
    found.iter().zip(expected).for_each(|(a, b)| assert!((a - b).abs() < 2e-3, "{found:?} for {expected:?}"));
}

#[test]
fn every_container_gives_all_frames_with_their_times() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for (name, codec) in [
        ("a.mp4", vec!["-c:v", "libx264", "-crf", "5", "-bf", "2"]),
        ("b.mov", vec!["-c:v", "mpeg4", "-q:v", "2"]),
        ("c.mkv", vec!["-c:v", "ffv1", "-output_ts_offset", "3.5"]),
        ("d.gif", vec![]),
    ] {
        ffmpeg(&[&["-f", "lavfi", "-i", STEPS][..], &codec].concat(), &folder.path().join(name));
    }
    let films = open_films(&[folder.path().to_owned()], None).unwrap();
    assert_eq!(films.iter().map(|film| film.name.as_str()).collect::<Vec<_>>(), ["a", "b", "c", "d"]);
    for film in &films {
        assert_eq!((film.width, film.height), (64, 48));
        close(&film.times_s, &(0..10).map(|n| f64::from(n) * 0.04).collect::<Vec<_>>());
        let chosen = Selection { range: 3..9, every: 2 };
        let frames: Vec<_> = film.frames(&chosen).unwrap().map(|frame| frame.unwrap()).collect();
        assert_eq!(frames.iter().map(|frame| frame.index).collect::<Vec<_>>(), [3, 5, 7]);
        for frame in frames {
            // Limited range: a luma of 16 is black, 235 is white.
            let expected = (20.0 * frame.index as f64 - 16.0).max(0.0) * 255.0 / 219.0;
            let mean = frame.rgb.iter().map(|&v| f64::from(v)).sum::<f64>() / frame.rgb.len() as f64;
            assert!((mean - expected).abs() < 6.0, "{}: frame {} is {mean} for {expected}", film.name, frame.index);
        }
    }
}

#[test]
fn uneven_times_and_turned_pictures_are_kept() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let uneven = folder.path().join("uneven.mkv");
    let filter = ["-vf", "select='not(eq(n,1)+eq(n,2)+eq(n,6))'", "-fps_mode", "vfr", "-c:v", "ffv1"];
    ffmpeg(&[&["-f", "lavfi", "-i", STEPS][..], &filter].concat(), &uneven);
    close(&Film::open(&uneven, None).unwrap().times_s, &[0.0, 0.12, 0.16, 0.2, 0.28, 0.32, 0.36]);

    let (flat, turned) = (folder.path().join("flat.mp4"), folder.path().join("turned.mp4"));
    ffmpeg(&["-f", "lavfi", "-i", STEPS, "-c:v", "mpeg4"], &flat);
    ffmpeg(&["-i", flat.to_str().unwrap(), "-c", "copy", "-metadata:s:v", "rotate=90"], &turned);
    let film = Film::open(&turned, None).unwrap();
    assert_eq!((film.width, film.height), (48, 64));
    assert_eq!(film.frames(&film.all()).unwrap().map(|frame| frame.unwrap().index).last(), Some(9));
}

#[test]
fn numbered_pictures_are_a_film_with_a_rate() {
    let folder = tempfile::tempdir().unwrap();
    for camera in ["left", "right"] {
        std::fs::create_dir(folder.path().join(camera)).unwrap();
        for number in [8, 9, 10] {
            let picture = image::RgbImage::from_pixel(6, 4, image::Rgb([number, 0, 0]));
            picture.save(folder.path().join(camera).join(format!("bild_{number}.png"))).unwrap();
        }
    }
    let refused = open_films(&[folder.path().to_owned()], None).unwrap_err();
    assert!(refused.is_usage() && refused.hint().unwrap().contains("--frame-rate-hz"), "{refused}");
    let films = open_films(&[folder.path().to_owned()], Some(50.0)).unwrap();
    assert_eq!(films.len(), 2);
    close(&films[1].times_s, &[0.0, 0.02, 0.04]);
    let reds: Vec<u8> = films[1].frames(&films[1].all()).unwrap().map(|frame| frame.unwrap().rgb[0]).collect();
    assert_eq!(reds, [8, 9, 10], "by number, not by name");
}

#[test]
fn what_is_no_film_is_named_with_a_way_out() {
    let folder = tempfile::tempdir().unwrap();
    let nothing = open_films(&[folder.path().to_owned()], None).unwrap_err();
    assert!(nothing.to_string().contains("holds no films") && nothing.hint().is_some(), "{nothing}");
    let missing = open_films(&[PathBuf::from("/no/such/film.mp4")], None).unwrap_err();
    assert!(matches!(missing, FilmError::File(FileError::Read { .. })), "{missing}");
    if !has_ffmpeg() {
        return;
    }
    let text = folder.path().join("text.mp4");
    std::fs::write(&text, "no film").unwrap();
    let refused = Film::open(&text, None).unwrap_err();
    assert!(refused.to_string().contains("text.mp4") && refused.hint().is_some(), "{refused}");
    // A film that breaks off is an error at the frame where it does, not a shorter film.
    let (whole, cut) = (folder.path().join("whole.mkv"), folder.path().join("cut.mkv"));
    ffmpeg(&["-f", "lavfi", "-i", STEPS, "-c:v", "ffv1"], &whole);
    let film = Film::open(&whole, None).unwrap();
    let bytes = std::fs::read(&whole).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let mut short = film;
    short.path = cut;
    assert!(short.frames(&short.all()).unwrap().any(|frame| frame.is_err()));
}
