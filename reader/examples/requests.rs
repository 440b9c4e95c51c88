//! Prints how many requests and bytes it takes to open files, to draw them at their coarsest, and to draw a hundredth
//! of them at their finest level and at the error of the next coarser one:
//! requests [--regions N] [--csv] FILE|ADDRESS...
//!
//! An address needs the feature `http` (http://, https://) or `object-store` (s3://, gs://, az://).
//! `tests/bench/streams.py` runs this on a disk, a web server and an S3 server, and beside Nexus.

use std::{error::Error, io, ops::Range, time::Instant};

use lodpack::{File, Limits, Query, ReadAt, source::Recording};

/// How many regions are read of each file.
const REGION_COUNT: usize = 200;
/// A region holds one root in this many.
const SHARE: usize = 100;

type Source = Box<dyn ReadAt + Send + Sync>;
type Bounds = [[f64; 3]; 2];

fn main() -> Result<(), Box<dyn Error>> {
    let (mut region_count, mut is_csv) = (REGION_COUNT, false);
    let mut arguments = std::env::args().skip(1);
    let mut names = Vec::new();
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--regions" => region_count = arguments.next().ok_or("--regions wants a number")?.parse()?,
            "--csv" => is_csv = true,
            _ => names.push(argument),
        }
    }
    if is_csv {
        println!("what,x0,y0,z0,x1,y1,z1,tolerance,triangles,requests,bytes,own_bytes,seconds");
    }
    for name in names {
        let source = Recording::new(open(&name)?);
        let steps = measure(&source, region_count)?;
        if is_csv {
            steps.iter().for_each(Step::print_row);
        } else {
            println!("{name}: {} bytes", source.size()?);
            print(&steps);
        }
    }
    Ok(())
}

fn open(name: &str) -> io::Result<Source> {
    match name.split_once("://") {
        None => Ok(Box::new(std::fs::File::open(name)?)),
        #[cfg(feature = "http")]
        Some(("http" | "https", _)) => {
            Ok(Box::new(lodpack::source::Http::new(name, lodpack::source::HttpOptions::default())))
        }
        #[cfg(feature = "object-store")]
        Some(("s3" | "gs" | "az", _)) => Ok(Box::new(lodpack::source::Object::open(name)?)),
        Some(_) => Err(io::Error::new(io::ErrorKind::Unsupported, format!("{name}: built without its feature"))),
    }
}

/// Something that is drawn, and what that took.
struct Step {
    what: &'static str,
    region: Bounds,
    /// Certified error, input units.
    error: f64,
    triangle_count: usize,
    requests: Vec<Range<u64>>,
    /// Bytes of the index blocks and pages that are needed; 0 where this is not measured.
    own_bytes: u64,
    /// Elapsed time, decoding included.
    seconds: f64,
}

impl Step {
    fn bytes(&self) -> u64 {
        self.requests.iter().map(|range| range.end - range.start).sum()
    }

    fn print_row(&self) {
        let &Step { what, region: [low, high], error, triangle_count, own_bytes, seconds, .. } = self;
        let (requests, bytes) = (self.requests.len(), self.bytes());
        let region: Vec<String> = low.iter().chain(&high).map(f64::to_string).collect();
        println!("{what},{},{error},{triangle_count},{requests},{bytes},{own_bytes},{seconds:.6}", region.join(","));
    }
}

/// Opens the file, draws it at its coarsest, and then draws regions. The file is opened anew for each region, but only
/// the first step counts what opening takes.
fn measure(source: &Recording<Source>, region_count: usize) -> lodpack::Result<Vec<Step>> {
    let start = Instant::now();
    let file = File::open(source, Limits::default())?;
    let all = file.bounds().unwrap_or_default();
    let step = |what, region, start: Instant| Step {
        what,
        region,
        error: 0.0,
        triangle_count: 0,
        requests: source.take(),
        own_bytes: 0,
        seconds: start.elapsed().as_secs_f64(),
    };
    let mut steps = vec![step("open", all, start)];
    let start = Instant::now();
    if let Some(overview) = file.overview()? {
        let triangle_count = overview.mesh(&file.lattice()).triangles.len();
        steps.push(Step { triangle_count, error: overview.error, ..step("overview after opening", all, start) });
    }
    let start = Instant::now();
    let cut = file.uniform_cut(0)?;
    let triangle_count = file.extract(&cut)?.triangles.len();
    steps.push(Step { triangle_count, error: cut.error, ..step("coarsest level after opening", all, start) });

    let boxes = (0..file.root_count()).map(|root| file.root_bounds(root)).collect::<lodpack::Result<Vec<_>>>()?;
    let wanted = boxes.len().div_ceil(SHARE);
    let coarser = file.level_count().checked_sub(2).and_then(|level| file.level(level)).map(|level| level.max_error);
    let mut resolutions = vec![("region at the finest", None)];
    resolutions.extend(coarser.map(|error| ("region at the next coarser level", Some(error))));
    for (what, tolerance) in resolutions {
        for centre in (0..boxes.len()).step_by(boxes.len().div_ceil(region_count).max(1)) {
            let region = region_around(&boxes, centre, wanted);
            let query = Query { volume: Some(region.into()), tolerance, ..Query::default() };
            let file = File::open(source, Limits::default())?;
            source.take();
            let start = Instant::now();
            let cut = file.select(&query)?;
            let triangle_count = file.extract(&cut)?.triangles.len();
            let found = step(what, region, start);
            steps.push(Step { triangle_count, error: cut.error, own_bytes: file.own_bytes(&cut)?, ..found });
        }
    }
    Ok(steps)
}

fn print(steps: &[Step]) {
    for step in steps.iter().filter(|step| step.own_bytes == 0) {
        print!("  {}: {} requests, {} bytes {:?}", step.what, step.requests.len(), step.bytes(), step.requests);
        match step.triangle_count {
            0 => println!(),
            count => println!("; {count} triangles, error {}", step.error),
        }
    }
    let regions: Vec<&Step> = steps.iter().filter(|step| step.own_bytes > 0).collect();
    let spread = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values[((values.len() - 1) as f64 * share) as usize];
        format!("median {:.2}, nine of ten below {:.2}, at most {:.2}", at(0.5), at(0.9), at(1.0))
    };
    for alike in regions.chunk_by(|a, b| a.what == b.what) {
        let over = |step: &Step| step.bytes() as f64 / step.own_bytes as f64;
        let within = alike.iter().filter(|step| step.requests.len() <= 10 && over(step) <= 1.5).count();
        println!("  {}, a hundredth of the roots each: {} of them, after opening", alike[0].what, alike.len());
        println!("    {within} of them within 10 requests and 1.5 times their own bytes");
        println!("    requests        {}", spread(alike.iter().map(|step| step.requests.len() as f64).collect()));
        println!("    bytes           {}", spread(alike.iter().map(|step| step.bytes() as f64).collect()));
        println!("    over own bytes  {}", spread(alike.iter().map(|step| over(step)).collect()));
    }
}

/// The smallest cube around the middle of a root's box that meets `count` boxes.
fn region_around(boxes: &[Bounds], root: usize, count: usize) -> Bounds {
    let [low, high] = boxes[root];
    let centre = [0, 1, 2].map(|k| (low[k] + high[k]) / 2.0);
    let distance = |[low, high]: &Bounds| {
        (0..3).map(|k| (low[k] - centre[k]).max(centre[k] - high[k]).max(0.0)).fold(0.0, f64::max)
    };
    let mut distances: Vec<f64> = boxes.iter().map(distance).collect();
    distances.sort_by(f64::total_cmp);
    let reach = distances[count.min(distances.len()) - 1];
    [centre.map(|x| x - reach), centre.map(|x| x + reach)]
}
