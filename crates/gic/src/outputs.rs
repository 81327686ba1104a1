//! Outputs never take the place of inputs: every place that a command writes to by the user's word is checked here.

use std::path::{Component, Path, PathBuf};

use gic_files::resolved;

use crate::error::{Error, Result};
use crate::pipeline::stage::{Stage, is_result_name};

/// What of a run folder its stages and commands keep in it, besides the outputs of the stages.
const KEPT_IN_RUNS: [&str; 7] =
    ["config.toml", "log.jsonl", "stamps", "selection", "identify.checkpoint.json", "colliders.toml", "colliders.json"];

/// The inputs of a command.
#[derive(Clone, Debug, Default)]
pub struct Inputs {
    files: Vec<PathBuf>,
    scenes: Vec<PathBuf>,
}

impl Inputs {
    /// The same with a file.
    #[must_use]
    pub fn file(mut self, path: &Path) -> Self {
        self.files.push(resolved(path));
        self
    }

    /// The same with a scene's folder: everything in it is input.
    #[must_use]
    pub fn scene(mut self, root: &Path) -> Self {
        self.scenes.push(resolved(root));
        self
    }

    /// Allows a file to be written, or not.
    ///
    /// # Errors
    /// [`Error::Overwrite`] where it is an input, a file of a scene, or a result of a run or a simulation.
    pub fn allow_file(&self, output: &Path) -> Result<()> {
        let place = resolved(output);
        let is_frame = place.parent().is_some_and(|folder| folder.join("trajectory.json").is_file())
            && place.file_name().is_some_and(|name| {
                let name = name.to_string_lossy();
                name == "trajectory.json" || name.starts_with("particles_")
            });
        match (self.meaning(&place), is_frame) {
            (Some(what), _) => Err(Error::Overwrite { path: output.to_owned(), what }),
            (None, true) => Err(Error::Overwrite { path: output.to_owned(), what: "a frame of a simulation" }),
            (None, false) => Ok(()),
        }
    }

    /// Allows files whose names begin with one of `names` to be written into a folder, or not.
    ///
    /// # Errors
    /// [`Error::Overwrite`] where the folder is a run or a scene, or holds such a file that is an input or a result.
    pub fn allow_folder(&self, output: &Path, names: &[&str]) -> Result<()> {
        let folder = resolved(output);
        if is_run(&folder) || self.scenes.contains(&folder) {
            return Err(Error::Overwrite { path: output.to_owned(), what: "a run or a scene" });
        }
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            let name = entry.file_name();
            let written = names.iter().any(|begin| name.to_string_lossy().starts_with(begin));
            if let (true, Some(what)) = (written, self.meaning(&folder.join(&name))) {
                return Err(Error::Overwrite { path: output.join(name), what });
            }
        }
        Ok(())
    }

    /// What a place is, if nothing must be written there.
    fn meaning(&self, place: &Path) -> Option<&'static str> {
        if self.files.iter().any(|file| file == place) {
            return Some("an input");
        }
        if place.exists() && self.scenes.iter().any(|scene| place.starts_with(scene)) {
            return Some("a file of the scene");
        }
        let run = place.ancestors().skip(1).find(|folder| is_run(folder))?;
        place.strip_prefix(run).is_ok_and(is_result).then_some("a result of a run")
    }
}

/// Whether a folder is a run.
fn is_run(folder: &Path) -> bool {
    folder.join("config.toml").is_file() && folder.join("stamps").is_dir()
}

/// Whether a file of a run, by its way from the run folder, belongs to a stage.
fn is_result(file: &Path) -> bool {
    let mut parts = file.components();
    let Some(Component::Normal(first)) = parts.next() else { return false };
    let is_first = |own: &str| Path::new(own).iter().next() == Some(first);
    let owned = Stage::ALL.iter().flat_map(|stage| stage.outputs()).copied().chain(KEPT_IN_RUNS).any(is_first);
    let in_folder = parts.next().is_some();
    owned && (!in_folder || is_result_name(file))
}

/// Refuses a run folder that is its scene's own, or whose stages would write into the scene.
///
/// # Errors
/// [`Error::Overwrite`].
pub(crate) fn allow_run(run: &Path, scene: &Path) -> Result<()> {
    let (folder, scene) = (resolved(run), resolved(scene));
    let inside =
        scene.strip_prefix(&folder).is_ok_and(|way| way.as_os_str().is_empty() || is_result(&way.join("x.ply")));
    if inside { Err(Error::Overwrite { path: run.to_owned(), what: "the scene's own folder" }) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_scenes_and_results_are_kept() {
        let root = tempfile::tempdir().unwrap();
        let [run, scene] = ["run", "scene"].map(|name| root.path().join(name));
        for folder in [run.join("stamps"), run.join("prediction"), scene.join("data")] {
            std::fs::create_dir_all(folder).unwrap();
        }
        for file in ["run/config.toml", "run/twin.json", "scene/data/r_0_0.png", "scene/frame_0000.png", "twin.json"] {
            std::fs::write(root.path().join(file), b"x").unwrap();
        }
        let inputs = Inputs::default().file(&root.path().join("twin.json")).scene(&scene);
        for kept in ["run/twin.json", "run/prediction/particles_0000.ply", "scene/data/r_0_0.png", "scene/../twin.json"]
        {
            assert!(inputs.allow_file(&root.path().join(kept)).is_err(), "{kept}");
        }
        for free in ["run/view.html", "run/prediction/view.html", "run/surface.ply", "sheet.png", "scene/sheet.png"] {
            inputs.allow_file(&root.path().join(free)).unwrap();
        }
        assert!(inputs.allow_folder(&run, &["frame_"]).is_err());
        assert!(inputs.allow_folder(&scene, &["frame_"]).is_err());
        inputs.allow_folder(root.path(), &["frame_"]).unwrap();
        assert!(inputs.allow_folder(root.path(), &["frame_", "twin"]).is_err());
        assert!(allow_run(&scene, &scene).is_err() && allow_run(&root.path().join("new"), &scene).is_ok());
        assert!(
            allow_run(root.path(), &scene).is_ok() && allow_run(root.path(), &root.path().join("surface")).is_err()
        );
    }
}
