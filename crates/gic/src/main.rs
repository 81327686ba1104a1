//! The command `gic`.

use std::process::ExitCode;

use mimalloc::MiMalloc;

/// Pictures and gradients are allocated in every step of training: an allocator that hands large blocks back to the
/// system each time spends a quarter of a step on getting them again.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

fn main() -> ExitCode {
    let program = std::env::current_exe().unwrap_or_else(|_| "gic".into());
    ExitCode::from(gic::cli::main(std::env::args_os(), program))
}
