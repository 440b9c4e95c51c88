//! Prints how many requests and bytes it takes to open files, to draw them at their coarsest, and to draw a hundredth of
//! them at their finest: requests FILE...

use lodpack::{File, Limits, Query, Recording, Result};

/// Regions that are tried for each file.
const REGION_COUNT: usize = 200;
/// A region holds one root in so many.
const SHARE: usize = 100;

fn main() -> std::result::Result<(), Box<dyn std::error::Error>> {
    for path in std::env::args().skip(1) {
        let bytes = std::fs::read(&path)?;
        println!("{path}: {} bytes", bytes.len());
        measure(&bytes)?;
    }
    Ok(())
}

fn measure(bytes: &[u8]) -> Result<()> {
    let source = Recording::new(bytes);
    let file = File::open(&source, Limits::default())?;
    print("open", &source.take());
    if let Some(overview) = file.overview()? {
        let (requests, mesh) = (source.take(), overview.mesh(&file.lattice()));
        println!("  overview of {} triangles, error {}", mesh.triangles.len(), overview.error);
        print("overview after opening", &requests);
    }
    file.extract(&file.uniform_cut(0)?)?;
    print("coarsest level after opening", &source.take());

    let boxes = (0..file.root_count()).map(|root| file.root_bounds(root)).collect::<Result<Vec<_>>>()?;
    let wanted = boxes.len().div_ceil(SHARE);
    let mut found: Vec<(usize, u64, f64)> = Vec::new();
    for centre in (0..boxes.len()).step_by(boxes.len().div_ceil(REGION_COUNT).max(1)) {
        let region = region_around(&boxes, centre, wanted);
        let query = Query { region: Some(region.into()), ..Query::default() };
        let file = File::open(&source, Limits::default())?;
        source.take();
        let cut = file.select(&query)?;
        let select = source.take();
        file.extract(&cut)?;
        let requests = [select, source.take()].concat();
        let read: u64 = requests.iter().map(|range| range.end - range.start).sum();
        let own = file.own_bytes(&cut)?;
        found.push((requests.len(), read, read as f64 / own as f64));
    }
    let within = found.iter().filter(|found| found.0 <= 10 && found.2 <= 1.5).count();
    let spread = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values[((values.len() - 1) as f64 * share) as usize];
        format!("median {:.2}, nine of ten below {:.2}, at most {:.2}", at(0.5), at(0.9), at(1.0))
    };
    println!("  {} regions of about {wanted} roots at the finest level, after opening:", found.len());
    println!("    {within} of them within 10 requests and 1.5 times their own bytes");
    println!("    requests        {}", spread(found.iter().map(|found| found.0 as f64).collect()));
    println!("    bytes           {}", spread(found.iter().map(|found| found.1 as f64).collect()));
    println!("    over own bytes  {}", spread(found.iter().map(|found| found.2).collect()));
    Ok(())
}

fn print(what: &str, requests: &[std::ops::Range<u64>]) {
    let bytes: u64 = requests.iter().map(|range| range.end - range.start).sum();
    println!("  {what}: {} requests, {bytes} bytes {requests:?}", requests.len());
}

/// The smallest cube around the middle of a root's box that meets `count` boxes.
fn region_around(boxes: &[[[f64; 3]; 2]], root: usize, count: usize) -> [[f64; 3]; 2] {
    let [low, high] = boxes[root];
    let centre = [0, 1, 2].map(|k| (low[k] + high[k]) / 2.0);
    let distance = |[low, high]: &[[f64; 3]; 2]| {
        (0..3).map(|k| (low[k] - centre[k]).max(centre[k] - high[k]).max(0.0)).fold(0.0, f64::max)
    };
    let mut distances: Vec<f64> = boxes.iter().map(distance).collect();
    distances.sort_by(f64::total_cmp);
    let reach = distances[count.min(distances.len()) - 1];
    [centre.map(|x| x - reach), centre.map(|x| x + reach)]
}
