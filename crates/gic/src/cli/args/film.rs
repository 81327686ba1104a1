//! Films, boards and masks: what makes a scene.

use std::path::PathBuf;

use clap::Args;

use crate::cli::values::{length, positive, positive_number, seconds};

/// Make a scene from films: pictures, times, the empty background, and cameras where they are known
///
/// Reads MP4, MOV, MKV, GIF, AVI and WebM by the program ffmpeg, one file a camera, or a folder of numbered pictures
/// for each. The background comes from the film itself; objects that rest in it and their shadows are taken out. Films
/// that do not begin together are put on one clock by a clap or a flash. Without cameras yet, run `gic calibrate` and
/// then `gic import -o SCENE --calibration FILE`: the pictures stay as they are.
#[derive(Debug, Args)]
#[command(after_help = "Example: gic import films/ -o SCENE --start 1.2 --frames 30 --calibration calibration.json")]
pub(crate) struct ImportArgs {
    /// A folder of films, one a camera, or the films
    #[arg(value_name = "FOLDER|FILE")]
    pub(crate) films: Vec<PathBuf>,
    /// The scene's folder
    #[arg(short, long, value_name = "SCENE", default_value = "scene")]
    pub(crate) out: PathBuf,
    /// Only draw small pictures of the films with their times, to choose --start and --frames by
    #[arg(long, value_name = "FILE.png", conflicts_with = "out")]
    pub(crate) thumbnails: Option<PathBuf>,
    /// Where to begin, on the clock of the first film [s] [default: where all films have begun]
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub(crate) start: Option<f64>,
    /// Number of frames [default: all]
    #[arg(long, value_name = "N", value_parser = positive)]
    pub(crate) frames: Option<usize>,
    /// Take every K-th frame
    #[arg(long, value_name = "K", default_value = "1", value_parser = positive)]
    pub(crate) every: usize,
    /// The cameras: a file of `gic calibrate`, a transforms.json or a scene, by the names of the films
    #[arg(long, value_name = "FILE|SCENE")]
    pub(crate) calibration: Option<PathBuf>,
    /// Frames per second of numbered pictures; films keep their own times
    #[arg(long, value_name = "HZ", value_parser = positive_number)]
    pub(crate) frame_rate_hz: Option<f64>,
    /// What shows the films' common clock
    #[arg(long, value_enum, default_value = "auto")]
    pub(crate) align: gic_film::Align,
}

/// Calibrate cameras with a printed board: lenses, places, the floor, the scale
///
/// First print a board (--print), measure a tag, and lay the pages flat on the floor where the object will fall. Then
/// film them with all cameras at rest, or take a picture with each: every camera has to see a page that another one
/// sees, too. Films are given as in `gic import`; their names are the cameras'. --moving is for a board that is shown
/// to all cameras in several places. Writes calibration.json for `gic import --calibration`, report.html, and pictures
/// of what is left over. The floor is the board's plane, z points up from it.
#[derive(Debug, Args)]
#[command(
    after_help = "Example: gic calibrate --print board.pdf && gic calibrate films/ -o calibration --tag-size-m 0.032"
)]
pub(crate) struct CalibrateArgs {
    /// A folder of films, one a camera, or the films; folders of numbered pictures, and single pictures, do as well
    #[arg(value_name = "FOLDER|FILE")]
    pub(crate) films: Vec<PathBuf>,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", default_value = "calibration")]
    pub(crate) out: PathBuf,
    /// The board: pages of tags, sheets:COLUMNSxROWS,gap=SHARE of a tag, lying anywhere on one plane; tags, for single
    /// tags; kalibr:COLUMNSxROWS,gap=SHARE; or charuco:COLUMNSxROWS,tag=SHARE of a square. All of AprilTags 36h11
    #[arg(long, value_name = "BOARD", default_value = "sheets:4x6")]
    pub(crate) board: gic_calibrate::Board,
    /// Side of a tag's black square, as measured on the paper [m]
    #[arg(long, value_name = "M", value_parser = length)]
    pub(crate) tag_size_m: Option<f64>,
    /// Only make the board, as a PDF at its true size
    #[arg(long, value_name = "FILE.pdf")]
    pub(crate) print: Option<PathBuf>,
    /// The paper to print on
    #[arg(long, value_enum, default_value = "a4")]
    pub(crate) paper: Paper,
    /// Number of pages to print
    #[arg(long, value_name = "N", default_value = "4", value_parser = positive)]
    pub(crate) pages: usize,
    /// The board moves: it is shown in several places, to all cameras at the same moments (films begin together)
    #[arg(long)]
    pub(crate) moving: bool,
    /// Lenses alone, each camera for itself, from a board that moves before it: writes intrinsics.json
    #[arg(long)]
    pub(crate) intrinsics: bool,
    /// Take the lenses from here (intrinsics.json or calibration.json), seek the places only
    #[arg(long, value_name = "FILE")]
    pub(crate) lenses: Option<PathBuf>,
    /// Focal length along y over that along x: 1 for square pixels, another for films that were resized unevenly
    #[arg(long, value_name = "RATIO", default_value = "1", value_parser = positive_number)]
    pub(crate) pixel_aspect: f64,
    /// What the board lies on; a moving board at its end
    #[arg(long, value_enum, default_value = "floor")]
    pub(crate) board_on: BoardOn,
    /// Frames per second of numbered pictures; matters with --moving, where cameras differ
    #[arg(long, value_name = "HZ", value_parser = positive_number)]
    pub(crate) frame_rate_hz: Option<f64>,
}

/// Sizes of paper.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(crate) enum Paper {
    A4,
    A3,
    Letter,
}

impl From<Paper> for gic_calibrate::Paper {
    fn from(paper: Paper) -> Self {
        match paper {
            Paper::A4 => Self::A4,
            Paper::A3 => Self::A3,
            Paper::Letter => Self::Letter,
        }
    }
}

/// What a board lies on.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(crate) enum BoardOn {
    Floor,
    Nothing,
}

impl From<BoardOn> for gic_calibrate::BoardOn {
    fn from(place: BoardOn) -> Self {
        match place {
            BoardOn::Floor => Self::Floor,
            BoardOn::Nothing => Self::Nothing,
        }
    }
}

/// Make the masks of a scene, and name the doubtful ones
///
/// From the difference to the empty background, or by a network of yours. Writes masks/ with a contact sheet, and tells
/// for each view how well its mask agrees with the visual hull of the others. A mask that you mend goes into the folder
/// masks_corrected/ under the same name: it wins, and is never written to.
#[derive(Debug, Args)]
#[command(after_help = "Example: gic masks SCENE --matting modnet.onnx --box left:120,80,400,420")]
pub(crate) struct MasksArgs {
    /// The scene's folder
    #[arg(value_name = "SCENE")]
    pub(crate) scene_path: PathBuf,
    /// Folder for the masks [default: masks in the scene]
    #[arg(short, long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Make the masks with this network (needs a gic built with --features onnx)
    #[arg(long, value_name = "MODEL.onnx")]
    pub(crate) matting: Option<PathBuf>,
    /// Where the object is [pixels]: for all cameras, or with a camera's name; may be repeated
    #[arg(long = "box", value_name = "[CAMERA:]x0,y0,x1,y1")]
    pub(crate) boxes: Vec<gic_film::ObjectBox>,
}
