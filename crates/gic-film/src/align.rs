//! One clock for all films: by a flash that all cameras see, or by a clap that all of them hear.
//!
//! A flash is the strongest rise of the median pixel's brightness between two frames, so it is known to a frame. A clap
//! is the strongest rise of the sound out of what was before, known to the sample; sound takes 3 ms a metre.

use gic_twin::Interrupt;
use serde::{Deserialize, Serialize};

use crate::error::{FilmError, Result};
use crate::ffmpeg::Decoder;
use crate::film::Film;
use crate::tuning::{
    CLEAR_RATIO, ECHO_WINDOWS, FLASH_SIZE_PX, LEAST_CLAP, LEAST_FLASH, ONSET_SHARE, QUIET_WINDOWS, SOUND_RATE_HZ,
    SOUND_WINDOW,
};

/// By what films are aligned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Align {
    /// Nothing: all films begin at one moment.
    None,
    /// A flash, or any light that is switched on: to half a frame.
    Flash,
    /// A clap: to a millisecond where all microphones are equally far.
    Clap,
    /// A clap where all films have one that is clear, else a flash, else nothing.
    #[default]
    Auto,
}

/// What was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Alignment {
    /// By what: never [`Align::Auto`].
    pub by: Align,
    /// When each film's first frame is on the clock of the first film [s].
    pub offsets_s: Vec<f64>,
}

/// Finds the clock of films.
///
/// # Errors
/// [`FilmError::Usage`] where the flash or clap that is asked for is not clear in every film; films that cannot be
/// decoded, an interruption.
pub fn align(films: &[Film], by: Align, interrupt: &Interrupt) -> Result<Alignment> {
    let find = |sign: Align| -> Result<Vec<Option<f64>>> {
        let moment = |film: &Film| {
            interrupt.check("some pictures")?;
            match sign {
                Align::Clap => clap(film),
                _ => flash(film),
            }
        };
        films.iter().map(moment).collect()
    };
    let signs: &[Align] = match by {
        Align::None => &[],
        Align::Auto if films.len() < 2 => &[],
        Align::Auto => &[Align::Clap, Align::Flash],
        Align::Clap => &[Align::Clap],
        Align::Flash => &[Align::Flash],
    };
    for sign in signs {
        let moments = find(*sign)?;
        if let Some(moments) = moments.iter().copied().collect::<Option<Vec<f64>>>() {
            return Ok(Alignment { by: *sign, offsets_s: moments.iter().map(|moment| moments[0] - moment).collect() });
        }
        if by != Align::Auto {
            let without = films.iter().zip(&moments).filter(|(_, moment)| moment.is_none());
            let names: Vec<&str> = without.map(|(film, _)| film.name.as_str()).collect();
            return Err(FilmError::usage(
                format!("no clear {} in {}", if by == Align::Clap { "clap" } else { "flash" }, names.join(", ")),
                "leave --align out to take what is clear in all films, or give --align none",
            ));
        }
    }
    Ok(Alignment { by: Align::None, offsets_s: vec![0.0; films.len()] })
}

/// When a film's clear flash is, on its own clock [s]: the time of the first bright frame.
fn flash(film: &Film) -> Result<Option<f64>> {
    let small = small_frames(film)?;
    let steps: Vec<f32> = small.windows(2).map(|pair| median_step(&pair[0], &pair[1])).collect();
    Ok(strongest(&steps, 1, LEAST_FLASH).map(|step| film.times_s[step + 1]))
}

/// All frames, grey and small.
fn small_frames(film: &Film) -> Result<Vec<Vec<f32>>> {
    let (width, height) = FLASH_SIZE_PX;
    if film.pictures.is_empty() {
        let filter = format!("scale={width}:{height}:flags=area");
        let form = ["-map", "0:v:0", "-vf", &filter, "-fps_mode", "passthrough", "-f", "rawvideo", "-pix_fmt", "gray"];
        let bytes = Decoder::start(&film.path, &form)?.rest()?;
        let frames = bytes.chunks_exact(width * height).map(|frame| frame.iter().map(|v| f32::from(*v) / 255.0));
        // What is decoded beyond the probed frames has no time.
        return Ok(frames.take(film.times_s.len()).map(Iterator::collect).collect());
    }
    let grey = |rgb: &[u8]| rgb.iter().map(|value| f32::from(*value)).sum::<f32>() / (3.0 * 255.0);
    let stride = (film.width * film.height / (width * height)).max(1);
    let shrunk =
        |frame: Result<crate::Frame>| Ok(frame?.rgb.chunks_exact(3).step_by(stride).map(grey).collect::<Vec<f32>>());
    film.frames(&film.all())?.map(shrunk).collect()
}

fn median_step(before: &[f32], after: &[f32]) -> f32 {
    let mut steps: Vec<f32> = before.iter().zip(after).map(|(a, b)| b - a).collect();
    let middle = steps.len() / 2;
    if steps.is_empty() { 0.0 } else { *steps.select_nth_unstable_by(middle, f32::total_cmp).1 }
}

/// When a film's clear clap is, on its own clock [s].
fn clap(film: &Film) -> Result<Option<f64>> {
    if !film.has_sound {
        return Ok(None);
    }
    // From the file's time 0 on, with silence where there is no sound.
    let (rate, filter) = (SOUND_RATE_HZ.to_string(), "aresample=async=1:first_pts=0");
    let form = ["-map", "0:a:0", "-ac", "1", "-ar", &rate, "-af", filter, "-f", "f32le"];
    let bytes = Decoder::start(&film.path, &form)?.rest()?;
    let sound: Vec<f32> = bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    Ok(clap_in(&sound).map(|sample| sample as f64 / SOUND_RATE_HZ as f64 - film.file_start_s))
}

/// The sample with which a clear clap begins.
fn clap_in(sound: &[f32]) -> Option<usize> {
    let amplitude = |window: &[f32]| window.iter().map(|value| value.abs()).fold(0.0, f32::max);
    let loud: Vec<f32> = sound.chunks(SOUND_WINDOW).map(amplitude).collect();
    let rise = |i: usize| match i.checked_sub(QUIET_WINDOWS) {
        // The peak may lie a window after the onset.
        Some(first) => loud[i] - loud[first..i - 1].iter().copied().fold(0.0, f32::max),
        None => 0.0,
    };
    let rises: Vec<f32> = (0..loud.len()).map(rise).collect();
    let window = strongest(&rises, ECHO_WINDOWS, LEAST_CLAP)?;
    let start = window.saturating_sub(2) * SOUND_WINDOW;
    let onset = ONSET_SHARE * loud[window];
    Some(start + sound[start..].iter().position(|value| value.abs() >= onset)?)
}

/// The place of the largest value, where it is at least `least` and no other one further off than `apart` comes near.
fn strongest(values: &[f32], apart: usize, least: f32) -> Option<usize> {
    let best = (0..values.len()).max_by(|&a, &b| values[a].total_cmp(&values[b]))?;
    let others = (0..values.len()).filter(|i| i.abs_diff(best) > apart).map(|i| values[i]);
    let next = others.fold(0.0, f32::max);
    (values[best] >= least && values[best] >= CLEAR_RATIO * next).then_some(best)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clap_is_found_in_noise_to_the_sample_and_two_are_none() {
        let mut sound: Vec<f32> = (0..96_000_u32).map(|i| 0.02 * ((i * 7919 % 1000) as f32 / 500.0 - 1.0)).collect();
        assert_eq!(clap_in(&sound), None, "noise alone");
        let mut add = |at: usize, loudness: f32| {
            for n in 0..3000 {
                sound[at + n] += loudness * (-(n as f32) / 600.0).exp() * (n as f32 * 0.9).cos();
            }
            clap_in(&sound)
        };
        assert_eq!(add(40_123, 0.8), Some(40_123));
        assert_eq!(add(70_000, 0.7), None, "which of the two?");
    }

    #[test]
    fn only_a_step_that_stands_out_counts() {
        assert_eq!(strongest(&[0.0, 0.01, 0.3, 0.2, 0.02], 1, 0.05), Some(2));
        assert_eq!(strongest(&[0.0, 0.2, 0.0, 0.3], 1, 0.05), None);
        assert_eq!(strongest(&[0.0, 0.02], 1, 0.05), None);
        assert_eq!(strongest(&[], 1, 0.05), None);
    }
}
