//! What a stage costs: wall-clock time, CPU time, peak memory.

use std::time::Instant;

use crate::events::Event;

/// Measures from its start on.
pub struct ResourceMeter {
    start: Instant,
    cpu_start: Option<f64>,
}

impl ResourceMeter {
    /// Starts measuring; where the system allows it, the mark of peak memory starts anew.
    pub fn start() -> Self {
        // Linux: "5" resets the peak. Where that is not possible, the peak is that of the whole process.
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

/// Memory [bytes] that programs can take, where the system tells (Linux).
pub fn available_memory_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024)
}

#[cfg(unix)]
fn usage() -> Option<nix::sys::resource::Usage> {
    nix::sys::resource::getrusage(nix::sys::resource::UsageWho::RUSAGE_SELF).ok()
}

/// CPU seconds of this process over all threads so far.
#[cfg(unix)]
fn cpu_seconds() -> Option<f64> {
    use nix::sys::time::TimeValLike;
    usage().map(|usage| 1e-6 * (usage.user_time() + usage.system_time()).num_microseconds() as f64)
}

/// Peak resident memory [bytes].
#[cfg(unix)]
fn peak_memory_bytes() -> Option<u64> {
    let unit = if cfg!(target_vendor = "apple") { 1 } else { 1024 };
    u64::try_from(usage()?.max_rss()).ok().map(|peak| peak * unit)
}

#[cfg(not(unix))]
fn cpu_seconds() -> Option<f64> {
    None
}

#[cfg(not(unix))]
fn peak_memory_bytes() -> Option<u64> {
    None
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn work_and_memory_are_counted() {
        let meter = ResourceMeter::start();
        let block = std::hint::black_box(vec![1u8; 64 << 20]);
        while cpu_seconds().unwrap() < meter.cpu_start.unwrap() + 0.02 {
            std::hint::black_box(block.iter().map(|&b| u64::from(b)).sum::<u64>());
        }
        let Event::StageDone { cpu_seconds, peak_memory_bytes, .. } = meter.done("test") else {
            panic!("a stage ends with StageDone")
        };
        assert!(cpu_seconds.unwrap() >= 0.02, "{cpu_seconds:?}");
        assert!((64 << 20..1 << 40).contains(&peak_memory_bytes.unwrap()), "{peak_memory_bytes:?}");
    }
}
