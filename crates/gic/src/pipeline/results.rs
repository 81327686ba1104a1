//! The files that stages leave: which they are, and whether they are still what the stage wrote.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use gic_files::FileError;
use sha2::{Digest, Sha256};

use super::stage::{Stage, is_result_name};
use super::stamp::{Hashes, Stamp};
use crate::error::{Error, Result};

/// Where the stamp of a stage is.
pub(super) fn stamp_file(run: &Path, stage: Stage) -> PathBuf {
    run.join(format!("stamps/{}.json", stage.name()))
}

/// Hashes of the files that a stage has left in a run.
///
/// # Errors
/// A file that is missing or cannot be read.
pub(super) fn hash_results(run: &Path, stage: Stage) -> Result<Hashes> {
    let mut hashes = Hashes::new();
    for output in stage.outputs() {
        let path = run.join(output);
        if path.is_dir() {
            for name in results_in(&path)? {
                hashes.insert(format!("{output}/{name}"), hash_file(&path.join(&name))?);
            }
        } else {
            hashes.insert((*output).to_owned(), hash_file(&path)?);
        }
    }
    Ok(hashes)
}

/// Names of the results in a folder.
fn results_in(folder: &Path) -> Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(FileError::read(folder))? {
        let name = PathBuf::from(entry.map_err(FileError::read(folder))?.file_name());
        if let (true, Some(name)) = (is_result_name(&name), name.to_str()) {
            names.push(name.to_owned());
        }
    }
    Ok(names)
}

/// SHA-256 of a file, hexadecimal.
pub(super) fn hash_file(path: &Path) -> Result<String> {
    let mut hash = Sha256::new();
    let mut file = gic_files::input::open(path).map_err(FileError::read(path))?;
    io::copy(&mut file, &mut hash).map_err(FileError::read(path))?;
    Ok(format!("{:x}", hash.finalize()))
}

/// The first file that a stage left and that is no longer there.
///
/// # Errors
/// A file that is there and is not what the stage wrote: it is somebody's work or damage, and never overwritten.
pub(super) fn missing_result(run: &Path, stage: Stage, stamp: &Stamp) -> Result<Option<String>> {
    let mut missing = None;
    for (name, written) in &stamp.written {
        let path = run.join(name);
        if !path.exists() {
            missing.get_or_insert_with(|| name.clone());
        } else if hash_file(&path)? != *written {
            return Err(Error::File(FileError::Content {
                problem: format!(
                    "is not the file that `{}` wrote: it is damaged, or was put there later",
                    stage.name()
                ),
                hint: Some(format!(
                    "move it away and `gic run SCENE -o {}` makes it anew, or restore it from a copy",
                    run.display()
                )),
                path,
            }));
        }
    }
    // What the gic that wrote the stamp did not write yet.
    let unwritten = stage.outputs().iter().find(|output| !run.join(output).exists());
    Ok(missing.or_else(|| unwritten.map(|output| (*output).to_owned())))
}

/// Checks, for reading, the results of stages that are finished: every file is there as it was written, and each stage
/// was made from the files that are there now. Stages that are not finished are left out.
///
/// # Errors
/// A damaged, foreign, missing or outdated result, or a damaged stamp.
pub fn check_results(run: &Path, stages: &[Stage]) -> Result<()> {
    let mut now = Hashes::new();
    for stage in Stage::ALL {
        let Some(stamp) = Stamp::read(&stamp_file(run, stage))? else { continue };
        if stages.contains(&stage) {
            check_result(run, stage, &stamp, &now)?;
        }
        now.extend(stamp.written);
    }
    Ok(())
}

/// The file of a twin: a run folder stands for the twin in it, which must be the one that the run wrote.
///
/// # Errors
/// As [`check_results`].
pub fn twin_file(path: &Path) -> Result<PathBuf> {
    if !path.is_dir() {
        return Ok(path.to_owned());
    }
    check_results(path, &[Stage::Identify])?;
    Ok(path.join("twin.json"))
}

fn check_result(run: &Path, stage: Stage, stamp: &Stamp, now: &Hashes) -> Result<()> {
    let problem = match missing_result(run, stage, stamp)? {
        Some(file) => (run.join(file), "is missing".to_owned()),
        // A selection that is no longer used may be as old as it likes; one that is used is older than the twin.
        None => match stamp.recipe.changed_input(now).filter(|_| stage != Stage::Select) {
            Some(file) => (run.join(file), format!("is newer than the result of `{}`", stage.name())),
            None => return Ok(()),
        },
    };
    let hint = Some(format!("bring the run up to date with `gic run SCENE -o {}`", run.display()));
    Err(Error::File(FileError::Content { path: problem.0, problem: problem.1, hint }))
}
