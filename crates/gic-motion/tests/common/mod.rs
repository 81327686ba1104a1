//! Scenes drawn from Gaussians.

use std::path::Path;

use gic_scene::{Camera, Scene};
use gic_splat::{Gaussians, RenderSettings, render};
use serde_json::json;

/// Writes what `cameras` see of each frame (time [s], Gaussians) in PAC-NeRF's layout and opens it; the folder lasts as
/// long as the first value.
pub(crate) fn scene(cameras: &[Camera], frames: &[(f64, Gaussians)]) -> (tempfile::TempDir, Scene) {
    let folder = tempfile::tempdir().unwrap();
    write_scene(folder.path(), cameras, frames);
    let scene = Scene::open(folder.path()).unwrap();
    (folder, scene)
}

fn write_scene(folder: &Path, cameras: &[Camera], frames: &[(f64, Gaussians)]) {
    std::fs::create_dir_all(folder.join("data")).unwrap();
    let mut list = Vec::new();
    let byte = |v: f32| (v * 255.0).round().clamp(0.0, 255.0) as u8;
    for (c, camera) in cameras.iter().enumerate() {
        for (frame, (time, gaussians)) in frames.iter().enumerate() {
            let picture = render(gaussians, camera, &RenderSettings::default());
            let straight = picture.color.iter().zip(&picture.alpha);
            let rgb: Vec<u8> = straight.flat_map(|(c, a)| c.map(|v| byte(v / a.max(1e-3)))).collect();
            let mask: Vec<u8> = picture.alpha.iter().map(|&a| byte(a)).collect();
            let (w, h, name) = (camera.width as u32, camera.height as u32, format!("./data/r_{c}_{frame}.png"));
            image::RgbImage::from_raw(w, h, rgb).unwrap().save(folder.join(&name)).unwrap();
            let mask_name = format!("data/a_{c}_{frame}.png");
            image::GrayImage::from_raw(w, h, mask).unwrap().save(folder.join(mask_name)).unwrap();
            // OpenGL: y up, looking along -z.
            let (r, o, f, p) = (camera.world_from_camera, camera.centre, camera.focal, camera.principal);
            let row = |i: usize| [r.x_axis[i], -r.y_axis[i], -r.z_axis[i], o[i]];
            list.push(json!({
                "file_path": name,
                "time": time,
                "c2w": [row(0), row(1), row(2)],
                "intrinsic": [[f.x, 0.0, p.x], [0.0, f.y, p.y], [0.0, 0.0, 1.0]],
            }));
        }
    }
    std::fs::write(folder.join("all_data.json"), serde_json::to_vec(&list).unwrap()).unwrap();
}
