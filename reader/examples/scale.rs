//! Prints what a file costs as it grows, one column a file: requests and bytes, processor time and memory.
//!
//! ```sh
//! cargo run --release -p lodpack --example scale -- million.lodpack billion.lodpack
//! ```
//!
//! Processor time is that of this program. Memory is what the process gained (Linux only). The program
//! `large_index` writes files to compare.
#![allow(clippy::disallowed_methods, reason = "cameras and regions; no file depends on them")]

use std::{error::Error, ops::Range, sync::Arc, time::Duration};

use lodpack::{
    File, Limits, Query, View,
    select::{Adapter, Coherence},
    source::Recording,
};

/// A query is repeated until it has taken this long.
const LEAST: Duration = Duration::from_millis(200);
/// Nodes of the large cut.
const NODES: u64 = 10_000;
/// Enough that their processor time can be measured, although the system counts it in steps of some milliseconds.
const FRAMES: u32 = 300;

type Opened<'f> = File<&'f Recording<std::fs::File>>;

fn main() -> Result<(), Box<dyn Error>> {
    let names: Vec<String> = std::env::args().skip(1).collect();
    let columns = names.iter().map(|name| measure(name)).collect::<Result<Vec<_>, _>>()?;
    println!("| | {} |", names.join(" | "));
    println!("|---|{}", "---:|".repeat(names.len()));
    for row in 0..columns.first().map_or(0, Vec::len) {
        let cells: Vec<&str> = columns.iter().map(|column| column[row].1.as_str()).collect();
        println!("| {} | {} |", columns[0][row].0, cells.join(" | "));
    }
    Ok(())
}

/// What is measured, and the result.
type Row = (String, String);

fn measure(name: &str) -> Result<Vec<Row>, Box<dyn Error>> {
    let source = Recording::new(std::fs::File::open(name)?);
    let open = || File::open(&source, Limits::default());
    let file = open()?;
    let mut rows = vec![
        ("file, bytes".to_string(), std::fs::metadata(name)?.len().to_string()),
        ("roots".to_string(), file.root_count().to_string()),
        ("opening".to_string(), requests(&source.take())),
    ];
    let before = resident_bytes();
    let file = open()?;
    source.take();
    file.extract(&file.uniform_cut(0)?)?;
    rows.push(("first picture, after opening".to_string(), requests(&source.take())));
    rows.push(("memory after that, kB".to_string(), gained(before)));

    let [low, high] = file.bounds().ok_or("the file is empty")?;
    let extent = high[0] - low[0];
    let side = (extent * (high[1] - low[1]) * 0.01).sqrt();
    let around = |side: f64| -> Query {
        let middle = [0.37, 0.41, 0.5];
        let centre = [0, 1, 2].map(|k| low[k] + (high[k] - low[k]) * middle[k]);
        let volume = [centre.map(|x| x - side / 2.0), centre.map(|x| x + side / 2.0)];
        Query { volume: Some(volume.into()), ..Query::default() }
    };
    let at_leaf_scale = (extent / leaves_along(&file)?) * 5.0;
    // At a height of two leaves, with the horizon in sight.
    let leaf = at_leaf_scale / 5.0;
    let view = View {
        position: [low[0] + extent * 0.37, low[1], high[2] + leaf * 2.0],
        forward: [0.0, 1.0, -0.2],
        up: [0.0, 0.0, 1.0],
        near: leaf * 0.01,
        ..View::default()
    };
    let queries: [(&str, Query); 4] = [
        ("a hundredth, finest", around(side)),
        ("five by five leaves, finest", around(at_leaf_scale)),
        ("a view over the surface", Query { view: Some(view), ..Query::default() }),
        ("10,000 nodes", Query { max_nodes: Some(NODES), ..Query::default() }),
    ];
    for (what, query) in queries {
        let file = open()?;
        source.take();
        let before = (resident_bytes(), cpu_time());
        let cut = file.select(&query)?;
        let row = |of: &str, value: String| (format!("{what}: {of}"), value);
        rows.push(row("nodes", cut.nodes.len().to_string()));
        rows.push(row("select", requests(&source.take())));
        rows.push(row("select, CPU ms, reading included", ms(cpu_time().saturating_sub(before.1))));
        rows.push(row("memory, kB", gained(before.0)));
        file.extract(&cut)?;
        rows.push(row("extract", requests(&source.take())));
        // Everything that it needs is there now.
        rows.push(row("select again, CPU ms", ms(mean(|| file.select(&query).map(drop))?)));
        source.take();
    }
    rows.extend(frames(&open()?, Query { view: Some(view), ..Query::default() })?);
    Ok(rows)
}

/// A camera that moves slowly: what choosing the cut of a frame takes.
fn frames(file: &Opened<'_>, query: Query) -> Result<Vec<Row>, Box<dyn Error>> {
    let view = query.view.ok_or("the query has no view")?;
    let query = |frame: u32| {
        let mut view = View { pixel_tolerance: 0.8, ..view };
        view.position[0] += f64::from(frame) / 60.0 * 0.025 * view.near * 200.0;
        view.orbit(view.position, 0.1 * f64::from(frame) / 60.0, 0.0);
        Query { view: Some(view), ..query.clone() }
    };
    let hierarchy = file.hierarchy_for(&query(0))?;
    let mut adapter = Adapter::new(Arc::clone(&hierarchy), &query(0), Coherence::default())?;
    let start = cpu_time();
    let mut changes = 0;
    for frame in 1..=FRAMES {
        changes += adapter.update(&query(frame))?.changes.len();
    }
    let mean = cpu_time().saturating_sub(start) / FRAMES;
    let row = |of: &str, value: String| (format!("a frame of a moving camera: {of}"), value);
    Ok(vec![
        row("nodes of the cut", adapter.cut().nodes.len().to_string()),
        row("nodes to choose from", hierarchy.node_count().to_string()),
        row("changes", format!("{:.1}", changes as f64 / f64::from(FRAMES))),
        row("mean, CPU ms", format!("{:.3}", mean.as_secs_f64() * 1e3)),
    ])
}

/// How many leaves lie along x, from the levels' tolerances: each level halves the sides.
fn leaves_along(file: &Opened<'_>) -> Result<f64, Box<dyn Error>> {
    let leaf = file.root_bounds(file.root_count() - 1)?;
    let [low, high] = file.bounds().ok_or("the file is empty")?;
    Ok((high[0] - low[0]) / (leaf[1][0] - leaf[0][0]))
}

fn requests(ranges: &[Range<u64>]) -> String {
    format!("{} requests, {} bytes", ranges.len(), ranges.iter().map(|range| range.end - range.start).sum::<u64>())
}

/// The mean processor time of something that is repeated.
fn mean(mut run: impl FnMut() -> lodpack::Result<()>) -> lodpack::Result<Duration> {
    let (start, mut runs) = (cpu_time(), 0);
    loop {
        run()?;
        runs += 1;
        let time = cpu_time().saturating_sub(start);
        if time >= LEAST {
            return Ok(time / runs);
        }
    }
}

fn ms(time: Duration) -> String {
    format!("{:.2}", time.as_secs_f64() * 1e3)
}

/// Processor time of this process so far.
fn cpu_time() -> Duration {
    let stat = std::fs::read_to_string("/proc/self/schedstat").unwrap_or_default();
    Duration::from_nanos(stat.split_whitespace().next().and_then(|ns| ns.parse().ok()).unwrap_or(0))
}

fn resident_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok()).unwrap_or(0) * 1024
}

fn gained(before: u64) -> String {
    (resident_bytes().saturating_sub(before) / 1024).to_string()
}
