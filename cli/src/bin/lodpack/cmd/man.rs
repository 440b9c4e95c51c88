//! `lodpack man`

use crate::args::{self, ManArgs};
use crate::output::{PendingFile, check_folder, say};
use anyhow::{Context, Result, bail};
use clap_mangen::Man;
use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

/// Prints or writes manual pages, made from what `--help` shows.
pub fn run(args: &ManArgs) -> Result<ExitCode> {
    // `lodpack help` says what the pages say.
    let mut lodpack = args::command().disable_help_subcommand(true);
    lodpack.build();
    if let Some(folder) = &args.output {
        write_pages(&lodpack, folder, args.force)?;
        return Ok(ExitCode::SUCCESS);
    }
    let command = match &args.command {
        None => &lodpack,
        Some(name) => lodpack
            .find_subcommand(name)
            .with_context(|| format!("there is no command '{name}'; `lodpack --help` lists all"))?,
    };
    say!("{}", String::from_utf8_lossy(&page(command)?).trim_end());
    Ok(ExitCode::SUCCESS)
}

fn write_pages(lodpack: &clap::Command, folder: &Path, force: bool) -> Result<()> {
    if folder.exists() && !folder.is_dir() {
        bail!("{} is a file; name a directory", folder.display());
    }
    if !folder.exists() {
        check_folder(folder)?;
        fs::create_dir(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    for command in [lodpack].into_iter().chain(lodpack.get_subcommands()) {
        let path = folder.join(Man::new(command.clone()).get_filename());
        let (pending, mut file) = PendingFile::create(&path, force, [])?;
        file.write_all(&page(command)?).with_context(|| format!("cannot write {}", path.display()))?;
        pending.finish(file)?;
        say!("{}", path.display());
    }
    Ok(())
}

/// The page of a command. What stands below its options in `--help` gets sections of its own.
fn page(command: &clap::Command) -> std::io::Result<Vec<u8>> {
    let man = Man::new(command.clone()).manual("lodpack");
    let mut page = vec![];
    man.render_title(&mut page)?;
    man.render_name_section(&mut page)?;
    man.render_synopsis_section(&mut page)?;
    man.render_description_section(&mut page)?;
    man.render_options_section(&mut page)?;
    if command.has_subcommands() {
        man.render_subcommands_section(&mut page)?;
    }
    let below = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    for paragraph in below.split("\n\n") {
        page.write_all(section(paragraph).as_bytes())?;
    }
    man.render_version_section(&mut page)?;
    Ok(page)
}

/// A paragraph of help in the language of man pages: lines of examples stay lines.
fn section(paragraph: &str) -> String {
    if let Some(examples) = paragraph.strip_prefix("Examples:\n") {
        let lines = examples.lines().map(|line| line.strip_prefix("  ").unwrap_or(line)).map(escaped);
        return format!(".SH EXAMPLES\n.nf\n{}.fi\n", lines.collect::<String>());
    }
    let (title, text) = match paragraph.strip_prefix("Exit status: ") {
        Some(text) => ("\"EXIT STATUS\"", text),
        None => ("NOTES", paragraph),
    };
    format!(".SH {title}\n{}", text.lines().map(escaped).collect::<String>())
}

/// A line that is text and nothing else: hyphens that can be copied, backslashes, and no request at its begin.
fn escaped(line: &str) -> String {
    let begin = if line.starts_with(['.', '\'']) { "\\&" } else { "" };
    format!("{begin}{}\n", line.replace('\\', "\\e").replace('-', "\\-"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_cannot_be_taken_for_requests() {
        assert_eq!(escaped(".parts[] | \\n -o"), "\\&.parts[] | \\en \\-o\n");
        assert_eq!(section("Examples:\n  a -b\n  c"), ".SH EXAMPLES\n.nf\na \\-b\nc\n.fi\n");
        assert_eq!(section("Exit status: 0 done."), ".SH \"EXIT STATUS\"\n0 done.\n");
    }
}
