//! Attacks on scenes, twins and run folders: files are changed at random, gic is started on them, and must answer.
//!
//! An answer is exit 0 or 1 within a time limit, and with 1 an error that says what is wrong. Nothing that gic reads is
//! changed, and a result of a run that is not what its stage wrote is named and kept.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

/// Longest time that a command may take on one of the small inputs.
const TIME_LIMIT: Duration = Duration::from_secs(120);
/// Most changes to one input.
const MOST_CHANGES: u64 = 3;

/// Where the stages leave their results in a run.
const RESULTS: [&str; 12] = [
    "gaussians",
    "continuum.ply",
    "fill.json",
    "surface",
    "filling",
    "selection.json",
    "twin.json",
    "twin.ply",
    "identify.json",
    "prediction",
    "appearance",
    "registration.json",
];
/// Settings of a twin that are spoilt on the command line, and with what.
const SETTINGS: [&str; 12] = [
    "particle_spacing_m",
    "grid_spacing_m",
    "substeps_per_frame",
    "density_kg_m3",
    "frame_rate_hz",
    "frames",
    "gravity_m_s2.1",
    "initial_velocity_m_s.1",
    "material.youngs_modulus_pa",
    "material.poisson_ratio",
    "colliders.0.point_m.1",
    "continuum.size_m.0",
];
const HOSTILE_VALUES: [&str; 14] = [
    "0",
    "-1",
    "1e-320",
    "1e-6",
    "1e-3",
    "0.5",
    "50",
    "1e4",
    "1e9",
    "1e16",
    "1e308",
    "18446744073709551615",
    "nan",
    "slip",
];

/// Numbers without end, the same for the same seed (splitmix64).
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, count: usize) -> usize {
        (self.next() % count.max(1) as u64) as usize
    }
}

/// What is attacked.
#[derive(Clone, Debug)]
pub(crate) enum Target {
    /// A scene, to be inspected.
    Scene(PathBuf),
    /// A folder with `scene` and `run`, the run's reconstruction finished with these flags.
    Run(PathBuf, Vec<String>),
    /// A folder with `run`, all its stages finished, to be read.
    WholeRun(PathBuf),
    /// A folder with `twin.json`, its matter and `frames`, to be simulated, drawn and gripped.
    Twin(PathBuf),
}

/// One attack: a target, and the seeds of the changes to it.
#[derive(Clone, Debug)]
pub(crate) struct Case {
    pub(crate) target: Target,
    pub(crate) changes: Vec<u64>,
}

impl Case {
    /// The case of a seed.
    pub(crate) fn new(seed: u64, targets: &[Target]) -> Self {
        let mut random = Random::new(seed);
        let target = targets[random.below(targets.len())].clone();
        let count = 1 + random.next() % MOST_CHANGES;
        Self { target, changes: (0..count).map(|_| random.next()).collect() }
    }

    /// Plays the case in an empty folder; what went wrong, if anything.
    pub(crate) fn play(&self, gic: &Path, folder: &Path) -> Result<(), String> {
        match &self.target {
            Target::Scene(scene) => {
                let copied = folder.join("scene");
                copy(scene, &copied);
                let told = self.change(&copied);
                let before = contents(&copied);
                let answer = answer(gic, &["inspect".into(), text(&copied), "--threads".into(), "1".into()])?;
                check(before == contents(&copied), || format!("{told}: inspecting changed the scene"))?;
                check(answer.code == 0 || answer.says_what(), || format!("{told}: no reason given: {}", answer.message))
            }
            Target::Run(made, flags) => {
                copy(made, folder);
                self.play_run(gic, folder, flags)
            }
            Target::WholeRun(made) => {
                copy(made, folder);
                self.play_whole_run(gic, folder)
            }
            Target::Twin(made) => {
                copy(made, folder);
                self.play_twin(gic, folder)
            }
        }
    }

    fn play_run(&self, gic: &Path, folder: &Path, flags: &[String]) -> Result<(), String> {
        let (run, scene) = (folder.join("run"), folder.join("scene"));
        let whole = contents(&run.join("gaussians"));
        let told = self.change(&run);
        let damaged = contents(&run.join("gaussians"));
        let changed =
            damaged.iter().find(|file| !whole.contains(file) && whole.iter().any(|(path, _)| *path == file.0));
        let mut args = vec!["reconstruct".into(), text(&scene), "-o".into(), text(&run)];
        args.extend(flags.iter().cloned());
        let answer = answer(gic, &args)?;
        check(answer.code == 0 || answer.says_what(), || format!("{told}: no reason given: {}", answer.message))?;
        let up_to_date = answer.message.contains("reconstruct: up to date");
        if let Some((path, bytes)) = changed {
            check(!up_to_date, || format!("{told}: {} is taken for whole", path.display()))?;
            let ran = answer.message.contains("reconstruct: ");
            check(ran || fs::read(path).is_ok_and(|now| now == *bytes), || format!("{told}: {path:?} was changed"))?;
        }
        Ok(())
    }

    /// A report is made of whole results only.
    fn play_whole_run(&self, gic: &Path, folder: &Path) -> Result<(), String> {
        let run = folder.join("run");
        let whole = contents(&run);
        let told = self.change(&run);
        let changed = contents(&run);
        let is_result = |path: &Path| {
            let name = path.strip_prefix(&run).unwrap_or(path);
            let is_note = name.file_name().is_some_and(|file| file.to_string_lossy().starts_with('.'));
            !is_note && RESULTS.iter().any(|result| name.starts_with(result))
        };
        // Without its stamp, nothing is known of a stage's results.
        let is_stamped =
            |whole: &(PathBuf, Vec<u8>)| !whole.0.starts_with(run.join("stamps")) || changed.contains(whole);
        let all_stamps = whole.iter().all(is_stamped);
        let damaged = whole.iter().find(|file| all_stamps && is_result(&file.0) && !changed.contains(file));
        let kept: Vec<_> = changed.iter().filter(|(path, _)| is_result(path)).collect();
        let answer = answer(gic, &["report".into(), text(&run)])?;
        check(answer.code == 0 || answer.says_what(), || format!("{told}: no reason given: {}", answer.message))?;
        if let Some((path, _)) = damaged {
            check(answer.code != 0, || format!("{told}: {} is taken for whole", path.display()))?;
        }
        let is_kept = |(path, bytes): &&(PathBuf, Vec<u8>)| fs::read(path).is_ok_and(|now| now == *bytes);
        check(kept.iter().all(is_kept), || format!("{told}: a report changed a result"))
    }

    /// A twin and a motion are used, or refused with the reason, and stay as they are.
    fn play_twin(&self, gic: &Path, folder: &Path) -> Result<(), String> {
        let mut random = Random::new(self.changes[0]);
        let told = match random.below(2) {
            0 => self.change(folder),
            _ => "unchanged".into(),
        };
        let before = contents(folder);
        let [twin, frames] = ["twin.json", "frames"].map(|name| text(&folder.join(name)));
        let out = |name: &str| text(&folder.join("made").join(name));
        let budget = ["--budget-hours", "0.002", "--budget-gb", "2"];
        let commands: [Vec<String>; 5] = [
            words(&["simulate", &twin, "-o", &out("future"), "--set", &setting(&mut random)], &budget),
            words(&["simulate", &twin, "-o", &out("future")], &budget),
            words(&["grasp", &twin, "-o", &out("grasp"), "--width-m", "0.1", "--no-pictures"], &budget),
            words(&["view", &frames, "-o", &out("view.html")], &[]),
            words(&["render", &frames, "-o", &out("pictures"), "--size", "32x32"], &[]),
        ];
        let command = &commands[random.below(commands.len())];
        fs::create_dir(folder.join("made")).map_err(|error| error.to_string())?;
        let answer = answer(gic, command)?;
        let told = format!("{told}; `gic {}`", command.join(" "));
        check(answer.code == 0 || answer.says_what(), || format!("{told}: no reason given: {}", answer.message))?;
        let _ = fs::remove_dir_all(folder.join("made"));
        check(before == contents(folder), || format!("{told}: an input was changed"))
    }

    /// Changes files of a folder; says what it did.
    fn change(&self, folder: &Path) -> String {
        self.changes.iter().map(|&seed| change(folder, &mut Random::new(seed))).collect::<Vec<_>>().join("; ")
    }
}

fn check(holds: bool, otherwise: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(otherwise()) }
}

struct Answer {
    code: i32,
    message: String,
}

impl Answer {
    /// Whether it is an error as gic tells errors.
    fn says_what(&self) -> bool {
        self.code != 0 && self.message.contains("error: ") && !self.message.contains("panicked")
    }
}

/// Runs gic to its end; an error where it does not end by itself with 0 or 1.
fn answer(gic: &Path, args: &[String]) -> Result<Answer, String> {
    let mut command = Command::new(gic);
    let errors = tempfile::tempfile().map_err(|error| error.to_string())?;
    let stderr = errors.try_clone().map_err(|error| error.to_string())?;
    let mut child = command
        .args(args)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(stderr)
        .spawn()
        .map_err(|error| format!("{}: {error}", gic.display()))?;
    let start = Instant::now();
    let status = loop {
        match child.try_wait().map_err(|error| error.to_string())? {
            Some(status) => break status,
            None if start.elapsed() > TIME_LIMIT => {
                let _ = child.kill();
                let _ = child.wait();
                return Err(format!("`gic {}` does not end", args.join(" ")));
            }
            None => std::thread::sleep(Duration::from_millis(2)),
        }
    };
    let message = read_all(errors);
    match status.code() {
        // 2: settings that cannot be used.
        Some(code @ 0..=2) => Ok(Answer { code, message }),
        _ => Err(format!("`gic {}` ended with {status}: {message}", args.join(" "))),
    }
}

fn read_all(mut file: fs::File) -> String {
    use std::io::{Read, Seek, SeekFrom};
    let mut bytes = Vec::new();
    let _ = file.seek(SeekFrom::Start(0)).and_then(|_| file.read_to_end(&mut bytes));
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Changes one file below a folder; says what it did.
fn change(folder: &Path, random: &mut Random) -> String {
    let files = files(folder);
    let Some(path) = files.get(random.below(files.len())) else { return "nothing to change".into() };
    let bytes = fs::read(path).unwrap_or_default();
    let is_json = serde_json::from_slice::<Value>(&bytes).is_ok();
    let what = match random.below(if is_json { 16 } else { 8 }) {
        0 => write(path, &bytes[..random.below(bytes.len())], "cut off"),
        1 => write(path, &[], "emptied"),
        2 => {
            let _ = fs::remove_file(path);
            "removed"
        }
        3 => {
            let _ = fs::remove_file(path).and_then(|()| fs::create_dir(path));
            "made a folder"
        }
        4 => {
            let other = fs::read(&files[random.below(files.len())]).unwrap_or_default();
            write(path, &other, "replaced by another file")
        }
        5 | 6 => write(path, &with_wrong_bytes(bytes, random), "given wrong bytes"),
        7 => write(path, &without_a_line(&bytes, random), "left without a line"),
        _ => {
            let mut value: Value = serde_json::from_slice(&bytes).unwrap_or_default();
            spoil(&mut value, random);
            write(path, value.to_string().as_bytes(), "given another value")
        }
    };
    format!("{} {what}", path.display())
}

fn write<'a>(path: &Path, bytes: &[u8], what: &'a str) -> &'a str {
    let _ = fs::write(path, bytes);
    what
}

fn with_wrong_bytes(mut bytes: Vec<u8>, random: &mut Random) -> Vec<u8> {
    for _ in 0..1 + random.below(4) {
        let at = random.below(bytes.len());
        if let Some(byte) = bytes.get_mut(at) {
            *byte = random.next() as u8;
        }
    }
    bytes
}

fn without_a_line(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let lines: Vec<&[u8]> = bytes.split_inclusive(|&byte| byte == b'\n').collect();
    let gone = random.below(lines.len());
    lines.iter().enumerate().filter(|(i, _)| *i != gone).flat_map(|(_, line)| line.to_vec()).collect()
}

/// Puts a hostile value somewhere into a tree.
fn spoil(value: &mut Value, random: &mut Random) {
    let inner = match value {
        Value::Array(items) if !items.is_empty() => {
            let index = random.below(items.len());
            Some(&mut items[index])
        }
        Value::Object(map) if !map.is_empty() => {
            let index = random.below(map.len());
            map.values_mut().nth(index)
        }
        _ => None,
    };
    match inner {
        Some(inner) if random.below(8) > 0 => spoil(inner, random),
        _ => {
            let hostile = [
                json!(0),
                json!(-1),
                json!(1e308),
                json!(1e-320),
                json!(1e16),
                json!(u64::MAX),
                json!(null),
                json!([]),
                json!({}),
                json!(""),
                json!("NaN"),
                json!("../../../etc/passwd"),
                json!([[[[]]]]),
            ];
            *value = hostile[random.below(hostile.len())].clone();
        }
    }
}

/// A setting of a twin with a hostile value.
fn setting(random: &mut Random) -> String {
    format!("{}={}", SETTINGS[random.below(SETTINGS.len())], HOSTILE_VALUES[random.below(HOSTILE_VALUES.len())])
}

fn words(command: &[&str], more: &[&str]) -> Vec<String> {
    let threads = ["--threads", "1"];
    command.iter().chain(more).chain(&threads).map(|word| (*word).to_owned()).collect()
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// All files below a folder, in order.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    for path in entries.map(|entry| entry.path()) {
        if path.is_dir() { found.extend(files(&path)) } else { found.push(path) }
    }
    found.sort();
    found
}

fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    files(folder).into_iter().map(|path| (path.clone(), fs::read(path).unwrap_or_default())).collect()
}

/// Copies what a folder holds.
pub(crate) fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a folder");
    for path in files(from) {
        let target = to.join(path.strip_prefix(from).expect("inside"));
        fs::create_dir_all(target.parent().expect("a parent")).expect("a folder");
        fs::copy(path, target).expect("copied");
    }
}

/// The small scenes of the readers' tests, one of each format.
pub(crate) fn scenes() -> Vec<Target> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../gic-scene/tests/data");
    let formats = ["blender", "colmap_binary", "colmap_text", "nerfstudio", "pac_nerf", "real_capture", "spring_gaus"];
    formats.map(|format| Target::Scene(data.join(format))).to_vec()
}

/// A run of a small scene whose reconstruction is finished, in `folder`.
pub(crate) fn run(gic: &Path, folder: &Path) -> Target {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../gic-scene/tests/data/pac_nerf");
    let (scene, run) = (folder.join("scene"), folder.join("run"));
    copy(&data, &scene);
    let flags: Vec<String> = ["--steps", "2", "--threads", "1"].map(String::from).to_vec();
    let mut args = vec!["reconstruct".into(), text(&scene), "-o".into(), text(&run)];
    args.extend(flags.iter().cloned());
    let made = answer(gic, &args).expect("gic runs");
    assert_eq!(made.code, 0, "{}", made.message);
    Target::Run(folder.to_owned(), flags)
}

/// A small twin of particles and its motion, in `folder`.
pub(crate) fn twin(gic: &Path, folder: &Path) -> Target {
    let file = |name: &str| folder.join(name);
    let mut twin = json!({
        "schema": "gic.twin/1",
        "material": {"model": "elastic", "youngs_modulus_pa": 1e5, "poisson_ratio": 0.3},
        "initial_velocity_m_s": [0.0, -2.0, 0.0],
        "colliders": [{"shape": "half_space", "point_m": [0, 0, 0], "normal": [0, 1, 0], "contact": "sticky"}],
        "grid_spacing_m": 0.04,
        "frames": 3,
        "continuum": {"shape": "box", "size_m": [0.12, 0.12, 0.12], "centre_m": [0.0, 0.2, 0.0]}
    });
    let simulate = |twin: &Value, out: &str| {
        fs::write(file("twin.json"), twin.to_string()).expect("a twin");
        let made = answer(gic, &words(&["simulate", &text(&file("twin.json")), "-o", &text(&file(out))], &[]));
        let made = made.expect("gic runs");
        assert_eq!(made.code, 0, "{}", made.message);
    };
    simulate(&twin, "first");
    fs::copy(file("first/particles_0000.ply"), file("matter.ply")).expect("copied");
    fs::remove_dir_all(file("first")).expect("removed");
    twin["continuum"] = "matter.ply".into();
    twin["particle_spacing_m"] = 0.02.into();
    simulate(&twin, "frames");
    Target::Twin(folder.to_owned())
}

/// A run of the bundled scene through all stages, far from converged, in `folder`: minutes.
pub(crate) fn whole_run(gic: &Path, folder: &Path) -> Target {
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("demo");
    let (scene, run) = (text(&scene), text(&folder.join("run")));
    let mut command = Command::new(gic);
    command.args(["run", &scene, "-o", &run, "--material", "elastic", "--steps", "400", "--cameras", "0,1,2,3,4,6"]);
    let ended = command.stdout(Stdio::null()).stderr(Stdio::null()).status().expect("gic runs");
    assert!(ended.success());
    Target::WholeRun(folder.to_owned())
}
