//! The module in the repository is of the sources beside it.

use std::fs;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

/// The crates that the module is made of.
const CRATES: [&str; 3] = ["gic-live", "gic-mpm", "gic-simd"];

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|ending| ending == "rs") && !path.ends_with("tests.rs") {
            found.push(path);
        }
    }
}

/// Code of a file: without comments of whole lines, indentation, and the tests at its end.
fn code(text: &str) -> impl Iterator<Item = &str> {
    let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    code.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with("//"))
}

fn hash() -> String {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let mut files = Vec::new();
    CRATES.iter().for_each(|name| sources(&crates.join(name).join("src"), &mut files));
    files.sort();
    let mut hash = Sha256::new();
    for file in files {
        hash.update(file.strip_prefix(crates).unwrap().to_string_lossy().as_bytes());
        code(&fs::read_to_string(&file).unwrap()).for_each(|line| hash.update(line.as_bytes()));
    }
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn the_module_is_of_these_sources() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../gic-view/src/page/live/gic_live.sources.sha256");
    if std::env::var_os("GIC_LIVE_WRITE_HASH").is_some() {
        fs::write(&file, hash() + "\n").unwrap();
    }
    let written = fs::read_to_string(&file).unwrap();
    assert_eq!(written.trim(), hash(), "gic-live, gic-mpm or gic-simd has changed: run scripts/build_live.sh");
}
