//! Where the bundle adjustment starts: each view alone tells the board's plane and the pages on it, for a focal length.
//! The focal length is the one with which the tags fit their pages best. Views are then laid onto each other by the
//! pages that they share.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::board::{Board, TagPlace};
use crate::error::{CalibrateError, Result};
use crate::homography::camera_from_tag;
use crate::lens::Lens;
use crate::rig::{Rig, SheetPlace, View};
use crate::tuning::{FOCAL_RANGE_WIDTHS, FOCAL_TRIALS};

/// What is known before.
pub(crate) struct Known<'a> {
    /// Names of the cameras.
    pub(crate) names: &'a [String],
    /// Width and height of their pictures [pixels].
    pub(crate) sizes: &'a [[usize; 2]],
    /// Their lenses, where they are known.
    pub(crate) lenses: Option<&'a [Lens]>,
    /// The board.
    pub(crate) board: Board,
    /// Side of a tag [m].
    pub(crate) side_m: f64,
    /// Number of moments.
    pub(crate) moments: usize,
    /// The moment whose board is the world's frame.
    pub(crate) reference: usize,
}

/// Lenses, places and pages to start from. Turns the corners of `views` where the board's tags are printed turned.
pub(crate) fn start(views: &mut [View], known: &Known) -> Result<Rig> {
    let lenses = match known.lenses {
        Some(lenses) => lenses.to_vec(),
        None => (0..known.sizes.len()).map(|camera| first_lens(views, camera, known)).collect(),
    };
    let quarters = turn_of_tags(views, &lenses, known);
    views.iter_mut().flat_map(|view| &mut view.tags).for_each(|tag| tag.corners.rotate_left(quarters));
    let planes: Vec<Option<PlaneView>> =
        views.iter().map(|view| plane_view(&lenses[view.camera], view, known)).collect();
    let (sheets, boards) = lay_together(&planes, known);
    let camera_from_board = |n: usize| Some(planes[n].as_ref()?.camera_from_plane * boards[n]?);
    let poses: Vec<Option<Isometry3<f64>>> = (0..views.len()).map(camera_from_board).collect();
    let (world_from_camera, world_from_board) = link(views, &poses, known)?;
    let tags = Rig::tags_of(&known.board, &sheets, known.side_m);
    Ok(Rig { lenses, world_from_camera, world_from_board, sheets, tags, side_m: known.side_m })
}

/// The lens of a camera, of several focal lengths the one that explains its views best.
fn first_lens(views: &[View], camera: usize, known: &Known) -> Lens {
    let [low, high] = FOCAL_RANGE_WIDTHS;
    let width = known.sizes[camera][0] as f64;
    let lens = |n: usize| {
        let share = n as f64 / (FOCAL_TRIALS - 1) as f64;
        Lens::simple(width * low * (high / low).powf(share), known.sizes[camera])
    };
    let own: Vec<&View> = views.iter().filter(|view| view.camera == camera).collect();
    let misfit = |lens: &Lens| {
        let planes: Vec<_> = own.iter().map(|view| plane_view(lens, view, known)).collect();
        let of_turn = |quarters: usize| -> f64 {
            planes.iter().map(|plane| plane.as_ref().map_or(1e3, |plane| plane.sheets(known, quarters).1)).sum()
        };
        (0..4).map(of_turn).fold(f64::INFINITY, f64::min)
    };
    let trials = (0..FOCAL_TRIALS).map(lens).map(|lens| (misfit(&lens), lens));
    trials.min_by(|a, b| a.0.total_cmp(&b.0)).map_or_else(|| lens(0), |(_, lens)| lens)
}

/// Other programs print tags turned by a quarter or a half: by how many quarters, by the fit of all views.
fn turn_of_tags(views: &[View], lenses: &[Lens], known: &Known) -> usize {
    let mut sums = [0.0; 4];
    for view in views {
        let Some(plane) = plane_view(&lenses[view.camera], view, known) else { continue };
        sums.iter_mut().enumerate().for_each(|(quarters, sum)| *sum += plane.sheets(known, quarters).1);
    }
    let best = (0..4).min_by(|&a, &b| f64::total_cmp(&sums[a], &sums[b])).unwrap_or_default();
    // Pages of one tag fit alike in any turn.
    if sums[best] < 0.5 * sums[0] { best } else { 0 }
}

/// The board's plane as a view alone tells it.
struct PlaneView {
    camera_from_plane: Isometry3<f64>,
    /// Tags and their corners on the plane [m].
    outlines: Vec<(u32, [[f64; 2]; 4])>,
}

impl PlaneView {
    /// The pages on the plane, and the sum of squared distances of corners from theirs [tags^2], where tags are printed
    /// turned by so many quarters.
    fn sheets(&self, known: &Known, quarters: usize) -> (Vec<SheetPlace>, f64) {
        let mut numbers: Vec<usize> = self.outlines.iter().filter_map(|(id, _)| known.board.sheet_of(*id)).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let (mut sheets, mut misfit) = (Vec::new(), 0.0);
        for number in numbers {
            let mut pairs = Vec::new();
            for tag in known.board.tags(number, known.side_m) {
                let Some((_, outline)) = self.outlines.iter().find(|(id, _)| *id == tag.id) else { continue };
                let corners = tag.corners(known.side_m);
                pairs.extend((0..4).map(|k| (corners[k], outline[(k + quarters) % 4])));
            }
            let (found, left) = fit_move(&pairs);
            sheets.push(SheetPlace { number, ..found });
            misfit += left / (known.side_m * known.side_m);
        }
        (sheets, misfit)
    }
}

/// The plane through the tags of a view: each tag tells its own place, all of them the plane, on which the corners'
/// rays then end.
fn plane_view(lens: &Lens, view: &View, known: &Known) -> Option<PlaneView> {
    let side_m = known.side_m;
    let mut points: Vec<Vector3<f64>> = Vec::new();
    for tag in &view.tags {
        let Some(pose) = camera_from_tag(lens, &tag.corners, side_m) else { continue };
        let corners = TagPlace { id: tag.id, centre: [0.0; 2], angle: 0.0 }.corners(side_m);
        points.extend(corners.map(|[x, y]| (pose * Point3::new(x, y, 0.0)).coords));
    }
    let (origin, normal) = plane_through(&points)?;
    let x = normal.cross(&Vector3::new(0.3, 1.0, 0.2)).normalize();
    let axes = Matrix3::from_columns(&[x, normal.cross(&x), normal]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    let flat = |pixel: [f64; 2]| {
        let ray = lens.direction(pixel);
        let depth = normal.dot(&origin) / normal.dot(&ray);
        let place = rotation.inverse() * (ray * depth - origin);
        (depth > 0.0).then_some([place.x, place.y])
    };
    let mut outlines = Vec::new();
    for tag in &view.tags {
        let [Some(a), Some(b), Some(c), Some(d)] = tag.corners.map(flat) else { continue };
        outlines.push((tag.id, [a, b, c, d]));
    }
    // The tags' size gives the distance: all lengths grow with it.
    let sides = outlines.iter().flat_map(|(_, o)| (0..4).map(|k| distance(o[k], o[(k + 1) % 4])));
    let scale = side_m * 4.0 * outlines.len() as f64 / sides.sum::<f64>();
    outlines.iter_mut().for_each(|(_, outline)| *outline = outline.map(|corner| corner.map(|c| c * scale)));
    let camera_from_plane = Isometry3::from_parts(Translation3::from(origin * scale), rotation);
    (scale.is_finite() && !outlines.is_empty()).then_some(PlaneView { camera_from_plane, outlines })
}

/// A point of the plane nearest to points, and its normal towards the camera.
fn plane_through(points: &[Vector3<f64>]) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let origin = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let scatter: Matrix3<f64> = points.iter().map(|p| (p - origin) * (p - origin).transpose()).sum();
    if points.is_empty() || !scatter.iter().all(|value| value.is_finite()) {
        return None;
    }
    let eigen = scatter.symmetric_eigen();
    let normal: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into();
    Some((origin, if normal.dot(&origin) < 0.0 { normal } else { -normal }))
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The place (of page 0) that brings the first of each pair nearest to the second, and the squared distances left.
fn fit_move(pairs: &[([f64; 2], [f64; 2])]) -> (SheetPlace, f64) {
    let count = pairs.len().max(1) as f64;
    let (mut from, mut to) = ([0.0; 2], [0.0; 2]);
    for (a, b) in pairs {
        (0..2).for_each(|axis| (from[axis], to[axis]) = (from[axis] + a[axis] / count, to[axis] + b[axis] / count));
    }
    let (mut along, mut across) = (0.0, 0.0);
    for (a, b) in pairs {
        let (a, b) = ([a[0] - from[0], a[1] - from[1]], [b[0] - to[0], b[1] - to[1]]);
        along += a[0] * b[0] + a[1] * b[1];
        across += a[0] * b[1] - a[1] * b[0];
    }
    let mut found = SheetPlace { number: 0, angle: across.atan2(along), shift: [0.0; 2] };
    let turned = found.apply(from);
    found.shift = [to[0] - turned[0], to[1] - turned[1]];
    let left = pairs.iter().map(|(a, b)| distance(found.apply(*a), *b).powi(2)).sum();
    (found, left)
}

impl SheetPlace {
    fn isometry(&self) -> Isometry3<f64> {
        let [x, y] = self.shift;
        Isometry3::new(Vector3::new(x, y, 0.0), Vector3::z() * self.angle)
    }

    /// The page's place in another frame of the plane.
    fn seen_from(&self, frame_from_plane: &Isometry3<f64>) -> SheetPlace {
        let centre = frame_from_plane * Point3::new(self.shift[0], self.shift[1], 0.0);
        let x = frame_from_plane.rotation * Vector3::x();
        SheetPlace { shift: [centre.x, centre.y], angle: self.angle + x.y.atan2(x.x), ..*self }
    }
}

/// Corners of the tags on pages that two lists share, in the frame of each.
fn shared(from: &[SheetPlace], to: &[SheetPlace], known: &Known) -> Vec<([f64; 2], [f64; 2])> {
    let mut pairs = Vec::new();
    for sheet in from {
        if let Some(other) = to.iter().find(|other| other.number == sheet.number) {
            let corners =
                known.board.tags(sheet.number, known.side_m).into_iter().flat_map(|t| t.corners(known.side_m));
            pairs.extend(corners.map(|corner| (sheet.apply(corner), other.apply(corner))));
        }
    }
    pairs
}

/// The pages on the board, and per view its plane from the board. The view with the most tags is the board; the others
/// are laid onto it in the order in which they share most with it.
fn lay_together(planes: &[Option<PlaneView>], known: &Known) -> (Vec<SheetPlace>, Vec<Option<Isometry3<f64>>>) {
    let views: Vec<Vec<SheetPlace>> =
        planes.iter().map(|plane| plane.as_ref().map_or(Vec::new(), |plane| plane.sheets(known, 0).0)).collect();
    let count = |n: usize| planes[n].as_ref().map_or(0, |plane| plane.outlines.len());
    let mut sheets = (0..planes.len()).max_by_key(|&n| count(n)).map_or(Vec::new(), |most| views[most].clone());
    let mut boards: Vec<Option<Isometry3<f64>>> = vec![None; planes.len()];
    loop {
        let common = |n: usize| shared(&sheets, &views[n], known).len();
        let open = (0..planes.len()).filter(|&n| boards[n].is_none() && common(n) > 0);
        let Some(next) = open.max_by_key(|&n| common(n)) else { break };
        let plane_from_board = fit_move(&shared(&sheets, &views[next], known)).0.isometry();
        boards[next] = Some(plane_from_board);
        let new = views[next].iter().filter(|sheet| sheets.iter().all(|other| other.number != sheet.number));
        let new: Vec<SheetPlace> = new.map(|sheet| sheet.seen_from(&plane_from_board.inverse())).collect();
        sheets.extend(new);
    }
    sheets.sort_by_key(|sheet| sheet.number);
    // The page with the lowest number is the board's frame.
    let view_from_board = sheets.first().map_or(Isometry3::identity(), SheetPlace::isometry);
    let board_from_view = view_from_board.inverse();
    sheets.iter_mut().for_each(|sheet| *sheet = sheet.seen_from(&board_from_view));
    boards.iter_mut().flatten().for_each(|board| *board *= view_from_board);
    (sheets, boards)
}

/// Where cameras or boards are in the world.
type Places = Vec<Isometry3<f64>>;

/// Places of cameras and boards in the world, from one view to the next that shares a camera or a moment with it.
fn link(views: &[View], camera_from_board: &[Option<Isometry3<f64>>], known: &Known) -> Result<(Places, Places)> {
    let mut cameras: Vec<Option<Isometry3<f64>>> = vec![None; known.names.len()];
    let mut boards: Vec<Option<Isometry3<f64>>> = vec![None; known.moments];
    boards[known.reference] = Some(Isometry3::identity());
    let mut order: Vec<usize> = (0..views.len()).filter(|&n| camera_from_board[n].is_some()).collect();
    order.sort_by_key(|&n| std::cmp::Reverse(views[n].tags.len()));
    let mut is_open = true;
    while is_open {
        is_open = false;
        for &n in &order {
            let (camera, moment) = (views[n].camera, views[n].moment);
            let Some(pose) = camera_from_board[n] else { continue };
            match (cameras[camera], boards[moment]) {
                (None, Some(board)) => cameras[camera] = Some(board * pose.inverse()),
                (Some(place), None) => boards[moment] = Some(place * pose),
                _ => continue,
            }
            is_open = true;
            break;
        }
    }
    let lost: Vec<&str> =
        cameras.iter().zip(known.names).filter(|(place, _)| place.is_none()).map(|(_, name)| name.as_str()).collect();
    if !lost.is_empty() {
        return Err(CalibrateError::pictures(
            format!("{} and the other cameras share no tag at any moment", lost.join(", ")),
            "show a tag to two cameras at once, from camera to camera through all of them; or leave these cameras out",
        ));
    }
    let cameras = cameras.into_iter().flatten().collect();
    // A moment that no view tells has no residuals either.
    Ok((cameras, boards.into_iter().map(Option::unwrap_or_default).collect()))
}
