//! Tasks on Slurm: an array job by a script that is kept in the output folder and can be read, changed and submitted by
//! hand.

use std::path::Path;
use std::process::Command;

use gic_twin::atomic;
use gic_twin::events::Events;

use super::{Launch, Started};
use crate::STAGE;
use crate::error::{BenchError, Result};
use crate::forecast::Forecast;
use crate::plan::Task;

const SCRIPT: &str = "bench.sbatch";
pub(super) fn submit(
    launch: &Launch,
    tasks: &[&Task],
    out: &Path,
    forecast: &Forecast,
    events: &Events,
) -> Result<Started> {
    let path = out.join(SCRIPT);
    atomic::write(&path, script(launch, tasks, out, forecast).as_bytes())?;
    let wait: &[&str] = if launch.wait { &["--wait"] } else { &[] };
    let output = Command::new("sbatch").arg("--parsable").args(wait).arg(&path).output();
    let output = output.map_err(|source| BenchError::Program {
        program: "sbatch".into(),
        hint: "run it where Slurm's clients are installed; the script is written and can be submitted there",
        source,
    })?;
    let job = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    // With --wait, the status is also that of the tasks; their records say more.
    if job.is_empty() {
        return Err(BenchError::Ended {
            program: format!("sbatch {}", path.display()),
            status: output.status,
            words: String::from_utf8_lossy(&output.stderr).trim().to_owned(),
            hint: "change the script or the flags; `sinfo` shows partitions and their limits",
        });
    }
    events.note(STAGE, format!("job {job} with {} tasks, by {}", tasks.len(), path.display()));
    Ok(if launch.wait { Started::Ended } else { Started::Submitted })
}

/// The script of an array job; its arrays name the tasks.
fn script(launch: &Launch, tasks: &[&Task], out: &Path, forecast: &Forecast) -> String {
    let limit = launch.jobs.map_or(String::new(), |jobs| format!("%{jobs}"));
    let partition = launch.partition.as_ref().map_or(String::new(), |name| format!("#SBATCH --partition={name}\n"));
    let time = launch.time.clone().unwrap_or(format!("{:.0}", forecast.minutes_with_margin().ceil()));
    let megabytes = (1e-6 * launch.memory_bytes(forecast)).ceil();
    let names: String = tasks.iter().map(|task| format!("  {}\n", quoted(&task.folder))).collect();
    let (program, out) = (quoted(&launch.program.to_string_lossy()), quoted(&out.to_string_lossy()));
    let (threads, last) = (launch.threads, tasks.len().saturating_sub(1));
    format!(
        "#!/bin/bash\n\
         # One scene a task, of {count} tasks. Written by `gic bench --on slurm`; submit it again by hand with\n\
         # `sbatch {SCRIPT}`: tasks that are finished end at once. `gic bench --collect` makes the tables.\n\
         #SBATCH --job-name=gic-bench\n\
         #SBATCH --array=0-{last}{limit}\n\
         #SBATCH --cpus-per-task={threads}\n\
         #SBATCH --mem={megabytes:.0}M\n\
         #SBATCH --time={time}\n\
         {partition}\
         #SBATCH --requeue\n\
         #SBATCH --output=/dev/null\n\
         \n\
         out={out}\n\
         tasks=(\n{names})\n\
         task=${{tasks[$SLURM_ARRAY_TASK_ID]}}\n\
         exec {program} --threads {threads} bench --task \"$task\" \"$out\" 2> \"$out/$task/messages.txt\"\n",
        count = tasks.len(),
    )
}

/// A word for the shell.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::On;
    use crate::engine::tests::launch;
    use crate::forecast::Source;
    use crate::plan::tests::task;

    fn forecast() -> Forecast {
        Forecast {
            tasks: 2,
            finished: 0,
            jobs: None,
            threads: 2,
            cpu_s: 1800.0,
            longest_s: 900.0,
            wall_s: None,
            memory_bytes: 7.5e8,
            source: Source::Rule,
        }
    }

    #[test]
    fn scripts_ask_for_the_forecast_with_a_margin_or_for_what_the_flags_say() {
        let tasks = [task("elastic_0"), task("cow's/seed=1")];
        let names: Vec<&Task> = tasks.iter().collect();
        let text = script(&launch(On::Slurm), &names, Path::new("/shared/out"), &forecast());
        for line in
            ["#SBATCH --array=0-1", "#SBATCH --time=75", "#SBATCH --mem=1500M", "  'elastic_0'", r"  'cow'\''s/seed=1'"]
        {
            assert!(text.lines().any(|l| l == line), "{line}: {text}");
        }
        let flags = Launch {
            partition: Some("long".into()),
            time: Some("1-00:00:00".into()),
            memory_gb: Some(3.0),
            jobs: Some(5),
            ..launch(On::Slurm)
        };
        let text = script(&flags, &names, Path::new("/shared/out"), &forecast());
        for line in
            ["#SBATCH --array=0-1%5", "#SBATCH --time=1-00:00:00", "#SBATCH --mem=3000M", "#SBATCH --partition=long"]
        {
            assert!(text.lines().any(|l| l == line), "{line}: {text}");
        }
    }

    #[test]
    fn the_shell_reads_the_script() {
        let tasks = [task("it's 0"), task("b")];
        let names: Vec<&Task> = tasks.iter().collect();
        let text = script(&launch(On::Slurm), &names, Path::new("/o"), &forecast());
        let shown = text.split("exec ").next().unwrap().to_owned() + "echo \"$out/$task\"";
        let shell = Command::new("bash").args(["-c", &shown]).env("SLURM_ARRAY_TASK_ID", "0").output().unwrap();
        assert_eq!(String::from_utf8_lossy(&shell.stdout).trim(), "/o/it's 0");
    }
}
