//! What a simulation may take, and what it will.

use gic_mpm::{Budget, Forecast, SimulationError};

use crate::resource_usage::available_memory_bytes;

/// The budget of an ordinary call: a day, and the memory that the machine has left.
pub fn usual_budget() -> Budget {
    let usual = Budget::default();
    let memory_bytes = available_memory_bytes().map_or(usual.memory_bytes, |bytes| bytes as f64);
    Budget { memory_bytes, ..usual }
}

/// A forecast in words.
pub fn forecast_in_words(forecast: &Forecast) -> String {
    format!("about {} on one core and {:.2} GB", duration(forecast.seconds), forecast.memory_bytes / 1e9)
}

fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 90.0 => format!("{:.0} s", s.max(1.0)),
        s if s < 5400.0 => format!("{:.0} minutes", s / 60.0),
        s => format!("{:.1} hours", s / 3600.0),
    }
}

/// The way out where a simulation is over its budget.
pub fn over_budget_hint(error: &SimulationError) -> Option<String> {
    let SimulationError::OverBudget { .. } = error else { return None };
    Some("let it take more with --budget-hours and --budget-gb, or make it smaller".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_told_in_the_unit_that_suits_them() {
        assert_eq!([0.2, 60.0, 600.0, 36_000.0].map(duration), ["1 s", "60 s", "10 minutes", "10.0 hours"]);
    }

    #[test]
    fn the_usual_budget_is_a_day_and_some_memory() {
        let Budget { memory_bytes, seconds } = usual_budget();
        assert!(memory_bytes > 1e6 && seconds == 86_400.0);
    }
}
