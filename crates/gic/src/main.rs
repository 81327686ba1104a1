//! The command `gic`.
fn main() {}
