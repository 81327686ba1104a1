//! Reads a PAC-NeRF folder and its truth, for the validation programs of this crate.

use std::path::Path;

use gic_identify::{Input, Observation, View};
use gic_mpm::{Collider, ColliderPath, Contact, Material, Primitive};
use gic_scene::Camera;
use glam::{DMat3, DQuat, DVec2, DVec3};

/// What the scene's maker knows.
#[derive(Clone, Debug)]
pub(crate) struct Truth {
    pub(crate) material: Material,
    pub(crate) velocity_m_s: DVec3,
}

fn number(v: &serde_json::Value) -> f64 {
    v.as_f64().expect("a number")
}

fn vector(v: &serde_json::Value) -> DVec3 {
    DVec3::new(number(&v[0]), number(&v[1]), number(&v[2]))
}

pub(crate) fn truth(scene: &Path) -> Truth {
    let json: serde_json::Value =
        serde_json::from_slice(&std::fs::read(scene.join("gt/params.json")).expect("params.json")).expect("json");
    let p = &json["params"];
    let material = match json["material"].as_str().expect("material") {
        "elastic" => Material::Elastic { youngs_modulus_pa: number(&p["E"]), poisson_ratio: number(&p["nu"]) },
        "plasticine" => Material::Plasticine {
            youngs_modulus_pa: number(&p["E"]),
            poisson_ratio: number(&p["nu"]),
            yield_stress_pa: number(&p["yield_stress"]),
        },
        "sand" => Material::Sand {
            friction_angle_deg: number(&p["friction_angle"]),
            youngs_modulus_pa: 1e6,
            poisson_ratio: 0.3,
        },
        "newtonian" => Material::Newtonian { viscosity_pa_s: number(&p["mu"]), bulk_modulus_pa: number(&p["kappa"]) },
        _ => Material::NonNewtonian {
            shear_modulus_pa: number(&p["mu"]),
            bulk_modulus_pa: number(&p["kappa"]),
            yield_stress_pa: number(&p["yield_stress"]),
            plastic_viscosity_pa_s: number(&p["plastic_viscosity"]),
        },
    };
    Truth { material, velocity_m_s: vector(&json["initial_velocity"]) }
}

/// True particles of a frame [m].
pub(crate) fn particles(scene: &Path, frame: usize) -> Vec<DVec3> {
    let file = std::fs::File::open(scene.join(format!("gt/particles_{frame}.npz"))).expect("particles");
    let mut npz = npyz::npz::NpzArchive::new(std::io::BufReader::new(file)).expect("npz");
    let x: Vec<f32> = npz.by_name("x").expect("x").expect("x").into_vec().expect("f32");
    x.chunks(3).map(|c| DVec3::new(c[0].into(), c[1].into(), c[2].into())).collect()
}

pub(crate) fn ground() -> Collider {
    Collider {
        primitive: Primitive::HalfSpace { normal: DVec3::Y },
        path: ColliderPath::Uniform {
            position_m: DVec3::ZERO,
            world_from_collider: DQuat::IDENTITY,
            velocity_m_s: DVec3::ZERO,
            angular_velocity_rad_s: DVec3::ZERO,
        },
        contact: Contact::Sticky,
    }
}

/// Cameras and masks of a scene with the given particles at time 0.
pub(crate) fn input(scene: &Path, positions: Vec<DVec3>, volume: f64) -> Input {
    let json: serde_json::Value =
        serde_json::from_slice(&std::fs::read(scene.join("all_data.json")).expect("all_data.json")).expect("json");
    let mut cameras: Vec<Option<Camera>> = Vec::new();
    let mut observations: Vec<Observation> = Vec::new();
    for entry in json.as_array().expect("a list") {
        let name = entry["file_path"].as_str().expect("path");
        let stem = name.rsplit('/').next().unwrap().trim_start_matches("r_").trim_end_matches(".png");
        let (camera, frame) = stem.split_once('_').unwrap();
        let Ok(frame) = frame.parse::<usize>() else { continue };
        let camera: usize = camera.parse().unwrap();
        let picture = image::open(scene.join(format!("data/a_{camera}_{frame}.png"))).expect("mask").into_luma8();
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        if cameras.len() <= camera {
            cameras.resize(camera + 1, None);
        }
        let (c, k) = (&entry["c2w"], &entry["intrinsic"]);
        let column = |j: usize| DVec3::new(number(&c[0][j]), number(&c[1][j]), number(&c[2][j]));
        cameras[camera] = Some(Camera {
            width,
            height,
            focal: DVec2::new(number(&k[0][0]), number(&k[1][1])),
            principal: DVec2::new(number(&k[0][2]), number(&k[1][2])),
            world_from_camera: DMat3::from_cols(column(0), -column(1), -column(2)),
            centre: column(3),
        });
        while observations.len() <= frame {
            observations.push(Observation {
                time_s: observations.len() as f64 / 24.0,
                surface: Vec::new(),
                surface_doubts: Vec::new(),
                views: Vec::new(),
            });
        }
        let mask = picture.as_raw().iter().map(|v| f32::from(*v) / 255.0).collect();
        observations[frame].views.push(View { camera, mask });
    }
    let n = positions.len();
    Input {
        devices: Vec::new(),
        device_doubts: Vec::new(),
        positions,
        particle_volume_m3: volume,
        volume_factors: Vec::new(),
        doubts: Vec::new(),
        surface_error_m: 0.5 * volume.cbrt(),
        opacities: vec![0.9; n],
        scales: vec![0.006; n],
        cameras: cameras.into_iter().map(|c| c.expect("camera")).collect(),
        observations,
        frame_rate_hz: 24.0,
        gravity_m_s2: DVec3::new(0.0, -9.8, 0.0),
        colliders: vec![ground()],
        world_doubt: None,
        was_filmed: false,
        density_kg_m3: 1000.0,
        grid_spacing_m: 0.02,
        substeps_per_frame: 200,
    }
}

/// Indices of the outermost particles of a regular gaussians: those with an empty neighbourhood on one side.
pub(crate) fn outer(points: &[DVec3]) -> Vec<usize> {
    let radius = 0.022;
    (0..points.len())
        .filter(|i| {
            let near: Vec<DVec3> =
                points.iter().filter(|q| q.distance(points[*i]) < radius).map(|q| points[*i] - *q).collect();
            (near.iter().sum::<DVec3>() / near.len() as f64).length() > 0.2 * radius
        })
        .collect()
}
