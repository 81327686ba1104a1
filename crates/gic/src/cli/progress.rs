//! Events on the terminal: bars on stderr when it is a terminal, plain lines when it is not.

use std::io::IsTerminal;

use gic_twin::events::{Event, Sink};
use indicatif::{ProgressBar, ProgressStyle};

pub(crate) struct Progress {
    quiet: bool,
    verbose: bool,
    terminal: bool,
    bar: Option<ProgressBar>,
}

impl Progress {
    pub(crate) fn new(quiet: bool, verbose: bool) -> Self {
        Self { quiet, verbose, terminal: std::io::stderr().is_terminal(), bar: None }
    }

    /// Prints a line above the bar.
    fn line(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| eprintln!("{text}")),
            None => eprintln!("{text}"),
        }
    }

    fn step(&mut self, stage: &str, phase: &str, step: u64, of: Option<u64>, values: &str) {
        if self.verbose {
            let of = of.map(|n| format!("/{n}")).unwrap_or_default();
            self.line(&format!("{stage}: {phase}{}{step}{of} {values}", if phase.is_empty() { "" } else { " " }));
        }
        if self.quiet || !self.terminal {
            return;
        }
        let bar = self.bar.get_or_insert_with(|| {
            let template = match of {
                Some(_) => "{prefix:>12} {wide_bar} {pos}/{len} {msg} {eta}",
                None => "{prefix:>12} {spinner} {pos} {wide_msg}",
            };
            let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
            ProgressBar::new(of.unwrap_or(0)).with_style(style)
        });
        if let Some(of) = of {
            bar.set_length(of);
        }
        bar.set_prefix(if phase.is_empty() { stage.to_owned() } else { phase.to_owned() });
        bar.set_message(values.to_owned());
        bar.set_position(step);
    }

    fn end_bar(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }
}

impl Sink for Progress {
    fn receive(&mut self, event: &Event) {
        match event {
            Event::Started { .. } => (),
            Event::StageStarted { .. } if self.bar.is_some() => {
                self.end_bar();
                self.receive(event);
            }
            Event::StageStarted { stage, reason } if !self.quiet => self.line(&format!("{stage}: {reason}")),
            Event::StageSkipped { stage, reason } if !self.quiet => {
                self.line(&format!("{stage}: {reason}, nothing to do"))
            }
            Event::StageStarted { .. } | Event::StageSkipped { .. } => (),
            Event::Step { stage, phase, step, of, values } => {
                let values: Vec<String> = values.iter().map(|(name, v)| format!("{name} {}", short(*v))).collect();
                self.step(stage, phase, *step, *of, &values.join(", "));
            }
            Event::Note { stage, text } if !self.quiet => self.line(&format!("{stage}: {text}")),
            Event::Note { .. } => (),
            Event::Warning { stage, text } => self.line(&format!("warning: {stage}: {text}")),
            Event::StageDone { stage, seconds, .. } => {
                self.end_bar();
                if !self.quiet {
                    self.line(&format!("{stage}: done in {seconds:.1} s"));
                }
            }
            Event::Failed { .. } => self.end_bar(),
        }
    }
}

/// A number in few characters.
fn short(value: f64) -> String {
    if value == 0.0 || (1e-2..1e4).contains(&value.abs()) {
        let text = format!("{value:.3}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        format!("{value:.3e}")
    }
}
