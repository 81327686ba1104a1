//! Films that begin at different moments are put on one clock.

mod common;

use std::path::Path;

use common::{ffmpeg, has_ffmpeg};
use gic_film::{Align, Film, align, open_films};
use gic_twin::Interrupt;

/// A film with a clap and a flash at `moment_s`, which lasts for the rest of the film, over moving noise.
fn film(folder: &Path, name: &str, rate: &str, moment_s: f64) {
    let picture =
        format!("testsrc2=s=96x64:r={rate}:d=2,eq=brightness=-0.4,eq=brightness='0.35*gte(t,{moment_s})':eval=frame");
    let sound =
        format!("aevalsrc='0.004*random(0)+0.8*exp(-60*(t-{moment_s}))*gte(t,{moment_s})*sin(4000*t)':s=44100:d=2");
    let codec = if name.ends_with("mkv") { ["-c:v", "ffv1", "-c:a", "flac"] } else { ["-c:v", "mpeg4", "-c:a", "aac"] };
    ffmpeg(&[&["-f", "lavfi", "-i", &picture, "-f", "lavfi", "-i", &sound][..], &codec].concat(), &folder.join(name));
}

fn offset(films: &[Film], by: Align) -> f64 {
    let found = align(films, by, &Interrupt::default()).unwrap();
    assert_eq!(found.by, if by == Align::Auto { Align::Clap } else { by });
    assert_eq!(found.offsets_s[0], 0.0);
    found.offsets_s[1]
}

#[test]
fn a_clap_aligns_to_a_millisecond_and_a_flash_to_a_frame() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    film(folder.path(), "a.mkv", "50", 0.7);
    film(folder.path(), "b.mp4", "30", 1.1234);
    film(folder.path(), "c.mov", "25", 0.3);
    let films = open_films(&[folder.path().to_owned()], None).unwrap();
    for (other, expected) in [(1, 0.7 - 1.1234), (2, 0.4)] {
        let pair = [films[0].clone(), films[other].clone()];
        for by in [Align::Clap, Align::Auto] {
            assert!((offset(&pair, by) - expected).abs() < 1e-3, "{} for {expected}", offset(&pair, by));
        }
        assert!((offset(&pair, Align::Flash) - expected).abs() < 0.05, "{}", offset(&pair, Align::Flash));
    }
}

#[test]
fn films_without_a_sign_stay_as_they_are() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.mkv", "b.mkv"] {
        ffmpeg(&["-f", "lavfi", "-i", "testsrc2=s=96x64:r=25:d=1", "-c:v", "ffv1"], &folder.path().join(name));
    }
    let films = open_films(&[folder.path().to_owned()], None).unwrap();
    let found = align(&films, Align::Auto, &Interrupt::default()).unwrap();
    assert_eq!((found.by, found.offsets_s), (Align::None, vec![0.0, 0.0]));
    let refused = align(&films, Align::Clap, &Interrupt::default()).unwrap_err();
    assert!(refused.is_usage() && refused.to_string().contains("a, b"), "{refused}");
}
