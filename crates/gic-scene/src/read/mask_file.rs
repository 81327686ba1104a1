//! Mask files in a folder of their own.

use std::path::{Path, PathBuf};

/// The mask of picture `name` (relative to the picture folder) in `folder`: `name.png`, or `name` with .png added.
pub(super) fn find_mask(folder: &Path, name: &Path) -> Option<PathBuf> {
    let replaced = folder.join(name.with_extension("png"));
    let mut added = folder.join(name).into_os_string();
    added.push(".png");
    [replaced, PathBuf::from(added), folder.join(name)].into_iter().find(|path| path.is_file())
}
