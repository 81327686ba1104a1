//! `log.jsonl`: every event as a line of JSON, with the time since the command began.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::Instant;

use gic_files::FileError;
use gic_twin::events::{Event, Sink};
use serde::Serialize;

use crate::error::Result;

pub(super) struct Log {
    file: BufWriter<File>,
    start: Instant,
}

#[derive(Serialize)]
struct Line<'a> {
    /// Time since the command began [s]; events have fields of their own, such as `seconds`.
    elapsed_s: f64,
    #[serde(flatten)]
    event: &'a Event,
}

impl Log {
    /// Appends to what earlier commands wrote.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let file = OpenOptions::new().create(true).append(true).open(path).map_err(FileError::write(path))?;
        Ok(Self { file: BufWriter::new(file), start: Instant::now() })
    }
}

impl Sink for Log {
    fn receive(&mut self, event: &Event) {
        let elapsed_s = (self.start.elapsed().as_secs_f64() * 1000.0).round() / 1000.0;
        // A full disk shows up where results are written; the log must not end the run.
        if let Ok(text) = gic_twin::json::text(&Line { elapsed_s, event }) {
            let _ = writeln!(self.file, "{text}").and_then(|()| self.file.flush());
        }
    }
}
