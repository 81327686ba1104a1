//! How a file names another one: by the way from its own folder, so that both can be moved together.

use std::path::{Component, Path, PathBuf};

/// The way from `folder` to `target`, with `/` between names on every system; where there is none, as between two
/// drives, the whole path of `target`.
///
/// Links are followed as far as the files exist, so that the way holds for them and not for their names.
pub fn relative_path(folder: &Path, target: &Path) -> PathBuf {
    let (folder, target) = (resolved(folder), resolved(target));
    let shared = folder.components().zip(target.components()).take_while(|(a, b)| a == b).count();
    if shared == 0 {
        return target;
    }
    let up = folder.components().skip(shared).map(|_| "..".to_owned());
    let down = target.components().skip(shared).map(|part| part.as_os_str().to_string_lossy().into_owned());
    up.chain(down).collect::<Vec<_>>().join("/").into()
}

/// The whole path, with links followed where the file or at least its folder exists.
pub fn resolved(path: &Path) -> PathBuf {
    if let Ok(whole) = path.canonicalize() {
        return whole;
    }
    let whole = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    match (whole.parent(), whole.components().next_back()) {
        (Some(parent), Some(Component::Normal(name))) => resolved(parent).join(name),
        _ => whole,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_leads_from_the_folder_to_the_file() {
        let root = tempfile::tempdir().unwrap();
        let (run, other) = (root.path().join("run"), root.path().join("other/deep"));
        std::fs::create_dir_all(run.join("prediction")).unwrap();
        std::fs::create_dir_all(&other).unwrap();
        std::fs::write(run.join("twin.ply"), b"x").unwrap();
        let way = relative_path(&run.join("prediction"), &run.join("twin.ply"));
        assert_eq!(way, Path::new("../twin.ply"));
        assert_eq!(relative_path(&other, &run.join("twin.ply")), Path::new("../../run/twin.ply"));
        assert_eq!(relative_path(&run, &run.join("not/there.ply")), Path::new("not/there.ply"));
    }
}
