//! One table of queries for every language: `tests/data/queries.txt`. This reader says what is expected; the tests of
//! the program and of the packages for Python, C and JavaScript compare. `LODPACK_WRITE_QUERIES=1` writes the table
//! again.
//!
//! A line is a file of `format-spec/vectors`, what is asked of it, `=`, and the answer: the kind of error, or nodes,
//! triangles, vertices, the error inside the box, that of everything, what limits the cut, and FNV-1a (64 bits) of the
//! positions (f64) and triangles (u32); of a channel that is asked for, its name and kind.

use std::{fmt::Write, path::Path};

use crate::{Cut, Error, File, Limits, Opened, Outside, Query, Result, heights::HeightsQuery};

/// What is asked.
const ASKED: [&str; 54] = [
    "tree",
    "tree tolerance=0",
    "tree tolerance=2.1",
    "tree tolerance=inf",
    "tree tolerance=nan",
    "tree tolerance=-1",
    "tree triangles=50",
    "tree triangles=18",
    "tree triangles=0",
    "tree triangles=18446744073709551615",
    "tree nodes=1",
    "tree nodes=4",
    "tree nodes=0",
    "tree nodes=18446744073709551615",
    "tree bytes=200",
    "tree bytes=0",
    "tree nodes=4 triangles=40",
    "tree box=0,0,0,2,2,4",
    "tree box=0,0,0,2,2,4 context",
    "tree box=0,0,0,2,2,4 context triangles=60",
    "tree box=0,0,0,2,2,4 nodes=2",
    "tree box=100,100,100,101,101,101",
    "tree box=100,100,100,101,101,101 context",
    "tree box=1,1,1,1,1,1",
    "tree box=2,2,2,1,1,1",
    "tree box=nan,0,0,1,1,1",
    "tree box=-inf,-inf,-inf,inf,inf,inf",
    "tree box=-inf,0,-inf,0,inf,inf",
    "tree drawn-by=torus",
    "tree drawn-by=heights/hills",
    "torus",
    "torus tolerance=0.1",
    "torus triangles=200",
    "torus triangles=29",
    "many_clusters box=-7,-7,-7,0,0,0 tolerance=0.2",
    "many_clusters box=-7,-7,-7,-6,-6,-6 context",
    "many_clusters nodes=53",
    "many_clusters triangles=600",
    "nothing",
    "exact_colours",
    "exact_colours channel=colour",
    "exact_colours channel=normal tolerance=0.125",
    "exact_colours channel=roughness box=-7,-7,-7,0,0,0 context",
    "exact_colours channel=Colour",
    "drawings channel=drawing triangles=50",
    "tree channel=colour",
    "heights/hills",
    "heights/hills tolerance=3",
    "heights/hills triangles=300",
    "heights/hills triangles=0",
    "heights/hills box=-inf,-inf,-inf,inf,inf,inf",
    "heights/hills box=-inf,-inf,0,0,inf,0 tolerance=5",
    "heights/hills box=nan,0,0,1,1,1",
    "heights/hills drawn-by=heights/ridge",
];

fn vectors() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../format-spec/vectors")
}

fn open(name: &str) -> Opened<Vec<u8>> {
    let bytes = std::fs::read(vectors().join(format!("{name}.lodpack"))).unwrap();
    Opened::open(bytes, Limits::default()).unwrap()
}

/// FNV-1a of 64 bits.
fn hash(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> u64 {
    let positions = positions.iter().flatten().flat_map(|x| x.to_le_bytes());
    let bytes = positions.chain(triangles.iter().flatten().flat_map(|vertex| vertex.to_le_bytes()));
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

fn answer(asked: &str) -> Result<String> {
    let mut words = asked.split(' ');
    let file = open(words.next().unwrap());
    let (mut drawn_by, mut channel) = (None, None);
    let mut query = Query::default();
    for word in words {
        let (name, value) = word.split_once('=').unwrap_or((word, ""));
        let numbers: Vec<f64> = value.split(',').filter_map(|number| number.parse().ok()).collect();
        match name {
            "tolerance" => query.tolerance = Some(numbers[0]),
            "triangles" => query.max_triangles = value.parse().ok(),
            "nodes" => query.max_nodes = value.parse().ok(),
            "bytes" => query.max_bytes = value.parse().ok(),
            "box" => query.volume = Some([[0, 1, 2], [3, 4, 5]].map(|corner| corner.map(|k: usize| numbers[k])).into()),
            "context" => query.outside = Outside::Coarsest,
            "channel" => channel = Some(value),
            "drawn-by" => drawn_by = Some(open(value)),
            other => panic!("{other}"),
        }
    }
    match &file {
        Opened::Mesh(file) => answer_of_mesh(file, &query, drawn_by.as_ref(), channel),
        Opened::Heights(file) => {
            let bounds = match query.volume {
                Some(crate::Volume::Box(corners)) => Some(corners.map(|[x, y, _]| [x, y])),
                _ => None,
            };
            let query = HeightsQuery { bounds, tolerance: query.tolerance, max_triangles: query.max_triangles };
            let cut = file.cut(&query)?;
            let mesh = match &drawn_by {
                Some(Opened::Heights(other)) => other.mesh(&cut)?,
                _ => file.mesh(&cut)?,
            };
            let (error, limiter) = (cut.error, cut.limiter.name());
            let counts = [cut.tiles.len(), mesh.triangles.len(), mesh.positions.len()];
            Ok(line(counts, [error; 2], limiter, hash(&mesh.positions, &mesh.triangles)))
        }
    }
}

fn answer_of_mesh(
    file: &File<Vec<u8>>,
    query: &Query,
    drawn_by: Option<&Opened<Vec<u8>>>,
    channel: Option<&str>,
) -> Result<String> {
    let cut = file.select(query)?;
    let mesh = match drawn_by {
        Some(Opened::Mesh(other)) => other.extract(&cut)?,
        // Types keep Rust from it.
        Some(Opened::Heights(_)) => return Err(Error::Query { what: "this cut is one of another file".into() }),
        None => file.extract(&cut)?,
    };
    assert_eq!(mesh.triangles.len() as u64, cut.triangle_count);
    let carried = match channel {
        None => String::new(),
        Some(name) => {
            // Rust asks by number.
            let number = file.channels().iter().position(|channel| channel.name == name);
            let number = number.ok_or(Error::Query { what: "there is no such channel".into() })?;
            let textured = file.extract_textured(&cut, &[number as u8])?;
            assert_eq!(textured.mesh.triangles, mesh.triangles);
            let channel = &file.channels()[number];
            format!(" {}:{}", channel.name, channel.kind.name())
        }
    };
    let Cut { error, limited_by, .. } = cut;
    let counts = [cut.nodes.len(), mesh.triangles.len(), mesh.positions.len()];
    let hash = hash(&mesh.positions, &mesh.triangles);
    Ok(line(counts, [error, cut.error_everywhere()], limited_by.name(), hash) + &carried)
}

fn line([nodes, triangles, vertices]: [usize; 3], [error, everywhere]: [f64; 2], limiter: &str, hash: u64) -> String {
    format!("{nodes} {triangles} {vertices} {error:?} {everywhere:?} {limiter} {hash:016x}")
}

#[test]
fn the_table_of_queries_has_the_answers_of_this_reader() {
    let mut table = String::new();
    for asked in ASKED {
        let answer = answer(asked).unwrap_or_else(|error| match error {
            Error::Query { .. } => "query".into(),
            error => panic!("{asked}: {error}"),
        });
        writeln!(table, "{asked} = {answer}").unwrap();
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/queries.txt");
    if std::env::var_os("LODPACK_WRITE_QUERIES").is_some() {
        std::fs::write(&path, &table).unwrap();
    }
    assert_eq!(std::fs::read_to_string(&path).unwrap(), table);
}
