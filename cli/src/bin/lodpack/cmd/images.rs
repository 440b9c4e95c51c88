//! The images that `lodpack extract` writes: how many texels they have, and in which formats they are.

use super::open::Source;
use crate::args::{ExtractArgs, ImagesChoice, TexelsChoice};
use crate::messages;
use crate::output::{bytes, count};
use lodpack::Cut;
use lodpack::decode::{PagedMesh, TexturedMesh};
use lodpack::index::Scale;
use lodpack_cli::mesh::encoded::{Formats, Written};
use lodpack_cli::mesh::layers::Look;
use lodpack_cli::reduce::{CutPainter, Detail, Finished};
use serde::Serialize;

/// How often texels are made larger until their images have few enough.
const ROUNDS: u32 = 12;
/// By how much at least, along each side.
const LEAST_LARGER: f64 = 1.02;
/// Images of so few texels are small enough for any number of triangles.
const FEW_TEXELS: u64 = 65_536;
/// Texels that are longer by less are as long.
const MORE: f64 = 1.005;

/// Images that were written.
#[derive(Serialize)]
pub struct ImageSummary {
    #[serde(flatten)]
    written: Written,
    /// How many times as long the sides of texels are as those of the file's images at this cut.
    coarser: f64,
}

/// The formats in which images of a look are written.
pub fn formats(look: &Look, args: &ExtractArgs) -> Formats {
    match args.images {
        ImagesChoice::Auto => Formats::of(look),
        ImagesChoice::Png => Formats::PNG,
        ImagesChoice::Jpeg => Formats::JPEG,
        ImagesChoice::Webp => Formats::WEBP,
    }
}

/// The texels of all pages of one kind.
fn texels(textured: &TexturedMesh, args: &ExtractArgs) -> u64 {
    let pages = PagedMesh::new(textured, args.page_size).page_sizes;
    pages.iter().map(|size| u64::from(size[0]) * u64::from(size[1])).sum()
}

/// A cut with its images as the file has them: whole, or at the finest scale at which they have no more texels than
/// was asked for. Also how many times as long their sides are.
///
/// # Errors
/// As [`lodpack::File::extract_textured`].
pub fn extracted(
    file: &lodpack::File<Source>,
    cut: &Cut,
    channels: &[u8],
    args: &ExtractArgs,
) -> lodpack::Result<(TexturedMesh, f64)> {
    let TexelsChoice::Most(most) = args.texels else { return Ok((file.extract_textured(cut, channels)?, 1.0)) };
    // The coarsest first: it takes a sixteenth of the bytes of the next but one.
    let mut fitting: Option<(TexturedMesh, f64)> = None;
    for scale in [Scale::Eighth, Scale::Quarter, Scale::Half, Scale::Full] {
        let textured = file.extract_textured_scaled(cut, channels, scale)?;
        let is_within = texels(&textured, args) <= most;
        let coarser = f64::from(1_u32 << scale.halvings());
        match fitting {
            Some(fitting) if !is_within => return Ok(fitting),
            None if !is_within => {
                let text = "the file has no images of so few texels: what is written has more; see --triangles";
                messages::tell("note", text);
                return Ok((textured, coarser));
            }
            _ => fitting = Some((textured, coarser)),
        }
    }
    Ok(fitting.unwrap_or_default())
}

/// A reduced cut with as many texels as it needs, as all, or as was asked for; and how many times as long their sides
/// are as those of the cut. None if nothing can be projected. `has_pages` says whether images are written.
pub fn painted(
    painter: &CutPainter<'_>,
    finished: &Finished,
    has_pages: bool,
    args: &ExtractArgs,
) -> Option<(TexturedMesh, f64)> {
    let (detail, most) = match args.texels {
        _ if !has_pages => (Detail::All, None),
        TexelsChoice::All => (Detail::All, None),
        TexelsChoice::Most(most) => (Detail::All, Some(most)),
        TexelsChoice::Auto => {
            let of_cut = texels(painter.cut(), args) as f64;
            (Detail::Needed, Some(((of_cut * painter.needed(finished)) as u64).max(FEW_TEXELS)))
        }
    };
    let mut side = painter.side(finished, detail);
    let mut painted = painter.painted(finished, side)?;
    if let Some(most) = most {
        // Small pieces have more texels around them than large ones, and a triangle has the finest texels beside it.
        for _ in 0..ROUNDS {
            let times = (texels(&painted, args) as f64 / most as f64).sqrt();
            if times <= 1.0 {
                break;
            }
            side *= times.max(LEAST_LARGER);
            painted = painter.painted(finished, side)?;
        }
    }
    Some((painted, side / painter.side_of_cut()))
}

/// Says which images were written, if some were.
pub fn tell(written: Written, coarser: f64, args: &ExtractArgs) -> Option<ImageSummary> {
    if written.count() == 0 {
        return None;
    }
    let formats = [(written.jpeg, "JPEG"), (written.png, "PNG"), (written.webp, "WebP")];
    let formats: Vec<String> =
        formats.iter().filter(|(count, _)| *count > 0).map(|(count, name)| format!("{count} as {name}")).collect();
    let mut text =
        format!("images: {}; {} texels, {}", formats.join(" and "), count(written.texels), bytes(written.bytes));
    if coarser > MORE {
        text += &format!("; sides of texels are {coarser:.1} times those of the file");
    }
    let is_auto = |is_less: bool, option: &'static str| is_less.then_some(option);
    let options = [
        is_auto(coarser > MORE && args.texels == TexelsChoice::Auto, "--texels all keeps them"),
        is_auto(written.jpeg > 0 && args.images == ImagesChoice::Auto, "--images png loses nothing"),
    ];
    let options: Vec<&str> = options.into_iter().flatten().collect();
    if !options.is_empty() {
        text += &format!(" ({})", options.join(", "));
    }
    messages::tell("note", &text);
    Some(ImageSummary { written, coarser })
}
