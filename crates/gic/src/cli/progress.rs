//! Events on the terminal: bars on stderr when it is a terminal, plain lines when it is not.

use std::collections::BTreeMap;
use std::io::IsTerminal;

use gic_twin::events::{Event, Sink};
use indicatif::{ProgressBar, ProgressStyle};

/// Values of a step by their names.
type Values = BTreeMap<String, f64>;

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

    fn step(&mut self, (stage, phase): (&str, &str), step: u64, of: Option<u64>, values: &Values) {
        if self.verbose {
            let of = of.map(|n| format!("/{n}")).unwrap_or_default();
            let values: Vec<String> = values.iter().map(|(name, v)| format!("{name} {}", short(*v))).collect();
            let gap = if phase.is_empty() { "" } else { " " };
            self.line(&format!("{stage}: {phase}{gap}{step}{of} {}", values.join(", ")));
        }
        if self.quiet || !self.terminal {
            return;
        }
        let name = if phase.is_empty() { stage } else { phase };
        // Phases count their own steps.
        if self.bar.as_ref().is_some_and(|bar| bar.prefix() != name) {
            self.end_bar();
        }
        let bar = self.bar.get_or_insert_with(|| {
            // What does not fit the line is cut off at its end, so what matters most stands first.
            let template = match of {
                Some(_) => "{prefix:>10} {bar:12} {pos}/{len} {wide_msg}",
                None => "{prefix:>10} {spinner} {pos} {wide_msg}",
            };
            let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
            ProgressBar::new(of.unwrap_or(0)).with_style(style).with_prefix(name.to_owned())
        });
        if let Some(of) = of {
            bar.set_length(of);
        }
        let left = seconds_left(values, (step, of), bar.elapsed().as_secs_f64());
        bar.set_message(in_words(left, values));
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
            Event::Step { stage, phase, step, of, values } => self.step((stage, phase), *step, *of, values),
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

/// The one estimate of the time left [s]: what the stage says, else what its pace so far says.
fn seconds_left(values: &Values, (step, of): (u64, Option<u64>), elapsed: f64) -> Option<f64> {
    let by_pace = || of.filter(|_| step > 0).map(|of| elapsed / step as f64 * of.saturating_sub(step) as f64);
    values.get("seconds_left").copied().or_else(by_pace)
}

/// What a step says, in words, the most important first: "35 s left, 28.4 dB, 1,702 Gaussians".
fn in_words(left: Option<f64>, values: &Values) -> String {
    let value = |name: &str| values.get(name).copied();
    let mut words = Vec::new();
    words.extend(left.map(|seconds| match seconds {
        0.0..90.0 => format!("{seconds:.0} s left"),
        _ => format!("{:.0} min left", seconds / 60.0),
    }));
    words.extend(value("psnr_db").map(|psnr| format!("{psnr:.1} dB")));
    words.extend(value("gaussians").map(|count| format!("{} Gaussians", grouped(count as u64))));
    words.extend(value("volume_m3").map(|volume| format!("{:.3} litres", 1e3 * volume)));
    words.extend(value("objective").map(|objective| format!("objective {}", short(objective))));
    words.extend(value("rollouts").map(|count| format!("{} rollouts", grouped(count as u64))));
    words.join(", ")
}

/// A count with commas between thousands.
fn grouped(count: u64) -> String {
    gic_view::units::grouped(&count.to_string())
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_told_in_words_that_fit_sixty_columns() {
        let values = [("loss", 0.1), ("psnr_db", 28.43), ("gaussians", 1702.0), ("seconds_left", 35.2)];
        let values = Values::from(values.map(|(name, value)| (name.to_owned(), value)));
        let left = seconds_left(&values, (10, Some(1200)), 5.0);
        assert_eq!(in_words(left, &values), "35 s left, 28.4 dB, 1,702 Gaussians");
        let line = format!("{:>10} {:12} 1150/1200 {}", "tracking", "", "35 s left, 28.4 dB");
        assert!(line.len() <= 60, "{line}");
    }

    #[test]
    fn the_pace_tells_what_no_stage_says() {
        assert_eq!(seconds_left(&Values::new(), (3, Some(12)), 6.0), Some(18.0));
        assert_eq!(seconds_left(&Values::new(), (3, None), 6.0), None);
        assert_eq!(
            in_words(Some(600.0), &Values::from([("objective".to_owned(), 3.25)])),
            "10 min left, objective 3.25"
        );
        assert_eq!(["999", "1,000", "12,345,678"], [999, 1_000, 12_345_678].map(grouped).each_ref().map(|s| &s[..]));
    }
}
