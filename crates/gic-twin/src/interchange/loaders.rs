//! Short programs beside a particle set that load it in other simulators.

use std::path::{Path, PathBuf};

use super::ExportBody;
use crate::atomic;
use crate::error::Result;

/// Writes the loader.
pub(super) fn write_genesis(path: &Path, _body: &ExportBody) -> Result<PathBuf> {
    let loader = path.with_extension("genesis.py");
    atomic::write(&loader, b"")?;
    Ok(loader)
}
