//! Reconstructs a scene and prints how well a held-out camera is reproduced.
//!
//! `cargo run --release -p gic-motion --example train_scene -- SCENE [--held-out 3] [--out FOLDER] [--settings
//! FILE.json] [--set KEY=JSON]... [--paper] [--seed 0] [--pictures FOLDER] [--checkpoint FOLDER] [--stop-at STEP]`,
//! where KEY is a path such as `loss.scale`. The pictures show each view: rendered, true, their difference, and the
//! depth. A run that was stopped at a step is measured as it is then, and goes on from its checkpoint.

use std::error::Error;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Instant;

use gic_motion::{DynamicGaussians, TrainSettings, ViewScore, evaluate, train};
use gic_scene::{Scene, View};
use gic_splat::{RenderSettings, render};
use serde_json::Value;

/// A step of training makes and drops tens of megabytes: the same allocator as the program's.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> Result<(), Box<dyn Error>> {
    let mut scene = None;
    let (mut out, mut checkpoint, mut pictures, mut seed, mut stop_at) = (None, None, None, 0, usize::MAX);
    let mut changes = Vec::new();
    let mut base: Option<Value> = None;
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut value = || args.next().ok_or_else(|| format!("{arg} needs a value"));
        match arg.as_str() {
            "--paper" => base = Some(serde_json::to_value(TrainSettings::paper())?),
            "--settings" => base = Some(serde_json::from_str(&std::fs::read_to_string(value()?)?)?),
            "--held-out" => changes.push(format!("held_out=[{}]", value()?)),
            "--out" => out = Some(PathBuf::from(value()?)),
            "--checkpoint" => checkpoint = Some(PathBuf::from(value()?)),
            "--seed" => seed = value()?.parse()?,
            "--stop-at" => stop_at = value()?.parse()?,
            "--pictures" => pictures = Some(PathBuf::from(value()?)),
            "--set" => changes.push(value()?),
            _ => scene = Some(PathBuf::from(arg)),
        }
    }
    let started = Instant::now();
    let scene = Scene::open(scene.ok_or("which scene?")?)?;
    let mut settings = match base {
        Some(settings) => settings,
        None => serde_json::to_value(TrainSettings::for_scene(&scene))?,
    };
    for change in &changes {
        set(&mut settings, change)?;
    }
    let settings: TrainSettings = serde_json::from_value(settings)?;
    let model = train(
        &scene,
        &settings,
        seed,
        &mut |p| {
            if p.step % 50 == 0 || p.step == p.steps {
                let held_out = p.held_out.map_or(String::new(), |s| {
                    format!("  held out: PSNR {:.2} SSIM {:.4} IoU {:.4}", s.psnr, s.ssim, s.iou)
                });
                let (n, seconds, left) = (p.gaussians, p.seconds, p.seconds_left);
                let step = format!("{:5}/{} {:?}", p.step, p.steps, p.phase);
                println!(
                    "{step} loss {:.4} psnr {:.2} n {n} {seconds:.0} s, {left:.0} s left{held_out}",
                    p.loss, p.psnr
                );
            }
            if p.step >= stop_at { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        },
        checkpoint.as_deref(),
    )?;
    println!("trained in {:.1} s", started.elapsed().as_secs_f64());
    let scores = evaluate(&model, &scene, &settings.held_out)?;
    println!("  camera frame   PSNR   SSIM    IoU  whole picture over white, over black");
    let print = |name: &str, s: &ViewScore| {
        println!("{name}  {:5.2} {:.4} {:.4}  {:5.2} {:5.2}", s.psnr, s.ssim, s.iou, s.psnr_white, s.psnr_black);
    };
    scores.iter().for_each(|s| print(&format!("{:8} {:5}", s.camera, s.frame), s));
    print("mean          ", &ViewScore::mean(&scores));
    if let Some(folder) = out {
        model.save(&folder)?;
    }
    if let Some(folder) = pictures {
        std::fs::create_dir_all(&folder)?;
        for view in &scene.views {
            let name = format!("{}_{}.png", view.camera, view.frame);
            comparison(&model, &scene, view)?.save(folder.join(name))?;
        }
    }
    Ok(())
}

/// Rendered, true, their difference and the depth side by side.
fn comparison(model: &DynamicGaussians, scene: &Scene, view: &View) -> Result<image::RgbImage, Box<dyn Error>> {
    let camera = scene.camera_of(view);
    let (picture, mask) = scene.load(view)?;
    let rendered = render(&model.at(scene.times[view.frame]), camera, &RenderSettings::default());
    let depth = |i: usize| rendered.depth[i] / rendered.alpha[i];
    let seen = || (0..rendered.alpha.len()).filter(|&i| rendered.alpha[i] > 0.5);
    let near = seen().map(depth).fold(f32::INFINITY, f32::min);
    let far = seen().map(depth).fold(near, f32::max);
    let byte = |v: f32| (v * 255.0).round().clamp(0.0, 255.0) as u8;
    let width = camera.width as u32;
    Ok(image::RgbImage::from_fn(4 * width, camera.height as u32, |column, y| {
        let (panel, x) = (column / width, column % width);
        let i = (y * width + x) as usize;
        let truth = picture.at(x as usize, y as usize).map(|c| c * mask.at(x as usize, y as usize));
        let pixel = match panel {
            0 => rendered.color[i],
            1 => truth,
            2 => core::array::from_fn(|c| (rendered.color[i][c] - truth[c]).abs()),
            _ if rendered.alpha[i] > 0.5 => [1.0 - 0.9 * (depth(i) - near) / (far - near); 3],
            _ => [0.0; 3],
        };
        image::Rgb(pixel.map(byte))
    }))
}

/// Sets a dotted key to a JSON value.
fn set(settings: &mut Value, assignment: &str) -> Result<(), Box<dyn Error>> {
    let (key, value) = assignment.split_once('=').ok_or("--set KEY=JSON")?;
    let pointer = format!("/{}", key.replace('.', "/"));
    *settings.pointer_mut(&pointer).ok_or_else(|| format!("no setting `{key}`"))? = serde_json::from_str(value)?;
    Ok(())
}
