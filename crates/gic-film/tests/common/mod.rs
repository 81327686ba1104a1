//! Films that ffmpeg makes; without it, tests say that they are skipped.

#![allow(dead_code)]

use std::io::Write;
use std::path::Path;
use std::process::Command;

/// Whether ffmpeg is there; says so where it is not.
pub(crate) fn has_ffmpeg() -> bool {
    let found = Command::new("ffmpeg").arg("-version").output().is_ok();
    if !found {
        // Past the capture of the test harness: a skip must be seen.
        let _ = writeln!(std::io::stderr(), "SKIPPED: ffmpeg is not installed");
    }
    found
}

/// Runs ffmpeg.
pub(crate) fn ffmpeg(arguments: &[&str], out: &Path) {
    let done = Command::new("ffmpeg").args(["-v", "error", "-y"]).args(arguments).arg(out).output().expect("ffmpeg");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
}
