//! What the tests of the program share.

use std::process::{Command, Output};

/// Runs gic.
pub(crate) fn gic(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gic")).args(args).output().expect("the binary starts")
}
