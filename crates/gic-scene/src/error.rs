//! What can be wrong with a scene: problems with the data, collected and listed together, and errors that stop at once.

use std::fmt;
use std::path::PathBuf;

use gic_files::FileError;
use thiserror::Error;

/// What to do about a missing mask.
pub(crate) const MASK_HINT: &str = "add a mask file or an alpha channel, a picture of the empty background of this \
                                    camera, or give a matting network (--matting model.onnx)";

/// One thing wrong with the data of a scene. The text names the file and says what to do.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Problem {
    /// A picture that the scene lists does not exist.
    #[error("{}: the picture is missing; restore it, or remove its entry from {}", path.display(), list.display())]
    MissingPicture {
        /// The picture.
        path: PathBuf,
        /// The file that lists it.
        list: PathBuf,
    },
    /// A picture has no mask.
    #[error("{}: no mask for this picture; {hint}", picture.display())]
    MissingMask {
        /// The picture.
        picture: PathBuf,
        /// What to add.
        hint: String,
    },
    /// A picture or mask file cannot be decoded.
    #[error("{}: cannot read this picture ({reason}); export it again as PNG or JPEG", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the decoder says.
        reason: String,
    },
    /// A picture or mask of another size than its camera's pictures.
    #[error(
        "{}: {}x{} pixels, but {} of this camera expects {}x{}; all pictures and masks of a camera need one size",
        path.display(), found.0, found.1, reference.display(), expected.0, expected.1
    )]
    WrongSize {
        /// The file.
        path: PathBuf,
        /// Its (width, height) [pixels].
        found: (usize, usize),
        /// The (width, height) [pixels] of the camera's pictures.
        expected: (usize, usize),
        /// Where the expected size comes from.
        reference: PathBuf,
    },
    /// A camera or picture without a usable pose or intrinsics.
    #[error("{}: {camera} has no usable pose: {reason}", path.display())]
    NoPose {
        /// The file that should hold the pose.
        path: PathBuf,
        /// The camera or picture.
        camera: String,
        /// What is missing or wrong.
        reason: String,
    },
    /// A lens or camera model that is not supported.
    #[error(
        "{}: {camera} uses the camera model {model}, which is not supported; undistort the pictures first",
        path.display()
    )]
    UnsupportedCamera {
        /// The file that names the model.
        path: PathBuf,
        /// The camera.
        camera: String,
        /// The model.
        model: String,
    },
    /// An entry of a list that cannot be understood.
    #[error("{}: {entry}: {reason}", path.display())]
    BadEntry {
        /// The file.
        path: PathBuf,
        /// Which entry.
        entry: String,
        /// What is wrong.
        reason: String,
    },
    /// A number outside the range in which it can be worked with.
    #[error("{}: {entry}: {field} is {value}, and must lie from {low} to {high}; correct it", path.display())]
    OutOfRange {
        /// The file.
        path: PathBuf,
        /// The camera, picture or point.
        entry: String,
        /// Which number of it, with its unit.
        field: &'static str,
        /// The number.
        value: f64,
        /// The least that it may be.
        low: f64,
        /// The most that it may be.
        high: f64,
    },
    /// A file outside the scene's folder.
    #[error(
        "{}: lies outside the scene; copy it into the scene's folder and correct its name in {}",
        path.display(), list.display()
    )]
    OutsideScene {
        /// The file.
        path: PathBuf,
        /// The file that names it.
        list: PathBuf,
    },
    /// Two pictures claim the same camera and frame.
    #[error("{}: {} shows the same camera and frame; remove one", path.display(), other.display())]
    Duplicate {
        /// The second picture.
        path: PathBuf,
        /// The first picture.
        other: PathBuf,
    },
    /// A fixed single camera: no geometry can be recovered.
    #[error(
        "{}: only one camera position; at least two (better four or more) are needed to recover shape",
        path.display()
    )]
    OneCamera {
        /// The file that lists the cameras.
        path: PathBuf,
    },
    /// Times that do not increase with the frame number.
    #[error(
        "{}: {picture} has time {time} s, not after {previous} s of the frame before it; correct the times",
        path.display()
    )]
    TimesNotIncreasing {
        /// The file that lists the times.
        path: PathBuf,
        /// The picture or frame with the wrong time.
        picture: String,
        /// Its time [s].
        time: f64,
        /// The time [s] of the frame before.
        previous: f64,
    },
    /// A mask without a single covered pixel.
    #[error("{}: the mask is empty; if the object is in the picture, correct the mask", path.display())]
    EmptyMask {
        /// The mask, or the picture it is made from.
        path: PathBuf,
    },
    /// A frame in which every camera's mask is empty.
    #[error(
        "{}: the masks of all cameras are empty at frame {frame} ({time} s); remove the frame or correct the masks",
        path.display()
    )]
    EmptyFrame {
        /// The root of the scene.
        path: PathBuf,
        /// The frame.
        frame: usize,
        /// Its time [s].
        time: f64,
    },
    /// A camera of a synchronised set lacks a frame that others have.
    #[error(
        "{}: camera {camera} has no picture of frame {frame}; the frame is used without this camera",
        path.display()
    )]
    MissingFrame {
        /// The file that lists the pictures.
        path: PathBuf,
        /// The camera's name.
        camera: String,
        /// The frame.
        frame: usize,
    },
    /// A camera of a scene without a single picture.
    #[error("{}: camera {camera} has no pictures; list them, or remove the camera from the scene", path.display())]
    IdleCamera {
        /// The file that lists the pictures.
        path: PathBuf,
        /// The camera's name.
        camera: String,
    },
    /// No picture is left to work with.
    #[error("{}: lists no pictures", path.display())]
    NoPictures {
        /// The file or folder.
        path: PathBuf,
    },
}

/// How bad a [`Problem`] is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// The scene can be used; the result may suffer.
    Warning,
    /// The scene cannot be used before this is corrected.
    Error,
}

impl Problem {
    /// Whether the scene can be used in spite of the problem.
    pub fn severity(&self) -> Severity {
        match self {
            Problem::EmptyMask { .. } | Problem::MissingFrame { .. } => Severity::Warning,
            _ => Severity::Error,
        }
    }
}

/// Why a scene cannot be opened or a picture cannot be loaded.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The path does not exist.
    #[error("{}: no such file or folder", path.display())]
    NotFound {
        /// The path.
        path: PathBuf,
    },
    /// The folder holds no scene in a known format.
    #[error(
        "{}: not a scene in a known format; expected one of: all_data.json (PAC-NeRF), camera.json with frame.json \
         (Spring-Gaus synthetic), dynamic/cameras_calib.json (Spring-Gaus real capture), transforms_train.json \
         (Blender, D-NeRF), transforms.json (nerfstudio), cameras/images .bin or .txt in sparse/0, sparse, colmap or \
         the folder itself (COLMAP)",
        path.display()
    )]
    UnknownFormat {
        /// The folder.
        path: PathBuf,
    },
    /// A file that cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file that is not what its name says, as a whole.
    #[error("{}: {reason}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong, where.
        reason: String,
    },
    /// Everything that is wrong with the data; at least one entry is an error.
    #[error("{}", Listed(.0))]
    Invalid(
        /// The problems, in the order of the files.
        Vec<Problem>,
    ),
    /// A setting for opening a scene that makes no sense.
    #[error("{name} = {value}: {reason}")]
    Setting {
        /// The field of [`crate::SceneSettings`].
        name: &'static str,
        /// Its value.
        value: String,
        /// What it must be.
        reason: String,
    },
    /// There is no picture of this camera at this frame.
    #[error("no picture of camera {camera} at frame {frame}")]
    NoSuchView {
        /// The camera's index.
        camera: usize,
        /// The frame's index.
        frame: usize,
    },
    /// A matting network cannot be used.
    #[error("{}: {reason}", path.display())]
    Matting {
        /// The network's file.
        path: PathBuf,
        /// What is wrong, and what to do.
        reason: String,
    },
}

impl From<Problem> for SceneError {
    fn from(problem: Problem) -> SceneError {
        SceneError::Invalid(vec![problem])
    }
}

struct Listed<'a>(&'a [Problem]);

impl fmt::Display for Listed<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let [one] = self.0 {
            return write!(f, "{one}");
        }
        write!(f, "{} problems with the data of this scene:", self.0.len())?;
        for problem in self.0 {
            write!(f, "\n  - {problem}")?;
        }
        Ok(())
    }
}
