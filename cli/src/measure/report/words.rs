//! What each setting buys, in sentences computed from the numbers.

use super::analysis::{DefaultCheck, competes};
use super::plot::short;
use super::{BudgetRow, BuildRow, Report, Varied};

/// The stages of a build's summary that keep a build correct.
pub(crate) const SAFETY_STAGES: [&str; 2] = ["repair", "certify"];

pub(crate) fn words(report: &Report) -> Vec<String> {
    let mut words = vec![];
    if let Some(default) = report.builds.first() {
        words.push(default_words(report, default));
        words.extend(tolerance_words(&report.builds, default));
        words.extend(setting_words(&report.builds, default));
        words.extend(thread_words(&report.builds));
        words.push(front_words(report.default_check.as_ref()));
        words.extend(safety_words(report, default));
    }
    words.extend(order_words(report));
    words.extend(cut_words(report));
    words.extend(budget_words(report));
    for (setting, why) in &report.failures {
        words.push(format!("No build succeeded with {setting}: {why}."));
    }
    words
}

fn bytes(value: u64) -> String {
    if value < 1000 { format!("{value} bytes") } else { format!("{}B", short(value as f64)) }
}

/// A ratio, as a change in per cent.
fn change(ratio: f64) -> String {
    let percent = (ratio - 1.0) * 100.0;
    match () {
        () if !percent.is_finite() => "-".into(),
        () if percent.abs() < 0.5 => "±0 %".into(),
        () if percent.abs() >= 100.0 => format!("x {}", short(ratio)),
        () => format!("{percent:+.0} %").replace('-', "−"),
    }
}

fn default_words(report: &Report, default: &BuildRow) -> String {
    let edge = report.unit();
    let input = report.input.as_ref().map_or(0, |input| input.triangles);
    format!(
        "With default settings, building {} triangles takes {} s of processor time ({} triangles per second) and {} of memory. It \
         writes {} with all levels; the finest has {} triangles. The certified error is {} mean edge lengths, the largest measured \
         error {}, and the measured root mean square error {}.",
        short(input as f64),
        short(default.cpu_seconds),
        short(input as f64 / default.cpu_seconds.max(1e-9)),
        bytes(default.peak_memory_bytes),
        bytes(default.bytes),
        short(default.triangles as f64),
        short(default.certified / edge),
        short(default.measured.max() / edge),
        short(default.measured.rms() / edge),
    )
}

/// The figures of a build relative to those of the default build.
fn beside(row: &BuildRow, default: &BuildRow) -> String {
    format!(
        "processor time {}, bytes {}, triangles {}, RMS {}, maximum {}, certified {}",
        change(row.cpu_seconds / default.cpu_seconds),
        change(row.bytes as f64 / default.bytes as f64),
        change(row.triangles as f64 / default.triangles as f64),
        change(row.measured.rms() / default.measured.rms()),
        change(row.measured.max() / default.measured.max()),
        change(row.certified / default.certified),
    )
}

fn tolerance_words(builds: &[BuildRow], default: &BuildRow) -> Vec<String> {
    let of = |factor: f64| {
        builds.iter().find(|row| row.setting.varied == Varied::Tolerance && row.setting.tolerance_factor == factor)
    };
    let sentence = |factor: f64, name: &str| Some(format!("{name} the tolerance: {}.", beside(of(factor)?, default)));
    [sentence(0.5, "Half"), sentence(2.0, "Twice")].into_iter().flatten().collect()
}

fn setting_words(builds: &[BuildRow], default: &BuildRow) -> Vec<String> {
    let others = builds
        .iter()
        .skip(1)
        .filter(|row| row.setting.tolerance_factor == 1.0 && (competes(row) || row.setting.varied == Varied::Regions));
    others
        .map(|row| match row.is_default_file {
            true => format!(
                "{}: the same file, byte for byte; processor time {}.",
                capital(&row.setting.name),
                change(row.cpu_seconds / default.cpu_seconds)
            ),
            false => format!("{}: {}.", capital(&row.setting.name), beside(row, default)),
        })
        .collect()
}

fn thread_words(builds: &[BuildRow]) -> Option<String> {
    let default = builds.first()?;
    let rows: Vec<&BuildRow> = builds.iter().filter(|row| row.setting.varied == Varied::Threads).collect();
    if rows.is_empty() {
        return None;
    }
    let same = if rows.iter().all(|row| row.is_default_file) { "the same bytes" } else { "DIFFERENT bytes" };
    let each: Vec<String> = rows
        .iter()
        .map(|row| {
            format!(
                "{}: processor time {}, elapsed {}, memory {}",
                row.setting.name,
                change(row.cpu_seconds / default.cpu_seconds),
                change(row.wall_seconds / default.wall_seconds),
                change(row.peak_memory_bytes as f64 / default.peak_memory_bytes as f64)
            )
        })
        .collect();
    Some(format!("Every number of threads gives {same}. {}.", capital(&each.join("; "))))
}

fn front_words(check: Option<&DefaultCheck>) -> String {
    let Some(check) = check else { return String::new() };
    if check.on_front {
        return "The default settings are on the Pareto front of bytes, processor time and error (RMS, maximum and certified): \
                no other setting in the sweep is better by more than 2 % in one of them without being worse in another."
            .into();
    }
    let mut settings: Vec<String> = vec![];
    for beaten in &check.beaten_by {
        let ratios = format!(
            "bytes {}, processor time {}, RMS {}, maximum {}, certified {}",
            change(beaten.bytes),
            change(beaten.cpu_seconds),
            change(beaten.rms),
            change(beaten.max),
            change(beaten.certified)
        );
        let text = format!("{} ({ratios})", beaten.setting);
        if !settings.contains(&text) {
            settings.push(text);
        }
    }
    let held: Vec<&str> = [(check.rms, "RMS"), (check.max, "maximum"), (check.certified, "certified error")]
        .into_iter()
        .filter_map(|(holds, name)| holds.then_some(name))
        .collect();
    let held = match held.len() {
        0 => "for every kind of error".to_string(),
        _ => format!("except for {}", held.join(" or ")),
    };
    format!(
        "The default settings are NOT on the Pareto front of bytes, processor time and error, {held}. They are beaten by {}. Repeated \
         default builds differ by {:.0} % in processor time.",
        settings.join(", "),
        check.time_spread * 100.0
    )
}

fn safety_words(report: &Report, default: &BuildRow) -> Vec<String> {
    let mut words = vec![];
    let shares: Vec<String> = SAFETY_STAGES
        .iter()
        .map(|stage| {
            let seconds = default.stage(stage);
            format!("{stage} {} s ({:.0} %)", short(seconds), seconds / default.cpu_seconds.max(1e-9) * 100.0)
        })
        .collect();
    words.push(format!(
        "Of the default build's {} s, safety takes: {}.",
        short(default.cpu_seconds),
        shares.join(", ")
    ));
    if let Some(cost) = &report.verification {
        words.push(format!(
            "Verifying the file with {} random cuts takes {} s of processor time; checking every stored error \
             against the input as well takes {} s ({} times the build). It found {}.",
            cost.cuts,
            short(cost.file_seconds),
            short(cost.against_seconds),
            short(cost.against_seconds / default.cpu_seconds.max(1e-9)),
            match cost.problems {
                0 => "nothing wrong".into(),
                count => format!("{count} PROBLEMS"),
            }
        ));
    }
    words
}

fn order_words(report: &Report) -> Option<String> {
    let input = report.input.as_ref()?;
    let order = report.orders.iter().find(|order| order.of == "builds" && order.error == "rms")?;
    Some(format!(
        "The surface is {} (creases: {:.1} % of the length of its edges; roughness {:.2}). The RMS error is proportional to \
         the number of triangles to the power of {:.2}; theory expects {}.",
        input.surface.kind.name(),
        input.surface.crease_share * 100.0,
        input.surface.roughness,
        order.slope,
        input.surface.kind.expected_words()
    ))
}

/// What more resolutions a node would buy where nodes are scarce.
fn budget_words(report: &Report) -> Option<String> {
    let scarce = report.budgets.iter().find(|row| row.varied == "triangles")?.max_nodes;
    let error = |resolutions: u8| {
        let is_kept =
            |row: &&BudgetRow| row.varied == "nodes" && row.resolutions == resolutions && row.max_nodes <= scarce;
        report.budgets.iter().rfind(is_kept)
    };
    let (one, two, three) = (error(1)?, error(2)?, error(3)?);
    Some(format!(
        "Within {} nodes and {} triangles, a picture of 1920 x 1080 is at most {} pixels off. If each node could be drawn as its \
         children are, too, it would be {}, and as its grandchildren {}.",
        one.max_nodes,
        short(one.max_triangles.unwrap_or(0) as f64),
        short(one.pixel_error),
        short(two.pixel_error),
        short(three.pixel_error),
    ))
}

fn cut_words(report: &Report) -> Vec<String> {
    let (picture, mut words) = (&report.first_picture, vec![]);
    let [requests, read, triangles] = picture.coarsest;
    if read == 0 {
        return words;
    }
    let overview = match picture.overview {
        Some((triangles, _)) => format!(", and brings an overview of {triangles} triangles"),
        None => String::new(),
    };
    words.push(format!(
        "First picture: opening takes {}, {}{overview}. All roots at their coarsest level, {} triangles, take {}, {} in all: {:.0} % of \
         the file.",
        counted(picture.open[0], "request"),
        bytes(picture.open[1]),
        short(triangles as f64),
        counted(requests, "request"),
        bytes(read),
        read as f64 / picture.file_bytes.max(1) as f64 * 100.0
    ));
    if let Some(finest) = report.tolerance_cuts().next() {
        words.push(format!(
            "The finest surface, {} triangles, takes {}, {}. Selecting takes {} ms, fetching {} ms, decoding node by node {} ms, and \
             decoding and stitching in one pass {} ms: {} triangles per second.",
            short(finest.triangles as f64),
            counted(finest.requests, "request"),
            bytes(finest.bytes_read),
            short(finest.select_seconds * 1e3),
            short(finest.fetch_seconds * 1e3),
            short(finest.decode_seconds * 1e3),
            short(finest.extract_seconds * 1e3),
            short(finest.triangles as f64 / (finest.select_seconds + finest.extract_seconds).max(1e-9))
        ));
    }
    words
}

fn counted(count: u64, name: &str) -> String {
    format!("{count} {name}{}", if count == 1 { "" } else { "s" })
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}
