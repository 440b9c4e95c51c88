//! All rows as one table (CSV). Lengths are in input units, times in seconds.

use super::{Distances, Report};
use std::fmt::Write;

const NAMES: &str = "kind,name,varied,tolerance,effort,fillings,chart_triangles,threads,region_triangles,runs,cpu_seconds,\
                     cpu_least,cpu_most,wall_seconds,peak_memory_bytes,bytes,requests,triangles,samples,nodes,certified,rms,max,\
                     rms_from_input,rms_to_input,max_from_input,max_to_input,select_seconds,fetch_seconds,decode_seconds,\
                     extract_seconds,pixel_error";

/// Renders the table.
pub fn table(report: &Report) -> String {
    let columns: Vec<&str> = NAMES.split(',').collect();
    let mut text = format!("{NAMES}\n");
    let mut line = |values: &[(&str, String)]| {
        let value =
            |column: &&str| values.iter().find(|(name, _)| name == column).map_or("", |(_, value)| value.as_str());
        let cells: Vec<String> = columns.iter().map(|column| quoted(value(column))).collect();
        let _ = writeln!(text, "{}", cells.join(","));
    };
    for row in &report.builds {
        let s = &row.setting;
        let mut values = vec![
            ("kind", "build".to_string()),
            ("name", s.name.clone()),
            ("varied", format!("{:?}", s.varied).to_lowercase()),
            ("tolerance", row.tolerance.to_string()),
            ("effort", format!("{:?}", s.effort).to_lowercase()),
            ("fillings", format!("{:?}", s.fillings)),
            ("chart_triangles", s.chart_triangles.map_or(String::new(), |count| count.to_string())),
            ("threads", s.threads.to_string()),
            ("region_triangles", s.region_triangles.to_string()),
            ("runs", row.runs.to_string()),
            ("cpu_seconds", row.cpu_seconds.to_string()),
            ("cpu_least", row.cpu_range[0].to_string()),
            ("cpu_most", row.cpu_range[1].to_string()),
            ("wall_seconds", row.wall_seconds.to_string()),
            ("peak_memory_bytes", row.peak_memory_bytes.to_string()),
            ("bytes", row.bytes.to_string()),
            ("triangles", row.triangles.to_string()),
            ("samples", row.samples.to_string()),
            ("nodes", row.roots[0].to_string()),
            ("certified", row.certified.to_string()),
        ];
        values.extend(distances(Some(row.measured)));
        line(&values);
    }
    for row in &report.cuts {
        let mut values = vec![
            ("kind", "cut".to_string()),
            ("name", format!("{} {}", row.asked, row.value)),
            ("varied", row.asked.to_string()),
            ("bytes", row.bytes_read.to_string()),
            ("requests", row.requests.to_string()),
            ("triangles", row.triangles.to_string()),
            ("samples", row.samples.to_string()),
            ("nodes", row.nodes.to_string()),
            ("certified", row.certified.to_string()),
            ("select_seconds", row.select_seconds.to_string()),
            ("fetch_seconds", row.fetch_seconds.to_string()),
            ("decode_seconds", row.decode_seconds.to_string()),
            ("extract_seconds", row.extract_seconds.to_string()),
        ];
        values.extend(distances(row.measured));
        line(&values);
    }
    for row in &report.budgets {
        line(&[
            ("kind", "budget".to_string()),
            (
                "name",
                format!(
                    "{} resolutions, {} nodes, {} triangles",
                    row.resolutions,
                    row.max_nodes,
                    row.max_triangles.map_or("any".into(), |most| most.to_string())
                ),
            ),
            ("varied", row.varied.to_string()),
            ("triangles", row.triangles.to_string()),
            ("nodes", row.nodes.to_string()),
            ("pixel_error", row.pixel_error.to_string()),
            ("select_seconds", row.select_seconds.to_string()),
        ]);
    }
    for peer in &report.peers {
        let number = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
        line(&[
            ("kind", "peer".to_string()),
            ("name", peer.name.clone()),
            ("cpu_seconds", number(peer.cpu_seconds)),
            ("bytes", number(peer.bytes)),
            ("triangles", number(peer.triangles)),
            ("rms", number(peer.rms)),
            ("max", number(peer.max)),
        ]);
    }
    text
}

fn distances(measured: Option<Distances>) -> Vec<(&'static str, String)> {
    let Some(measured) = measured else { return vec![] };
    vec![
        ("rms", measured.rms().to_string()),
        ("max", measured.max().to_string()),
        ("rms_from_input", measured.rms[0].to_string()),
        ("rms_to_input", measured.rms[1].to_string()),
        ("max_from_input", measured.max[0].to_string()),
        ("max_to_input", measured.max[1].to_string()),
    ]
}

fn quoted(value: &str) -> String {
    if value.contains([',', '"', '\n']) { format!("\"{}\"", value.replace('"', "\"\"")) } else { value.to_owned() }
}
