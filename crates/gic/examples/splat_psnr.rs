//! How a file of Gaussians looks beside the pictures of a scene's first frame: PSNR of the pixels inside the masks,
//! mean over cameras.
//!
//! ```text
//! cargo run --release -p gic --example splat_psnr -- SCENE RUN/appearance/gaussians.ply RUN/appearance/albedo.ply
//! ```

use std::error::Error;
use std::path::Path;

use gic_scene::{Mask, Picture, Scene, View};
use gic_splat::{Gaussians, RenderSettings, read_ply, render};

/// Least coverage of a pixel inside the mask.
const INSIDE: f32 = 0.999;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene, files @ ..] = arguments.as_slice() else { return Err("give a scene and files of Gaussians".into()) };
    let scene = Scene::open(Path::new(scene))?;
    let views = scene.views_at(0);
    let pictures = scene.load_all(views)?;
    for file in files {
        let gaussians = read_ply(Path::new(file))?.gaussians;
        let compared = views.iter().zip(&pictures);
        let each: Vec<f64> = compared.map(|(view, shot)| psnr_inside(&scene, &gaussians, view, shot)).collect();
        let mean = each.iter().sum::<f64>() / each.len() as f64;
        let (count, bytes) = (gaussians.positions.len(), std::fs::metadata(file)?.len());
        println!("{file}: {mean:.2} dB over {} cameras; {count} Gaussians, {bytes} bytes", each.len());
    }
    Ok(())
}

/// PSNR of a view's pixels inside its mask [dB], both over black.
fn psnr_inside(scene: &Scene, gaussians: &Gaussians, view: &View, (picture, mask): &(Picture, Mask)) -> f64 {
    let drawn = render(gaussians, scene.camera_of(view), &RenderSettings::pictures()).color;
    let pixels = drawn.iter().zip(picture.rgb.chunks_exact(3)).zip(&mask.coverage);
    let inside = pixels.filter(|(_, coverage)| **coverage > INSIDE).map(|(pair, _)| pair);
    let squares: Vec<f64> = inside
        .flat_map(|(drawn, seen)| (0..3).map(|c| f64::from(drawn[c].clamp(0.0, 1.0) - seen[c]).powi(2)))
        .collect();
    -10.0 * (squares.iter().sum::<f64>() / squares.len() as f64).log10()
}
