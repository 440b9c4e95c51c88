//! `lodpack atlas`

use super::inputs::find_inputs;
use crate::args::{AtlasArgs, ProgressStyle};
use crate::interrupt;
use crate::output::{PendingFolder, bound, bytes, check_folder, count, length, say};
use crate::progress_bar::{self, Terminal};
use anyhow::{Context, Result, bail};
use lodpack_cli::geometry_images::{
    AtlasOptions, BuiltAtlas, MANIFEST_NAME, Resolutions, WriteOptions, atlas_files, build_atlas, mip_folders,
    read_atlas, write_atlas,
};
use lodpack_cli::import::{ImportOptions, Imported, Objects, Room, import_large_meshes};
use lodpack_cli::measure::two_sided::{FLOOR, OneSided, RELATIVE_GAP, Side};
use lodpack_cli::mesh::Mesh;
use lodpack_cli::mesh::attributes::Surface;
use lodpack_cli::progress::Progress;
use std::fs;
use std::path::Path;
use std::process::ExitCode;

/// Points on each surface for root mean squares.
const SAMPLES: usize = 200_000;

/// Writes a mesh as geometry images.
pub fn run(args: &AtlasArgs) -> Result<ExitCode> {
    let dir = &args.output;
    check_output(dir, args.force)?;
    interrupt::on_stop_leave_nothing();
    let (built, resolutions, distance) = {
        let progress = Terminal::new(ProgressStyle::Auto, progress_bar::ATLAS);
        let (channels, objects) = (args.channels.clone(), Objects::Join);
        let options = ImportOptions { channels, objects, ..ImportOptions::default() };
        let inputs = find_inputs(&args.inputs)?;
        let surface = match import_large_meshes(&inputs, &Room::memory_alone(), &options, &progress)? {
            Imported::Memory(surface) => surface,
            // Unlimited memory never spills.
            Imported::Spilled(_) => Surface::default(),
        };
        let input = surface.mesh.clone();
        let built = build_atlas(surface, &AtlasOptions::default(), &progress);
        if built.triangle_count == 0 {
            let input = args.inputs.first().map(|path| path.display().to_string()).unwrap_or_default();
            bail!("{input}: after repair, no triangle has an area; check the mesh");
        }
        let options = WriteOptions { resolution: args.resolution, texel_resolution: args.texels, mips: args.mips };
        progress.begin("write", 0);
        let folder = PendingFolder::merging(dir)?;
        let written = write_atlas(folder.unfinished(), &built.product, &options, &progress)?;
        progress.begin("measure", 0);
        let distance = distance_between(&input, &read_atlas(folder.unfinished())?);
        folder.finish_by(put_in_place)?;
        (built, written, distance)
    };
    print(&built, (resolutions, distance), dir)?;
    Ok(ExitCode::SUCCESS)
}

/// Puts a complete atlas in its place, where an older one goes.
fn put_in_place(work: &Path, dir: &Path) -> Result<()> {
    if !dir.exists() {
        return fs::rename(work, dir).with_context(|| format!("cannot write {}", dir.display()));
    }
    remove_old(dir)?;
    move_files(work, dir)
}

/// Moves the files of a folder, and those of folders in it. The one that says that an atlas is complete comes last.
fn move_files(from: &Path, to: &Path) -> Result<()> {
    let mut names = vec![];
    for entry in fs::read_dir(from).with_context(|| format!("cannot read {}", from.display()))? {
        names.push(entry?.file_name());
    }
    names.sort_by_key(|name| (name == MANIFEST_NAME, name.clone()));
    for name in names {
        let (from, to) = (from.join(&name), to.join(&name));
        if from.is_dir() {
            fs::create_dir_all(&to).with_context(|| format!("cannot make {}", to.display()))?;
            move_files(&from, &to)?;
        } else {
            fs::rename(&from, &to).with_context(|| format!("cannot write {}", to.display()))?;
        }
    }
    fs::remove_dir(from).with_context(|| format!("cannot remove {}", from.display()))
}

/// Refuses an unsuitable output before any work is done.
fn check_output(dir: &Path, force: bool) -> Result<()> {
    if !dir.exists() {
        return check_folder(dir);
    }
    if !dir.is_dir() {
        bail!("{} is a file; name a directory", dir.display());
    }
    let mut entries = fs::read_dir(dir).with_context(|| format!("cannot read {}", dir.display()))?;
    if entries.next().is_some() && !force {
        bail!("{} is not empty; pass --force to overwrite the images in it", dir.display());
    }
    Ok(())
}

/// Removes an older atlas, atlas.json first, so that its images do not mix with the new ones. Other files stay.
fn remove_old(dir: &Path) -> Result<()> {
    if dir.exists() {
        for file in atlas_files(dir).with_context(|| format!("cannot read {}", dir.display()))? {
            fs::remove_file(&file).with_context(|| format!("cannot remove {}", file.display()))?;
        }
        // Folders in which there is something else stay.
        mip_folders(dir).unwrap_or_default().iter().for_each(|folder| drop(fs::remove_dir(folder)));
    }
    Ok(())
}

/// How far the input and the surface of the images, as they were written, are apart at most: the bounds of the larger
/// direction, and the larger root mean square.
fn distance_between(input: &Mesh, images: &Mesh) -> OneSided {
    let [input, images] = [input, images].map(|mesh| Side::new(&mesh.positions, &mesh.triangles));
    let one_way = |from: &Side, to: &Side| from.measured(to, SAMPLES, (RELATIVE_GAP, FLOOR * input.mean_edge), &|| {});
    let (there, back) = (one_way(&input, &images), one_way(&images, &input));
    let farther = if back.upper > there.upper { back } else { there };
    OneSided { rms: there.rms.max(back.rms), ..farther }
}

fn print(built: &BuiltAtlas, (resolutions, distance): (Resolutions, OneSided), dir: &Path) -> Result<()> {
    let product = &built.product;
    let resolution = resolutions.positions;
    let side = (1u64 << resolution) + 1;
    let samples = product.root_count() as u64 * side * side;
    let patch_triangles: usize = product.patches.iter().map(|patch| patch.triangles.len()).sum();
    let mut size = 0;
    let files = atlas_files(dir)?;
    for file in &files {
        size += fs::metadata(file)?.len();
    }
    say!("{}", dir.display());
    say!("  input      {} triangles, {} vertices after repair", count(built.triangle_count), count(built.vertex_count));
    say!(
        "  images     {} roots of {} charts, resolution {resolution}: {side} x {side} samples each, {:.2} per input vertex",
        count(product.root_count() as u64),
        count(product.charts.len() as u64),
        samples as f64 / built.vertex_count as f64
    );
    say!(
        "  distance   {} at most between the input and the surface of the images, in both directions, certified; {} (RMS); a larger --resolution brings \
         them nearer",
        bound(distance.upper),
        length(distance.rms)
    );
    let names = product.looks.channel_names();
    if !names.is_empty() {
        let side = (1u64 << resolutions.texels) + 1;
        say!("  channels   {}; texels {side} x {side} each", names.join(", "));
    }
    if resolutions.mips > 0 {
        say!("  mips       {} folders, the last one with 2 x 2 samples each", resolutions.mips);
    }
    say!(
        "  patches    {} meshes of {} triangles ({:.2} %); {} charts were divided further",
        count(product.patches.len() as u64),
        count(patch_triangles as u64),
        100.0 * patch_triangles as f64 / built.triangle_count as f64,
        count(built.retried_charts)
    );
    say!("  files      {}, {}", count(files.len() as u64), bytes(size));
    Ok(())
}
