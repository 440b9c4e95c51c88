//! The report as one HTML file without scripts, in light and dark. It is also well-formed XML.

use super::analysis::{competes, front};
use super::plot::{Axis, COLOURS, Marker, Plot, Point, Series, bars, escape, short};
use super::{BudgetRow, BuildRow, Order, PeerRow, Report, Varied};
use std::fmt::Write;

const STYLE: &str = "body{margin:1.5rem auto;max-width:1180px;padding:0 1rem;font:15px/1.45 system-ui,sans-serif;\
                     color:#1d2126;background:#fff}h1{font-size:1.5rem}h2{font-size:1.15rem;margin-top:2rem}\
                     .plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(480px,1fr));gap:1rem}\
                     svg{width:100%;height:auto}.wide{overflow-x:auto}table{border-collapse:collapse;font-size:13px}\
                     td,th{padding:.15rem .55rem;text-align:right;border-bottom:1px solid #8884}td:first-child,th:first-child\
                     {text-align:left}.note{opacity:.75}@media(prefers-color-scheme:dark){body{color:#dfe3e8;background:#15181c}}";

/// A figure of a peer's file, if known.
type PeerValue = fn(&PeerRow) -> Option<f64>;

/// A cost against which errors are drawn.
struct Cost {
    name: &'static str,
    label: &'static str,
    of: fn(&BuildRow) -> f64,
    of_peer: PeerValue,
    /// Whether repeated measurements differ.
    spreads: bool,
}

const COSTS: [Cost; 3] = [
    Cost {
        name: "processor time",
        label: "processor time of the build, s",
        of: |row| row.cpu_seconds,
        of_peer: |peer| peer.cpu_seconds,
        spreads: true,
    },
    Cost {
        name: "bytes",
        label: "bytes of the file, all levels",
        of: |row| row.bytes as f64,
        of_peer: |peer| peer.bytes,
        spreads: false,
    },
    Cost {
        name: "triangles",
        label: "triangles of the finest level",
        of: |row| row.triangles as f64,
        of_peer: |peer| peer.triangles,
        spreads: false,
    },
];

/// An error that is drawn.
struct Measure {
    name: &'static str,
    key: &'static str,
    of: fn(&BuildRow) -> f64,
    of_peer: PeerValue,
}

const MEASURES: [Measure; 2] = [
    Measure { name: "Measured RMS error", key: "rms", of: |row| row.measured.rms(), of_peer: |peer| peer.rms },
    // Other programs measure their largest error; none certifies it.
    Measure { name: "Certified largest error", key: "certified", of: |row| row.certified, of_peer: |peer| peer.max },
];

const FRONT: &str = "Pareto front";

fn log(label: impl Into<String>) -> Axis {
    Axis { label: label.into(), is_log: true }
}

/// The whole page.
pub fn page(report: &Report) -> String {
    let subject = escape(&report.subject);
    let machine = &report.machine;
    let mut html = format!(
        "<!DOCTYPE html>\n<html xmlns=\"http://www.w3.org/1999/xhtml\" lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width\"/>\n<meta name=\"color-scheme\" content=\"light dark\"/>\n\
         <title>lodpack report: {subject}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{subject}: error against run time</h1>\n"
    );
    let _ = writeln!(
        html,
        "<p class=\"note\">lodpack {} on {} ({} cores), {}. Times are processor seconds, medians where builds are repeated, with a \
         line from least to most. Lengths are {}. Rings mark the Pareto front of the two quantities of a plot.</p>",
        machine.version,
        escape(&machine.processor),
        machine.cores,
        escape(&machine.system),
        if report.input.is_some() { "in mean edge lengths of the input" } else { "in units of the input" }
    );
    html += "<ul>\n";
    for sentence in &report.words {
        let _ = writeln!(html, "<li>{}</li>", escape(sentence));
    }
    html += "</ul>\n";
    if !report.builds.is_empty() {
        section(&mut html, "Builds: error against processor time, bytes and triangles", &build_plots(report));
        section(
            &mut html,
            "What each setting buys, and what safety costs",
            &[settings_plot(report), stage_bars(report)],
        );
    }
    orders_table(&mut html, report);
    if !report.cuts.is_empty() {
        section(&mut html, "Run time: queries of one file", &cut_plots(report));
    }
    if !report.budgets.is_empty() {
        section(
            &mut html,
            "Budgets of nodes and triangles, with one, two and three resolutions a node",
            &budget_plots(report),
        );
    }
    tables(&mut html, report);
    html += "</body>\n</html>\n";
    html
}

fn section(html: &mut String, title: &str, plots: &[String]) {
    let _ = writeln!(html, "<h2>{}</h2>\n<div class=\"plots\">", escape(title));
    for svg in plots {
        let _ = writeln!(html, "<div>{svg}</div>");
    }
    *html += "</div>\n";
}

fn build_plots(report: &Report) -> Vec<String> {
    COSTS.iter().flat_map(|cost| MEASURES.iter().map(move |measure| build_plot(report, cost, measure))).collect()
}

fn build_plot(report: &Report, cost: &Cost, measure: &Measure) -> String {
    let edge = report.unit();
    let rows: Vec<&BuildRow> = report.builds.iter().filter(|row| competes(row)).collect();
    let on_front = front(&rows.iter().map(|row| [(cost.of)(row), (measure.of)(row)]).collect::<Vec<_>>());
    let point = |row: &BuildRow, error: f64, on_front: bool| Point {
        x: (cost.of)(row),
        y: error / edge,
        spread: cost.spreads.then_some(row.cpu_range),
        title: format!("{}: {} {}, error {}", row.setting.name, short((cost.of)(row)), cost.name, short(error / edge)),
        label: if row.setting.varied == Varied::Default { "default".into() } else { String::new() },
        on_front,
    };
    let of_varied = |knobs: &[Varied]| {
        let found = rows.iter().zip(&on_front).filter(|(row, _)| knobs.contains(&row.setting.varied));
        let mut found: Vec<Point> = found.map(|(row, front)| point(row, (measure.of)(row), *front)).collect();
        found.sort_by(|a, b| a.y.total_cmp(&b.y));
        found
    };
    let mut series = vec![];
    let mut ends: Vec<Point> = rows
        .iter()
        .zip(&on_front)
        .filter(|(_, front)| **front)
        .map(|(row, _)| Point { x: (cost.of)(row), y: (measure.of)(row) / edge, ..Point::default() })
        .collect();
    ends.sort_by(|a, b| a.x.total_cmp(&b.x));
    series.push(Series {
        name: FRONT.into(),
        colour: "#888888",
        marker: Marker::Bare,
        line: Some("2 4"),
        points: ends,
    });
    let sweep = of_varied(&[Varied::Default, Varied::Tolerance]);
    if cost.name == "triangles"
        && let Some(order) =
            report.orders.iter().find(|o| o.of == "builds" && o.error == measure.key && o.over == "triangles")
    {
        series.extend(slopes(order, edge));
    }
    series.push(Series {
        name: "tolerances, default settings".into(),
        colour: COLOURS[0],
        line: Some("none"),
        points: sweep,
        ..Series::default()
    });
    if measure.key == "certified" {
        let swept = rows.iter().filter(|row| matches!(row.setting.varied, Varied::Default | Varied::Tolerance));
        let mut points: Vec<Point> =
            swept.map(|row| Point { label: String::new(), ..point(row, row.measured.max(), false) }).collect();
        points.sort_by(|a, b| a.y.total_cmp(&b.y));
        let (name, colour, marker) = ("largest error, measured".into(), COLOURS[1], Marker::Hollow);
        series.push(Series { name, colour, marker, line: Some("1 3"), points });
    }
    for (name, varied, marker, colour) in [
        ("efforts", Varied::Effort, Marker::Square, COLOURS[2]),
        ("fillings", Varied::Fillings, Marker::Diamond, COLOURS[3]),
        ("chart sizes", Varied::Charts, Marker::Hollow, COLOURS[4]),
        ("combinations", Varied::Combination, Marker::Diamond, COLOURS[5]),
    ] {
        series.push(Series { name: name.into(), colour, marker, line: None, points: of_varied(&[varied]) });
    }
    series.extend(peer_series(&report.peers, cost.of_peer, measure.of_peer, edge));
    series.retain(|series| !series.points.is_empty());
    let title = format!("{} against {}", measure.name, cost.name);
    Plot { title, x: log(cost.label), y: log("error / mean edge"), series }.svg()
}

/// The fitted line, and lines of the expected slopes through its middle.
fn slopes(order: &Order, edge: f64) -> Vec<Series> {
    let [from, to] = order.range;
    let at = |x: f64| order.at_one * x.powf(order.slope) / edge;
    let middle = (from * to).sqrt();
    let line = |name: String, dashes, value: &dyn Fn(f64) -> f64| Series {
        name,
        colour: "#888888",
        marker: Marker::Bare,
        line: Some(dashes),
        points: [from, to].map(|x| Point { x, y: value(x), ..Point::default() }).into(),
    };
    let mut all = vec![line(format!("fitted, slope {:.2}", order.slope), "8 4", &at)];
    let [steepest, flattest] = order.expected;
    // A slope of 0 would say nothing.
    let ends = [("1 3 6 3", Some(steepest)), ("1 3", (flattest != steepest && flattest < 0.0).then_some(flattest))];
    for (dashes, expected) in ends {
        let Some(expected) = expected else { continue };
        all.push(line(format!("expected, {expected}"), dashes, &|x| at(middle) * (x / middle).powf(expected)));
    }
    all
}

/// One series for all rows of a peer.
fn peer_series(peers: &[PeerRow], cost: PeerValue, measure: PeerValue, edge: f64) -> Vec<Series> {
    let mut series: Vec<Series> = vec![];
    for peer in peers {
        let (Some(x), Some(y)) = (cost(peer), measure(peer)) else { continue };
        let point = Point { x, y: y / edge, title: peer.name.clone(), ..Point::default() };
        match series.iter_mut().find(|series| series.name == peer.name) {
            Some(series) => series.points.push(point),
            None => {
                let colour = COLOURS[(6 + series.len()) % COLOURS.len()];
                let (name, marker) = (peer.name.clone(), Marker::Square);
                series.push(Series { name, colour, marker, line: None, points: vec![point] });
            }
        }
    }
    for series in &mut series {
        series.points.sort_by(|a, b| a.x.total_cmp(&b.x));
        series.line = (series.points.len() > 1).then_some("3 3");
    }
    series
}

fn settings_plot(report: &Report) -> String {
    let Some(default) = report.builds.first() else { return String::new() };
    let knobs = [
        ("", Varied::Default, Marker::Dot),
        ("efforts", Varied::Effort, Marker::Square),
        ("fillings", Varied::Fillings, Marker::Diamond),
        ("chart sizes", Varied::Charts, Marker::Hollow),
        ("regions", Varied::Regions, Marker::Square),
        ("combinations", Varied::Combination, Marker::Diamond),
    ];
    let series = knobs.iter().zip(COLOURS.iter().cycle()).map(|((name, varied, marker), &colour)| {
        let rows =
            report.builds.iter().filter(|row| row.setting.varied == *varied && row.setting.tolerance_factor == 1.0);
        let points = rows.map(|row| Point {
            x: row.cpu_seconds / default.cpu_seconds,
            y: row.bytes as f64 / default.bytes as f64,
            spread: Some(row.cpu_range.map(|seconds| seconds / default.cpu_seconds)),
            label: row.setting.name.clone(),
            title: format!("{}: RMS {}", row.setting.name, short(row.measured.rms() / report.unit())),
            on_front: false,
        });
        Series { name: (*name).into(), colour, marker: *marker, line: None, points: points.collect() }
    });
    Plot {
        title: "Settings at the default tolerance, relative to the default".into(),
        x: Axis { label: "processor time relative to the default".into(), is_log: true },
        y: Axis { label: "bytes relative to the default".into(), is_log: true },
        series: series.filter(|series| !series.points.is_empty()).collect(),
    }
    .svg()
}

fn stage_bars(report: &Report) -> String {
    const PARTS: [&str; 8] =
        ["import", "repair (safety)", "segment", "simplify", "certify (safety)", "grids", "rest of roots", "pack"];
    let shown = report.builds.iter().filter(|row| {
        row.setting.tolerance_factor == 1.0
            && matches!(row.setting.varied, Varied::Default | Varied::Effort | Varied::Fillings | Varied::Charts)
    });
    let rows: Vec<(String, Vec<f64>)> = shown
        .map(|row| {
            let stage = |name: &str| row.stage(name);
            let grids = stage("embed") + stage("sample");
            let rest = (stage("roots") - stage("simplify") - stage("certify") - grids).max(0.0);
            let (simplify, certify) = (stage("simplify"), stage("certify"));
            let values =
                vec![stage("import"), stage("repair"), stage("segment"), simplify, certify, grids, rest, stage("pack")];
            (row.setting.name.clone(), values)
        })
        .collect();
    bars("Processor time by stage", "s", &PARTS, &rows)
}

fn cut_plots(report: &Report) -> Vec<String> {
    let edge = report.unit();
    type Pick = fn(&super::CutRow) -> Option<f64>;
    let errors: [(&str, Pick, &'static str, Marker); 3] = [
        ("certified", |row| Some(row.certified), COLOURS[0], Marker::Dot),
        ("measured maximum", |row| Some(row.measured?.max()), COLOURS[1], Marker::Hollow),
        ("measured RMS", |row| Some(row.measured?.rms()), COLOURS[2], Marker::Dot),
    ];
    let against = |title: &str, label: &str, cost: fn(&super::CutRow) -> f64, of_peer: PeerValue| {
        let mut series = vec![];
        for (name, pick, colour, marker) in errors {
            let points = report.tolerance_cuts().filter_map(|row| {
                let y = pick(row)? / edge;
                Some(Point {
                    x: cost(row),
                    y,
                    title: format!("{name}: {} triangles", row.triangles),
                    ..Point::default()
                })
            });
            series.push(Series { name: name.into(), colour, marker, line: Some("none"), points: points.collect() });
        }
        for (asked, marker, colour) in
            [("triangles", Marker::Square, COLOURS[4]), ("bytes", Marker::Diamond, COLOURS[3])]
        {
            let points = report.cuts.iter().filter(|row| row.asked == asked).map(|row| Point {
                x: cost(row),
                y: row.certified / edge,
                title: format!("at most {} {asked}", row.value),
                ..Point::default()
            });
            let name = format!("budget of {asked}, certified");
            series.push(Series { name, colour, marker, line: None, points: points.collect() });
        }
        let peers = peer_series(&report.peers, of_peer, |peer| peer.rms, edge);
        series.extend(peers.into_iter().map(|peer| Series { name: format!("{}, RMS", peer.name), ..peer }));
        series.retain(|series| !series.points.is_empty());
        Plot { title: title.into(), x: log(label), y: log("error / mean edge"), series }.svg()
    };
    type Time = (&'static str, fn(&super::CutRow) -> f64);
    let times: [Time; 4] = [
        ("select", |row| row.select_seconds),
        ("fetch", |row| row.fetch_seconds),
        ("decode node by node", |row| row.decode_seconds),
        ("decode and stitch in one pass", |row| row.extract_seconds),
    ];
    let series = times.iter().zip(COLOURS).map(|((name, pick), colour)| Series {
        name: (*name).into(),
        colour,
        line: Some("none"),
        points: report
            .tolerance_cuts()
            .map(|row| Point { x: row.triangles as f64, y: pick(row) * 1e3, ..Point::default() })
            .collect(),
        ..Series::default()
    });
    let times =
        Plot { title: "Time of a query, by step".into(), x: log("triangles"), y: log("ms"), series: series.collect() };
    vec![
        against(
            "Error against bytes read, opening included",
            "bytes read",
            |row| row.bytes_read as f64,
            |peer| peer.bytes,
        ),
        against("Error against triangles drawn", "triangles", |row| row.triangles as f64, |peer| peer.triangles),
        times.svg(),
    ]
}

/// A quantity of a cut within budgets.
type OfBudget = fn(&BudgetRow) -> f64;

/// Niski (2007), figures 4.5, 4.6 and 4.8.
fn budget_plots(report: &Report) -> Vec<String> {
    let against = |title: String, varied: &str, [x, y]: [(&str, OfBudget); 2]| {
        let series = [(1, "one resolution a node"), (2, "two"), (3, "three")].into_iter().zip(COLOURS);
        let series = series.map(|((resolutions, name), colour)| {
            let rows = report.budgets.iter().filter(|row| row.resolutions == resolutions && row.varied == varied);
            let points = rows.map(|row| Point {
                x: x.1(row),
                y: y.1(row),
                title: format!(
                    "{:.0} nodes, {} triangles, {} pixels",
                    row.nodes,
                    short(row.triangles),
                    short(row.pixel_error)
                ),
                ..Point::default()
            });
            Series { name: name.into(), colour, line: Some("none"), points: points.collect(), ..Series::default() }
        });
        Plot { title, x: log(x.0), y: log(y.0), series: series.filter(|series| !series.points.is_empty()).collect() }
            .svg()
    };
    let triangles = report.budgets.iter().find(|row| row.varied == "nodes").and_then(|row| row.max_triangles);
    let nodes = report.budgets.iter().find(|row| row.varied == "triangles").map(|row| row.max_nodes);
    let (triangles, nodes) = (short(triangles.unwrap_or(0) as f64), short(nodes.unwrap_or(0) as f64));
    let node_budget: (&str, OfBudget) = ("most nodes", |row| row.max_nodes as f64);
    let error: (&str, OfBudget) = ("largest error, pixels", |row| row.pixel_error);
    vec![
        against(format!("Error with at most {triangles} triangles"), "nodes", [node_budget, error]),
        against(
            format!("Error with at most {nodes} nodes"),
            "triangles",
            [("most triangles", |row| row.max_triangles.unwrap_or(0) as f64), error],
        ),
        against(
            "Triangles at the same error".into(),
            "nodes_at_error",
            [node_budget, ("triangles", |row| row.triangles)],
        ),
        against(
            format!("Time to find a cut with at most {triangles} triangles"),
            "nodes",
            [node_budget, ("ms", |row| row.select_seconds * 1e3)],
        ),
    ]
}

fn orders_table(html: &mut String, report: &Report) {
    let Some(input) = report.input.as_ref().filter(|_| !report.orders.is_empty()) else { return };
    let head = ["error", "of", "over", "slope", "expected", "scatter", "points", "from", "to"];
    let rows = report.orders.iter().map(|order| {
        let expected = match order.expected {
            [a, b] if a == b => format!("{a}"),
            [a, b] => format!("{a} to {b}"),
        };
        vec![
            order.error.to_string(),
            order.of.to_string(),
            order.over.to_string(),
            format!("{:.2}", order.slope),
            expected,
            format!("{:.0} %", order.scatter * 100.0),
            order.points.to_string(),
            short(order.range[0]),
            short(order.range[1]),
        ]
    });
    let _ = writeln!(
        html,
        "<h2>Order of convergence</h2>\n<p>Least-squares slopes of error over triangles and over samples (vertices) in log-log, from \
         results with at most a quarter of the input's triangles. The surface is {}. Expected: {}.</p>",
        input.surface.kind.name(),
        escape(input.surface.kind.expected_words())
    );
    write_table(html, &head, rows);
}

fn tables(html: &mut String, report: &Report) {
    let edge = report.unit();
    if !report.builds.is_empty() {
        *html += "<h2>All builds</h2>\n";
        let head = [
            "setting",
            "tolerance",
            "CPU s",
            "range",
            "elapsed s",
            "memory MB",
            "bytes",
            "triangles",
            "roots (grids)",
            "certified",
            "maximum",
            "RMS",
        ];
        let rows = report.builds.iter().map(|row| {
            vec![
                row.setting.name.clone(),
                short(row.tolerance / edge),
                short(row.cpu_seconds),
                format!("{} to {}", short(row.cpu_range[0]), short(row.cpu_range[1])),
                short(row.wall_seconds),
                short(row.peak_memory_bytes as f64 / 1e6),
                row.bytes.to_string(),
                row.triangles.to_string(),
                format!("{} ({})", row.roots[0], row.roots[1]),
                short(row.certified / edge),
                short(row.measured.max() / edge),
                short(row.measured.rms() / edge),
            ]
        });
        write_table(html, &head, rows);
    }
    if !report.cuts.is_empty() {
        *html += "<h2>All queries</h2>\n";
        let head = [
            "asked",
            "of",
            "triangles",
            "nodes",
            "requests",
            "bytes read",
            "select ms",
            "fetch ms",
            "decode ms",
            "decode and stitch ms",
            "certified",
            "maximum",
            "RMS",
        ];
        let rows = report.cuts.iter().map(|row| {
            let measured = |pick: fn(&super::Distances) -> f64| {
                row.measured.as_ref().map_or(String::new(), |measured| short(pick(measured) / edge))
            };
            let ms = |seconds: f64| short(seconds * 1e3);
            vec![
                row.asked.to_string(),
                short(if row.asked == "tolerance" { row.value / edge } else { row.value }),
                row.triangles.to_string(),
                row.nodes.to_string(),
                row.requests.to_string(),
                row.bytes_read.to_string(),
                ms(row.select_seconds),
                ms(row.fetch_seconds),
                ms(row.decode_seconds),
                ms(row.extract_seconds),
                short(row.certified / edge),
                measured(super::Distances::max),
                measured(super::Distances::rms),
            ]
        });
        write_table(html, &head, rows);
    }
}

fn write_table<const N: usize>(html: &mut String, head: &[&str; N], rows: impl Iterator<Item = Vec<String>>) {
    let cells = |tag: &str, values: &[String]| -> String {
        values.iter().map(|value| format!("<{tag}>{}</{tag}>", escape(value))).collect()
    };
    let head: Vec<String> = head.iter().map(|name| name.to_string()).collect();
    let _ = writeln!(html, "<div class=\"wide\"><table>\n<tr>{}</tr>", cells("th", &head));
    for row in rows {
        let _ = writeln!(html, "<tr>{}</tr>", cells("td", &row));
    }
    *html += "</table></div>\n";
}
