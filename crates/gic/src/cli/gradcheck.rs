//! `gic gradcheck`.

use gic::gradcheck::{TOLERANCE, check, materials};

use super::Context;
use super::args::GradcheckArgs;

pub(crate) fn run(args: &GradcheckArgs, context: &Context) -> anyhow::Result<()> {
    context.print(format!(
        "{:<14} {:<30} {:>12} {:>16} {:>16} {:>10}",
        "material", "derivative with respect to", "value", "adjoint", "differences", "rel. error"
    ));
    let (mut rows, mut failures) = (0, 0);
    for material in materials().into_iter().filter(|m| args.material.is_none_or(|wanted| wanted.name() == m.model())) {
        for row in check(material)? {
            let verdict = if row.passes() { "" } else { "  FAILS" };
            context.print(format!(
                "{:<14} {:<30} {:>12.5e} {:>16.9e} {:>16.9e} {:>10.1e}{verdict}",
                row.model, row.name, row.value, row.adjoint, row.difference, row.error
            ));
            rows += 1;
            failures += usize::from(!row.passes());
        }
    }
    anyhow::ensure!(failures == 0, "{failures} of {rows} derivatives differ by more than {TOLERANCE:e}");
    context.print(format!("all {rows} derivatives agree within {TOLERANCE:e}"));
    Ok(())
}
