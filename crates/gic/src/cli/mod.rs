//! The terminal's side: parse first, resolve once, run, report.

mod args;
mod bench;
mod calibrate;
mod context;
mod flags;
mod gradcheck;
mod grasp;
mod import;
mod progress;
mod render;
mod results;
mod run;
mod simulate;
#[cfg(test)]
mod tests;
mod values;
mod view;

use std::ffi::OsString;
use std::io::Write;
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::Duration;

use clap::{CommandFactory, FromArgMatches};
use gic_twin::Interrupt;
use gic_twin::events::{Event, Events};

use crate::Explanation;
use args::{Cli, Command};
pub(crate) use context::Context;
use context::Output;
use flags::Given;

/// Runs a command line, whose first word is the program's name, and returns the exit code: 0 done, 1 failed, 2 bad
/// usage or settings, 130 interrupted. `program` is the file to call where a command calls gic again.
///
/// Takes over Ctrl-C and the number of threads: for processes that do nothing else.
pub fn main(words: impl IntoIterator<Item = OsString>, program: PathBuf) -> u8 {
    let (cli, given) = match parse(words) {
        Ok(parsed) => parsed,
        Err(error) => {
            // Where nobody listens, nobody can be told.
            let _ = error.print();
            return error.exit_code() as u8;
        }
    };
    match execute(cli, given, program) {
        Ok(()) => 0,
        Err(error) => {
            let explanation = Explanation::of(&error);
            report(&explanation);
            match explanation {
                Explanation { is_interrupt: true, .. } => 130,
                Explanation { is_usage: true, .. } => 2,
                _ => 1,
            }
        }
    }
}

/// Runs a command line, whose first word is the program's name, inside another program: returns what the terminal would
/// show on stdout; events and interrupts are the caller's, `--threads` holds for this call, and `gic bench` finds the
/// program in the path.
///
/// # Errors
/// [`clap::Error`] for bad usage, else that of the command.
pub fn call(words: impl IntoIterator<Item = OsString>, events: Events, interrupt: Interrupt) -> anyhow::Result<String> {
    let (cli, given) = match parse(words) {
        // Help and version are results, too.
        Err(asked) if !asked.use_stderr() => return Ok(asked.to_string()),
        parsed => parsed?,
    };
    gic_simd::Level::from_env()?;
    let output = Output::Text(Mutex::default());
    let threads = cli.global.threads;
    let context = Context { events, interrupt, given, program: "gic".into(), threads, output };
    match threads {
        Some(threads) => {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
            pool.install(|| dispatch(cli.command, &context))?;
        }
        None => dispatch(cli.command, &context)?,
    }
    Ok(context.output.into_text())
}

fn parse(words: impl IntoIterator<Item = OsString>) -> Result<(Cli, Given), clap::Error> {
    let matches = Cli::command().try_get_matches_from(words)?;
    let given = matches.subcommand().map(|(_, command)| Given::to(command)).unwrap_or_default();
    Ok((Cli::from_arg_matches(&matches)?, given))
}

fn execute(cli: Cli, given: Given, program: PathBuf) -> anyhow::Result<()> {
    if let Some(threads) = cli.global.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
    }
    gic_simd::Level::from_env()?;
    let interrupt = Interrupt::default();
    on_ctrl_c(&interrupt)?;
    let events = Events::default();
    events.add(progress::Progress::new(cli.global.quiet, cli.global.verbose));
    let threads = cli.global.threads;
    dispatch(cli.command, &Context { events, interrupt, given, program, threads, output: Output::Stdout })
}

fn dispatch(command: Command, context: &Context) -> anyhow::Result<()> {
    let done = run_command(command, context);
    if let Err(error) = &done {
        context.events.send(&Event::Failed { causes: error.chain().map(ToString::to_string).collect() });
    }
    done
}

fn run_command(command: Command, context: &Context) -> anyhow::Result<()> {
    match command {
        Command::Demo(args) => results::demo(&args, context),
        Command::Import(args) => import::run(&args, context),
        Command::Calibrate(args) => calibrate::run(&args, context),
        Command::Masks(args) => import::masks(&args, context),
        Command::Inspect(args) => results::inspect(&args, context),
        Command::Report(args) => run::report(&args, context),
        Command::Eval(args) => results::eval(&args, context),
        Command::Bench(args) => bench::run(&args, context),
        Command::Export(args) => run::export(&args, context),
        Command::Run(args) => run::run(&args, context),
        Command::Reconstruct(args) => run::reconstruct(&args, context),
        Command::Register(args) => run::register(&args, context),
        Command::Fill(args) => run::fill(&args, context),
        Command::Identify(args) => run::identify(&args, context),
        Command::Simulate(args) => simulate::run(&args, context),
        Command::Render(args) => render::run(&args, context),
        Command::View(args) => view::run(&args, context),
        Command::Grasp(args) => grasp::run(&args, context),
        Command::Gradcheck(args) => gradcheck::run(&args, context),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "gic", &mut script);
            context.print(String::from_utf8_lossy(&script).trim_end())?;
            Ok(())
        }
    }
}

/// How long a command may take to stop at a safe point. After it the process ends wherever it is: files are written
/// whole or not at all, so nothing that was finished is lost.
const GRACE: Duration = Duration::from_millis(1_800);

fn on_ctrl_c(interrupt: &Interrupt) -> anyhow::Result<()> {
    let interrupt = interrupt.clone();
    ctrlc::set_handler(move || {
        if interrupt.requested() {
            std::process::exit(130);
        }
        interrupt.request();
        eprintln!("\nstopping; press Ctrl-C again to stop at once");
        std::thread::spawn(|| {
            std::thread::sleep(GRACE);
            eprintln!("interrupted; what was finished is kept: run the same command again to go on from there");
            std::process::exit(130);
        });
    })?;
    Ok(())
}

/// Prints an error, its causes and the way out on stderr.
fn report(error: &Explanation) {
    let mut text = format!("error: {}\n", error.message);
    for cause in &error.causes {
        text += &format!("  caused by: {cause}\n");
    }
    if let Some(hint) = &error.hint {
        text += &format!("  hint: {hint}\n");
    }
    let _ = std::io::stderr().write_all(text.as_bytes());
}
