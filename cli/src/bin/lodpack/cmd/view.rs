//! `lodpack view`

use crate::args::ViewArgs;
use anyhow::{Context, Result, bail};
use std::env::{self, consts::EXE_SUFFIX};
use std::path::PathBuf;
use std::process::{Command, ExitCode};

const VIEWER: &str = "lodpack-view";

/// Starts the viewer with all that was typed, and ends as it does.
pub fn run(args: &ViewArgs) -> Result<ExitCode> {
    let Some(viewer) = find_viewer() else {
        bail!(
            "{VIEWER} is neither beside lodpack nor in a directory of PATH; install it with `cargo install --path viewer-min` in \
             lodpack's source code"
        );
    };
    let mut command = Command::new(&viewer);
    command.args(&args.arguments);
    become_program(command).with_context(|| format!("cannot start {}", viewer.display()))
}

/// The viewer that was installed with this program, or any other that the shell would find.
fn find_viewer() -> Option<PathBuf> {
    let name = format!("{VIEWER}{EXE_SUFFIX}");
    let own = env::current_exe().ok().and_then(|program| Some(program.parent()?.to_owned()));
    let path = env::var_os("PATH").unwrap_or_default();
    own.into_iter().chain(env::split_paths(&path)).map(|folder| folder.join(&name)).find(|file| file.is_file())
}

/// The viewer takes this process's place, so that whoever stops the one stops the other.
#[cfg(unix)]
fn become_program(mut command: Command) -> std::io::Result<ExitCode> {
    Err(std::os::unix::process::CommandExt::exec(&mut command))
}

#[cfg(not(unix))]
fn become_program(mut command: Command) -> std::io::Result<ExitCode> {
    let code = command.status()?.code().and_then(|code| u8::try_from(code).ok());
    Ok(code.map_or(ExitCode::FAILURE, ExitCode::from))
}
