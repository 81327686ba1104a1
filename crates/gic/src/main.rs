//! The command `gic`.

mod cli;

use std::process::ExitCode;

use mimalloc::MiMalloc;

/// Pictures and gradients are allocated in every step of training: an allocator that hands large blocks back to the
/// system each time spends a quarter of a step on getting them again.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

fn main() -> ExitCode {
    cli::main()
}
