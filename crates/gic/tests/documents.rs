//! What the documents say of settings is true of them.

use std::path::{Path, PathBuf};

use gic::config::{Config, Layer};

const STAGES: [&str; 6] = ["scene", "reconstruct", "register", "fill", "identify", "appearance"];

/// All documents of the repository.
fn documents() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut files = vec![root.join("crates/gic-scene/CONVENTIONS.md")];
    let mut folders = vec![root.clone()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder").map(|entry| entry.expect("an entry").path()) {
            if entry.is_dir() && entry.starts_with(root.join("docs")) | (entry == root.join("docs")) {
                folders.push(entry);
            } else if entry.extension().is_some_and(|extension| extension == "md") {
                files.push(entry);
            }
        }
    }
    files
}

/// `key = value` in a piece of code, with or without spaces; a key may have a path.
fn assignment(code: &str) -> Option<(&str, &str)> {
    let (key, value) = code.split_once('=')?;
    let (key, value) = (key.trim(), value.trim());
    let is_key = |key: &str| key.starts_with(|c: char| c.is_ascii_lowercase());
    let known = key.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || "_.".contains(c));
    (is_key(key) && known && !value.is_empty()).then_some((key, value))
}

/// The assignments in a line: in code spans, and after `--set`.
fn assignments(line: &str) -> Vec<(&str, &str)> {
    let spans = line.split('`').skip(1).step_by(2);
    let words = line.split("--set ").skip(1).filter_map(|rest| rest.split_whitespace().next());
    let words = words.map(|word| word.trim_matches(|c| "`'\"".contains(c)));
    spans.chain(words).filter_map(assignment).collect()
}

fn set(key: &str, value: &str) -> gic::Result<Config> {
    Config::resolve(vec![Layer::from_assignments([format!("{key}={value}").as_str()])?])
}

/// A line that says `default` states the default; any other says what to change, which then changes something.
#[test]
fn keys_and_values_in_documents_are_those_of_the_settings() {
    let mut seen = 0;
    for file in documents() {
        let text = std::fs::read_to_string(&file).expect("a document");
        for (number, line) in text.lines().enumerate() {
            for (key, value) in assignments(line) {
                let place = format!("{}:{}: {key} = {value}", file.display(), number + 1);
                let stage = key.split('.').next().unwrap_or_default();
                let config = if STAGES.contains(&stage) || key == "seed" {
                    set(key, value).unwrap_or_else(|error| panic!("{place}: {error}"))
                } else {
                    // A key without its stage; most such names are no settings.
                    let found = STAGES.iter().find_map(|stage| set(&format!("{stage}.{key}"), value).ok());
                    let Some(config) = found else { continue };
                    config
                };
                seen += 1;
                assert_eq!(config == Config::default(), line.contains("default"), "{place}");
            }
        }
    }
    assert!(seen > 0, "no document names a setting");
}

#[test]
fn assignments_are_found_in_text() {
    let found =
        assignments("turn it off (`fill.symmetry = false`), or --set reconstruct.loss.scale=0; `y = 0` and `a == b`");
    assert_eq!(found[0], ("fill.symmetry", "false"));
    assert!(found.contains(&("reconstruct.loss.scale", "0;")) || found.contains(&("reconstruct.loss.scale", "0")));
}
