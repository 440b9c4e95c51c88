//! `lodpack submit`

use super::print_json;
use crate::args::SubmitArgs;
use crate::output::{check_folder, say, shell};
use anyhow::{Context, Result, bail};
use lodpack_cli::job::{SlurmScripts, merged_file};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Submits the unfinished parts of a job, and its merge, to a scheduler.
pub fn run(args: &SubmitArgs) -> Result<ExitCode> {
    let output = &match &args.output {
        Some(output) => output.clone(),
        None => planned_file(&args.job)?,
    };
    check_folder(output)?;
    let program = match &args.program {
        Some(program) => program.clone(),
        None => std::env::current_exe().context("cannot find the path of this program; pass it with --program")?,
    };
    let scripts = SlurmScripts::new(&args.job, output, &program, args.threads)?;
    if args.dry_run && args.json {
        print_json(&scripts)?;
        return Ok(ExitCode::SUCCESS);
    }
    if args.dry_run {
        let named = |name: &str| scripts.folder.join(name);
        for (stage, script) in &scripts.stages {
            print_script(&named(&format!("{stage}.sh")), script)?;
        }
        if let Some(parts) = &scripts.parts {
            print_script(&named("parts.sh"), parts)?;
        }
        for (stage, script) in &scripts.after_parts {
            print_script(&named(&format!("{stage}.sh")), script)?;
        }
        print_script(&named("merge.sh"), &scripts.merge)?;
        let script = |(stage, _): &(String, String)| format!("{stage}.sh");
        let parts = scripts.parts.iter().map(|_| "parts.sh".to_owned());
        let names = scripts.stages.iter().map(script).chain(parts).chain(scripts.after_parts.iter().map(script));
        for (place, name) in names.chain(["merge.sh".to_owned()]).enumerate() {
            let wait = if place > 0 { "--dependency=afterok:<the number printed by the command above> " } else { "" };
            say!("# sbatch --parsable {wait}{}", shell(&named(&name)));
        }
        return Ok(ExitCode::SUCCESS);
    }
    let submitted = scripts.submit()?;
    if args.json {
        print_json(&submitted)?;
        return Ok(ExitCode::SUCCESS);
    }
    for (stage, id) in &submitted.stages {
        say!("{stage:<10} {id}");
    }
    match &submitted.parts {
        Some(parts) => say!("parts      {parts}"),
        None => say!("parts      all are done"),
    }
    for (stage, id) in &submitted.after_parts {
        say!("{stage:<10} {id}");
    }
    say!("merge      {}, which waits for the parts", submitted.merge);
    say!("logs       {}", scripts.folder.display());
    say!("after a failure, submit again: only unfinished parts are run");
    Ok(ExitCode::SUCCESS)
}

/// The file with the planned name, which must not exist: the merge overwrites files, and there is no one to ask when it
/// runs.
fn planned_file(job: &Path) -> Result<PathBuf> {
    let Some(output) = merged_file(&[job.to_owned()])? else {
        bail!("{} is no job's directory; name one that `lodpack plan` has made", job.display());
    };
    match output.exists() {
        true => bail!("{0} exists; remove it, or pass -o {1} to overwrite it", output.display(), shell(&output)),
        false => Ok(output),
    }
}

fn print_script(path: &Path, text: &str) -> Result<()> {
    say!("# {}", path.display());
    say!("{text}");
    Ok(())
}
