//! Results of other programs, from a table.

use super::ReportError;
use serde::Serialize;
use std::path::Path;

/// The result of another program for the same mesh.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PeerRow {
    /// The program and its setting.
    pub name: String,
    /// The mesh: its file name without the extension. Empty if the table is about a single mesh.
    pub mesh: String,
    /// Processor time. Like all figures below, none if it was not measured.
    pub cpu_seconds: Option<f64>,
    /// Size of its file.
    pub bytes: Option<f64>,
    /// Triangles.
    pub triangles: Option<f64>,
    /// Root mean square error, in input units.
    pub rms: Option<f64>,
    /// Largest error, in input units.
    pub max: Option<f64>,
}

/// Reads a table (CSV; column names in the first line; other columns allowed) and keeps the rows about `mesh`.
///
/// # Errors
///
/// [`ReportError::Io`], [`ReportError::Peers`].
pub fn read_peers(path: &Path, mesh: &str) -> Result<Vec<PeerRow>, ReportError> {
    let text = std::fs::read_to_string(path);
    let text = text.map_err(|source| ReportError::Io { what: "cannot read", path: path.to_owned(), source })?;
    let rows = parse(&text).map_err(|(line, what)| ReportError::Peers { path: path.to_owned(), line, what })?;
    Ok(rows.into_iter().filter(|row| row.mesh.is_empty() || row.mesh == mesh).collect())
}

fn parse(text: &str) -> Result<Vec<PeerRow>, (usize, String)> {
    let mut lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty());
    let (_, head) = lines.next().ok_or((1, "the table is empty".to_string()))?;
    let names: Vec<&str> = head.split(',').map(str::trim).collect();
    if !names.contains(&"name") {
        return Err((1, "there is no column 'name'".into()));
    }
    let mut rows = vec![];
    for (number, line) in lines {
        let values: Vec<&str> = line.split(',').map(str::trim).collect();
        if values.len() != names.len() {
            return Err((number, format!("{} values, but {} columns", values.len(), names.len())));
        }
        let mut row = PeerRow::default();
        for (name, value) in names.iter().zip(values) {
            let slot = match *name {
                "name" => {
                    row.name = value.to_owned();
                    continue;
                }
                "mesh" => {
                    row.mesh = value.to_owned();
                    continue;
                }
                "cpu_seconds" => &mut row.cpu_seconds,
                "bytes" => &mut row.bytes,
                "triangles" => &mut row.triangles,
                "rms" => &mut row.rms,
                "max" => &mut row.max,
                _ => continue,
            };
            if !value.is_empty() {
                let parsed = value.parse::<f64>().ok().filter(|value| value.is_finite() && *value >= 0.0);
                *slot = Some(parsed.ok_or_else(|| (number, format!("'{value}' is not a value of {name}")))?);
            }
        }
        rows.push(row);
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_of_tables_are_found_by_name() {
        let rows = parse("bytes,name,mesh,note,rms\n10,a b,m,x,0.5\n\n,c,,,\n").expect("a table");
        assert_eq!(rows.len(), 2);
        assert_eq!((rows[0].bytes, rows[0].rms, rows[0].name.as_str()), (Some(10.0), Some(0.5), "a b"));
        assert_eq!(rows[1], PeerRow { name: "c".into(), ..PeerRow::default() });
        for (bad, line) in
            [("", 1), ("bytes\n1", 1), ("name,bytes\na", 2), ("name,bytes\na,1\nb,many", 3), ("name,rms\na,-1", 2)]
        {
            assert_eq!(parse(bad).expect_err("a bad table").0, line, "{bad}");
        }
    }
}
