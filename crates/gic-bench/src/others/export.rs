//! A suite in the layout that the released code of other methods reads.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gic_files::{FileError, PlyLayout, PlyProperty, write_ply};
use gic_scene::{Camera, Mask, Picture, Scene, SceneSettings};
use gic_twin::events::Events;
use gic_twin::{Interrupt, TwinError, atomic};
use serde::Serialize;
use serde_json::{Value, json};

use crate::STAGE;
use crate::error::{BenchError, Result};
use crate::suite::SuiteScene;
use crate::truth::Truth;

/// Coverage below which a pixel is background: where both methods' own script cuts its mattes.
const LEAST_COVERAGE: f32 = 0.9;
/// Number of frames that ProJo4D's configurations ask for.
const PROJO4D_FRAMES: usize = 14;
/// Words in a path by which ProJo4D takes a scene for one of another data set.
const PROJO4D_WORDS: [&str; 4] = ["gso", "render", "pacnerf", "real_capture"];

/// A method whose released code reads the suite.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Method {
    /// GIC, the paper's own.
    Gic,
    /// ProJo4D.
    Projo4d,
}

impl Method {
    /// Folder of a scene, from the output folder: ProJo4D finds the truth by it.
    fn folder(self, law: &str, scene: &str) -> PathBuf {
        let data = Path::new("data/pacnerf");
        match self {
            Self::Gic => data.join(scene),
            Self::Projo4d => data.join(law).join(scene),
        }
    }

    /// The command for a scene, without its folders.
    fn command(self, law: &str) -> String {
        match self {
            Self::Gic => {
                format!("python train_dynamic.py -c config/pacnerf/{law}/default.json --reg_scale --reg_alpha")
            }
            Self::Projo4d => format!("python train_projo4d.py -c config/pacnerf/{law}/projo4d.json"),
        }
    }

    /// The files that say that a scene is done.
    fn results(self) -> &'static str {
        match self {
            Self::Gic => "*-pred.json",
            Self::Projo4d => "projo4d_pred*.json",
        }
    }
}

/// A picture in `all_data.json`.
#[derive(Serialize)]
struct Entry {
    file_path: String,
    /// [s].
    time: f64,
    /// Camera to world, [3, 4]; x right, y up, the camera looks along -z.
    c2w: [[f64; 4]; 3],
    intrinsic: [[f64; 3]; 3],
}

/// Writes the scenes, and `run.sh`, which runs the method on each that has no result yet.
///
/// # Errors
/// A law, a number of frames or a path that the method does not take, an unreadable scene, an unwritable folder.
pub fn export_suite(
    method: Method,
    scenes: &[SuiteScene],
    cameras: Option<&[usize]>,
    out: &Path,
    events: &Events,
    interrupt: &Interrupt,
) -> Result<()> {
    let out = std::path::absolute(out).map_err(FileError::read(out))?;
    validate(method, scenes, &out)?;
    let mut lines = Vec::new();
    let mut truths: BTreeMap<&str, BTreeMap<&str, Value>> = BTreeMap::new();
    for (done, scene) in scenes.iter().enumerate() {
        let law = law_name(scene)?;
        let settings = SceneSettings { cameras: cameras.map(<[usize]>::to_vec), ..SceneSettings::default() };
        let read = Scene::open_with(&scene.path, &settings).map_err(BenchError::scene(&scene.path))?;
        if method == Method::Projo4d && read.times.len() < PROJO4D_FRAMES {
            return Err(BenchError::usage(
                format!("{} has {} frames, and ProJo4D asks for {PROJO4D_FRAMES}", scene.name, read.times.len()),
                "leave it out with --filter, or change n_frames in its configuration and this folder's scenes by hand",
            ));
        }
        let folder = method.folder(law, &scene.name);
        write_scene(&read, &out.join(&folder), interrupt)?;
        if method == Method::Projo4d {
            write_clouds(&scene.truth, &out.join("simulation_data").join(law).join(&scene.name))?;
            truths.entry(law).or_default().insert(&scene.name, truth_json(&scene.truth));
        }
        lines.push(format!(
            "run {} {} {}",
            quoted(&scene.name),
            quoted(&folder.to_string_lossy()),
            method.command(law)
        ));
        events.step(STAGE, "", done as u64 + 1, Some(scenes.len() as u64), &[]);
    }
    for (law, scenes) in truths {
        atomic::write_json(&out.join(format!("data/pacnerf/{law}.json")), &scenes)?;
    }
    Ok(atomic::write(&out.join("run.sh"), script(method, &lines).as_bytes())?)
}

fn validate(method: Method, scenes: &[SuiteScene], out: &Path) -> Result<()> {
    scenes.iter().try_for_each(|scene| law_name(scene).map(drop))?;
    let path = out.to_string_lossy().to_lowercase();
    match PROJO4D_WORDS.iter().find(|word| method == Method::Projo4d && path.contains(*word)) {
        Some(word) => Err(BenchError::usage(
            format!(
                "{} contains \"{word}\", by which ProJo4D takes scenes for those of another data set",
                out.display()
            ),
            "choose another output folder",
        )),
        None => Ok(()),
    }
}

/// What both methods call the law of a scene.
fn law_name(scene: &SuiteScene) -> Result<&'static str> {
    match scene.truth.material.model() {
        "elastic" => Ok("elastic"),
        "newtonian" => Ok("newtonian"),
        "non-newtonian" => Ok("non_newtonian"),
        "plasticine" => Ok("plasticine"),
        "sand" => Ok("sand"),
        other => Err(BenchError::usage(
            format!("{} is {other}, a law that the method does not have", scene.name),
            "leave it out with --filter",
        )),
    }
}

fn write_scene(scene: &Scene, folder: &Path, interrupt: &Interrupt) -> Result<()> {
    atomic::create_folder(&folder.join("data"))?;
    let failed = |source| BenchError::Scene { path: scene.root.clone(), source };
    let mut entries = Vec::new();
    for view in &scene.views {
        if interrupt.requested() {
            return Err(TwinError::Interrupted {
                after: format!("some pictures of {}", folder.display()),
                resume: "run the same command again".into(),
            }
            .into());
        }
        let name = format!("{}_{}.png", view.camera, view.frame);
        let (picture, mask) = scene.load(view).map_err(failed)?;
        over_white(&picture, &mask).save_png(&folder.join(format!("data/m_{name}"))).map_err(failed)?;
        entries.push(entry(&scene.cameras[view.camera], format!("./data/r_{name}"), scene.times[view.frame]));
    }
    Ok(atomic::write_json(&folder.join("all_data.json"), &entries)?)
}

/// The object over pure white, which nothing of the object is.
fn over_white(picture: &Picture, mask: &Mask) -> Picture {
    let almost_white = 254.0 / 255.0;
    let mut result = picture.clone();
    for (pixel, coverage) in result.rgb.chunks_exact_mut(3).zip(&mask.coverage) {
        if *coverage < LEAST_COVERAGE {
            pixel.fill(1.0);
        } else if pixel.iter().all(|value| *value > almost_white) {
            pixel.fill(almost_white);
        }
    }
    result
}

fn entry(camera: &Camera, file_path: String, time: f64) -> Entry {
    let axes = camera.world_from_camera;
    // From y down, z forward to y up, z backward.
    let row = |i: usize| [axes.x_axis[i], -axes.y_axis[i], -axes.z_axis[i], camera.centre[i]];
    Entry {
        file_path,
        time,
        c2w: [row(0), row(1), row(2)],
        intrinsic: [
            [camera.focal.x, 0.0, camera.principal.x],
            [0.0, camera.focal.y, camera.principal.y],
            [0.0, 0.0, 1.0],
        ],
    }
}

/// The truth as ProJo4D's own figures need it.
fn truth_json(truth: &Truth) -> Value {
    let mut found = serde_json::Map::from_iter([("v".to_owned(), json!(truth.velocity_m_s))]);
    for (name, value) in truth.material.parameter_names().iter().zip(truth.material.parameters()) {
        let key = match *name {
            "youngs_modulus_pa" => "E",
            "poisson_ratio" => "nu",
            "viscosity_pa_s" | "shear_modulus_pa" => "mu",
            "bulk_modulus_pa" => "kappa",
            "yield_stress_pa" => "ys",
            "plastic_viscosity_pa_s" => "eta",
            _ => "fa",
        };
        found.insert(key.into(), json!(value));
    }
    Value::Object(found)
}

/// True particles of the frames from the first on, which ProJo4D's own figures need.
fn write_clouds(truth: &Truth, folder: &Path) -> Result<()> {
    atomic::create_folder(folder)?;
    let properties = [PlyProperty::Float("x"), PlyProperty::Float("y"), PlyProperty::Float("z")];
    let layout = PlyLayout { comment: None, properties: &properties, triangles: None };
    for frame in 0.. {
        let Some(particles) = truth.particles(frame)? else { break };
        let path = folder.join(format!("{frame:03}.ply"));
        write_ply(&path, &layout, particles.iter()).map_err(TwinError::from)?;
    }
    Ok(())
}

fn script(method: Method, lines: &[String]) -> String {
    format!(
        "#!/bin/sh\n\
         # Runs the released code on every scene of this folder that has no result yet:\n\
         #   sh run.sh CHECKOUT    the folder of the code, whose environment is active\n\
         # Results: output/SCENE; `gic bench --collect OUT --others HERE/output` puts them into the tables.\n\
         here=$(cd \"$(dirname \"$0\")\" && pwd)\n\
         cd \"$1\" || exit 1\n\
         run() {{\n  name=$1 scene=$2\n  shift 2\n  \
         ls \"$here/output/$name\"/{results} >/dev/null 2>&1 && return\n  \
         \"$@\" -s \"$here/$scene\" -m \"$here/output/$name\" || echo \"$name failed\" >&2\n}}\n\
         {lines}\n",
        results = method.results(),
        lines = lines.join("\n"),
    )
}

/// A word for the shell.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', r"'\''"))
}
