//! Reconstructs a scene and prints how well a held-out camera is reproduced.
//!
//! `cargo run --release -p gic-motion --example train_scene -- SCENE [--held-out 3] [--out FOLDER] [--settings FILE.json]
//! [--set KEY=JSON]... [--paper] [--seed 0]`, where KEY is a path such as `loss.scale`.

use std::error::Error;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Instant;

use gic_motion::{TrainSettings, ViewScore, evaluate, train};
use gic_scene::Scene;
use serde_json::Value;

fn main() -> Result<(), Box<dyn Error>> {
    let mut scene = None;
    let (mut out, mut checkpoint, mut seed) = (None, None, 0);
    let mut settings = serde_json::to_value(TrainSettings::default())?;
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut value = || args.next().ok_or_else(|| format!("{arg} needs a value"));
        match arg.as_str() {
            "--paper" => settings = serde_json::to_value(TrainSettings::paper())?,
            "--settings" => settings = serde_json::from_str(&std::fs::read_to_string(value()?)?)?,
            "--held-out" => settings["held_out"] = serde_json::from_str(&format!("[{}]", value()?))?,
            "--out" => out = Some(PathBuf::from(value()?)),
            "--checkpoint" => checkpoint = Some(PathBuf::from(value()?)),
            "--seed" => seed = value()?.parse()?,
            "--set" => set(&mut settings, &value()?)?,
            _ => scene = Some(PathBuf::from(arg)),
        }
    }
    let settings: TrainSettings = serde_json::from_value(settings)?;
    let started = Instant::now();
    let scene = Scene::open(scene.ok_or("which scene?")?)?;
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
            ControlFlow::Continue(())
        },
        checkpoint.as_deref(),
    )?;
    println!("trained in {:.1} s", started.elapsed().as_secs_f64());
    let scores = evaluate(&model, &scene, &settings.held_out)?;
    println!("camera frame   PSNR   SSIM    IoU  PSNR over white");
    let mean = ViewScore::mean(&scores);
    for s in &scores {
        println!("{:6} {:5}  {:5.2} {:.4} {:.4}  {:5.2}", s.camera, s.frame, s.psnr, s.ssim, s.iou, s.psnr_white);
    }
    println!("mean          {:5.2} {:.4} {:.4}  {:5.2}", mean.psnr, mean.ssim, mean.iou, mean.psnr_white);
    if let Some(folder) = out {
        model.save(&folder)?;
    }
    Ok(())
}

/// Sets a dotted key to a JSON value.
fn set(settings: &mut Value, assignment: &str) -> Result<(), Box<dyn Error>> {
    let (key, value) = assignment.split_once('=').ok_or("--set KEY=JSON")?;
    let pointer = format!("/{}", key.replace('.', "/"));
    *settings.pointer_mut(&pointer).ok_or_else(|| format!("no setting `{key}`"))? = serde_json::from_str(value)?;
    Ok(())
}
