//! Pixels: pictures and masks of a scene, decoded, matted and undistorted.

use std::path::Path;

use rayon::prelude::*;

use crate::error::{MASK_HINT, Problem, SceneError};
use crate::matting;
use crate::picture::{self, Decoded, Mask, Picture, PixelBox};
use crate::scene::Scene;
use crate::view::{MaskSource, View};

impl Scene {
    /// Picture and mask of `camera` at `frame`.
    ///
    /// # Errors
    /// [`SceneError::NoSuchView`]; otherwise as [`Scene::load`].
    pub fn load_view(&self, camera: usize, frame: usize) -> Result<(Picture, Mask), SceneError> {
        self.load(self.view(camera, frame).ok_or(SceneError::NoSuchView { camera, frame })?)
    }

    /// Picture and mask of a view, undistorted, both of the camera's size.
    ///
    /// # Errors
    /// [`SceneError::Invalid`] naming a file that cannot be decoded, or whose size is wrong.
    pub fn load(&self, view: &View) -> Result<(Picture, Mask), SceneError> {
        let (picture, mask) = self.load_as_filmed(view, None)?;
        Ok(self.undistorted(view, picture, mask))
    }

    /// Picture and mask of a view as its file has them, with the lens's distortion. A mask that is made, and not read,
    /// lies within `window`.
    ///
    /// # Errors
    /// As [`Scene::load`].
    pub fn load_as_filmed(&self, view: &View, window: Option<PixelBox>) -> Result<(Picture, Mask), SceneError> {
        let Decoded { picture, alpha } = picture::decode(&view.picture)?;
        let mask = match &view.mask {
            MaskSource::Alpha => {
                let coverage = alpha.ok_or_else(|| without_mask(&view.picture))?;
                Mask { width: picture.width, height: picture.height, coverage }
            }
            MaskSource::File(path) => picture::decode_mask(path)?,
            MaskSource::OverWhite(path) => matting::from_white(&picture, &picture::decode(path)?.picture),
            MaskSource::Difference => {
                let background = self.backgrounds[view.camera].as_ref().ok_or_else(|| without_mask(&view.picture))?;
                matting::difference_matte_within(&picture, &picture::decode(background)?.picture, window)
            }
            MaskSource::Network => {
                let network = self.network.as_ref().ok_or_else(|| without_mask(&view.picture))?;
                match window {
                    Some(window) => network.matte(&picture.cut_out(window))?.put_into(window, &picture),
                    None => network.matte(&picture)?,
                }
            }
        };
        let expected = (picture.width, picture.height);
        if (mask.width, mask.height) != expected {
            return Err(Problem::WrongSize {
                path: view.mask_path().to_owned(),
                found: (mask.width, mask.height),
                expected,
                reference: view.picture.clone(),
            }
            .into());
        }
        self.check_size(view.camera, &picture, &view.picture)?;
        Ok((picture, mask))
    }

    /// The cameras' lenses in words that differ where lenses do; `None` where no camera has one.
    pub fn lenses(&self) -> Option<String> {
        self.lenses.iter().any(Option::is_some).then(|| format!("{:?}", self.lenses))
    }

    /// A view's picture and mask, of its camera's size, without the lens's distortion.
    pub fn undistorted(&self, view: &View, picture: Picture, mask: Mask) -> (Picture, Mask) {
        match &self.lenses[view.camera] {
            Some(lens) => lens.undistort(&self.cameras[view.camera], &picture, &mask),
            None => (picture, mask),
        }
    }

    /// The box around what differs from a view's empty background, grown by a quarter of its sides: where a network has
    /// to look. `None` without a background, and where nothing differs.
    ///
    /// # Errors
    /// As [`Scene::load`].
    pub fn box_of_difference(&self, view: &View, picture: &Picture) -> Result<Option<PixelBox>, SceneError> {
        let Some(background) = &self.backgrounds[view.camera] else { return Ok(None) };
        let mask = matting::difference_matte(picture, &picture::decode(background)?.picture);
        Ok(mask.bounding_box().map(|found| {
            let (grow_x, grow_y) = ((found.x1 - found.x0).div_ceil(4), (found.y1 - found.y0).div_ceil(4));
            PixelBox {
                x0: found.x0.saturating_sub(grow_x),
                y0: found.y0.saturating_sub(grow_y),
                x1: (found.x1 + grow_x).min(picture.width),
                y1: (found.y1 + grow_y).min(picture.height),
            }
        }))
    }

    /// The mask of a view; cheaper than [`Scene::load`] where the mask is a file of its own.
    ///
    /// # Errors
    /// As [`Scene::load`].
    pub fn load_mask(&self, view: &View) -> Result<Mask, SceneError> {
        match (&view.mask, &self.lenses[view.camera]) {
            (MaskSource::File(path), None) => {
                let mask = picture::decode_mask(path)?;
                let camera = &self.cameras[view.camera];
                let expected = (camera.width, camera.height);
                if (mask.width, mask.height) != expected {
                    let found = (mask.width, mask.height);
                    let reference = view.picture.clone();
                    return Err(Problem::WrongSize { path: path.clone(), found, expected, reference }.into());
                }
                Ok(mask)
            }
            _ => Ok(self.load(view)?.1),
        }
    }

    /// The masks of several views, loaded in parallel, in their order.
    ///
    /// # Errors
    /// As [`Scene::load`]; problems of all views are listed together.
    pub fn load_masks(&self, views: &[View]) -> Result<Vec<Mask>, SceneError> {
        gather(views.par_iter().map(|view| self.load_mask(view)).collect())
    }

    /// Pictures and masks of several views, loaded in parallel, in their order.
    ///
    /// # Errors
    /// As [`Scene::load`]; problems of all views are listed together.
    pub fn load_all(&self, views: &[View]) -> Result<Vec<(Picture, Mask)>, SceneError> {
        gather(views.par_iter().map(|view| self.load(view)).collect())
    }

    /// The picture of the empty background of `camera`, undistorted, if the scene has one.
    ///
    /// # Errors
    /// As [`Scene::load`].
    pub fn load_background(&self, camera: usize) -> Result<Option<Picture>, SceneError> {
        let Some(path) = &self.backgrounds[camera] else { return Ok(None) };
        let picture = picture::decode(path)?.picture;
        self.check_size(camera, &picture, path)?;
        let Some(lens) = &self.lenses[camera] else { return Ok(Some(picture)) };
        let everywhere =
            Mask { width: picture.width, height: picture.height, coverage: vec![1.0; picture.width * picture.height] };
        Ok(Some(lens.undistort(&self.cameras[camera], &picture, &everywhere).0))
    }

    /// Decodes every picture and mask and lists what is wrong: files that cannot be decoded, empty masks. Opening has
    /// already checked everything that does not need pixels.
    pub fn check_pixels(&self) -> Vec<Problem> {
        let areas: Vec<Result<f64, SceneError>> =
            self.views.par_iter().map(|view| self.load(view).map(|(_, mask)| mask.area())).collect();
        self.mask_area_problems(&areas)
    }

    /// Problems found in the masks' areas [pixels], one entry for each view.
    pub(crate) fn mask_area_problems(&self, areas: &[Result<f64, SceneError>]) -> Vec<Problem> {
        let mut problems = Vec::new();
        let mut filled = vec![false; self.times.len()];
        for (view, area) in self.views.iter().zip(areas) {
            match area {
                Err(SceneError::Invalid(found)) => {
                    problems.extend(found.iter().cloned());
                    filled[view.frame] = true;
                }
                Err(other) => {
                    problems.push(Problem::Unreadable { path: view.picture.clone(), reason: other.to_string() });
                    filled[view.frame] = true;
                }
                Ok(area) if *area > 0.0 => filled[view.frame] = true,
                Ok(_) => {
                    problems.push(Problem::EmptyMask { path: view.mask_path().to_owned() });
                }
            }
        }
        let empty = (0..self.times.len()).filter(|&frame| !filled[frame]);
        problems.extend(empty.map(|frame| Problem::EmptyFrame {
            path: self.root.clone(),
            frame,
            time: self.times[frame],
        }));
        problems
    }

    fn check_size(&self, camera: usize, picture: &Picture, path: &Path) -> Result<(), SceneError> {
        let camera = &self.cameras[camera];
        if (picture.width, picture.height) == (camera.width, camera.height) {
            return Ok(());
        }
        Err(Problem::WrongSize {
            path: path.to_owned(),
            found: (picture.width, picture.height),
            expected: (camera.width, camera.height),
            reference: self.root.clone(),
        }
        .into())
    }
}

fn without_mask(picture: &Path) -> Problem {
    Problem::MissingMask { picture: picture.to_owned(), hint: MASK_HINT.to_owned() }
}

/// All values, or all problems together; an error that is no list of problems wins.
fn gather<T>(results: Vec<Result<T, SceneError>>) -> Result<Vec<T>, SceneError> {
    let mut values = Vec::with_capacity(results.len());
    let mut problems = Vec::new();
    for result in results {
        match result {
            Ok(value) => values.push(value),
            Err(SceneError::Invalid(found)) => problems.extend(found),
            Err(other) => return Err(other),
        }
    }
    if problems.is_empty() { Ok(values) } else { Err(SceneError::Invalid(problems)) }
}
