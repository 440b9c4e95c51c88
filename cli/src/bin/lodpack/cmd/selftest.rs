//! `lodpack selftest`

use super::{print_json, use_threads};
use crate::args::{ProgressStyle, SelftestArgs};
use crate::interrupt;
use crate::output::{PendingFile, bytes, count, length, say};
use crate::progress_bar::{self, Terminal};
use anyhow::{Context, Result, bail};
use lodpack_cli::measure::selftest::{
    FAMILIES, Limits, Row, RowId, Totals, cases, run_row, run_rows, stop_rows, write_csv,
};
use lodpack_cli::progress::Progress;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

/// Limits of a row. The slowest takes about a minute on a core of its own, but the machine may be busy.
const TIME: Duration = Duration::from_secs(900);
const MEMORY: u64 = 1 << 30;

/// Runs the stability suite; exit status 1 if a row is bad.
pub fn run(args: &SelftestArgs) -> Result<ExitCode> {
    let memory = args.memory.unwrap_or(MEMORY);
    let temporary = args.temp.clone().unwrap_or_else(std::env::temp_dir);
    if let Some(id) = args.row {
        use_threads(1)?;
        let row = run_row(id, memory, &temporary).context("cannot write the mesh of a row")?;
        say!("{}", serde_json::to_string(&row)?);
        return Ok(ExitCode::SUCCESS);
    }
    let rows = chosen_rows(args)?;
    if args.list {
        list(&rows)?;
        return Ok(ExitCode::SUCCESS);
    }
    let meshes = temporary.clone();
    interrupt::on_stop_after(move || stop_rows(&meshes), Path::new(""), "");
    let csv = args.csv.as_ref().map(|path| PendingFile::create(path, true, [])).transpose()?;
    let processes = std::thread::available_parallelism().map_or(1, |cores| cores.get());
    let limits = Limits { time: TIME, memory_bytes: memory, processes };
    let program = std::env::current_exe().context("cannot find the path of this program")?;
    let done = {
        let progress = Terminal::new(ProgressStyle::Auto, progress_bar::SELFTEST);
        progress.begin("selftest", rows.len() as u64);
        run_rows(&program, &rows, &limits, &temporary, &|row: &Row| {
            progress.advance(1);
            if !row.is_good() {
                progress.note(&format!("{}:{:?}: {}", row.case, row.dial, row.problems.join("; ")));
            }
        })?
    };
    let totals = Totals::new(&done);
    if let Some((pending, mut file)) = csv {
        write_csv(&mut file, &done).context("cannot write the table")?;
        pending.finish(file)?;
    }
    if args.json {
        print_json(&serde_json::json!({ "rows": done, "totals": totals }))?;
    } else {
        print(&done, &totals)?;
    }
    Ok(ExitCode::from(u8::from(totals.bad > 0)))
}

fn chosen_rows(args: &SelftestArgs) -> Result<Vec<RowId>> {
    let is_named = |name: &str| args.case.is_empty() || args.case.iter().any(|case| case == name);
    if let Some(unknown) = args.case.iter().find(|&name| !cases().any(|case| case.name == name)) {
        bail!("there is no case '{unknown}'; --list shows all");
    }
    Ok(cases().filter(|case| is_named(case.name)).flat_map(|case| case.rows(args.quick)).collect())
}

fn list(rows: &[RowId]) -> Result<()> {
    for (family, cases) in FAMILIES {
        say!("{family}");
        for case in cases {
            let dials: Vec<String> =
                rows.iter().filter(|row| row.case.name == case.name).map(|row| format!("{:?}", row.dial)).collect();
            if !dials.is_empty() {
                say!("  {:<16} {}: {}", case.name, case.meaning, dials.join(", "));
            }
        }
    }
    say!("{} rows", rows.len());
    Ok(())
}

fn print(rows: &[Row], totals: &Totals) -> Result<()> {
    say!(
        "{:<16} {:>8} {:>9}  {:<8} {:>10} {:>10} {:>6}  {:>5} {:>5}  {:>6} {:>6}",
        "case",
        "dial",
        "triangles",
        "outcome",
        "certified",
        "measured",
        "ratio",
        "roots",
        "grids",
        "CPU s",
        "MB"
    );
    for row in rows {
        let file = row.file.as_ref();
        let length_of = |value: Option<f64>| value.map_or(String::new(), length);
        let ratios = [&row.file, &row.grids].into_iter().flatten().filter_map(|file| file.least_ratio);
        let ratio = ratios.reduce(f64::min).map_or(String::new(), |ratio| format!("{ratio:.3}"));
        let roots = |value: Option<u64>| value.map_or(String::new(), |value| value.to_string());
        say!(
            "{:<16} {:>8} {:>9}  {:<8} {:>10} {:>10} {:>6}  {:>5} {:>5}  {:>6.2} {:>6}",
            row.case,
            row.dial,
            count(row.triangles),
            if row.is_good() { row.outcome.name() } else { "BAD" },
            length_of(file.map(|f| f.certified)),
            length_of(file.map(|f| f.measured)),
            ratio,
            roots(file.map(|f| f.irregular_roots + f.grid_roots)),
            roots(row.grids.as_ref().map(|f| f.grid_roots)),
            row.cpu_seconds,
            row.peak_memory_bytes / 1_000_000
        );
        for problem in &row.problems {
            say!("    BAD: {problem}");
        }
        if !row.message.is_empty() {
            say!("    {}", row.message);
        }
    }
    let ratio = |value: Option<f64>| value.map_or("none".into(), |value| format!("{value:.4}"));
    say!(
        "{} rows: {} files, {} refused, {} bad; certified over measured error {} to {}; {:.0} CPU s, longest {:.1}; peak memory {}",
        totals.rows,
        totals.files,
        totals.refused,
        totals.bad,
        ratio(totals.least_ratio),
        ratio(totals.largest_ratio),
        totals.cpu_seconds,
        totals.longest_cpu_seconds,
        bytes(totals.peak_memory_bytes)
    );
    Ok(())
}
