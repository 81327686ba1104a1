//! What is sought: lenses, places of cameras, places of the board, places of tags on it.

use nalgebra::{Isometry3, Point3};

use crate::board::{Board, TagPlace};
use crate::detect::Sighting;
use crate::lens::Lens;

/// The tags that a camera sees at a moment.
#[derive(Clone, Debug)]
pub(crate) struct View {
    /// Number of the camera.
    pub(crate) camera: usize,
    /// Number of the moment.
    pub(crate) moment: usize,
    /// The tags.
    pub(crate) tags: Vec<Sighting>,
}

/// Where a page of the board lies in the board's frame: the place of its middle [m] and its turn [rad].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SheetPlace {
    /// Its number.
    pub(crate) number: usize,
    /// x and y [m].
    pub(crate) shift: [f64; 2],
    /// Turn against the clock [rad].
    pub(crate) angle: f64,
}

impl SheetPlace {
    /// A place of the page in the board's frame.
    pub(crate) fn apply(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.angle.sin_cos();
        [cos * x - sin * y + self.shift[0], sin * x + cos * y + self.shift[1]]
    }
}

/// Cameras, boards and pages.
#[derive(Clone, Debug)]
pub(crate) struct Rig {
    /// Per camera.
    pub(crate) lenses: Vec<Lens>,
    /// Per camera; its rotation is that of OpenCV's axes.
    pub(crate) world_from_camera: Vec<Isometry3<f64>>,
    /// Per moment; the world is the board's frame at one of them.
    pub(crate) world_from_board: Vec<Isometry3<f64>>,
    /// The pages that are seen, by number; the first is the board's frame.
    pub(crate) sheets: Vec<SheetPlace>,
    /// All tags of these pages with their page's place in the list, by number.
    pub(crate) tags: Vec<(usize, TagPlace)>,
    /// Side of a tag [m].
    pub(crate) side_m: f64,
}

impl Rig {
    /// All tags of pages.
    pub(crate) fn tags_of(board: &Board, sheets: &[SheetPlace], side_m: f64) -> Vec<(usize, TagPlace)> {
        let of_sheet =
            |(n, sheet): (usize, &SheetPlace)| board.tags(sheet.number, side_m).into_iter().map(move |t| (n, t));
        let mut tags: Vec<_> = sheets.iter().enumerate().flat_map(of_sheet).collect();
        tags.sort_by_key(|(_, tag)| tag.id);
        tags
    }

    /// Where a tag lies in the list.
    pub(crate) fn tag(&self, id: u32) -> Option<usize> {
        self.tags.binary_search_by_key(&id, |(_, tag)| tag.id).ok()
    }

    /// The corners of a tag in the board's frame [m].
    pub(crate) fn corners(&self, tag: usize) -> [Point3<f64>; 4] {
        let (sheet, place) = &self.tags[tag];
        place.corners(self.side_m).map(|corner| {
            let [x, y] = self.sheets[*sheet].apply(corner);
            Point3::new(x, y, 0.0)
        })
    }

    /// Where a camera sees a tag at a moment [pixels]; `None` behind the camera or from behind the board.
    pub(crate) fn predict(&self, camera: usize, moment: usize, tag: usize) -> Option<[[f64; 2]; 4]> {
        let camera_from_board = self.world_from_camera[camera].inverse() * self.world_from_board[moment];
        let normal = camera_from_board.rotation * nalgebra::Vector3::z();
        let corners = self.corners(tag).map(|corner| camera_from_board * corner);
        let is_seen_from_front = normal.dot(&corners[0].coords) < 0.0;
        if !is_seen_from_front {
            return None;
        }
        let mut pixels = [[0.0; 2]; 4];
        for (pixel, corner) in pixels.iter_mut().zip(&corners) {
            *pixel = self.lenses[camera].project(&corner.coords)?.into();
        }
        Some(pixels)
    }
}
