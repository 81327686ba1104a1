//! The figure of the paper's appendix: the matter that filling finds with n_u = 2 to 5 levels, cut through the middle,
//! beside the truth.
//!
//! ```text
//! gic fill RUN
//! cargo run --release -p gic --example filling_levels -- RUN SCENE/gt filling.png
//! ```
//!
//! From left to right n_u = 2, 3, 4, 5 and the truth at the first frame. Grey: matter, darker where denser; red:
//! outline of the true matter, which is where the true particles, smoothed over 0.6 of their spacing, are half as dense
//! as inside.

use std::error::Error;
use std::path::{Path, PathBuf};

use gic::config::{Config, Layer};
use gic::pipeline::{FillSummary, open_scene};
use gic_bench::Truth;
use gic_continuum::{FillSettings, Filling, MaskedView, fill};
use gic_motion::DynamicGaussians;
use glam::DVec3;
use image::{Rgb, RgbImage};

/// Side of a panel [pixels], and its share that the object's largest side takes.
const SIDE: u32 = 320;
const SHARE: f64 = 0.8;
/// Standard deviation of the true particles' smoothing, in spacings.
const SMOOTHING: f64 = 0.6;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<PathBuf> = std::env::args().skip(1).map(PathBuf::from).collect();
    let [run, truth, picture] = arguments.as_slice() else {
        return Err("give a run folder, the folder with the truth, and the picture to write".into());
    };
    let truth = Truth::read(truth)?;
    let particles = truth.particles(0)?.ok_or("the truth has no particles of the first frame")?;
    let summary: FillSummary = serde_json::from_slice(&std::fs::read(run.join("fill.json"))?)?;
    let size = summary.object_size_m;
    let cut = Cut::through(&particles, size, truth.particle_spacing_m);
    let mut figure = RgbImage::from_pixel(5 * SIDE, SIDE, Rgb([255; 3]));
    for (panel, levels) in (2..=5).enumerate() {
        let filling = filled(run, size, levels)?;
        let volume = filling.volume() / truth.volume_m3.unwrap_or(f64::NAN) - 1.0;
        println!("n_u = {levels}: voxels {:.2} mm, volume {:+.2} %", 1e3 * filling.field.spacing, 100.0 * volume);
        cut.draw(&mut figure, panel as u32, &|x, y| {
            let density = filling.field.sample(cut.place(x, y));
            (density >= filling.th_min).then_some(density)
        });
    }
    cut.draw(&mut figure, 4, &|x, y| cut.truth[(y * SIDE + x) as usize].then_some(1.0));
    figure.save(picture)?;
    Ok(())
}

/// The first frame of a run, filled with `levels` levels.
fn filled(run: &Path, size: f64, levels: usize) -> Result<Filling, Box<dyn Error>> {
    let scene = open_scene(&Config::resolve(vec![Layer::read(&run.join("config.toml"))?])?)?;
    let masks = scene.load_masks(scene.views_at(0))?;
    let pairs = scene.views_at(0).iter().zip(&masks);
    let views: Vec<MaskedView> = pairs
        .map(|(view, mask)| MaskedView { camera: scene.camera_of(view), mask: Some(mask.coverage.as_slice()) })
        .collect();
    let ground = scene.world.ground;
    let settings = FillSettings { levels, ground, ..FillSettings::for_size(size) };
    let gaussians = DynamicGaussians::load(&run.join("gaussians"))?.at(scene.times[0]);
    Ok(fill(&gaussians, &views, &settings)?)
}

/// A plane through the middle of the true particles, and what is true in it.
struct Cut {
    centre: DVec3,
    /// Side of a pixel [m].
    pixel: f64,
    /// Whether a pixel is true matter, shape [SIDE * SIDE].
    truth: Vec<bool>,
}

impl Cut {
    fn through(particles: &[[f32; 3]], size: f64, spacing: f64) -> Cut {
        let all: Vec<DVec3> = particles.iter().map(|p| DVec3::from(p.map(f64::from))).collect();
        let centre = all.iter().sum::<DVec3>() / all.len() as f64;
        let mut cut = Cut { centre, pixel: size / (SHARE * f64::from(SIDE)), truth: Vec::new() };
        let deviation = SMOOTHING * spacing;
        let near: Vec<DVec3> = all.into_iter().filter(|p| (p.z - centre.z).abs() < 4.0 * deviation).collect();
        let unit = (SMOOTHING * (2.0 * std::f64::consts::PI).sqrt()).powi(-3);
        let density = |at: DVec3| {
            let exponents = near.iter().map(|p| -0.5 * p.distance_squared(at) / (deviation * deviation));
            unit * exponents.filter(|e| *e > -8.0).map(f64::exp).sum::<f64>()
        };
        cut.truth = (0..SIDE * SIDE).map(|i| density(cut.place(i % SIDE, i / SIDE)) > 0.5).collect();
        cut
    }

    /// The place of a pixel: x to the right, y up.
    fn place(&self, x: u32, y: u32) -> DVec3 {
        let offset = |i: u32| (f64::from(i) + 0.5 - 0.5 * f64::from(SIDE)) * self.pixel;
        self.centre + DVec3::new(offset(x), -offset(y), 0.0)
    }

    /// Draws the density that `matter` gives, with the outline of the true matter.
    fn draw(&self, figure: &mut RgbImage, panel: u32, matter: &dyn Fn(u32, u32) -> Option<f64>) {
        let at = |x: u32, y: u32| self.truth[(y * SIDE + x) as usize];
        for y in 0..SIDE {
            for x in 0..SIDE {
                let edge = x > 0 && y > 0 && (at(x, y) != at(x - 1, y) || at(x, y) != at(x, y - 1));
                let color = match (edge, matter(x, y)) {
                    (true, _) => [220, 40, 40],
                    (false, Some(density)) => [(210.0 - 110.0 * density.clamp(0.0, 1.0)) as u8; 3],
                    (false, None) => [255; 3],
                };
                figure.put_pixel(panel * SIDE + x, y, Rgb(color));
            }
        }
    }
}
