//! What other simulators are given: complete, consistent, the same bytes again. `scripts/check_simulators.py` loads it
//! with them.

use std::fs;
use std::path::Path;

use gic_mpm::Material;
use gic_twin::interchange::{
    ExportBody, Motion, UpAxis, UsdLook, write_glb, write_mjcf, write_particle_set, write_particles_ply, write_usd,
};
use gic_twin::matter::{Solid, SolidKind, read_particles};
use gic_twin::twin::{ContactKind, MatterSource, Obstacle, ObstacleShape, Twin};
use glam::DVec3;

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

fn body(twin: &Twin) -> ExportBody {
    ExportBody::new(twin, Motion::default()).unwrap()
}

/// The body at rest, and a quarter of a metre higher a frame later.
fn moving() -> ExportBody {
    let rest = body(&twin()).particles().to_vec();
    let higher = rest.iter().map(|p| *p + DVec3::Y * 0.25).collect();
    ExportBody::new(&twin(), Motion { frame_rate_hz: 30.0, frames: vec![rest, higher] }).unwrap()
}

/// The values of an attribute, in the order of the text.
fn attributes(text: &str, name: &str) -> Vec<f64> {
    let start = format!("{name}=\"");
    text.split(&start).skip(1).map(|rest| rest.split('"').next().unwrap().parse().unwrap()).collect()
}

#[test]
fn mjcf_holds_body_velocity_and_obstacles() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("twin.xml");
    write_mjcf(&path, &body(&twin()), false).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    // The body falls 0.9 m: the modulus is raised as told.
    let raised = attributes(&text, "young")[0] / 3e5;
    assert!(raised > 1.05 && raised < 1.4 && text.contains(&format!("{raised:.4} times")), "{raised}");
    assert_eq!(attributes(&text, "poisson"), [0.4]);
    for part in [
        "gravity=\"0 -9.8 0\" integrator=\"discrete\"",
        "type=\"plane\" size=\"0 0 1\" pos=\"0 -1 0\" zaxis=\"0 1 0\" friction=\"2 ",
        "priority=\"1\"",
        "moves and is left out",
        "dof=\"trilinear\" cellcount=\"",
    ] {
        assert!(text.contains(part), "`{part}` is missing in:\n{}", &text[..3000]);
    }
    let step = attributes(&text, "timestep")[0];
    assert!(step > 0.0 && step < 0.2 / Material::wave_speed_m_s(&twin().material, 1000.0), "{step}");
}

#[test]
fn mujocos_motor_gives_mass_momentum_and_spin_of_the_particles_in_the_first_step() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("twin.xml");
    let body = body(&twin());
    write_mjcf(&path, &body, false).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    let node = |line: &str| {
        let position: Vec<f64> =
            line.split("pos=\"").nth(1)?.split('"').next()?.split(' ').flat_map(str::parse).collect();
        Some((DVec3::from_slice(&position), attributes(line, "mass")[0]))
    };
    let nodes: Vec<(DVec3, f64)> = text.lines().filter(|l| l.contains("<body name")).filter_map(node).collect();
    let momenta: Vec<DVec3> = attributes(&text, "coef").chunks(3).map(DVec3::from_slice).collect();
    assert_eq!(nodes.len(), momenta.len());
    let mass: f64 = nodes.iter().map(|n| n.1).sum();
    assert!((mass - 8.0).abs() < 1e-6, "{mass}");
    let centre = nodes.iter().map(|(at, mass)| *at * *mass).sum::<DVec3>() / mass;
    let mesh = body.tetrahedra().unwrap();
    let middle = |corners: &[u32; 4]| corners.iter().map(|&corner| mesh.vertices[corner as usize]).sum::<DVec3>() / 4.0;
    let filled = mesh.tetrahedra.iter().zip(mesh.volumes()).map(|(corners, volume)| volume * middle(corners));
    // Nodes of thin cells weigh a little more than what their cells hold.
    assert!(centre.distance(filled.sum::<DVec3>() / mesh.volume()) < 1e-4, "{centre}");
    let [velocity, spin] = [DVec3::new(0.5, 0.0, -1.0), DVec3::new(0.0, 3.0, 0.0)];
    for ((at, mass), momentum) in nodes.iter().zip(&momenta) {
        let wanted = *mass * (velocity + spin.cross(*at - body.centre_of_mass_m()));
        assert!(momentum.distance(wanted) < 1e-6 * mass, "{momentum} instead of {wanted}");
    }
    // The impulse of the first step is 1, and nothing of the filter is left after it.
    let step = attributes(&text, "timestep")[0];
    assert!((attributes(&text, "gainprm")[0] * step + 1.0).abs() < 1e-4);
    assert!((-step / attributes(&text, "dynprm")[0]).exp() < 1e-8);
    // The keyframe has the velocity already.
    let key = text.split("qvel=\"").nth(1).unwrap().split('"').next().unwrap();
    let speeds: Vec<f64> = key.split(' ').map(|v| v.parse().unwrap()).collect();
    assert_eq!(speeds.len(), 3 * nodes.len());
    assert!(text.contains("act=\"1\"") && (DVec3::from_slice(&speeds) * nodes[0].1 - momenta[0]).length() < 1e-6);
}

#[test]
fn mujocos_cells_are_as_large_as_the_impact_compresses_and_its_contact_is_stiffer_than_a_step() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("twin.xml");
    let of = |youngs_modulus_pa: f64| {
        let material = Material::Elastic { youngs_modulus_pa, poisson_ratio: 0.4 };
        write_mjcf(&path, &body(&Twin { material, particle_spacing_m: Some(0.0125), ..twin() }), false).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        let step = attributes(&text, "timestep")[0];
        let contact: f64 = text.split("solref=\"").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        assert!(contact > 0.0 && contact < step, "MuJoCo takes the stiffest contact that a step resolves");
        let counts = text.split("cellcount=\"").nth(1).unwrap().split('"').next().unwrap();
        counts.split(' ').map(|n| n.parse().unwrap()).collect::<Vec<u32>>()
    };
    // A cube that meets the floor with 9.7 kPa is compressed by .51 of 20 kPa, by .27 of 100 kPa, and of 100 MPa not,
    // where the number of cells has its bound. Its mesh is up to a particle wider than it.
    assert_eq!(of(2e4), [3; 3]);
    assert_eq!(of(1e5), [5; 3]);
    assert_eq!(of(1e8), [7; 3]);
}

#[test]
fn usd_holds_particles_meshes_material_obstacles_and_motion() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("twin.usda");
    let red = |points: &[DVec3]| vec![[1.0, 0.0, 0.0]; points.len()];
    write_usd(&path, &moving(), Some(&red), UsdLook::Surface).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    for part in [
        "upAxis = \"Y\"",
        "endTimeCode = 1",
        "timeCodesPerSecond = 30",
        "float omniphysics:youngsModulus = 300000",
        "float newton:mpm:youngsModulus = 300000",
        "float omniphysics:mass = 8",
        "float physics:mass = 8",
        "custom string gic:model = \"elastic\"",
        "def Xform \"Twin\" (\n        prepend apiSchemas = [\"PhysicsDeformableBodyAPI\"]",
        "\"NewtonPointsDeformableSimAPI\"]",
        "def TetMesh \"Volume\"",
        "color3f[] primvars:displayColor = [(1, 0, 0), ",
        "def Plane \"Obstacle0\"",
        "double3 xformOp:translate = (0, -1, 0)",
        "# colliders[1] (sphere) moves and is left out",
    ] {
        assert!(text.contains(part), "`{part}` is missing");
    }
    // The corner particle of the box, a quarter of a metre higher in the second frame.
    assert!(text.contains("point3f[] points = [(-0.075, -0.075, -0.075), "));
    assert!(text.contains("1: [(-0.075, 0.175, -0.075), "));
    assert_eq!(text.matches('{').count(), text.matches('}').count());
}

#[test]
fn usd_holds_every_law_as_newtons() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("twin.usda");
    let of = |material: Material| {
        write_usd(&path, &body(&Twin { material, ..twin() }), None, UsdLook::Surface).unwrap();
        fs::read_to_string(&path).unwrap()
    };
    let fluid = of(Material::Newtonian { viscosity_pa_s: 5.0, bulk_modulus_pa: 1e5 });
    assert!(fluid.contains("newton:mpm:viscosity = 5") && fluid.contains("newton:mpm:yieldStress = 0"));
    assert!(!fluid.contains("TetMesh") && !fluid.contains("omniphysics:youngsModulus"));
    let jelly = Material::Viscoelastic { youngs_modulus_pa: 2e5, poisson_ratio: 0.3, retardation_time_s: 0.01 };
    assert!(of(jelly).contains("newton:mpm:elasticDamping = 2000"));
    let sand = of(Material::Sand { friction_angle_deg: 30.0, youngs_modulus_pa: 2e6, poisson_ratio: 0.3 });
    // sqrt(3) 2 sin 30 / (3 - sin 30) = 2 sqrt(3) / 5.
    assert!(sand.contains("newton:mpm:internalFriction = 0.6928203230275508"), "{}", &sand[..1800]);
    let clay = Material::Plasticine { youngs_modulus_pa: 1e6, poisson_ratio: 0.3, yield_stress_pa: 1e4 };
    assert!(of(clay).contains("newton:mpm:yieldStress = 7071.067811865475"));
}

#[test]
fn glb_holds_surface_colours_and_a_morph_target_a_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("twin.glb");
    let red = |points: &[DVec3]| vec![[1.0, 0.0, 0.0]; points.len()];
    write_glb(&path, &moving(), Some(&red)).unwrap();
    let bytes = fs::read(&path).unwrap();
    let integer = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((&bytes[..4], integer(4), integer(8)), (&b"glTF"[..], 2, bytes.len()));
    let (length, binary) = (integer(12), 20 + integer(12));
    let document: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    assert_eq!(document["buffers"][0]["byteLength"].as_u64().unwrap() as usize, integer(binary));
    assert_eq!(document["extras"]["mass_kg"].as_f64(), Some(8.000000000000002));
    let primitive = &document["meshes"][0]["primitives"][0];
    assert_eq!(primitive["targets"].as_array().unwrap().len(), 2);
    let floats = |accessor: &serde_json::Value| {
        let accessor = &document["accessors"][accessor.as_u64().unwrap() as usize];
        let view = &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let number = |key: &str| view[key].as_u64().unwrap() as usize;
        let start = binary + 8 + number("byteOffset");
        let values: Vec<f32> = bytes[start..start + number("byteLength")]
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
            .collect();
        values
    };
    assert!(floats(&primitive["attributes"]["COLOR_0"]).chunks_exact(3).all(|c| c == [1.0, 0.0, 0.0]));
    let higher = floats(&primitive["targets"][1]["POSITION"]);
    assert!(higher.chunks_exact(3).all(|d| d[0].abs() < 1e-6 && (d[1] - 0.25).abs() < 1e-6));
    let sampler = &document["animations"][0]["samplers"][0];
    assert_eq!(floats(&sampler["output"]), [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(floats(&sampler["input"]), [0.0, 1.0 / 30.0]);
}

#[test]
fn particles_ply_comes_back_with_velocities() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("particles.ply");
    let body = body(&twin()).turned_up(UpAxis::Z);
    write_particles_ply(&path, &body).unwrap();
    let read = read_particles(&path).unwrap();
    for ((p, v), at) in read.positions.iter().zip(&read.velocities).zip(body.particles()) {
        assert!((*p - *at).length() < 1e-6);
        // The spin about y is one about z when z points up.
        let expected = DVec3::new(0.5, 1.0, 0.0) + DVec3::Z.cross(*at) * 3.0;
        assert!((*v - expected).length() < 1e-5, "{v} {expected}");
    }
}

#[test]
fn particle_sets_are_numpy_arrays_and_parameters() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("twin.npz");
    let body = body(&twin());
    let parameters = write_particle_set(&path, &body).unwrap();
    let mut archive = npyz::npz::NpzArchive::open(&path).unwrap();
    let mut array = |name: &str| {
        let array = archive.by_name(name).unwrap().unwrap();
        (array.shape().to_vec(), array.into_vec::<f32>().unwrap())
    };
    let (shape, positions) = array("positions");
    assert_eq!(shape, [64, 3]);
    assert!((f64::from(positions[0]) - body.particles()[0].x).abs() < 1e-6);
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
    assert!(fs::read_to_string(folder.path().join("twin.genesis.py")).unwrap().contains("\"twin.npz\""));
    let first = fs::read(&path).unwrap();
    write_particle_set(&path, &body).unwrap();
    assert_eq!(first, fs::read(&path).unwrap(), "the same bytes again");
}

#[test]
fn mujoco_gets_elastic_solids_and_others_as_such_only_when_asked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("twin.xml");
    let of =
        |material: Material, approximate: bool| write_mjcf(&path, &body(&Twin { material, ..twin() }), approximate);
    let fluid = Material::Newtonian { viscosity_pa_s: 5.0, bulk_modulus_pa: 1e5 };
    for approximate in [false, true] {
        let error = of(fluid, approximate).unwrap_err();
        assert!(error.to_string().contains("newtonian") && error.hint().unwrap().contains("--format usd"), "{error}");
    }
    let jelly = Material::Viscoelastic { youngs_modulus_pa: 2e5, poisson_ratio: 0.3, retardation_time_s: 0.01 };
    of(jelly, false).unwrap();
    assert!(fs::read_to_string(&path).unwrap().contains("damping=\"0.01\""));
    fs::remove_file(&path).unwrap();
    let clay = Material::Plasticine { youngs_modulus_pa: 1e6, poisson_ratio: 0.3, yield_stress_pa: 1e4 };
    let error = of(clay, false).unwrap_err();
    assert!(error.hint().unwrap().contains("--approximate"), "{error}");
    assert!(!Path::exists(&path));
    of(clay, true).unwrap();
    assert!(fs::read_to_string(&path).unwrap().contains("EXPORTED AS ELASTIC"));
}
