//! Reads a cut of at most TRIANGLES triangles from a web server: http URL TRIANGLES

use lodpack::{
    Error, File, Limits, Query,
    source::{Counting, Http, HttpOptions, SourceError},
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [url, triangles] = arguments.as_slice() else { return Err("give an address and a number".into()) };

    let source = Counting::new(Http::new(url.as_str(), HttpOptions::default()));
    let file = match File::open(source, Limits::default()) {
        // Each thing that a server may do wrong has a name.
        Err(Error::Io { source, .. }) if SourceError::of(&source) == Some(&SourceError::RangesIgnored) => {
            return Err("this server sends whole files only: download it first".into());
        }
        other => other?,
    };
    let cut = file.select(&Query { max_triangles: Some(triangles.parse()?), ..Query::default() })?;
    let mesh = file.extract(&cut)?;
    println!("{} triangles, error at most {}", mesh.triangles.len(), cut.error);
    println!("{} bytes in {} requests", file.source().byte_count(), file.source().read_count());
    Ok(())
}
