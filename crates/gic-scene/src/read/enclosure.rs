//! A scene names files inside its own folder only: what somebody else wrote does not choose what is read elsewhere.

use std::path::{Component, Path};

use super::draft::Draft;
use crate::error::Problem;
use crate::view::MaskSource;

/// The files of a draft that lie outside the scene's folder by their names. Links in the folder may lead where they
/// like: its owner made them.
pub(super) fn problems(draft: &Draft, root: &Path) -> Vec<Problem> {
    let masks = draft.views.iter().filter_map(|view| match &view.mask {
        Some(MaskSource::File(path) | MaskSource::OverWhite(path)) => Some(path),
        _ => None,
    });
    let pictures = draft.views.iter().map(|view| &view.picture);
    let backgrounds = draft.cameras.iter().filter_map(|camera| camera.background.as_ref());
    let outside = pictures.chain(masks).chain(backgrounds).filter(|path| !is_inside(path, root));
    outside.map(|path| Problem::OutsideScene { path: path.clone(), list: draft.list.clone() }).collect()
}

fn is_inside(path: &Path, root: &Path) -> bool {
    let Ok(inner) = path.strip_prefix(root) else { return false };
    let mut depth = 0_i64;
    inner.components().all(|part| {
        depth += match part {
            Component::Normal(_) => 1,
            Component::ParentDir => -1,
            _ => 0,
        };
        depth >= 0
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_lead_out_are_found() {
        let root = Path::new("/scene");
        for (path, inside) in [
            ("/scene/a.png", true),
            ("/scene/a/../b.png", true),
            ("/scene/../b.png", false),
            ("/scene/a/../../scene/b.png", false),
            ("/etc/passwd", false),
        ] {
            assert_eq!(is_inside(Path::new(path), root), inside, "{path}");
        }
    }
}
