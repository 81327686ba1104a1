//! `suite.json`: the tasks of an output folder. It is all that a task needs besides the scenes.

use std::path::{Path, PathBuf};

use gic_files::FileError;
use gic_twin::atomic;
use serde::{Deserialize, Serialize};

use crate::error::{BenchError, Result};
use crate::suite::SuiteScene;
use crate::sweep::Case;

const SCHEMA: &str = "gic.bench/1";
const FILE: &str = "suite.json";

/// One scene, run in one way.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Task {
    /// Its run folder, from the output folder; also its name.
    pub folder: String,
    /// Name of the scene.
    pub scene: String,
    /// The scene's folder.
    pub scene_path: PathBuf,
    /// The case, without the seed; empty where the sweep has one.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub case: String,
    /// The seed, where one was given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Where the command was given: relative paths in the arguments start there.
    pub directory: PathBuf,
    /// Arguments of `gic run`, besides the scene and the run folder.
    pub arguments: Vec<String>,
}

impl Task {
    /// The run folder.
    pub fn run(&self, out: &Path) -> PathBuf {
        out.join(&self.folder)
    }

    /// What a run of the task writes on stderr.
    pub fn messages(&self, out: &Path) -> PathBuf {
        self.run(out).join("messages.txt")
    }

    /// Scene and case for people.
    pub fn label(&self) -> String {
        let seed = self.seed.map(|seed| format!("seed {seed}"));
        let parts = [Some(self.scene.clone()), Some(self.case.clone()).filter(|case| !case.is_empty()), seed];
        parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
    }

    /// The command line of `gic run`.
    pub fn words(&self, out: &Path) -> Vec<String> {
        let [scene, run] = [&self.scene_path, &self.run(out)].map(|path| path.to_string_lossy().into_owned());
        let head = ["gic".to_owned(), "run".into(), scene, "-o".into(), run];
        head.into_iter().chain(self.arguments.iter().cloned()).collect()
    }
}

/// All tasks of an output folder, by scene.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Plan {
    schema: String,
    /// The tasks.
    pub tasks: Vec<Task>,
}

impl Plan {
    /// The plan of an output folder.
    ///
    /// # Errors
    /// No plan there, a damaged one, one of another version.
    pub fn read(out: &Path) -> Result<Self> {
        let path = out.join(FILE);
        if !path.is_file() {
            return Err(BenchError::File(FileError::Content {
                path,
                problem: "is missing".into(),
                hint: Some("give the folder that `gic bench SUITE -o OUT` writes into".into()),
            }));
        }
        let plan: Self = atomic::read_json(&path)?;
        if plan.schema != SCHEMA {
            return Err(BenchError::File(FileError::Content {
                path,
                problem: format!("has the schema {}, not {SCHEMA}", plan.schema),
                hint: Some("use the gic that wrote it, or another output folder".into()),
            }));
        }
        Ok(plan)
    }

    /// Adds tasks to the plan of an output folder, or changes those of the same name, and keeps it there.
    ///
    /// # Errors
    /// Run folders inside each other, an unwritable folder.
    pub fn extend(out: &Path, tasks: &[Task]) -> Result<Self> {
        let mut plan = match out.join(FILE).is_file() {
            true => Self::read(out)?,
            false => Self { schema: SCHEMA.into(), tasks: Vec::new() },
        };
        plan.tasks.retain(|known| !tasks.iter().any(|task| task.folder == known.folder));
        plan.tasks.extend(tasks.iter().cloned());
        plan.tasks.sort_by(|a, b| a.scene.cmp(&b.scene));
        let nested = |task: &&Task| {
            plan.tasks.iter().any(|other| {
                other.folder != task.folder && Path::new(&task.folder).starts_with(Path::new(&other.folder))
            })
        };
        if let Some(task) = plan.tasks.iter().find(nested) {
            return Err(BenchError::usage(
                format!("{} would lie inside another run of {}", task.folder, out.display()),
                "give a sweep an output folder of its own",
            ));
        }
        atomic::create_folder(out)?;
        atomic::write_json(&out.join(FILE), &plan)?;
        Ok(plan)
    }

    /// The task of a name.
    ///
    /// # Errors
    /// No such task.
    pub fn task(&self, name: &str) -> Result<&Task> {
        self.tasks.iter().find(|task| task.folder == name).ok_or_else(|| {
            BenchError::usage(format!("the suite has no task \"{name}\""), format!("the folders in {FILE} name them"))
        })
    }
}

/// The tasks of every scene in every case, which all take these further arguments of `gic run`.
///
/// # Errors
/// No current folder.
pub fn tasks(scenes: &[SuiteScene], cases: &[Case], further: &[String]) -> Result<Vec<Task>> {
    let directory = std::env::current_dir().map_err(FileError::read(Path::new(".")))?;
    let task = |scene: &SuiteScene, case: &Case| Task {
        folder: if case.folder.is_empty() { scene.name.clone() } else { format!("{}/{}", scene.name, case.folder) },
        scene: scene.name.clone(),
        scene_path: scene.path.clone(),
        case: case.name.clone(),
        seed: case.seed,
        directory: directory.clone(),
        // The model is given to the method, as in the paper; nothing else of the truth is.
        arguments: ["--material", scene.truth.material.model()]
            .map(String::from)
            .into_iter()
            .chain(case.arguments.iter().chain(further).cloned())
            .collect(),
    };
    Ok(scenes.iter().flat_map(|scene| cases.iter().map(move |case| task(scene, case))).collect())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn task(folder: &str) -> Task {
        Task {
            folder: folder.into(),
            scene: folder.split('/').next().unwrap().into(),
            scene_path: "/scenes/x".into(),
            case: String::new(),
            seed: None,
            directory: "/".into(),
            arguments: vec!["--material".into(), "elastic".into()],
        }
    }

    #[test]
    fn batches_add_to_the_plan() {
        let folder = tempfile::tempdir().unwrap();
        assert!(Plan::read(folder.path()).unwrap_err().hint().is_some());
        Plan::extend(folder.path(), &[task("sand_1"), task("elastic_1")]).unwrap();
        let changed = Task { arguments: vec!["--steps".into()], ..task("sand_1") };
        let plan = Plan::extend(folder.path(), &[task("sand_0"), changed.clone()]).unwrap();
        let names: Vec<&str> = plan.tasks.iter().map(|task| task.folder.as_str()).collect();
        assert_eq!(names, ["elastic_1", "sand_0", "sand_1"]);
        assert_eq!(Plan::read(folder.path()).unwrap().task("sand_1").unwrap(), &changed);
        assert!(plan.task("sand_2").is_err());
    }

    #[test]
    fn runs_do_not_lie_inside_each_other() {
        let folder = tempfile::tempdir().unwrap();
        Plan::extend(folder.path(), &[task("sand_1")]).unwrap();
        let refused = Plan::extend(folder.path(), &[task("sand_1/seed=1")]).unwrap_err();
        assert!(refused.to_string().contains("sand_1/seed=1"), "{refused}");
    }
}
