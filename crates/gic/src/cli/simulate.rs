//! `gic simulate`.

use std::path::{Path, PathBuf};

use gic_twin::simulate::{Companion, SimulationRequest, simulate};
use gic_twin::twin::Setting;
use serde_json::json;

use super::Context;
use super::args::SimulateArgs;

pub(crate) fn run(args: &SimulateArgs, context: &Context) -> anyhow::Result<()> {
    let companions = args.companions.iter().map(|c| Companion { twin: twin_file(&c.twin), shift_m: c.shift_m });
    let request = SimulationRequest {
        twin: twin_file(&args.twin),
        settings: settings(args)?,
        colliders: args.colliders.clone(),
        companions: companions.collect(),
        out: args.out.clone(),
        frames: args.frames,
        restart: args.restart,
    };
    let outcome = simulate(&request, &context.events, &context.interrupt)?;
    context.print(format!("{} frames of {} particles in {}", outcome.frames, outcome.particles, args.out.display()));
    Ok(())
}

/// A run folder stands for the twin in it.
pub(super) fn twin_file(path: &Path) -> PathBuf {
    if path.is_dir() { path.join("twin.json") } else { path.to_owned() }
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
