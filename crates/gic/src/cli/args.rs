//! Flags: one definition yields parser, help and completions.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use gic_mpm::MaterialKind;
use gic_scene::SceneSettings;
use gic_twin::twin::Setting;

use super::flags::{AppearanceFlags, Flags, ReconstructFlags, SettingsFlags};
use super::values::{Pad, coefficient, length, positive, positive_number, refinement, seconds, size, threads};
use gic_grasp::Gripper;

/// Video in, physical digital twin out.
///
/// gic watches an object fall, bounce, flow or crumble in videos from a few calibrated cameras and finds out what it is
/// made of: its shape, its velocity and the parameters of its material, with error bars. The result, `twin.json`, can
/// be simulated into new futures.
#[derive(Debug, Parser)]
#[command(
    name = "gic",
    version,
    max_term_width = 120,
    propagate_version = true,
    subcommand_required = true,
    arg_required_else_help = true
)]
#[command(after_help = EXIT_CODES)]
pub(crate) struct Cli {
    #[command(flatten)]
    pub(crate) global: Global,
    #[command(subcommand)]
    pub(crate) command: Command,
}

const EXIT_CODES: &str = "\
Exit codes: 0 done, 1 failed, 2 bad usage or settings, 130 interrupted (what was finished is kept; run the same command \
again to go on).
Results go to stdout, everything else to stderr.";

#[derive(Debug, Args)]
#[command(next_display_order = 900)]
pub(crate) struct Global {
    /// Say more: every step with its numbers
    #[arg(short, long, global = true, conflicts_with = "quiet")]
    pub(crate) verbose: bool,
    /// Say less: results, warnings and errors only
    #[arg(short, long, global = true)]
    pub(crate) quiet: bool,
    /// Number of threads [default: one per core]
    #[arg(long, global = true, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
}

// One value in a process: its size does not matter.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Demo(DemoArgs),
    Import(ImportArgs),
    Calibrate(CalibrateArgs),
    Masks(MasksArgs),
    Inspect(InspectArgs),
    Run(RunArgs),
    Reconstruct(ReconstructArgs),
    Register(RegisterArgs),
    Fill(FillArgs),
    Identify(IdentifyArgs),
    Report(ReportArgs),
    Eval(EvalArgs),
    Bench(BenchArgs),
    Export(ExportArgs),
    Simulate(SimulateArgs),
    Render(RenderArgs),
    View(ViewArgs),
    Grasp(GraspArgs),
    Gradcheck(GradcheckArgs),
    /// Print the completion script of a shell
    ///
    /// For bash: gic completions bash > ~/.local/share/bash-completion/completions/gic
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
}

/// See gic work: the scene that comes with it, from video to twin, against the truth (a few minutes)
#[derive(Debug, Args)]
pub(crate) struct DemoArgs {
    /// Folder for the scene and the run
    #[arg(short, long, value_name = "DIR", default_value = "gic-demo")]
    pub(crate) out: PathBuf,
}

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

/// Show what gic reads of a scene: cameras, frames, masks, size, ground, and what looks wrong
///
/// Knows PAC-NeRF, Spring-Gaus (synthetic and real), Blender / D-NeRF, nerfstudio and COLMAP folders by their files.
#[derive(Debug, Args)]
pub(crate) struct InspectArgs {
    /// The scene's folder
    #[arg(value_name = "SCENE")]
    pub(crate) scene_path: PathBuf,
    /// Write a contact sheet: small pictures with the masks' outlines
    #[arg(long, value_name = "FILE.png")]
    pub(crate) sheet: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) scene: SceneSettings,
}

/// Write report.html of a finished run anew
#[derive(Debug, Args)]
pub(crate) struct ReportArgs {
    /// The run folder
    pub(crate) run: PathBuf,
    #[command(flatten)]
    pub(crate) elsewhere: SceneElsewhere,
}

/// Compare a run with ground truth: parameters, velocity, shape in every frame
#[derive(Debug, Args)]
pub(crate) struct EvalArgs {
    /// The run folder
    pub(crate) run: PathBuf,
    #[command(flatten)]
    pub(crate) elsewhere: SceneElsewhere,
    /// The truth: a folder with params.json and particles_N.npz
    #[arg(long, value_name = "SCENE/gt")]
    pub(crate) truth: PathBuf,
}

/// Hand a twin to other programs: meshes, Gaussians, simulators
///
/// Every format describes the same body, the twin's particles, and states the same mass.
#[derive(Debug, Args)]
pub(crate) struct ExportArgs {
    /// A run folder, the folder of a simulation, or a twin.json
    #[arg(value_name = "TWIN")]
    pub(crate) source: PathBuf,
    /// What to write
    #[arg(long, value_enum)]
    pub(crate) format: crate::export::Export,
    /// The file, or folder of a sequence [default: in the folder of the twin]
    #[arg(short, long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
    /// Turn everything so that this axis points up [default: as it is]
    #[arg(long, value_enum, value_name = "AXIS")]
    pub(crate) up: Option<Up>,
    /// Where the format lacks the twin's law, take the nearest: MuJoCo's bodies are elastic
    #[arg(long)]
    pub(crate) approximate: bool,
}

/// An axis that points up.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(crate) enum Up {
    Y,
    Z,
}

impl From<Up> for gic_twin::interchange::UpAxis {
    fn from(up: Up) -> Self {
        match up {
            Up::Y => Self::Y,
            Up::Z => Self::Z,
        }
    }
}

/// Run every scene of a folder, here or on a cluster, and write the paper's table
///
/// Each scene needs a gt folder; of it, only the material's model is given to the runs. OUT keeps all: suite.json (the
/// tasks), a run folder for each with result.json, and the tables results.md, .csv, .json, costs.json and suite.html
/// (sortable). A finished task is not run again, every other goes on where it stopped: run the same command again, with
/// the same or another --on. More scenes or another --filter add to what is there. `gic bench --collect OUT` makes the
/// tables of what is there.
#[derive(Debug, Args)]
#[command(after_help = "Examples: gic bench SUITE -o OUT --jobs 2 -- --steps 400\n          \
    gic bench SUITE -o OUT --on slurm --partition long --threads 4\n          \
    gic bench SUITE -o OUT --matrix identify.target=masks,surfaces --cameras '0,4,8;all' --repeat 3")]
pub(crate) struct BenchArgs {
    /// The folder that holds the scenes' folders; with --collect and --task the output folder
    #[arg(value_name = "SUITE_DIR|OUT")]
    pub(crate) suite: PathBuf,
    /// Folder for the runs and the tables
    #[arg(short, long, value_name = "OUT", required_unless_present_any = ["collect", "task"])]
    pub(crate) out: Option<PathBuf>,
    /// Only scenes whose name contains this
    #[arg(long, value_name = "TEXT", conflicts_with_all = ["collect", "task"])]
    pub(crate) filter: Option<String>,
    #[command(flatten)]
    pub(crate) sweep: SweepArgs,
    #[command(flatten)]
    pub(crate) engine: EngineArgs,
    /// Say what the tasks will take, and start nothing
    #[arg(long, conflicts_with_all = ["collect", "task", "export_suite"])]
    pub(crate) forecast: bool,
    /// Make the tables of what is in the output folder, and start nothing
    #[arg(long, conflicts_with_all = ["out", "task", "export_suite"])]
    pub(crate) collect: bool,
    /// Results of other methods: a folder that holds their output folders, called as the scenes are; may be repeated
    #[arg(long, value_name = "DIR", conflicts_with_all = ["task", "export_suite"])]
    pub(crate) others: Vec<PathBuf>,
    /// Write the scenes as the released code of another method reads them, with a script that runs it
    #[arg(long, value_enum, value_name = "METHOD", conflicts_with = "task")]
    pub(crate) export_suite: Option<gic_bench::others::Method>,
    /// Run one task of an output folder, by the name in its suite.json: what the engines call
    #[arg(long, value_name = "TASK", conflicts_with = "out")]
    pub(crate) task: Option<String>,
    /// Further arguments for `gic run`, after --
    #[arg(last = true, conflicts_with_all = ["collect", "task", "export_suite"])]
    pub(crate) arguments: Vec<String>,
}

/// Several ways of running every scene: all combinations
#[derive(Debug, Args)]
pub(crate) struct SweepArgs {
    /// A setting of config.toml and its alternatives, with semicolons between values that hold commas; may be repeated
    #[arg(long, value_name = "KEY=V,V", conflicts_with_all = ["collect", "task", "export_suite"])]
    pub(crate) matrix: Vec<gic_bench::sweep::Variation>,
    /// Sets of cameras; `all` for all
    #[arg(long, value_name = "A,B;all", conflicts_with_all = ["collect", "task"])]
    pub(crate) cameras: Option<String>,
    /// Run each so often, with seeds one after the other
    #[arg(long, value_name = "N", value_parser = positive, conflicts_with_all = ["collect", "task", "export_suite"])]
    pub(crate) repeat: Option<usize>,
    /// The first seed
    #[arg(long, value_name = "N", conflicts_with_all = ["collect", "task", "export_suite"])]
    pub(crate) seed: Option<u64>,
}

/// Where the tasks run
#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("engine").multiple(true).conflicts_with_all(["collect", "task", "export_suite"]))]
pub(crate) struct EngineArgs {
    /// Where the tasks run; the suite and OUT must lie where all machines find them by the same path
    #[arg(long, value_enum, default_value_t, group = "engine")]
    pub(crate) on: gic_bench::engine::On,
    /// Most tasks at the same time [default: one here, what there is room for on a cluster]
    #[arg(long, value_name = "N", value_parser = positive, group = "engine")]
    pub(crate) jobs: Option<usize>,
    /// Slurm, Ray: memory of a task [GB] [default: twice the forecast]
    #[arg(long, value_name = "GB", value_parser = positive_number, group = "engine")]
    pub(crate) memory_gb: Option<f64>,
    /// Slurm: the partition
    #[arg(long, value_name = "NAME", group = "engine")]
    pub(crate) partition: Option<String>,
    /// Slurm: most time of a task, as sbatch takes it [default: five times the forecast]
    #[arg(long, value_name = "TIME", group = "engine")]
    pub(crate) time: Option<String>,
    /// Slurm: wait for the end of the job and make the tables
    #[arg(long, group = "engine")]
    pub(crate) wait: bool,
    /// Ray, Dask: the cluster's address; without it a cluster on this machine
    #[arg(long, value_name = "ADDRESS", group = "engine")]
    pub(crate) address: Option<String>,
    /// Ray, Dask: the Python that has them and the package gic; by default python3 of the path
    #[arg(long, value_name = "FILE", group = "engine")]
    pub(crate) python: Option<PathBuf>,
}

/// Make a twin from videos: reconstruct, fill, identify, predict, dress, report
///
/// Runs what is missing in the run folder, so a run that was stopped goes on with the same command, and a changed
/// setting reruns only what depends on it. Results: twin.json (the twin), report.html (open it in a browser),
/// prediction/ (the twin's motion), appearance/ (its colours).
#[derive(Debug, Args)]
#[command(after_help = "Example: gic run SCENE --material elastic -o RUN")]
pub(crate) struct RunArgs {
    #[command(flatten)]
    pub(crate) place: SceneAndRun,
    #[command(flatten)]
    pub(crate) scene: SceneSettings,
    #[command(flatten)]
    pub(crate) reconstruct: ReconstructFlags,
    #[command(flatten)]
    pub(crate) fill: gic_continuum::Settings,
    #[command(flatten)]
    pub(crate) identify: gic_identify::Settings,
    #[command(flatten)]
    pub(crate) appearance: AppearanceFlags,
    #[command(flatten)]
    pub(crate) settings: SettingsFlags,
}

/// Only the first stage of `run`: from pictures to moving Gaussians
#[derive(Debug, Args)]
pub(crate) struct ReconstructArgs {
    #[command(flatten)]
    pub(crate) place: SceneAndRun,
    #[command(flatten)]
    pub(crate) scene: SceneSettings,
    #[command(flatten)]
    pub(crate) reconstruct: ReconstructFlags,
    #[command(flatten)]
    pub(crate) settings: SettingsFlags,
}

/// The stages of `run` up to registration: where photographs of the object at rest lie in the video's first frame
///
/// For real captures, which have `static` beside `dynamic`. Nobody gives a pose: all rotations are tried. Writes
/// registration.json.
#[derive(Debug, Args)]
pub(crate) struct RegisterArgs {
    /// The run folder
    pub(crate) run: PathBuf,
    #[command(flatten)]
    pub(crate) elsewhere: SceneElsewhere,
    #[command(flatten)]
    pub(crate) settings: SettingsFlags,
}

/// The stages of `run` up to filling: from Gaussians to matter
#[derive(Debug, Args)]
pub(crate) struct FillArgs {
    /// The run folder
    pub(crate) run: PathBuf,
    #[command(flatten)]
    pub(crate) elsewhere: SceneElsewhere,
    #[command(flatten)]
    pub(crate) fill: gic_continuum::Settings,
    #[command(flatten)]
    pub(crate) settings: SettingsFlags,
}

/// The stages of `run` up to the twin: from matter to material
#[derive(Debug, Args)]
pub(crate) struct IdentifyArgs {
    /// The run folder
    pub(crate) run: PathBuf,
    #[command(flatten)]
    pub(crate) elsewhere: SceneElsewhere,
    #[command(flatten)]
    pub(crate) identify: gic_identify::Settings,
    #[command(flatten)]
    pub(crate) settings: SettingsFlags,
}

impl InspectArgs {
    /// The settings among the flags.
    pub(crate) fn flags(&self) -> Flags<'_> {
        Flags { scene_path: Some(&self.scene_path), scene: Some(&self.scene), ..Flags::default() }
    }
}

impl RunArgs {
    /// The settings among the flags.
    pub(crate) fn flags(&self) -> Flags<'_> {
        Flags {
            scene_path: Some(&self.place.scene_path),
            scene: Some(&self.scene),
            reconstruct: Some(&self.reconstruct),
            fill: Some(&self.fill),
            identify: Some(&self.identify),
            appearance: Some(&self.appearance),
            any: Some(&self.settings),
        }
    }
}

impl ReconstructArgs {
    /// The settings among the flags.
    pub(crate) fn flags(&self) -> Flags<'_> {
        Flags {
            scene_path: Some(&self.place.scene_path),
            scene: Some(&self.scene),
            reconstruct: Some(&self.reconstruct),
            any: Some(&self.settings),
            ..Flags::default()
        }
    }
}

impl RegisterArgs {
    /// The settings among the flags.
    pub(crate) fn flags(&self) -> Flags<'_> {
        Flags { scene_path: self.elsewhere.scene.as_deref(), any: Some(&self.settings), ..Flags::default() }
    }
}

impl FillArgs {
    /// The settings among the flags.
    pub(crate) fn flags(&self) -> Flags<'_> {
        Flags {
            scene_path: self.elsewhere.scene.as_deref(),
            fill: Some(&self.fill),
            any: Some(&self.settings),
            ..Flags::default()
        }
    }
}

impl IdentifyArgs {
    /// The settings among the flags.
    pub(crate) fn flags(&self) -> Flags<'_> {
        Flags {
            scene_path: self.elsewhere.scene.as_deref(),
            identify: Some(&self.identify),
            any: Some(&self.settings),
            ..Flags::default()
        }
    }
}

/// Where a run's scene is.
#[derive(Debug, Args)]
pub(crate) struct SceneElsewhere {
    /// The scene that the run was made from, where it has moved
    #[arg(long, value_name = "SCENE")]
    pub(crate) scene: Option<PathBuf>,
}

impl SceneElsewhere {
    /// The settings among the flags.
    pub(crate) fn flags(&self) -> Flags<'_> {
        Flags { scene_path: self.scene.as_deref(), ..Flags::default() }
    }
}

/// Where a run reads and writes.
#[derive(Debug, Args)]
pub(crate) struct SceneAndRun {
    /// The scene's folder, in any known format (see `gic inspect`)
    #[arg(value_name = "SCENE")]
    pub(crate) scene_path: PathBuf,
    /// The run folder; made if it does not exist
    #[arg(short, long, value_name = "RUN")]
    pub(crate) out: PathBuf,
}

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

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn the_flags_are_consistent() {
        super::Cli::command().debug_assert();
    }
}
