//! A two-coloured ball that falls a little between two frames, seen by four cameras, drawn by tracing rays; and how to
//! write it in every format. The files under `tests/data` were made by `cargo test -p gic-scene --test formats --
//! --ignored`.

#![allow(dead_code)]

use std::fs;
use std::path::{Path, PathBuf};

use gic_scene::Camera;
use glam::{DMat3, DQuat, DVec2, DVec3};
use image::{GrayImage, RgbImage, RgbaImage};
use serde_json::{Value, json};

pub(crate) const WIDTH: usize = 48;
pub(crate) const HEIGHT: usize = 36;
pub(crate) const FOCAL: f64 = 60.0;
pub(crate) const RADIUS: f64 = 0.15;
/// Centres of the ball [m] at both frames.
pub(crate) const BALL: [DVec3; 2] = [DVec3::new(0.02, 0.21, 0.0), DVec3::new(0.02, 0.17, 0.0)];
pub(crate) const TIMES: [f64; 2] = [0.0, 1.0 / 24.0];
/// Brown-Conrady coefficients k1, k2, p1, p2 of the distorted fixtures.
pub(crate) const DISTORTION: [f64; 4] = [-0.9, 0.2, 0.03, -0.02];

/// The folder of the fixtures.
pub(crate) fn data(format: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(format)
}

/// The fixture of a format, copied to where it may be damaged.
pub(crate) fn copy(format: &str) -> tempfile::TempDir {
    fn copy_folder(from: &Path, to: &Path) {
        fs::create_dir_all(to).expect("a folder");
        for entry in fs::read_dir(from).expect("the fixture").flatten() {
            let target = to.join(entry.file_name());
            if entry.path().is_dir() {
                copy_folder(&entry.path(), &target)
            } else {
                drop(fs::copy(entry.path(), target))
            }
        }
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    copy_folder(&data(format), folder.path());
    folder
}

/// The cameras; the first looks along -z from (0, 0.2, 1), upright.
pub(crate) fn cameras() -> Vec<Camera> {
    let centres =
        [DVec3::new(0.0, 0.2, 1.0), DVec3::new(1.0, 0.5, 0.2), DVec3::new(-0.7, 0.6, 0.7), DVec3::new(0.1, 0.9, -0.8)];
    centres
        .into_iter()
        .map(|centre| {
            let forward = (DVec3::new(0.0, 0.2, 0.0) - centre).normalize();
            let right = forward.cross(DVec3::Y).normalize();
            Camera {
                width: WIDTH,
                height: HEIGHT,
                focal: DVec2::splat(FOCAL),
                principal: DVec2::new(WIDTH as f64 / 2.0, HEIGHT as f64 / 2.0),
                world_from_camera: DMat3::from_cols(right, forward.cross(right), forward),
                centre,
            }
        })
        .collect()
}

/// The camera-to-world matrix in OpenGL axes, as the formats store it: rows of right, up, backward, position.
pub(crate) fn c2w(camera: &Camera, rows: usize) -> Value {
    let r = camera.world_from_camera;
    let row = |i: usize| json!([r.x_axis[i], -r.y_axis[i], -r.z_axis[i], camera.centre[i]]);
    let mut matrix = vec![row(0), row(1), row(2)];
    if rows == 4 {
        matrix.push(json!([0.0, 0.0, 0.0, 1.0]));
    }
    Value::from(matrix)
}

pub(crate) fn intrinsic() -> Value {
    json!([[FOCAL, 0.0, WIDTH as f64 / 2.0], [0.0, FOCAL, HEIGHT as f64 / 2.0], [0.0, 0.0, 1.0]])
}

/// Distorted normalised coordinates, written out from OpenCV's documentation.
fn distort(u: DVec2, [k1, k2, p1, p2]: [f64; 4]) -> DVec2 {
    let (x, y) = (u.x, u.y);
    let r2 = x * x + y * y;
    let radial = 1.0 + k1 * r2 + k2 * r2 * r2;
    DVec2::new(
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    )
}

/// What a pixel sees: coverage of the ball and its mean colour there, by 4 x 4 rays.
fn trace(camera: &Camera, ball: DVec3, column: usize, row: usize, distortion: [f64; 4]) -> (f64, DVec3) {
    let (mut hits, mut colour) = (0.0, DVec3::ZERO);
    for sample in 0..16 {
        let offset = DVec2::new((sample % 4) as f64 + 0.5, (sample / 4) as f64 + 0.5) / 4.0;
        let seen = (DVec2::new(column as f64, row as f64) + offset - camera.principal) / camera.focal;
        // Invert the distortion by iterating u <- u - (distort(u) - seen).
        let mut u = seen;
        (0..30).for_each(|_| u -= distort(u, distortion) - seen);
        let ray = (camera.world_from_camera * DVec3::new(u.x, u.y, 1.0)).normalize();
        let to_ball = ball - camera.centre;
        let along = to_ball.dot(ray);
        let off = to_ball.length_squared() - along * along;
        if off < RADIUS * RADIUS {
            let point = camera.centre + ray * (along - (RADIUS * RADIUS - off).sqrt());
            colour += if point.y > ball.y { DVec3::new(0.9, 0.3, 0.2) } else { DVec3::new(0.1, 0.4, 0.9) };
            hits += 1.0;
        }
    }
    (hits / 16.0, colour / f64::max(hits, 1.0))
}

fn floor(row: usize) -> DVec3 {
    DVec3::new(0.6, 0.6, 0.55) + 0.003 * row as f64
}

fn byte(value: f64) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// Coverage and straight colour of all pixels.
pub(crate) fn draw(camera: &Camera, frame: usize, distortion: [f64; 4]) -> RgbaImage {
    RgbaImage::from_fn(WIDTH as u32, HEIGHT as u32, |x, y| {
        let (a, c) = trace(camera, BALL[frame], x as usize, y as usize, distortion);
        image::Rgba([byte(c.x), byte(c.y), byte(c.z), byte(a)])
    })
}

pub(crate) fn over_floor(drawn: &RgbaImage) -> RgbImage {
    RgbImage::from_fn(drawn.width(), drawn.height(), |x, y| {
        let [r, g, b, a] = drawn.get_pixel(x, y).0.map(|v| f64::from(v) / 255.0);
        let colour = a * DVec3::new(r, g, b) + (1.0 - a) * floor(y as usize);
        image::Rgb([byte(colour.x), byte(colour.y), byte(colour.z)])
    })
}

pub(crate) fn mask_of(drawn: &RgbaImage) -> GrayImage {
    GrayImage::from_fn(drawn.width(), drawn.height(), |x, y| image::Luma([drawn.get_pixel(x, y).0[3]]))
}

fn write_json(path: PathBuf, value: &Value) {
    fs::write(path, format!("{value:#}\n")).expect("written");
}

fn folder(path: PathBuf) -> PathBuf {
    fs::create_dir_all(&path).expect("a folder");
    path
}

pub(crate) fn write_pac_nerf(root: &Path) {
    let pictures = folder(root.join("data"));
    let mut list = Vec::new();
    for (number, camera) in cameras().iter().enumerate() {
        let mut entry = |frame: i32, time: f64| {
            let file = format!("./data/r_{number}_{frame}.png");
            list.push(json!({"file_path": file, "time": time, "c2w": c2w(camera, 3), "intrinsic": intrinsic()}));
        };
        entry(-1, -1.0 / 24.0);
        let empty = RgbImage::from_fn(WIDTH as u32, HEIGHT as u32, |_, y| {
            let colour = floor(y as usize);
            image::Rgb([byte(colour.x), byte(colour.y), byte(colour.z)])
        });
        empty.save(pictures.join(format!("r_{number}_-1.png"))).expect("saved");
        for frame in 0..2 {
            entry(frame as i32, TIMES[frame]);
            let drawn = draw(camera, frame, [0.0; 4]);
            over_floor(&drawn).save(pictures.join(format!("r_{number}_{frame}.png"))).expect("saved");
            mask_of(&drawn).save(pictures.join(format!("a_{number}_{frame}.png"))).expect("saved");
        }
    }
    write_json(root.join("all_data.json"), &Value::from(list));
}

pub(crate) fn write_spring_gaus(root: &Path) {
    let cameras = cameras();
    let entries: Vec<Value> = cameras
        .iter()
        .enumerate()
        .map(|(c, camera)| json!({"camera": format!("camera_{c}"), "c2w": c2w(camera, 4), "K": intrinsic()}))
        .collect();
    folder(root.to_owned());
    write_json(root.join("camera.json"), &Value::from(entries));
    write_json(root.join("frame.json"), &json!([{"000": TIMES[0]}, {"001": TIMES[1]}]));
    for (c, camera) in cameras.iter().enumerate() {
        let pictures = folder(root.join(format!("camera_{c}")));
        for frame in 0..2 {
            draw(camera, frame, [0.0; 4]).save(pictures.join(format!("{frame:03}.png"))).expect("saved");
        }
    }
}

/// D-NeRF: the first three cameras train, at alternating times; the fourth tests.
pub(crate) fn write_blender(root: &Path) {
    let angle = 2.0 * (WIDTH as f64 / 2.0 / FOCAL).atan();
    for (split, members) in [("train", 0..3), ("test", 3..4)] {
        let pictures = folder(root.join(split));
        let frames: Vec<Value> = members
            .map(|c| {
                let camera = &cameras()[c];
                draw(camera, c % 2, [0.0; 4]).save(pictures.join(format!("r_{c:03}.png"))).expect("saved");
                let file_path = format!("./{split}/r_{c:03}");
                json!({"file_path": file_path, "time": (c % 2) as f64, "transform_matrix": c2w(camera, 4)})
            })
            .collect();
        write_json(root.join(format!("transforms_{split}.json")), &json!({"camera_angle_x": angle, "frames": frames}));
    }
}

/// Distorted pictures, masks by `mask_path`.
pub(crate) fn write_nerfstudio(root: &Path) {
    let (pictures, masks) = (folder(root.join("images")), folder(root.join("masks")));
    let [k1, k2, p1, p2] = DISTORTION;
    let frames: Vec<Value> = cameras()
        .iter()
        .enumerate()
        .map(|(c, camera)| {
            let drawn = draw(camera, 0, DISTORTION);
            over_floor(&drawn).save(pictures.join(format!("frame_{c:05}.png"))).expect("saved");
            mask_of(&drawn).save(masks.join(format!("frame_{c:05}.png"))).expect("saved");
            json!({"file_path": format!("images/frame_{c:05}.png"), "mask_path": format!("masks/frame_{c:05}.png"),
                   "transform_matrix": c2w(camera, 4)})
        })
        .collect();
    let all = json!({"camera_model": "OPENCV", "w": WIDTH, "h": HEIGHT, "fl_x": FOCAL, "fl_y": FOCAL,
        "cx": WIDTH as f64 / 2.0, "cy": HEIGHT as f64 / 2.0, "k1": k1, "k2": k2, "p1": p1, "p2": p2, "frames": frames});
    write_json(root.join("transforms.json"), &all);
}

/// World-to-camera quaternion and translation, as COLMAP stores them.
fn world_to_camera(camera: &Camera) -> (DQuat, DVec3) {
    let rotation = camera.world_from_camera.transpose();
    (DQuat::from_mat3(&rotation), -(rotation * camera.centre))
}

/// Camera 1 of the model is a pinhole (images 0 and 1), camera 2 has OpenCV distortion (images 2 and 3); JPEG
/// photographs.
pub(crate) fn write_colmap(root: &Path, binary: bool) {
    let (pictures, masks) = (folder(root.join("images")), folder(root.join("masks")));
    let model = folder(root.join("sparse/0"));
    let (w, h) = (WIDTH as f64 / 2.0, HEIGHT as f64 / 2.0);
    let parameters: [Vec<f64>; 2] =
        [vec![FOCAL, FOCAL, w, h], [vec![FOCAL, FOCAL, w, h], DISTORTION.to_vec()].concat()];
    let point = BALL[0];
    let (mut cameras_bin, mut images_bin) = (2_u64.to_le_bytes().to_vec(), 4_u64.to_le_bytes().to_vec());
    let (mut cameras_txt, mut images_txt) = ("# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n".to_owned(), String::new());
    for (index, (id, model, name)) in [(1_u32, 1_u32, "PINHOLE"), (2, 4, "OPENCV")].into_iter().enumerate() {
        cameras_bin.extend(id.to_le_bytes());
        cameras_bin.extend(model.to_le_bytes());
        cameras_bin.extend((WIDTH as u64).to_le_bytes());
        cameras_bin.extend((HEIGHT as u64).to_le_bytes());
        parameters[index].iter().for_each(|value| cameras_bin.extend(value.to_le_bytes()));
        let list: Vec<String> = parameters[index].iter().map(f64::to_string).collect();
        cameras_txt += &format!("{id} {name} {WIDTH} {HEIGHT} {}\n", list.join(" "));
    }
    for (c, camera) in cameras().iter().enumerate() {
        let drawn = draw(camera, 0, if c < 2 { [0.0; 4] } else { DISTORTION });
        over_floor(&drawn).save(pictures.join(format!("photo {c}.jpg"))).expect("saved");
        mask_of(&drawn).save(masks.join(format!("photo {c}.png"))).expect("saved");
        let (q, t) = world_to_camera(camera);
        let id = if c < 2 { 1_u32 } else { 2 };
        images_bin.extend((c as u32 + 1).to_le_bytes());
        [q.w, q.x, q.y, q.z, t.x, t.y, t.z].iter().for_each(|value| images_bin.extend(value.to_le_bytes()));
        images_bin.extend(id.to_le_bytes());
        images_bin.extend(format!("photo {c}.jpg\0").bytes());
        // One observation, so that a reader has to step over it.
        images_bin.extend(1_u64.to_le_bytes());
        [w, h].iter().for_each(|value| images_bin.extend(value.to_le_bytes()));
        images_bin.extend(1_u64.to_le_bytes());
        images_txt += &format!(
            "{} {} {} {} {} {} {} {} {id} photo {c}.jpg\n{w} {h} 1\n",
            c + 1,
            q.w,
            q.x,
            q.y,
            q.z,
            t.x,
            t.y,
            t.z
        );
    }
    let mut points_bin = 1_u64.to_le_bytes().to_vec();
    points_bin.extend(1_u64.to_le_bytes());
    point.to_array().iter().for_each(|value| points_bin.extend(value.to_le_bytes()));
    points_bin.extend([255, 0, 51]);
    points_bin.extend(0.5_f64.to_le_bytes());
    points_bin.extend(1_u64.to_le_bytes());
    points_bin.extend([1_u32.to_le_bytes(), 0_u32.to_le_bytes()].concat());
    let points_txt = format!("1 {} {} {} 255 0 51 0.5 1 0\n", point.x, point.y, point.z);
    if binary {
        fs::write(model.join("cameras.bin"), cameras_bin).expect("written");
        fs::write(model.join("images.bin"), images_bin).expect("written");
        fs::write(model.join("points3D.bin"), points_bin).expect("written");
    } else {
        fs::write(model.join("cameras.txt"), cameras_txt).expect("written");
        fs::write(model.join("images.txt"), images_txt).expect("written");
        fs::write(model.join("points3D.txt"), points_txt).expect("written");
    }
}

/// Two video cameras whose file numbers start differently; photographs by a flat COLMAP model.
pub(crate) fn write_real_capture(root: &Path) {
    let dynamic = root.join("dynamic");
    let mut calibration = json!({"camera_matrix": intrinsic(), "distortion_coefficient": [[0.0, 0.0, 0.0, 0.0, 0.0]]});
    let mut sequence = json!({"hit_frame": 1});
    for (c, name, start) in [(0, "C0733", 412), (1, "C0787", 398), (2, "C0801", 431)] {
        let camera = &cameras()[c];
        let (q, t) = world_to_camera(camera);
        let turn = q.to_scaled_axis();
        calibration[name] = json!({"rvecs": [[turn.x], [turn.y], [turn.z]], "tvecs": [[t.x], [t.y], [t.z]]});
        let pictures = folder(dynamic.join("videos_images").join(name));
        let masks = folder(dynamic.join("videos_masks").join(name));
        let mut files = Vec::new();
        for frame in 0..2 {
            let drawn = draw(camera, frame, [0.0; 4]);
            over_floor(&drawn).save(pictures.join(format!("{:05}.jpg", start + frame))).expect("saved");
            mask_of(&drawn).save(masks.join(format!("{:05}.png", start + frame))).expect("saved");
            files.push(format!("{:05}.jpg", start + frame));
        }
        sequence[name] = json!(files);
    }
    write_json(dynamic.join("cameras_calib.json"), &calibration);
    write_json(folder(dynamic.join("sequences/ball")).join("0.json"), &sequence);
    let temporary = tempfile::tempdir().expect("a folder");
    write_colmap(temporary.path(), true);
    let parts = [("images", "images"), ("masks", "masks"), ("sparse/0", "colmap")];
    for (from, to) in parts {
        let to = folder(root.join("static").join(to).join("ball"));
        for entry in fs::read_dir(temporary.path().join(from)).expect("made").flatten() {
            fs::copy(entry.path(), to.join(entry.file_name())).expect("copied");
        }
    }
}
