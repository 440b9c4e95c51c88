//! The summary of a build or merge, for people.

use crate::output::{bound, by_filling, bytes, count, length, say};
use anyhow::Result;
use lodpack_cli::pipeline::summary::BuildSummary;
use std::path::Path;

/// Prints the summary.
pub fn print(s: &BuildSummary, output: &Path) -> Result<()> {
    let r = &s.repairs;
    say!("{}", output.display());
    say!(
        "  input      {} triangles; after repair {} triangles, {} vertices",
        count(s.input_triangles),
        count(s.triangles),
        count(s.input_vertices)
    );
    if s.objects > 0 {
        let assemblies = match s.assemblies {
            0 => String::new(),
            1 => " in 1 assembly".into(),
            some => format!(" in {} assemblies", count(some)),
        };
        let objects =
            if s.objects == 1 { "1 object was kept".into() } else { format!("{} objects were kept", count(s.objects)) };
        say!("  objects    {objects}{assemblies}");
    }
    say!(
        "  repairs    {} vertices welded, {} degenerate and {} duplicate faces dropped, {} edges and {} vertices cut, {} faces flipped",
        count(r.welded_vertices),
        count(r.degenerate_faces),
        count(r.duplicate_faces),
        count(r.nonmanifold_edges_cut),
        count(r.nonmanifold_vertices_split),
        count(r.flipped_faces)
    );
    say!("  roots      {}; {:.3} samples per input vertex", by_filling(&s.roots), s.samples_per_input_vertex);
    say!("  size       {}, {:.2} bits per input vertex", bytes(s.bytes), s.bits_per_input_vertex);
    say!(
        "  error      {} certified, tolerance {} ({:.2} mean edge lengths)",
        bound(s.certified_error),
        length(s.tolerance),
        s.tolerance / s.mean_edge_length
    );
    for level in &s.levels {
        say!(
            "  level {:<4} {:>12} triangles   error {:>10}   {:>10}",
            level.level,
            count(level.triangles),
            bound(level.certified_error),
            bytes(level.bytes)
        );
    }
    let f = &s.fallbacks;
    let coarser = match f.coarser_images {
        0 => String::new(),
        charts => format!(", {charts} with fewer texels than their images"),
    };
    say!(
        "  fallbacks  {} charts simplified again, {} kept as they are, {} arc samples added, {} charts without a map{coarser}",
        f.retried_charts,
        f.unsimplified_charts,
        f.raised_samples,
        f.embedding_failures
    );
    let stages: Vec<String> = s.stages.iter().map(|t| format!("{} {:.2}", t.stage, t.cpu_seconds)).collect();
    say!("  CPU        {:.2} s ({})", s.cpu_seconds, stages.join(", "));
    let disk = match s.temporary_bytes {
        0 => String::new(),
        size => format!(", temporary files {}", bytes(size)),
    };
    say!("  elapsed    {:.2} s, peak memory {}{disk}", s.wall_seconds, bytes(s.peak_memory_bytes));
    Ok(())
}
