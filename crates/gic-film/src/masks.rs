//! Masks of a scene: made, compared with each other by the visual hull, and written beside a contact sheet.
//!
//! A mask in `masks_corrected/` wins over the one that would be made. `masks/masks.json` lists what was written with
//! its hash, so that a mask by another hand is never written over.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use gic_files::FileError;
use gic_scene::{
    Format, Hull, HullSettings, HullView, Mask, MaskChoice, Picture, PixelBox, Scene, SceneSettings, View, sheet,
};
use gic_twin::events::Events;
use gic_twin::{Interrupt, atomic};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::error::{FilmError, Result};
use crate::sheet::labelled;
use crate::tuning::{GOOD_OVERLAP, HULL_RESOLUTION, SHEET_COLUMNS, TELLING_GAIN};

/// What masks to make.
#[derive(Clone, Debug)]
pub struct MasksRequest {
    /// The scene's folder.
    pub scene: PathBuf,
    /// Folder for the masks; by default where a nerfstudio scene has them.
    pub out: Option<PathBuf>,
    /// A network to make them with; by default they are made from the difference to the empty background.
    pub network: Option<PathBuf>,
    /// Where the object is.
    pub boxes: Vec<ObjectBox>,
}

/// Where the object is in the pictures of a camera, or of all.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ObjectBox {
    /// The camera's name; all cameras without one.
    pub camera: Option<String>,
    /// The rectangle.
    pub pixels: PixelBox,
}

/// What an [`ObjectBox`] must be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("must be like 120,80,400,420 or left:120,80,400,420: first column, first row, end column, end row")]
pub struct BoxError;

/// The masks that were made.
#[derive(Clone, Debug, Serialize)]
pub struct Masks {
    /// Where they are.
    #[serde(skip)]
    pub folder: PathBuf,
    /// Where masks by hand belong.
    #[serde(skip)]
    pub corrected: PathBuf,
    schema: &'static str,
    /// Each view.
    pub views: Vec<ViewReport>,
}

/// A view's mask.
#[derive(Clone, Debug, Serialize)]
pub struct ViewReport {
    /// The mask's file in its folder.
    pub file: String,
    /// The camera's name.
    pub camera: String,
    /// The frame.
    pub frame: usize,
    /// Where the mask comes from: `difference`, `network`, or `corrected` by hand.
    pub source: &'static str,
    /// Its area [pixels].
    pub area_px: f64,
    /// Overlap with the outline of the visual hull of all views of the frame; `None` where there is no hull.
    pub overlap: Option<f64>,
    /// Mean overlap of the other views when this one carves nothing; `None` with fewer than four views.
    pub overlap_of_others_without: Option<f64>,
    /// Whether it disagrees with the others.
    pub is_doubtful: bool,
    /// SHA-256 of the file.
    sha256: String,
}

#[derive(Deserialize)]
struct Listed {
    views: Vec<ListedView>,
}

#[derive(Deserialize)]
struct ListedView {
    file: String,
    sha256: String,
}

const STAGE: &str = "masks";
const LIST: &str = "masks.json";

impl FromStr for ObjectBox {
    type Err = BoxError;

    fn from_str(text: &str) -> std::result::Result<Self, BoxError> {
        let (camera, sides) = match text.rsplit_once(':') {
            Some((camera, sides)) => (Some(camera.to_owned()), sides),
            None => (None, text),
        };
        let sides: Vec<usize> = sides.split(',').map_while(|side| side.trim().parse().ok()).collect();
        match sides[..] {
            [x0, y0, x1, y1] if x0 < x1 && y0 < y1 && text.matches(',').count() == 3 => {
                Ok(Self { camera, pixels: PixelBox { x0, y0, x1, y1 } })
            }
            _ => Err(BoxError),
        }
    }
}

/// Makes and writes the masks of a scene.
///
/// # Errors
/// A scene that cannot be read or has no empty backgrounds, a folder with masks by another hand, an interruption.
pub fn make_masks(request: &MasksRequest, events: &Events, interrupt: &Interrupt) -> Result<Masks> {
    let masks = if request.network.is_some() { MaskChoice::Auto } else { MaskChoice::Difference };
    let settings = SceneSettings { masks, matting: request.network.clone(), ..SceneSettings::default() };
    let scene = Scene::open_with(&request.scene, &settings)?;
    let boxes = boxes_of(&scene, &request.boxes)?;
    let folder = match (&request.out, scene.format) {
        (Some(folder), _) => folder.clone(),
        (None, Format::Nerfstudio) => scene.root.join("masks"),
        (None, format) => {
            return Err(FilmError::usage(
                format!("a scene in the format {format} keeps its masks under names of its own"),
                "give a folder for the masks with -o",
            ));
        }
    };
    check_place(&folder, &scene)?;
    let maker = Maker { scene: &scene, boxes, with_network: request.network.is_some() };
    let mut made = Masks {
        folder: folder.clone(),
        corrected: scene.root.join("masks_corrected"),
        schema: "gic.masks/1",
        views: Vec::new(),
    };
    atomic::create_folder(&folder)?;
    let mut tiles: BTreeMap<(usize, usize), Picture> = BTreeMap::new();
    let shown = sheet::evenly_spaced(scene.times.len(), SHEET_COLUMNS);
    for frame in 0..scene.times.len() {
        interrupt.check("some pictures")?;
        let views = scene.views_at(frame);
        let taken: Vec<Taken> =
            views.par_iter().map(|view| maker.take(view, &made.corrected)).collect::<Result<_>>()?;
        let mut reports: Vec<ViewReport> =
            views.iter().zip(&taken).map(|(view, taken)| maker.write(view, taken, &folder)).collect::<Result<_>>()?;
        compare(&scene, views, &taken, &mut reports);
        if shown.contains(&frame) {
            for ((view, taken), report) in views.iter().zip(&taken).zip(&reports) {
                let number = format!("{frame}{}", if report.is_doubtful { "?" } else { "" });
                tiles.insert((view.camera, frame), labelled(&taken.picture, Some(&taken.mask), &number));
            }
        }
        made.views.extend(reports);
        events.step(STAGE, "", frame as u64 + 1, Some(scene.times.len() as u64), &[]);
    }
    atomic::write_json(&folder.join(LIST), &made)?;
    let row = |camera: usize| shown.iter().map(|frame| tiles.remove(&(camera, *frame))).collect();
    let rows: Vec<Vec<Option<Picture>>> = (0..scene.cameras.len()).map(row).collect();
    sheet::assemble(&rows).save_png(&folder.join("contact_sheet.png"))?;
    Ok(made)
}

/// The box of each camera.
fn boxes_of(scene: &Scene, boxes: &[ObjectBox]) -> Result<Vec<Option<PixelBox>>> {
    for named in boxes.iter().filter_map(|object| object.camera.as_ref()) {
        if !scene.camera_names.contains(named) {
            return Err(FilmError::usage(
                format!("--box names camera {named}, which is none of {}", scene.camera_names.join(", ")),
                "give the name of a camera, or leave it out for all",
            ));
        }
    }
    let cameras = scene.camera_names.iter().zip(&scene.cameras);
    cameras
        .map(|(name, camera)| {
            let own = boxes.iter().rev().find(|object| object.camera.as_ref() == Some(name));
            let Some(found) = own.or_else(|| boxes.iter().rev().find(|object| object.camera.is_none())) else {
                return Ok(None);
            };
            let PixelBox { x0, y0, x1, y1 } = found.pixels;
            if x0 >= camera.width || y0 >= camera.height {
                return Err(FilmError::usage(
                    format!(
                        "--box begins at {x0},{y0}, outside the {}x{} pixels of {name}",
                        camera.width, camera.height
                    ),
                    "give columns and rows of the picture",
                ));
            }
            Ok(Some(PixelBox { x0, y0, x1: x1.min(camera.width), y1: y1.min(camera.height) }))
        })
        .collect()
}

/// The file of a view's mask, in the folder of masks.
fn file_of(view: &View) -> String {
    let stem = view.picture.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    format!("{stem}.png")
}

/// Refuses a folder in which a mask would be lost that this program did not write.
fn check_place(folder: &Path, scene: &Scene) -> Result<()> {
    let list = folder.join(LIST);
    let listed: Vec<ListedView> = if list.is_file() { atomic::read_json::<Listed>(&list)?.views } else { Vec::new() };
    for file in scene.views.iter().map(file_of) {
        let path = folder.join(&file);
        let is_own =
            || listed.iter().any(|view| view.file == file && hash(&path).is_ok_and(|hash| hash == view.sha256));
        if path.is_file() && !is_own() {
            return Err(FilmError::content(
                &path,
                "is a mask that gic did not write",
                "move masks by hand into masks_corrected/, where they win, or choose another folder with -o",
            ));
        }
    }
    Ok(())
}

fn hash(path: &Path) -> Result<String> {
    let bytes = fs::read(path).map_err(FileError::read(path))?;
    Ok(format!("{:x}", Sha256::digest(bytes)))
}

/// A view with its mask, as filmed.
struct Taken {
    picture: Picture,
    mask: Mask,
    source: &'static str,
}

struct Maker<'a> {
    scene: &'a Scene,
    boxes: Vec<Option<PixelBox>>,
    with_network: bool,
}

impl Maker<'_> {
    fn take(&self, view: &View, corrected: &Path) -> Result<Taken> {
        let by_hand = corrected.join(file_of(view));
        if by_hand.is_file() {
            let (picture, mask) = (Picture::read(&view.picture)?, Mask::read(&by_hand)?);
            if (mask.width, mask.height) != (picture.width, picture.height) {
                return Err(FilmError::content(
                    &by_hand,
                    format!(
                        "is {}x{} pixels, its picture {}x{}",
                        mask.width, mask.height, picture.width, picture.height
                    ),
                    "correct the mask at the picture's size",
                ));
            }
            return Ok(Taken { picture, mask, source: "corrected" });
        }
        let own = self.boxes[view.camera];
        let window = match own {
            // A network looks closer where it sees the object alone.
            None if self.with_network => self.scene.box_of_difference(view, &Picture::read(&view.picture)?)?,
            own => own,
        };
        let (picture, mask) = self.scene.load_as_filmed(view, window)?;
        Ok(Taken { picture, mask, source: if self.with_network { "network" } else { "difference" } })
    }

    fn write(&self, view: &View, taken: &Taken, folder: &Path) -> Result<ViewReport> {
        let file = file_of(view);
        let path = folder.join(&file);
        taken.mask.save_png(&path)?;
        Ok(ViewReport {
            sha256: hash(&path)?,
            file,
            camera: self.scene.camera_names[view.camera].clone(),
            frame: view.frame,
            source: taken.source,
            area_px: taken.mask.area(),
            overlap: None,
            overlap_of_others_without: None,
            is_doubtful: taken.mask.bounding_box().is_none(),
        })
    }
}

/// Compares the masks of a frame by the visual hull: one that is too large sticks out of it, one that is too small cuts
/// the others' parts off, so that without it they agree better.
fn compare(scene: &Scene, views: &[View], taken: &[Taken], reports: &mut [ViewReport]) {
    let full: Vec<usize> = (0..views.len()).filter(|&i| !reports[i].is_doubtful).collect();
    let masks: Vec<Mask> = full
        .par_iter()
        .map(|&i| scene.undistorted(&views[i], taken[i].picture.clone(), taken[i].mask.clone()).1)
        .collect();
    let all: Vec<HullView> =
        full.iter().zip(&masks).map(|(&i, mask)| HullView { camera: scene.camera_of(&views[i]), mask }).collect();
    if all.len() < 2 {
        return;
    }
    let overlaps = overlaps(&all);
    let others = |i: usize| all.iter().enumerate().filter(move |(j, _)| *j != i).map(|(_, view)| *view).collect();
    let without: Vec<Option<f64>> = (0..all.len())
        .into_par_iter()
        .map(|i| {
            let others: Vec<HullView> = others(i);
            (others.len() >= 3).then(|| mean(&self::overlaps(&others)))
        })
        .collect();
    let gain = |i: usize| {
        let with: Vec<f64> =
            overlaps.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, overlap)| *overlap).collect();
        without[i].map_or(0.0, |without| without - mean(&with))
    };
    let worst = (0..all.len()).max_by(|&a, &b| gain(a).total_cmp(&gain(b))).filter(|&i| gain(i) > TELLING_GAIN);
    // What the worst one cuts off is not the others' fault.
    let mut judged = overlaps.clone();
    if let Some(worst) = worst {
        let again = self::overlaps(&others(worst));
        (0..all.len()).filter(|i| *i != worst).zip(again).for_each(|(i, overlap)| judged[i] = overlap);
    }
    for (place, &i) in full.iter().enumerate() {
        reports[i].overlap = Some(overlaps[place]);
        reports[i].overlap_of_others_without = without[place];
        reports[i].is_doubtful = worst == Some(place) || judged[place] < GOOD_OVERLAP;
    }
}

/// Overlap of each view's mask with the outline of the hull of all; 0 without a hull.
fn overlaps(views: &[HullView]) -> Vec<f64> {
    let settings = HullSettings { resolution: HULL_RESOLUTION, tolerated_misses: 0 };
    match Hull::carve(views, &settings) {
        Some(hull) => views.iter().map(|view| hull.reprojection_iou(view)).collect(),
        None => vec![0.0; views.len()],
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_read_with_and_without_a_camera() {
        let pixels = PixelBox { x0: 1, y0: 2, x1: 30, y1: 40 };
        assert_eq!("1,2,30,40".parse(), Ok(ObjectBox { camera: None, pixels }));
        assert_eq!("a:b:1,2,30,40".parse(), Ok(ObjectBox { camera: Some("a:b".into()), pixels }));
        for wrong in ["1,2,3", "1,2,1,4", "1,2,3,4,5", "a:1,2,3,x", ""] {
            assert_eq!(wrong.parse::<ObjectBox>(), Err(BoxError), "{wrong}");
        }
    }
}
