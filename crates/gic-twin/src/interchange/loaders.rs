//! Short programs beside a particle set that load it in other simulators.

use std::path::Path;

use crate::atomic;
use crate::error::Result;

/// The program, for a particle set named NAME.npz.
const GENESIS: &str = include_str!("genesis.py");

/// Writes the loader for Genesis beside the arrays at `path`.
pub(super) fn write_genesis(path: &Path) -> Result<()> {
    let arrays = path.file_name().unwrap_or_default().to_string_lossy();
    let loader = path.with_extension("genesis.py");
    atomic::write(&loader, GENESIS.replace("NAME.npz", &arrays).as_bytes())
}
