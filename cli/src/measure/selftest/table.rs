//! The table as CSV, and its totals.

use super::{Outcome, Row, cases};
use std::io::{self, Write};

const COLUMNS: &str = "case,dial,dial means,triangles,outcome,problems,certified,measured,certified over measured (least of all levels),\
levels,triangles drawn,bytes,irregular roots,grid roots,cuts,unproven nodes,charts tried again,charts kept as they are,\
arc samples added,grids: certified,grids: measured,grids: least ratio,grids: grid roots,grids: not embeddable,charts embedded,\
charts no disks,charts too uneven,charts not solved,charts split,flips before,flips after,residual,condition number,\
vertices welded,faces dropped,edges cut,vertices split,faces flipped,build CPU s,CPU s,peak MB,message";

/// Writes all rows as CSV with a heading. Lengths are in units of each mesh.
///
/// # Errors
///
/// Any error of `out`.
pub fn write_csv(out: &mut impl Write, rows: &[Row]) -> io::Result<()> {
    writeln!(out, "{COLUMNS}")?;
    rows.iter().try_for_each(|row| writeln!(out, "{}", fields(row).join(",")))
}

fn fields(row: &Row) -> Vec<String> {
    let number = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.4e}"));
    let ratio = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.4}"));
    let meaning = cases().find(|case| case.name == row.case).map_or("", |case| case.meaning);
    let mut fields = vec![
        row.case.clone(),
        row.dial.to_string(),
        quoted(meaning),
        row.triangles.to_string(),
        row.outcome.name().into(),
        quoted(&row.problems.join("; ")),
    ];
    let mut push = |count: Option<u64>| fields.push(count.map_or(String::new(), |count| count.to_string()));
    let (file, grids, maps) = (row.file.as_ref(), row.grids.as_ref(), row.embedding.as_ref());
    push(None);
    push(None);
    push(None);
    push(file.map(|f| f.levels.into()));
    push(file.map(|f| f.triangles));
    push(file.map(|f| f.bytes));
    push(file.map(|f| f.irregular_roots));
    push(file.map(|f| f.grid_roots));
    push(file.map(|f| f.cuts.into()));
    push(file.map(|f| f.unproven_nodes));
    push(file.map(|f| f.retried_charts));
    push(file.map(|f| f.unsimplified_charts));
    push(file.map(|f| f.raised_samples));
    push(None);
    push(None);
    push(None);
    push(grids.map(|f| f.grid_roots));
    push(grids.map(|f| f.embedding_failures));
    push(maps.map(|m| m.embedded));
    push(maps.map(|m| m.not_disks));
    push(maps.map(|m| m.uneven));
    push(maps.map(|m| m.unsolved));
    push(maps.map(|_| row.splits));
    push(maps.map(|m| m.flips_before));
    push(maps.map(|m| m.flips_after));
    let lengths = |f: Option<&super::Measured>| [number(f.map(|f| f.certified)), number(f.map(|f| f.measured))];
    let least = |f: Option<&super::Measured>| ratio(f.and_then(|f| f.least_ratio));
    fields.splice(6..9, lengths(file).into_iter().chain([least(file)]));
    fields.splice(19..22, lengths(grids).into_iter().chain([least(grids)]));
    fields.extend([number(maps.map(|m| m.residual)), number(maps.map(|m| m.conditioning))]);
    fields.extend(row.repairs.map(|count| count.to_string()));
    fields.extend([row.build_seconds, row.cpu_seconds].map(|seconds| format!("{seconds:.2}")));
    fields.push((row.peak_memory_bytes / 1_000_000).to_string());
    fields.push(quoted(&row.message));
    fields
}

/// Quotes text for CSV if needed.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.into() }
}

/// The totals of a table.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Totals {
    /// Rows.
    pub rows: usize,
    /// Files.
    pub files: usize,
    /// Refusals.
    pub refused: usize,
    /// Rows with problems, refusals and files included.
    pub bad: usize,
    /// Smallest ratio of certified over measured error, over all levels of all files, grids included.
    pub least_ratio: Option<f64>,
    /// Largest of these ratios.
    pub largest_ratio: Option<f64>,
    /// Processor time of all rows.
    pub cpu_seconds: f64,
    /// The most processor time of any row.
    pub longest_cpu_seconds: f64,
    /// The most memory of any row.
    pub peak_memory_bytes: u64,
}

impl Totals {
    /// Adds up rows.
    pub fn new(rows: &[Row]) -> Self {
        let count = |outcome| rows.iter().filter(|row| row.outcome == outcome).count();
        let ratios =
            || rows.iter().flat_map(|row| [&row.file, &row.grids]).flatten().filter_map(|file| file.least_ratio);
        Self {
            rows: rows.len(),
            files: count(Outcome::File),
            refused: count(Outcome::Refused),
            bad: rows.iter().filter(|row| !row.is_good()).count(),
            least_ratio: ratios().reduce(f64::min),
            largest_ratio: ratios().reduce(f64::max),
            cpu_seconds: rows.iter().map(|row| row.cpu_seconds).sum(),
            longest_cpu_seconds: rows.iter().map(|row| row.cpu_seconds).fold(0.0, f64::max),
            peak_memory_bytes: rows.iter().map(|row| row.peak_memory_bytes).max().unwrap_or(0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::selftest::Measured;
    use crate::stage::embed::EmbedReport;

    #[test]
    fn every_row_has_a_field_for_every_column() {
        let full = Row {
            file: Some(Measured { certified: 0.5, measured: 0.25, least_ratio: Some(2.0), ..Measured::default() }),
            grids: Some(Measured { certified: 0.75, ..Measured::default() }),
            embedding: Some(EmbedReport::default()),
            ..Row::default()
        };
        let columns: Vec<&str> = COLUMNS.split(',').collect();
        for row in [Row::default(), full.clone()] {
            assert_eq!(fields(&row).len(), columns.len());
        }
        let at = |name: &str| fields(&full)[columns.iter().position(|&c| c == name).unwrap()].clone();
        assert_eq!([at("certified"), at("measured"), at("grids: certified")], ["5.0000e-1", "2.5000e-1", "7.5000e-1"]);
        assert_eq!(quoted("a \"b\", c"), "\"a \"\"b\"\", c\"");
    }

    #[test]
    fn totals_count_bad_rows_whatever_their_outcome() {
        let row = |outcome, problems: &[&str]| Row {
            outcome,
            problems: problems.iter().map(|p| p.to_string()).collect(),
            ..Row::default()
        };
        let rows = [row(Outcome::File, &[]), row(Outcome::Refused, &["due"]), row(Outcome::Hung, &["long"])];
        let totals = Totals::new(&rows);
        assert_eq!((totals.rows, totals.files, totals.refused, totals.bad), (3, 1, 1, 2));
    }
}
