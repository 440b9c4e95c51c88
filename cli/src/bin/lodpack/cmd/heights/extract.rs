//! Meshes and rasters of files of heights.

use super::super::extract::{Drawn, format_of, is_stdout};
use super::super::open::{Source, in_file};
use crate::args::{ExtractArgs, NormalsChoice, ProgressStyle};
use crate::messages;
use crate::output::count;
use crate::progress_bar::{self, Terminal};
use anyhow::{Result, bail};
use lodpack::Limiter;
use lodpack::heights::{BARE, DrapeImage, Heights, HeightsCut, HeightsMesh, HeightsQuery};
use lodpack_cli::heights::triangulate;
use lodpack_cli::mesh::draped;
use lodpack_cli::mesh::export::MeshFormat;
use lodpack_cli::mesh::shaded::Shading;
use lodpack_cli::reduce::Topology;

/// How many tiles or samples a mesh was made of, and which of both.
pub type Nodes = (u64, &'static str);

/// A budget is met after at most this many attempts, or not at all.
const ATTEMPTS: usize = 24;

/// The mesh that was asked for, and how many tiles it has.
pub fn mesh_of(file: &Heights<Source>, tolerance: Option<f64>, args: &ExtractArgs) -> Result<(Drawn, Nodes)> {
    let name = args.file.display();
    if args.nodes.is_some() || args.context {
        bail!("{name}: a grid of heights has tiles, to which --nodes and --context do not apply; omit them");
    }
    let bounds = args.bbox.map(|bbox| bbox.0.map(|[x, y, _]| [x, y]));
    let mut query = HeightsQuery { bounds, tolerance, max_triangles: args.triangles };
    let (cut, mesh) = meet(file, &mut query, args)?;
    if cut.tiles.is_empty() {
        bail!("{name}: nothing touches the box; the grid reaches {}", super::reach(file));
    }
    let normals: Vec<[f32; 3]> = mesh.normals.iter().map(|normal| normal.map(|x| f32::from(x) / 32767.0)).collect();
    let wants_colours = args.channels == "auto";
    let ramp = file.ramp().filter(|_| wants_colours);
    let mut colours: Option<Vec<[u8; 3]>> =
        ramp.map(|ramp| mesh.heights.iter().map(|&height| ramp.colour(height)).collect());
    let image = if wants_colours { image_over(file, &cut, args)? } else { None };
    let mut draped = None;
    if let Some(image) = &image {
        match format_of(args)? {
            MeshFormat::Stl => {}
            MeshFormat::Obj if is_stdout(&args.output) => {}
            MeshFormat::Obj | MeshFormat::Glb => {
                draped = Some(draped::draped(&mesh, &normals, file.grid(), image));
            }
            MeshFormat::Ply => {
                let below = colours.unwrap_or_else(|| vec![BARE; mesh.positions.len()]);
                let painted =
                    mesh.samples.iter().zip(below).map(|(&sample, below)| draped::colour_at(image, sample, below));
                colours = Some(painted.collect());
                messages::tell("note", "PLY has colours of vertices alone: write GLB or OBJ to keep the image");
            }
        }
    }
    let drawn = Drawn {
        positions: mesh.positions,
        triangles: mesh.triangles,
        error: cut.error,
        error_everywhere: cut.error,
        limited_by: cut.limiter,
        cut_triangles: None,
        topology: Topology::Kept,
        textured: None,
        coarser: 1.0,
        numbers: vec![],
        shading: Some(Shading {
            normals,
            colours,
            has_normals_everywhere: args.normals == Some(NormalsChoice::Smooth),
        }),
        draped,
        objects: None,
    };
    Ok((drawn, (cut.tiles.len() as u64, "tiles")))
}

/// The image over a cut, as fine as a page may be; none if there is none.
fn image_over(file: &Heights<Source>, cut: &HeightsCut, args: &ExtractArgs) -> Result<Option<DrapeImage>> {
    let Some(drape) = file.drape() else { return Ok(None) };
    let ends = cut.tiles.iter().map(|tile| file.grid().ends(tile.id));
    let all = ends.reduce(|one, other| [0, 1].map(|axis| join(one[axis], other[axis])));
    let Some([columns, rows]) = all else { return Ok(None) };
    // A window has up to two more texels.
    let Some(window) = drape.window_of_size(columns, rows, args.page_size.saturating_sub(2)) else { return Ok(None) };
    if window.halvings > 0 {
        let share = 1_u64 << window.halvings;
        messages::tell(
            "note",
            &format!(
                "the image has one texel of every {share} along each side, to fit one page; ask for less with --bbox, or for more with --page-size"
            ),
        );
    }
    Ok(Some(in_file(&args.file, file.drape_image(&window))?))
}

fn join([a, b]: [f64; 2], [c, d]: [f64; 2]) -> [f64; 2] {
    [a.min(c), b.max(d)]
}

/// The triangulation that was asked for, and how many samples it was made of.
pub fn tin_of(file: &Heights<Source>, tolerance: f64, args: &ExtractArgs) -> Result<(Drawn, Nodes)> {
    let name = args.file.display();
    let bounds = args.bbox.map(|bbox| bbox.0.map(|[x, y, _]| [x, y]));
    let progress = Terminal::new(ProgressStyle::Auto, progress_bar::TIN);
    let tin = match triangulate(file, bounds, tolerance, &progress) {
        Err(lodpack::Error::Query { what }) => bail!("{name}: {what}; the grid reaches {}", super::reach(file)),
        tin => in_file(&args.file, tin)?,
    };
    progress.complete();
    let drawn = Drawn {
        positions: tin.positions,
        triangles: tin.triangles,
        error: tin.error,
        error_everywhere: tin.error,
        limited_by: Limiter::Tolerance,
        cut_triangles: None,
        topology: Topology::Kept,
        textured: None,
        coarser: 1.0,
        numbers: vec![],
        shading: None,
        draped: None,
        objects: None,
    };
    Ok((drawn, (tin.sample_count, "samples")))
}

/// A mesh within the budget: stitching adds triangles, which a cut does not know.
fn meet(file: &Heights<Source>, query: &mut HeightsQuery, args: &ExtractArgs) -> Result<(HeightsCut, HeightsMesh)> {
    let mut limiter = None;
    for _ in 0..ATTEMPTS {
        let mut cut = match file.cut(query) {
            Err(lodpack::Error::Query { .. }) if query.max_triangles.is_some() => break,
            cut => in_file(&args.file, cut)?,
        };
        let mesh = in_file(&args.file, file.mesh(&cut))?;
        let made = mesh.triangles.len() as u64;
        let Some(most) = args.triangles.filter(|&most| made > most) else {
            cut.limiter = limiter.unwrap_or(cut.limiter);
            return Ok((cut, mesh));
        };
        limiter = Some(Limiter::Triangles);
        let smaller = (cut.triangle_count as f64 * (most as f64 / made as f64) * 0.98) as u64;
        query.max_triangles = Some(smaller.min(cut.triangle_count.saturating_sub(1)));
    }
    let coarsest =
        in_file(&args.file, file.cut(&HeightsQuery { tolerance: Some(f64::MAX), max_triangles: None, ..*query }))?;
    bail!(
        "{}: the coarsest surface has {} triangles; ask for more with --triangles",
        args.file.display(),
        count(coarsest.triangle_count)
    );
}
