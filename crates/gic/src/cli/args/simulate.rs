//! What a twin does next.

use std::path::PathBuf;

use clap::Args;
use gic_grasp::Gripper;
use gic_mpm::MaterialKind;
use gic_twin::twin::Setting;

use crate::cli::values::{Pad, coefficient, length, positive, positive_number, refinement, size};

/// Simulate a twin: what happens to this matter from here on
///
/// The same world, further on, or another one: other parameters, another law, other obstacles, company. Writes
/// particles_NNNN.ply (binary; position, velocity, von Mises stress, J = relative volume) for every frame from 0, the
/// initial state, and trajectory.json. Run the same command again after an interruption, or with more --frames, and it
/// goes on where it stopped, with the same bytes as without interruption.
#[derive(Debug, Args)]
#[command(after_help = "Example: gic simulate examples/elastic.json -o /tmp/elastic --set youngs_modulus_pa=2e5")]
pub(crate) struct SimulateArgs {
    /// The twin (schema gic.twin/1), or a run folder
    #[arg(value_name = "TWIN.json|RUN")]
    pub(crate) twin: PathBuf,
    /// Folder for the frames
    #[arg(short, long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Number of frames, the initial state included [default: the twin's]
    #[arg(long, value_name = "N", value_parser = positive)]
    pub(crate) frames: Option<usize>,
    /// Change a value of the twin: youngs_modulus_pa=2e5, gravity_m_s2=0,-1.62,0, colliders.0.contact=slip
    #[arg(long, value_name = "KEY=VALUE")]
    pub(crate) set: Vec<Setting>,
    /// Another law; parameters that both laws have stay, further ones come with --set
    #[arg(long, value_enum)]
    pub(crate) material: Option<MaterialKind>,
    /// Gravity [m/s^2]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub(crate) gravity: Option<String>,
    /// Initial velocity [m/s]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub(crate) velocity: Option<String>,
    /// Further obstacles, at rest or moving: a TOML or JSON file with a list `colliders` as in a twin
    #[arg(long, value_name = "FILE")]
    pub(crate) colliders: Option<PathBuf>,
    /// Another twin or run folder in the same world, moved by X,Y,Z metres; may be repeated, also for copies of the
    /// same
    #[arg(long = "with", value_name = "TWIN@X,Y,Z")]
    pub(crate) companions: Vec<gic_twin::simulate::Companion>,
    /// Start anew, even if the folder holds frames of another twin or other settings
    #[arg(long)]
    pub(crate) restart: bool,
    #[command(flatten)]
    pub(crate) budget: BudgetArgs,
}

/// What a simulation may take.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct BudgetArgs {
    /// Longest that it may take by its forecast, on one core [h] [default: a day]
    #[arg(long, value_name = "HOURS", value_parser = positive_number)]
    pub(crate) budget_hours: Option<f64>,
    /// Most memory that it may take by its forecast [GB] [default: what the machine has left]
    #[arg(long, value_name = "GB", value_parser = positive_number)]
    pub(crate) budget_gb: Option<f64>,
}

/// Make pictures and films of a simulated motion
///
/// Writes frame_NNNN.png for every frame of a folder that `gic simulate` wrote, or of a run's prediction; with --film
/// also a .gif, or where the program ffmpeg is installed an .mp4 (H.264) or an animated .webp. Pictures of 160 rows and
/// more show the time and what the colours mean. An orbit follows the body.
#[derive(Debug, Args)]
#[command(after_help = "Example: gic render /tmp/elastic -o /tmp/pictures --film /tmp/elastic.gif")]
pub(crate) struct RenderArgs {
    /// A folder of simulated frames, or a run folder
    #[arg(value_name = "FRAMES|RUN")]
    pub(crate) frames: PathBuf,
    /// Folder for the pictures
    #[arg(short, long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// From where: `orbit`, or the number of a camera of the scene
    #[arg(long, value_name = "N|orbit", default_value = "orbit")]
    pub(crate) camera: gic_view::render::Viewpoint,
    /// The scene whose cameras to use; a run knows its own
    #[arg(long, value_name = "SCENE")]
    pub(crate) scene: Option<PathBuf>,
    /// What lies behind the matter
    #[arg(long, value_enum, default_value = "floor")]
    pub(crate) background: gic_view::render::Background,
    /// What the colours mean
    #[arg(long, value_enum, default_value = "stress")]
    pub(crate) color: gic_view::render::Coloring,
    /// Put the video's picture to the left; needs a camera of the scene
    #[arg(long)]
    pub(crate) beside_video: bool,
    /// Width and height of pictures from an orbit [pixels]
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "640x480", value_parser = size)]
    pub(crate) size: [usize; 2],
    /// Make a film too
    #[arg(long, value_name = "FILE.gif|.mp4|.webp")]
    pub(crate) film: Option<PathBuf>,
    /// How many times slower than life the film runs
    #[arg(long, value_name = "TIMES", default_value = "1", value_parser = positive_number)]
    pub(crate) slow_motion: f64,
    /// Without time and colour bar in the pictures
    #[arg(long)]
    pub(crate) no_labels: bool,
}

/// Make a page that shows a simulated motion in a browser: turn it, step through time, see stress and speed
///
/// One HTML file that needs nothing installed and no network: splats or points, stress and speed on a colour bar whose
/// range can be set, obstacles, and with a scene the film or its masks behind the twin through the scene's cameras.
/// FILE.html#frame=7&colour=stress&draw=points&camera=0 opens it there. With --live the page simulates: pull the body,
/// change its law's parameters and gravity, and watch.
#[derive(Debug, Args)]
#[command(after_help = "Example: gic view RUN -o twin.html, gic view --live RUN -o live.html")]
pub(crate) struct ViewArgs {
    /// A folder of simulated frames, or a run folder; with --live a twin (schema gic.twin/1), or a run folder
    #[arg(value_name = "FRAMES|RUN|TWIN.json")]
    pub(crate) frames: PathBuf,
    /// Simulate the twin in the page, with at most 3,000 particles
    #[arg(long, conflicts_with_all = ["scene", "rerun"])]
    pub(crate) live: bool,
    /// The page [default: view.html in the folder, live.html beside the twin]
    #[arg(short, long, value_name = "FILE.html")]
    pub(crate) out: Option<PathBuf>,
    /// The scene whose film stands behind the twin; a run knows its own
    #[arg(long, value_name = "SCENE")]
    pub(crate) scene: Option<PathBuf>,
    /// Write a recording for the Rerun viewer instead, and open it where that is installed; needs a gic built with
    /// --features rerun
    #[arg(long, value_name = "FILE.rrd", conflicts_with = "out")]
    pub(crate) rerun: Option<PathBuf>,
}

/// Grip a twin with two rigid pads, as a robot would: force, stress, slip
///
/// The pads close on the twin to each width, hold it, and lift it from a table. Widths are those of the object between
/// the pads. Prints a table; writes grasp.json, a picture per width (stress from blue to red) and a film.
#[derive(Debug, Args)]
#[command(after_help = "Example: gic grasp RUN --width-m 0.055,0.045,0.035")]
pub(crate) struct GraspArgs {
    /// The twin (schema gic.twin/1), or a run folder
    #[arg(value_name = "RUN|TWIN.json")]
    pub(crate) twin: PathBuf,
    /// Widths to close to [m]
    #[arg(long, value_name = "W,...", value_delimiter = ',', required = true, allow_hyphen_values = true)]
    pub(crate) width_m: Vec<f64>,
    /// Which way to close: along x, y or z of the world through the centre of mass, or between the two places of the
    /// surface that face each other best
    #[arg(long, value_name = "auto|x|y|z", default_value = "auto")]
    pub(crate) axis: gic_grasp::AxisChoice,
    /// A pad's sides, across and along the finger [m]
    #[arg(long, value_name = "WIDTHxLENGTH", default_value_t = Pad(Gripper::default().pad_m))]
    pub(crate) pad: Pad,
    /// Coulomb coefficient of friction between pads and object
    #[arg(long, value_name = "MU", default_value_t = Gripper::default().friction, value_parser = coefficient)]
    pub(crate) friction: f64,
    /// How far to lift [m]
    #[arg(long, value_name = "HEIGHT", default_value_t = Gripper::default().lift_m, value_parser = length)]
    pub(crate) lift_m: f64,
    /// Cut each particle into N^3 on a grid N times finer [default: the least with which the grid feels the pads]
    #[arg(long, value_name = "N", value_parser = refinement)]
    pub(crate) refine: Option<usize>,
    /// Change a value of the twin, as in `gic simulate`
    #[arg(long, value_name = "KEY=VALUE")]
    pub(crate) set: Vec<Setting>,
    /// Folder for the results [default: `grasp` in the run folder or beside the twin]
    #[arg(short, long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// The film [default: grasp.gif in the folder]
    #[arg(long, value_name = "FILE.gif|.mp4")]
    pub(crate) film: Option<PathBuf>,
    /// Width and height of the pictures [pixels]
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "640x480", value_parser = size)]
    pub(crate) size: [usize; 2],
    /// Numbers only
    #[arg(long)]
    pub(crate) no_pictures: bool,
    #[command(flatten)]
    pub(crate) budget: BudgetArgs,
}

/// Check the simulator's gradients: adjoint against finite differences in f64
///
/// Prints one line per parameter, density, velocity and a few positions, for a block that hits a sticky floor within 50
/// substeps. Fails when one of them differs by more than 1e-3.
#[derive(Debug, Args)]
pub(crate) struct GradcheckArgs {
    /// Only this material
    #[arg(long, value_name = "MODEL")]
    pub(crate) material: Option<MaterialKind>,
}
