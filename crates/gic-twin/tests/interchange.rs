//! What other simulators are given: complete, consistent, the same bytes again. `scripts/check_simulators.py` loads it
//! with them.

use std::fs;

use gic_geometry::TetMesh;
use gic_mpm::Material;
use gic_twin::interchange::{MotionSamples, write_mjcf, write_particle_set, write_usd};
use gic_twin::matter::{Solid, SolidKind};
use gic_twin::twin::{ContactKind, MatterSource, Obstacle, ObstacleShape, Twin};
use glam::DVec3;

/// Two tetrahedra of 1/6 and 1/3 m^3.
fn mesh() -> TetMesh {
    let vertices = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_Z * 2.0];
    TetMesh { vertices, tetrahedra: vec![[0, 1, 2, 3], [1, 0, 2, 4]] }
}

fn twin() -> Twin {
    let material = Material::Elastic { youngs_modulus_pa: 3e5, poisson_ratio: 0.4 };
    let shape = Solid { kind: SolidKind::Box { size_m: [0.2; 3] }, centre_m: [0.0; 3], rotation_deg: [0.0; 3] };
    let floor = ObstacleShape::HalfSpace { point_m: [0.0, -1.0, 0.0], normal: [0.0, 2.0, 0.0] };
    let mut moving = Obstacle::new(ObstacleShape::Sphere { centre_m: [9.0; 3], radius_m: 1.0 }, ContactKind::Slip);
    moving.velocity_m_s = Some([1.0, 0.0, 0.0]);
    Twin {
        colliders: vec![Obstacle::new(floor, ContactKind::Sticky), moving],
        initial_velocity_m_s: [0.5, 0.0, -1.0],
        initial_angular_velocity_rad_s: [0.0, 3.0, 0.0],
        particle_spacing_m: Some(0.05),
        ..Twin::new(material, MatterSource::Solid(shape))
    }
}

/// The values of an attribute, in the order of the text.
fn attributes(text: &str, name: &str) -> Vec<f64> {
    let start = format!("{name}=\"");
    text.split(&start).skip(1).map(|rest| rest.split('"').next().unwrap().parse().unwrap()).collect()
}

#[test]
fn mjcf_holds_every_vertex_mass_and_obstacle() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("twin.xml");
    write_mjcf(&path, &mesh(), &twin()).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    assert_eq!(text.matches("<body ").count(), 5);
    assert_eq!(text.matches("type=\"slide\"").count(), 15);
    let masses = attributes(&text, "mass");
    assert!((masses.iter().sum::<f64>() - 500.0).abs() < 1e-2, "{masses:?}");
    assert!((masses[3] - 1000.0 / 24.0).abs() < 1e-2, "{masses:?}");
    assert_eq!(attributes(&text, "young"), [3e5]);
    assert_eq!(attributes(&text, "poisson"), [0.4]);
    for part in [
        "body=\"v0 v1 v2 v3 v4\"",
        "element=\"0 1 2 3 1 0 2 4\"",
        "gravity=\"0 -9.8 0\"",
        "type=\"plane\" size=\"0 0 1\" pos=\"0 -1 0\" zaxis=\"0 1 0\"",
        "moves and is left out",
        "name=\"start\"",
    ] {
        assert!(text.contains(part), "`{part}` is missing in:\n{text}");
    }
    let step = attributes(&text, "timestep")[0];
    assert!(step > 0.0 && step < 1.0 / Material::wave_speed_m_s(&twin().material, 1000.0), "{step}");
    // Spin about y: the vertex at +x starts slower along z than that at -2 z along x.
    let velocities = text.split("qvel=\"").nth(1).unwrap().split('"').next().unwrap();
    let v: Vec<f64> = velocities.split(' ').map(|x| x.parse().unwrap()).collect();
    assert_eq!(v.len(), 15);
    let [p0, p1]: [DVec3; 2] = [DVec3::from_slice(&v), DVec3::from_slice(&v[3..])];
    assert!((p1 - p0 - DVec3::Y.cross(DVec3::X) * 3.0).length() < 1e-9, "rigid: {v:?}");
}

#[test]
fn usd_holds_mesh_material_and_motion() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("twin.usda");
    let shifted = |by: f64| mesh().vertices.iter().map(|p| *p + DVec3::Y * by).collect();
    let motion = MotionSamples { frame_rate_hz: 30.0, frames: vec![shifted(0.0), shifted(0.25)] };
    write_usd(&path, &mesh(), &twin(), &motion).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    for part in [
        "upAxis = \"Y\"",
        "endTimeCode = 1",
        "timeCodesPerSecond = 30",
        "float omniphysics:youngsModulus = 300000",
        "float omniphysics:poissonsRatio = 0.4",
        "custom string gic:model = \"elastic\"",
        "int4[] tetVertexIndices = [(0, 1, 2, 3), (1, 0, 2, 4)]",
        "1: [(0, 0.25, 0), (1, 0.25, 0), (0, 1.25, 0), (0, 0.25, 1), (0, 0.25, -2)],",
        "int[] faceVertexCounts = [3, 3, 3, 3, 3, 3]",
    ] {
        assert!(text.contains(part), "`{part}` is missing in:\n{text}");
    }
    assert_eq!(text.matches('{').count(), text.matches('}').count());
}

#[test]
fn particle_sets_are_numpy_arrays_and_parameters() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("twin.npz");
    let (twin, world) = twin().to_world().unwrap();
    let parameters = write_particle_set(&path, &twin, &world).unwrap();
    let mut archive = npyz::npz::NpzArchive::open(&path).unwrap();
    let mut array = |name: &str| {
        let array = archive.by_name(name).unwrap().unwrap();
        (array.shape().to_vec(), array.into_vec::<f32>().unwrap())
    };
    let (shape, positions) = array("positions");
    assert_eq!(shape, [64, 3]);
    assert!((f64::from(positions[0]) - world.bodies[0].positions[0].x).abs() < 1e-6);
    let (shape, masses) = array("masses");
    assert_eq!(shape, [64]);
    assert!((masses.iter().sum::<f32>() - 8.0).abs() < 1e-4, "density times volume");
    let (_, velocities) = array("velocities");
    assert!((velocities.iter().skip(2).step_by(3).sum::<f32>() / 64.0 + 1.0).abs() < 1e-5);
    let json: serde_json::Value = serde_json::from_slice(&fs::read(&parameters).unwrap()).unwrap();
    assert!(parameters.ends_with("twin.particles.json"), "twin.json is the twin itself");
    assert_eq!(json["arrays"], "twin.npz");
    assert_eq!(json["material"]["model"], "elastic");
    let lame = json["elasticity"]["lame_mu_pa"].as_f64().unwrap();
    assert!((lame / (3e5 / 2.8) - 1.0).abs() < 1e-12);
    let first = fs::read(&path).unwrap();
    write_particle_set(&path, &twin, &world).unwrap();
    assert_eq!(first, fs::read(&path).unwrap(), "the same bytes again");
}

#[test]
fn only_elastic_solids_go_to_mujoco_and_usd() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("twin.xml");
    let fluid = Twin { material: Material::Newtonian { viscosity_pa_s: 5.0, bulk_modulus_pa: 1e5 }, ..twin() };
    for error in [
        write_mjcf(&path, &mesh(), &fluid).unwrap_err(),
        write_usd(&path, &mesh(), &fluid, &MotionSamples::default()).unwrap_err(),
    ] {
        assert!(error.to_string().contains("newtonian"), "{error}");
        assert!(error.hint().unwrap().contains("--format particles"));
    }
    assert!(!path.exists());
}
