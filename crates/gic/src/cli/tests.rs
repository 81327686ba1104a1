//! Every flag of every command: accepted, told apart, and where it is a setting, found in the settings.

use clap::{Arg, ArgAction, Command as Clap, CommandFactory};
use toml::{Table, Value};

use super::args::{Cli, Command};
use super::flags::Given;
use crate::config::Config;

/// An output folder.
const OUT: [&str; 2] = ["--out", "some-name"];

/// All commands with a name, each with what has to be given besides its flags.
fn commands() -> Vec<(Clap, Vec<String>)> {
    let mut cli = Cli::command();
    cli.build();
    let needed = |command: &Clap| {
        let mut all = Vec::new();
        for arg in command.get_arguments().filter(|arg| arg.is_required_set()) {
            all.extend(arg.get_long().map(|name| format!("--{name}")));
            all.push(example(arg));
        }
        // Needed but for a few flags.
        if command.get_name() == "bench" {
            all.extend(OUT.map(String::from));
        }
        all
    };
    let named = cli.get_subcommands().filter(|command| command.get_name() != "help");
    named.map(|command| (command.clone(), needed(command))).collect()
}

/// A value that the argument accepts and that is not its default.
fn example(arg: &Arg) -> String {
    let defaults: Vec<_> = arg.get_default_values().iter().map(|value| value.to_string_lossy().into_owned()).collect();
    let choices = arg.get_possible_values();
    if let Some(other) = choices.iter().rev().find(|choice| !defaults.iter().any(|d| d == choice.get_name())) {
        return other.get_name().to_owned();
    }
    let name = arg.get_value_names().and_then(|names| names.first()).map_or("", |name| name.as_str());
    let value = match name {
        "N" | "N|orbit" => "7",
        "CAMERA" => "2,3",
        "M" | "MU" | "HEIGHT" | "RATIO" | "TIMES" | "W,..." => "0.0125",
        "HZ" | "KG_M3" | "KG" | "HOURS" | "GB" | "SECONDS" => "850.5",
        "K" => "3",
        "NAME=VALUE" => "poisson_ratio=0.25",
        "KEY=VALUE" => "reconstruct.loss.scale=0.5",
        "KEY=V,V" => "fill.levels=3,4",
        "BOARD" => "kalibr:6x6",
        "[CAMERA:]x0,y0,x1,y1" => "left:1,2,30,40",
        "X,Y,Z" => "1,2,-3",
        "TWIN@X,Y,Z" => "twin.json@1,2,-3",
        "WIDTHxHEIGHT" => "320x200",
        "WIDTHxLENGTH" => "0.03x0.04",
        "auto|x|y|z" => "y",
        _ => "some-name",
    };
    value.to_owned()
}

fn parse(words: &[String]) -> (Command, Given) {
    let parsed = super::parse(words.iter().map(Into::into));
    let (cli, given) = parsed.unwrap_or_else(|error| panic!("{words:?}: {error}"));
    (cli.command, given)
}

/// The settings that a command would run with.
fn settings(command: &Command, given: &Given) -> Option<Table> {
    let flags = match command {
        Command::Inspect(args) => args.flags(),
        Command::Run(args) => args.flags(),
        Command::Reconstruct(args) => args.flags(),
        Command::Register(args) => args.flags(),
        Command::Fill(args) => args.flags(),
        Command::Identify(args) => args.flags(),
        _ => return None,
    };
    let config = Config::resolve(flags.layers(given).expect("layers")).expect("resolved");
    Some(Table::try_from(config).expect("a table"))
}

/// Paths of the values in which two trees differ.
fn differences(path: &str, a: Option<&Value>, b: Option<&Value>, found: &mut Vec<String>) {
    if let (Some(Value::Table(a)), Some(Value::Table(b))) = (a, b) {
        for key in a.keys().chain(b.keys().filter(|key| !a.contains_key(*key))) {
            differences(&format!("{path}.{key}"), a.get(key), b.get(key), found);
        }
    } else if a != b {
        found.push(path.trim_start_matches('.').to_owned());
    }
}

fn changed(plain: Table, with: Table) -> Vec<String> {
    let mut found = Vec::new();
    differences("", Some(&Value::Table(plain)), Some(&Value::Table(with)), &mut found);
    found
}

#[test]
fn every_flag_is_accepted_and_those_of_settings_arrive() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("config.toml");
    std::fs::write(&file, "[fill]\nlevels = 3\n").expect("written");
    let mut settings_seen = 0;
    for (command, needed) in commands() {
        let base: Vec<String> = ["gic", command.get_name()].map(String::from).into_iter().chain(needed).collect();
        let flags = command.get_arguments().filter(|arg| !arg.is_positional() && !arg.is_required_set());
        for arg in flags.filter(|arg| !matches!(arg.get_id().as_str(), "help" | "version")) {
            let id = arg.get_id().as_str();
            let flag = format!("--{}", arg.get_long().expect("every flag has a long name"));
            if base.contains(&flag) {
                continue;
            }
            let mut words = base.clone();
            let without_out = command.get_arg_conflicts_with(arg).iter().any(|other| other.get_id() == "out");
            if words.ends_with(&OUT.map(String::from)) && without_out {
                words.truncate(words.len() - OUT.len());
            }
            words.push(flag);
            if matches!(arg.get_action(), ArgAction::Set | ArgAction::Append) {
                words.push(if id == "config" { file.to_string_lossy().into_owned() } else { example(arg) });
            }
            if arg.is_global_set() {
                parse(&words);
                continue;
            }
            let ((plain, none), (with, given)) = (parse(&base), parse(&words));
            assert_ne!(format!("{plain:?}"), format!("{with:?}"), "{words:?} changes nothing");
            if arg.get_help_heading().is_none() {
                continue;
            }
            settings_seen += 1;
            let found = changed(settings(&plain, &none).expect("settings"), settings(&with, &given).expect("settings"));
            let expected = match id {
                "schedule" => {
                    assert!(found.len() > 10 && found.iter().all(|key| key.starts_with("reconstruct.")), "{found:?}");
                    continue;
                }
                "config" => "fill.levels".to_owned(),
                "assignments" => "reconstruct.loss.scale".to_owned(),
                "no_appearance" => "appearance.enabled".to_owned(),
                "fix" => "identify.fix.poisson_ratio".to_owned(),
                key => {
                    found.first().filter(|path| path.split('.').next_back() == Some(key)).cloned().unwrap_or_default()
                }
            };
            assert_eq!(found, [expected], "{words:?}");
        }
    }
    assert!(settings_seen > 40, "only {settings_seen} flags are settings");
}

#[test]
fn flags_win_over_files_which_win_over_defaults_that_are_shown() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("config.toml");
    std::fs::write(&file, "[fill]\nlevels = 3\nsymmetry = false\nth_min = 0.4\n").expect("written");
    let file = file.to_str().expect("a path");
    let words = ["gic", "fill", "run", "--config", file, "--levels", "5", "--set", "fill.th_min=0.7"].map(String::from);
    let (command, given) = parse(&words);
    let fill = &settings(&command, &given).expect("settings")["fill"];
    assert_eq!((&fill["levels"], &fill["th_min"]), (&Value::Integer(5), &Value::Float(0.7)));
    assert_eq!(fill["symmetry"], Value::Boolean(false), "a flag that is not given leaves what the file says");
}

#[test]
fn help_has_no_links_of_the_documentation_and_no_default_typed_by_hand() {
    let mut cli = Cli::command();
    cli.build();
    for command in std::iter::once(&cli).chain(cli.get_subcommands()) {
        let text = command.clone().render_long_help().to_string();
        assert!(!text.contains("[`") && !text.contains("`]"), "gic {}: {text}", command.get_name());
        for arg in command.get_arguments() {
            let help = [arg.get_help(), arg.get_long_help()].into_iter().flatten().map(ToString::to_string);
            for stated in help.filter_map(|help| Some(help.split_once("[default: ")?.1.split_once(']')?.0.to_owned())) {
                let typed = stated.chars().any(|c| c.is_ascii_digit()) || !arg.get_default_values().is_empty();
                assert!(!typed, "gic {} --{}: {stated}", command.get_name(), arg.get_id());
            }
        }
    }
}
