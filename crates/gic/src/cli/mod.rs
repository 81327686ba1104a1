//! The terminal's side: parse first, resolve once, run, report.

mod args;
mod flags;
mod gradcheck;
mod grasp;
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
use std::io::{ErrorKind, Write};
use std::path::PathBuf;

use clap::{CommandFactory, FromArgMatches};
use gic_twin::events::{Event, Events};
use gic_twin::{Interrupt, TwinError};
use gic_view::ViewError;

use crate::Error;
use args::{Cli, Command};
use flags::Given;

/// What a command needs from the outside.
pub(crate) struct Context {
    pub(crate) events: Events,
    pub(crate) interrupt: Interrupt,
    /// What the command line gives to the command.
    pub(crate) given: Given,
    /// The file to call for gic itself.
    pub(crate) program: PathBuf,
}

impl Context {
    /// Prints a result on stdout; `-q` does not silence results, only the way there.
    ///
    /// # Errors
    /// What the system says, such as that the disk is full; a closed pipe (`gic ... | head`) is no failure.
    pub(crate) fn print(&self, text: impl std::fmt::Display) -> crate::Result<()> {
        let mut out = std::io::stdout();
        match writeln!(out, "{text}").and_then(|()| out.flush()) {
            Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Error::Print { source: error }),
            _ => Ok(()),
        }
    }
}

/// Runs a command line, whose first word is the program's name, and returns the exit code: 0 done, 1 failed, 2 bad
/// usage, 130 interrupted. `program` is the file to call where a command calls gic again.
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
            report(&error);
            if error.chain().any(is_interrupt) { 130 } else { 1 }
        }
    }
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
    let context = Context { events, interrupt, given, program };
    let done = dispatch(cli.command, &context);
    if let Err(error) = &done {
        context.events.send(&Event::Failed { causes: error.chain().map(ToString::to_string).collect() });
    }
    done
}

fn dispatch(command: Command, context: &Context) -> anyhow::Result<()> {
    match command {
        Command::Demo(args) => results::demo(&args, context),
        Command::Inspect(args) => results::inspect(&args, context),
        Command::Report(args) => run::report(&args, context),
        Command::Eval(args) => results::eval(&args, context),
        Command::Bench(args) => results::bench(&args, context),
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

fn on_ctrl_c(interrupt: &Interrupt) -> anyhow::Result<()> {
    let interrupt = interrupt.clone();
    ctrlc::set_handler(move || {
        if interrupt.requested() {
            std::process::exit(130);
        }
        interrupt.request();
        eprintln!("\nstopping at the next safe point; press Ctrl-C again to stop at once");
    })?;
    Ok(())
}

/// Whether the user interrupted.
fn is_interrupt(error: &(dyn std::error::Error + 'static)) -> bool {
    error.downcast_ref::<Error>().is_some_and(Error::is_interrupt)
        || error.downcast_ref::<TwinError>().is_some_and(TwinError::is_interrupt)
        || error.downcast_ref::<ViewError>().is_some_and(ViewError::is_interrupt)
}

/// The way out of an error, where it knows one.
fn hint(error: &(dyn std::error::Error + 'static)) -> Option<String> {
    let pipeline = error.downcast_ref::<Error>().and_then(Error::hint);
    let twin = || error.downcast_ref::<TwinError>().and_then(TwinError::hint);
    let view = || error.downcast_ref::<ViewError>().and_then(ViewError::hint);
    pipeline.or_else(twin).or_else(view)
}

/// Prints an error, its causes and the way out on stderr.
fn report(error: &anyhow::Error) {
    let mut text = format!("error: {error}\n");
    let mut last = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        // Some libraries repeat their cause in their own message.
        if !last.contains(&cause) {
            text += &format!("  caused by: {cause}\n");
        }
        last = cause;
    }
    if let Some(hint) = error.chain().find_map(hint) {
        text += &format!("  hint: {hint}\n");
    }
    let _ = std::io::stderr().write_all(text.as_bytes());
}
