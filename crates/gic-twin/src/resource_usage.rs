//! What a stage costs: wall-clock time, CPU time, peak memory.

use std::time::Instant;

use crate::events::Event;

/// Clock ticks per second of `/proc/self/stat`, fixed in Linux's interface to programs.
const TICKS_PER_SECOND: f64 = 100.0;

/// Measures from its start on.
pub struct ResourceMeter {
    start: Instant,
    cpu_start: Option<f64>,
}

impl ResourceMeter {
    /// Starts measuring; the system's mark of peak memory starts anew, where it lets us.
    pub fn start() -> Self {
        // Linux: "5" resets the peak. Elsewhere, and where it is forbidden, the peak is that of the whole process.
        let _ = std::fs::write("/proc/self/clear_refs", "5");
        Self { start: Instant::now(), cpu_start: cpu_seconds() }
    }

    /// Wall-clock seconds since the start.
    pub fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// The event that ends a stage.
    pub fn done(&self, stage: &str) -> Event {
        Event::StageDone {
            stage: stage.into(),
            seconds: self.seconds(),
            cpu_seconds: cpu_seconds().zip(self.cpu_start).map(|(now, start)| now - start),
            peak_memory_bytes: peak_memory_bytes(),
        }
    }
}

/// CPU seconds of this process over all threads so far, where the system tells.
fn cpu_seconds() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The second field is the program's name in parentheses and may hold blanks; user and system time are fields 14 and
    // 15.
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(11);
    let ticks: f64 = fields.next()?.parse::<f64>().ok()? + fields.next()?.parse::<f64>().ok()?;
    Some(ticks / TICKS_PER_SECOND)
}

/// Peak resident memory [bytes], where the system tells.
fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    line.split_whitespace().next()?.parse::<u64>().ok().map(|kib| kib * 1024)
}
