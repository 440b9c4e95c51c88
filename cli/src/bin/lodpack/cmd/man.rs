//! `lodpack man`

use crate::args::{self, ManArgs};
use crate::output::{PendingFile, check_folder, say};
use anyhow::{Context, Result, bail};
use clap::builder::Resettable;
use clap_mangen::Man;
use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

/// Prints or writes manual pages, made from what `--help` shows.
pub fn run(args: &ManArgs) -> Result<ExitCode> {
    // `lodpack help` needs no page: it prints what the pages say.
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

/// The page of a command. The paragraphs below the options in `--help` become sections of their own.
fn page(command: &clap::Command) -> std::io::Result<Vec<u8>> {
    let bare = command.clone().after_help(Resettable::Reset).version(Resettable::Reset);
    let mut page = vec![];
    Man::new(bare).source(concat!("lodpack ", env!("CARGO_PKG_VERSION"))).manual("lodpack").render(&mut page)?;
    let below = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    below.split("\n\n").for_each(|paragraph| page.extend(section(paragraph).into_bytes()));
    Ok(page)
}

/// A paragraph of help in the language of man pages. Examples keep their lines.
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

/// A line that is taken as text: hyphens can be copied, and no line begins a request.
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
