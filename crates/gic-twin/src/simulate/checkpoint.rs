//! The saved state beside the frames: what a later call needs to go on with the same bits.

use std::fs::File;
use std::io::{BufReader, Read, Write};
use std::path::{Path, PathBuf};

use gic_mpm::Snapshot;

use crate::atomic;
use crate::error::{Result, TwinError};

fn file(folder: &Path) -> PathBuf {
    folder.join(".state")
}

/// Writes the state of a run with the given identity, atomically.
pub(super) fn write(folder: &Path, identity: &[u8; 32], snapshot: &Snapshot) -> Result<()> {
    atomic::write_with(&file(folder), |w| {
        w.write_all(identity)?;
        snapshot.write(w)
    })
}

/// Reads the state of the run with the given identity; `None` where there is none, or one of another run, or a damaged
/// one.
pub(super) fn read(folder: &Path, identity: &[u8; 32]) -> Result<Option<Snapshot>> {
    let path = file(folder);
    let mut reader = match File::open(&path) {
        Ok(file) => BufReader::new(file),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(TwinError::read(&path)(e)),
    };
    let mut found = [0; 32];
    if reader.read_exact(&mut found).is_err() || found != *identity {
        return Ok(None);
    }
    Ok(Snapshot::read(reader).ok())
}
