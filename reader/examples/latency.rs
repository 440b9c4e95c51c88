//! Draws a camera path of 750 frames from a source where each read takes 50 ms, in the three modes of Correa 2004
//! (section 4.6.1); prints a table and writes a plot. The clock is virtual, so the numbers are the same everywhere.
//!
//! ```sh
//! cargo run --release -p lodpack --example latency -- model.lodpack plot.svg
//! ```

mod viewing;

use std::{
    collections::hash_map::DefaultHasher,
    error::Error,
    fmt::Write,
    hash::{Hash, Hasher},
    sync::Arc,
    time::Duration,
};

use lodpack::{
    File, Limits, Node, ReadAt, View,
    index::BlockContents,
    select::{Coherence, Hierarchy, select_in},
    stream::{Counters, Follower, Mode, Options, Shows, Simulation},
};
use viewing::{FRAME_COUNT, FRAMES_PER_SECOND, Path, query};

const LATENCY: Duration = Duration::from_millis(50);
const FRAME_TIME: Duration = Duration::from_nanos(1_000_000_000 / FRAMES_PER_SECOND as u64);
/// How far prefetching looks ahead: a few reads, one after the other.
const AHEAD: Duration = Duration::from_millis(400);
/// Frames after which everything is loaded and the pictures are compared.
const COMPARED: [u32; 5] = [0, 150, 300, 450, 600];

const MODES: [(Mode, &str, &str); 3] = [
    (Mode::Synchronous, "synchronous", "#888888"),
    (Mode::Asynchronous, "asynchronous", "#d95f02"),
    (Mode::AsynchronousWithPrefetch, "with prefetch", "#1b6ca8"),
];

/// The results of one mode on the path.
struct Run {
    counters: Counters,
    /// For each frame the mean error of the roots in sight, in pixels; none while the overview is drawn.
    errors: Vec<Option<f64>>,
    /// For each frame the demand misses so far.
    misses: Vec<u64>,
    frames_in_time: u32,
}

/// What is needed to tell the errors of what is drawn.
struct Errors {
    roots: Vec<([[f64; 3]; 2], Vec<BlockContents>)>,
}

impl Errors {
    fn new<S: ReadAt>(file: &File<S>) -> lodpack::Result<Self> {
        let root = |root| Ok((file.root_bounds(root)?, file.root_contents(root)?.blocks));
        Ok(Self { roots: (0..file.root_count()).map(root).collect::<lodpack::Result<_>>()? })
    }

    /// The mean error in pixels of the roots that are wanted finer than at their coarsest level.
    fn mean(&self, view: &View, wanted: &[Node], drawn: &[Node]) -> f64 {
        let fine = wanted.iter().zip(drawn).filter(|(wanted, _)| wanted.level > 0);
        mean(fine.filter_map(|(wanted, drawn)| {
            let ([low, high], blocks) = self.roots.get(wanted.root as usize)?;
            let outside = |k: usize| (low[k] - view.position[k]).max(view.position[k] - high[k]).max(0.0);
            let distance = (0..3).map(|k| outside(k) * outside(k)).sum::<f64>().sqrt();
            let block = blocks.iter().rev().find(|block| block.level <= drawn.level)?;
            Some(block.error * view.pixels_per_tangent() / distance.max(view.near))
        }))
    }
}

/// Caches that hold half of the file's bytes and about a third of its surfaces.
fn options<S: ReadAt>(mode: Mode, file: &File<S>) -> Options {
    let finest = file.level_count().checked_sub(1).and_then(|level| file.level(level));
    let triangle_count = finest.map_or(0, |level| level.triangle_count);
    Options { mode, byte_cache: file_size(file) / 2, decoded_cache: 32 * triangle_count, ..Options::default() }
}

/// A file and the path along which it is viewed.
struct Scene<'f, S> {
    file: &'f File<S>,
    path: Path,
    hierarchy: Arc<Hierarchy>,
}

fn run<S: ReadAt>(Scene { file, path, hierarchy }: &Scene<'_, S>, mode: Mode) -> lodpack::Result<Run> {
    let mut session = file.session(options(mode, file))?;
    let mut simulation = Simulation::new(file.source(), LATENCY);
    let mut follower = Follower::new(hierarchy.clone(), Coherence::default(), AHEAD);
    let errors = Errors::new(file)?;
    let mut run = Run { counters: Counters::default(), errors: vec![], misses: vec![], frames_in_time: 0 };
    for frame in 0..FRAME_COUNT {
        let view = path.view(frame);
        let (wanted, expected) = follower.follow(&query(view), FRAME_TIME * (frame + 1))?;
        let drawn = simulation.frame(&mut session, &wanted.nodes, &expected)?;
        let is_picture = drawn.shows == Shows::Picture;
        run.errors.push(is_picture.then(|| errors.mean(&view, &wanted.nodes, &session.picture().nodes())));
        run.misses.push(session.counters().misses);
        run.frames_in_time += u32::from(is_picture && drawn.late_roots == 0);
        simulation.advance(&session, FRAME_TIME);
    }
    run.counters = session.counters();
    Ok(run)
}

/// What some frames draw once everything is loaded.
fn pictures<S: ReadAt>(Scene { file, path, hierarchy }: &Scene<'_, S>, mode: Mode) -> lodpack::Result<Vec<u64>> {
    let mut session = file.session(options(mode, file))?;
    let mut simulation = Simulation::new(file.source(), LATENCY);
    let mut hashes = Vec::new();
    for frame in COMPARED {
        let cut = select_in(hierarchy, &query(path.view(frame)))?.nodes;
        while !simulation.frame(&mut session, &cut, &cut)?.is_complete {
            simulation.settle(&session);
        }
        let mesh = session.picture().mesh();
        let mut hasher = DefaultHasher::new();
        mesh.positions.iter().for_each(|point| point.map(f64::to_bits).hash(&mut hasher));
        mesh.triangles.hash(&mut hasher);
        hashes.push(hasher.finish());
    }
    Ok(hashes)
}

fn file_size<S: ReadAt>(file: &File<S>) -> u64 {
    file.source().size().unwrap_or(0)
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    sum / f64::from(count.max(1))
}

fn table(runs: &[Run]) -> String {
    let mut text = String::from("| |");
    MODES.iter().for_each(|(_, name, _)| text += &format!(" {name} |"));
    text += "\n|---|---:|---:|---:|\n";
    let mut row = |name: &str, value: &dyn Fn(&Run) -> String| {
        let _ = write!(text, "| {name} |");
        runs.iter().for_each(|run| text += &format!(" {} |", value(run)));
        text += "\n";
    };
    row("frames that waited (stalls)", &|run| run.counters.stalls.to_string());
    row("time waited, s", &|run| format!("{:.1}", run.counters.stall_time.as_secs_f64()));
    row("demand misses", &|run| run.counters.misses.to_string());
    row("of these in the first frame", &|run| run.misses.first().map_or(0, |&count| count).to_string());
    row("of these in the worst later frame", &|run| {
        run.misses.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap_or(0).to_string()
    });
    row("frames drawn exactly as wanted", &|run| format!("{} of {FRAME_COUNT}", run.frames_in_time));
    row("roots drawn coarser than wanted, mean per frame", &|run| {
        format!("{:.2}", run.counters.late_roots as f64 / f64::from(FRAME_COUNT))
    });
    row("mean error in sight, pixels", &|run| format!("{:.3}", mean(run.errors.iter().copied().flatten())));
    row("requests", &|run| run.counters.requests.to_string());
    row("kB read", &|run| format!("{:.0}", run.counters.bytes_read as f64 / 1e3));
    row("kB prefetched", &|run| format!("{:.0}", run.counters.prefetch_bytes as f64 / 1e3));
    row("of these never demanded (waste)", &|run| match run.counters.prefetch_bytes {
        0 => "-".into(),
        all => format!("{:.0} %", 100.0 * run.counters.wasted_prefetch_bytes() as f64 / all as f64),
    });
    row("mean time from first demand to decoded, ms", &|run| {
        format!("{:.0}", run.counters.latency.mean().as_secs_f64() * 1e3)
    });
    row("borders made anew, of those drawn", &|run| {
        let share = run.counters.borders_rebuilt as f64 / run.counters.borders_drawn.max(1) as f64;
        format!("{:.2} %", 100.0 * share)
    });
    text
}

/// One line per mode, over the frames. A line is interrupted where there is no value.
fn panel(svg: &mut String, top: f64, title: &str, values: [Vec<Option<f64>>; 3]) {
    const SIZE: [f64; 2] = [680.0, 180.0];
    let most = values.iter().flatten().flatten().copied().fold(1e-9, f64::max);
    let _ = writeln!(svg, r#"<text x="50" y="{}" font-weight="bold">{title}</text>"#, top - 8.0);
    for k in 0..=4 {
        let (y, value) = (top + SIZE[1] * (1.0 - f64::from(k) / 4.0), most * f64::from(k) / 4.0);
        let label = if most < 10.0 { format!("{value:.2}") } else { format!("{value:.0}") };
        let _ = writeln!(svg, r##"<path d="M50 {y:.1}H{}" stroke="#dddddd"/>"##, 50.0 + SIZE[0]);
        let _ = writeln!(svg, r#"<text x="45" y="{:.1}" text-anchor="end">{label}</text>"#, y + 4.0);
    }
    for ((_, _, colour), values) in MODES.iter().zip(values) {
        let (mut path, mut command) = (String::new(), 'M');
        for (frame, value) in values.iter().enumerate() {
            let Some(value) = value else {
                command = 'M';
                continue;
            };
            let x = 50.0 + SIZE[0] * frame as f64 / f64::from(FRAME_COUNT);
            let _ = write!(path, "{command}{x:.1} {:.1}", top + SIZE[1] * (1.0 - value / most));
            command = 'L';
        }
        let _ = writeln!(svg, r#"<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.3"/>"#);
    }
}

fn plot(runs: &[Run; 3]) -> String {
    let mut svg = String::from(
        r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 760 520" font-family="sans-serif" font-size="12">"#,
    );
    svg += "\n<rect width=\"760\" height=\"520\" fill=\"white\"/>\n";
    panel(&mut svg, 60.0, "Mean error of what is in sight, pixels", [0, 1, 2].map(|k| runs[k].errors.clone()));
    let misses = |run: &Run| run.misses.iter().map(|&count| Some(count as f64)).collect();
    panel(&mut svg, 290.0, "Demand misses so far", [0, 1, 2].map(|k| misses(&runs[k])));
    let _ = writeln!(svg, r#"<text x="390" y="490" text-anchor="middle">frame, 0 to {FRAME_COUNT}</text>"#);
    for (k, (_, name, colour)) in MODES.iter().enumerate() {
        let x = 50 + 150 * k;
        let _ = writeln!(svg, r#"<path d="M{x} 509h24" stroke="{colour}" stroke-width="3"/>"#);
        let _ = writeln!(svg, r#"<text x="{}" y="513">{name}</text>"#, x + 30);
    }
    svg + "</svg>\n"
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let name = arguments.next().ok_or("usage: latency model.lodpack [plot.svg]")?;
    let file = File::open(std::fs::File::open(name)?, Limits::default())?;
    let path = Path::around(file.bounds().ok_or("the file is empty")?);
    let scene = Scene { file: &file, path, hierarchy: Arc::new(file.hierarchy()?) };
    let [a, b, c] = MODES.map(|(mode, _, _)| run(&scene, mode));
    let runs = [a?, b?, c?];
    print!("{}", table(&runs));
    if let Some(path) = arguments.next() {
        std::fs::write(path, plot(&runs))?;
    }
    let [a, b, c] = MODES.map(|(mode, _, _)| pictures(&scene, mode));
    let (a, b, c) = (a?, b?, c?);
    let verdict = if a == b && b == c { "identical" } else { "DIFFERENT" };
    println!("\nonce loaded, frames {COMPARED:?} are {verdict} in the three modes");
    Ok(())
}
