//! Cameras that stand still in formats that give every picture a camera of its own.

use super::draft::{Draft, DraftCamera, Intrinsics};

/// Makes one camera of those whose pictures repeat a pose and its intrinsics at different times. Where any picture has
/// a pose of its own the camera moves, and all stay.
pub(super) fn merge_repeated(draft: &mut Draft) {
    let mut standing: Vec<Vec<usize>> = Vec::new();
    for (index, camera) in draft.cameras.iter().enumerate() {
        match standing.iter_mut().find(|same| is_same(&draft.cameras[same[0]], camera)) {
            Some(same) => same.push(index),
            None => standing.push(vec![index]),
        }
    }
    let repeats = |same: &Vec<usize>| {
        let mut times: Vec<f64> =
            draft.views.iter().filter(|view| same.contains(&view.camera)).map(|view| view.time).collect();
        times.sort_by(f64::total_cmp);
        times.len() > 1 && times.windows(2).all(|pair| pair[0] < pair[1])
    };
    if standing.len() == draft.cameras.len() || !standing.iter().all(repeats) {
        return;
    }
    for view in &mut draft.views {
        view.camera = standing.iter().position(|same| same.contains(&view.camera)).unwrap_or_default();
    }
    let mut cameras: Vec<Option<DraftCamera>> = std::mem::take(&mut draft.cameras).into_iter().map(Some).collect();
    for (number, same) in standing.iter().enumerate() {
        let names: Vec<String> =
            same.iter().filter_map(|i| cameras[*i].as_ref().map(|camera| camera.name.clone())).collect();
        let name = common_name(&names).unwrap_or_else(|| number.to_string());
        draft.cameras.extend(cameras[same[0]].take().map(|camera| DraftCamera { name, ..camera }));
    }
}

fn is_same(a: &DraftCamera, b: &DraftCamera) -> bool {
    let intrinsics = |camera: &DraftCamera| match camera.intrinsics {
        Intrinsics::Pixels { focal, principal, size } => (Some((focal, principal, size)), None),
        Intrinsics::HorizontalAngle(angle) => (None, Some(angle)),
    };
    (a.world_from_camera, a.centre, &a.lens, &a.background) == (b.world_from_camera, b.centre, &b.lens, &b.background)
        && intrinsics(a) == intrinsics(b)
}

/// What the names of a camera's pictures begin with, without separators at its end; the name itself where all share it.
fn common_name(names: &[String]) -> Option<String> {
    let first = names.first()?;
    let shared = |name: &String| first.char_indices().zip(name.chars()).take_while(|((_, a), b)| a == b).count();
    let count = names.iter().map(shared).min()?;
    let prefix: String = first.chars().take(count).collect();
    if names.iter().all(|name| *name == prefix) {
        return Some(prefix);
    }
    // Digits that all pictures' numbers begin with are no part of it, unless a separator ends them.
    let name = prefix.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end_matches(['_', '-', '/', '.']);
    let name = name.rsplit('/').next().unwrap_or(name);
    (!name.is_empty()).then(|| name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_is_called_what_its_pictures_share() {
        let name = |names: &[&str]| common_name(&names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>());
        assert_eq!(name(&["images/c0_00.png", "images/c0_01.png"]).as_deref(), Some("c0"));
        assert_eq!(name(&["left/0000.png", "left/0010.png"]).as_deref(), Some("left"));
        assert_eq!(name(&["0001.png", "0002.png"]), None);
        assert_eq!(name(&["door", "door"]).as_deref(), Some("door"));
    }
}
