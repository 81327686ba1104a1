//! `gic grasp`.

use std::path::Path;

use gic_grasp::{GraspRequest, Gripper, grasp};

use super::Context;
use super::args::GraspArgs;
use super::simulate::{budget, inputs_of};
use crate::Error;
use crate::pipeline::twin_file;

pub(crate) fn run(args: &GraspArgs, context: &Context) -> anyhow::Result<()> {
    let twin = twin_file(&args.twin)?;
    let beside = || twin.parent().unwrap_or(Path::new("")).join("grasp");
    let out = args.out.clone().unwrap_or_else(beside);
    let request = GraspRequest {
        settings: args.set.clone(),
        widths_m: args.width_m.clone(),
        axis: args.axis,
        gripper: Gripper { pad_m: args.pad.0, friction: args.friction, lift_m: args.lift_m },
        refine: args.refine,
        pictures: !args.no_pictures,
        size: args.size,
        budget: budget(args.budget),
        film: args.film.clone().unwrap_or_else(|| out.join("grasp.gif")),
        out,
        twin,
    };
    let inputs = inputs_of(std::iter::once(&request.twin));
    inputs.allow_folder(&request.out, &["grasp", "width_"])?;
    inputs.allow_file(&request.film)?;
    let report = grasp(&request, &context.events, &context.interrupt).map_err(Error::from)?;
    context.print(report.table())?;
    context.print(format!("results in {}", request.out.display()))?;
    Ok(())
}
