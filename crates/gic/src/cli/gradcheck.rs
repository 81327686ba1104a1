//! `gic gradcheck`: the simulator's adjoint against finite differences in f64, per parameter.

use anyhow::Context as _;
use gic_mpm::{GRADCHECK_TOLERANCE, Rules, gradcheck, gradcheck_materials, gradcheck_world};

use super::Context;
use super::args::GradcheckArgs;

/// Frames of the checked rollout, the initial state included.
const FRAMES: usize = 2;

pub(crate) fn run(args: &GradcheckArgs, context: &Context) -> anyhow::Result<()> {
    context.print(format!(
        "{:<14} {:<30} {:>12} {:>16} {:>16} {:>10}",
        "material", "derivative with respect to", "value", "adjoint", "differences", "rel. error"
    ))?;
    let (mut rows, mut failures) = (0, 0);
    let wanted = |model: &str| args.material.is_none_or(|wanted| wanted.name() == model);
    for material in gradcheck_materials().into_iter().filter(|material| wanted(material.model())) {
        for row in gradcheck(&gradcheck_world(material), Rules::Exact, FRAMES).context("gradient check")? {
            let verdict = if row.passes() { "" } else { "  FAILS" };
            context.print(format!(
                "{:<14} {:<30} {:>12.5e} {:>16.9e} {:>16.9e} {:>10.1e}{verdict}",
                material.model(),
                row.name,
                row.value,
                row.adjoint,
                row.finite_difference,
                row.relative_error
            ))?;
            rows += 1;
            failures += usize::from(!row.passes());
        }
    }
    anyhow::ensure!(failures == 0, "{failures} of {rows} derivatives differ by more than {GRADCHECK_TOLERANCE:e}");
    context.print(format!("all {rows} derivatives agree within {GRADCHECK_TOLERANCE:e}"))?;
    Ok(())
}
