//! `gic simulate`.

use std::path::PathBuf;

use gic_mpm::Budget;
use gic_twin::simulate::{Companion, Scenario, SimulationRequest, simulate, usual_budget};
use gic_twin::twin::{MatterSource, Setting, Twin};
use serde_json::json;

use super::Context;
use super::args::{BudgetArgs, SimulateArgs};
use crate::outputs::Inputs;
use crate::pipeline::twin_file;

pub(crate) fn run(args: &SimulateArgs, context: &Context) -> anyhow::Result<()> {
    let mut companions = Vec::new();
    for companion in &args.companions {
        companions.push(Companion { twin: twin_file(&companion.twin)?, shift_m: companion.shift_m });
    }
    let twin = twin_file(&args.twin)?;
    let twins = std::iter::once(&twin).chain(companions.iter().map(|companion| &companion.twin));
    let inputs = args.colliders.iter().fold(inputs_of(twins), |inputs, file| inputs.file(file));
    inputs.allow_folder(&args.out, &["particles_", "trajectory.json"])?;
    let obstacles = args.colliders.as_deref().map(Twin::read_obstacles).transpose()?.unwrap_or_default();
    let request = SimulationRequest {
        scenario: Scenario { twin, settings: settings(args)?, obstacles, companions },
        out: args.out.clone(),
        frames: args.frames,
        restart: args.restart,
        budget: budget(args.budget),
    };
    let outcome = simulate(&request, &context.events, &context.interrupt)?;
    context.print(format!("{} frames of {} particles in {}", outcome.frames, outcome.particles, args.out.display()))?;
    Ok(())
}

/// The files of some twins and of their matter. What cannot be read is told by who reads it.
pub(super) fn inputs_of<'a>(twins: impl Iterator<Item = &'a PathBuf>) -> Inputs {
    twins.fold(Inputs::default(), |inputs, file| match Twin::read(file, &[]).map(|twin| twin.continuum) {
        Ok(MatterSource::File(matter)) => inputs.file(file).file(&matter),
        _ => inputs.file(file),
    })
}

/// The usual budget with what the flags say.
pub(super) fn budget(args: BudgetArgs) -> Budget {
    let usual = usual_budget();
    Budget {
        seconds: args.budget_hours.map_or(usual.seconds, |hours| 3600.0 * hours),
        memory_bytes: args.budget_gb.map_or(usual.memory_bytes, |gb| 1e9 * gb),
    }
}

/// The settings of the flags that stand for one, then those of `--set`.
fn settings(args: &SimulateArgs) -> anyhow::Result<Vec<Setting>> {
    let mut settings = Vec::new();
    if let Some(model) = args.material {
        settings.push(Setting { path: vec!["material".into(), "model".into()], value: json!(model.name()) });
    }
    for (key, value) in [("gravity_m_s2", &args.gravity), ("initial_velocity_m_s", &args.velocity)] {
        if let Some(value) = value {
            settings.push(format!("{key}={value}").parse()?);
        }
    }
    settings.extend(args.set.iter().cloned());
    Ok(settings)
}
