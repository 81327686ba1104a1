//! The scene of a run: found by the path that the run keeps, known by the hash of what was read.

use std::path::{Path, PathBuf};

use gic_files::FileError;
use gic_scene::{Scene, SceneError, Seek, World};
use gic_twin::atomic::read_json;
use sha2::{Digest, Sha256};

use super::Stage;
use super::identify_record::IdentifyRecord;
use super::results::{hash_file, stamp_file};
use super::stamp::Stamp;
use crate::config::{Config, Layer};
use crate::error::{Error, Result};

/// Opens the scene of a run folder, with all frames of the video and the cameras as they were found; it lies at
/// `elsewhere`, or where the run says.
///
/// # Errors
/// Those of [`open_scene`], unusable settings, another scene than the run's.
pub fn scene_of_run(run: &Path, elsewhere: Option<&Path>) -> Result<Scene> {
    let mut config = config_of_run(run)?;
    if let Some(path) = elsewhere {
        config.scene.path = Some(path.to_owned());
    }
    let video = open_scene(&config)?;
    let hash = hash_scene(&fitted_part(&video, &config)?, &config)?;
    check_origin(run, &video.root, &hash)?;
    let identified = run.join("identify.json");
    Ok(if identified.exists() { read_json::<IdentifyRecord>(&identified)?.as_fitted(&video) } else { video })
}

/// The settings that a run keeps.
pub(crate) fn config_of_run(run: &Path) -> Result<Config> {
    Config::resolve(vec![Layer::read(&run.join("config.toml"))?])
}

/// Opens the scene that a configuration names.
///
/// # Errors
/// No scene named, everything that is wrong with it, or a number of frames to fit to that it does not have.
pub fn open_scene(config: &Config) -> Result<Scene> {
    let Some(path) = &config.scene.path else {
        return Err(Error::Usage {
            problem: "the run does not know its scene".into(),
            hint: Some("start it with `gic run SCENE -o RUN` or `gic reconstruct SCENE -o RUN`".into()),
        });
    };
    let scene = Scene::open_with(path, &config.scene).map_err(|source| Error::Stage {
        stage: "reading the scene",
        hint: matches!(source, SceneError::NotFound { .. })
            .then(|| "check the path; where a run's scene has moved, say with --scene SCENE where it is now".into()),
        source: source.into(),
    })?;
    let fitted = fitted_part(&scene, config)?.times.len();
    let seek = config.scene.seek();
    if seek == Seek::default() {
        return Ok(scene);
    }
    let gravity = config.identify.gravity_m_s2.map(Into::into).or(scene.world.gravity);
    scene.corrected(gravity, fitted, seek).map_err(Error::stage("reading the masks of the first frames"))
}

/// The frames that everything is fitted to.
pub(super) fn fitted_part(video: &Scene, config: &Config) -> Result<Scene> {
    const MIN_FITTED_FRAMES: usize = 2;
    let all = video.times.len();
    match config.scene.fit_frames {
        None => Ok(video.clone()),
        Some(count) if (MIN_FITTED_FRAMES..=all).contains(&count) => Ok(video.first_frames(count)),
        Some(count) => Err(Error::Usage {
            problem: format!("scene.fit_frames is {count}, and the video has {all} frames"),
            hint: Some(format!("give --fit-frames a number from {MIN_FITTED_FRAMES} to {all}, or leave it out")),
        }),
    }
}

/// Hash of everything that the stages read of a scene: pictures, masks or the network that makes them, cameras, times.
pub(super) fn hash_scene(scene: &Scene, config: &Config) -> Result<String> {
    let mut all = Sha256::new();
    let World { up, gravity, ground, ground_deviation_m, metric } = scene.world;
    let world = format!("World {{ up: {up:?}, gravity: {gravity:?}, ground: {ground:?}, metric: {metric:?} }}");
    all.update(format!("{:?} {:?} {:?} {world}", scene.format, scene.cameras, scene.times));
    if ground_deviation_m != 0.0 {
        all.update(format!("{ground_deviation_m:?}"));
    }
    if let Some(lenses) = scene.lenses() {
        all.update(lenses);
    }
    if scene.has_lags() {
        all.update(format!("{:?}", scene.views.iter().map(|view| view.time_s).collect::<Vec<_>>()));
    }
    let mut files: Vec<&Path> = Vec::new();
    for view in &scene.views {
        files.extend([view.picture.as_path(), view.mask_path()]);
    }
    files.extend(scene.backgrounds.iter().flatten().map(PathBuf::as_path));
    files.dedup();
    for file in files {
        all.update(gic_files::input::read(file).map_err(FileError::read(file))?);
    }
    if let Some(network) = &config.scene.matting {
        all.update(hash_file(network)?);
    }
    if let Some(rest) = &scene.rest {
        all.update(hash_scene(rest, config)?);
    }
    Ok(format!("{:x}", all.finalize()))
}

/// Refuses a scene that is not the one that the run's Gaussians were made from.
pub(super) fn check_origin(run: &Path, root: &Path, hash: &str) -> Result<()> {
    match Stamp::read(&stamp_file(run, Stage::Reconstruct))? {
        Some(stamp) if stamp.recipe.input_hash() != hash => Err(Error::Usage {
            problem: format!("the scene in {} is not the one that {} was made from", root.display(), run.display()),
            hint: Some(format!(
                "say with --scene SCENE where the run's own scene is, or make the run anew with \
                 `gic run SCENE -o {}`",
                run.display()
            )),
        }),
        _ => Ok(()),
    }
}
