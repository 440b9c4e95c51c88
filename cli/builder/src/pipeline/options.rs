//! The options that the bytes of a file depend on, and why the pipeline may refuse an input.

use lodpack::index::Placement;
use serde::{Deserialize, Serialize};

use crate::region::{Division, REGION_TEXELS, REGION_TRIANGLES, RegionError};
use lodpack_import::Objects;
use lodpack_import::raster::RasterOptions;
use lodpack_mesh::appearance::{Appearance, Channels};
use lodpack_mesh::tolerance::{Tolerance, Unit};
use lodpack_runtime::storage::WorkError;

/// A region is not divided for its texels if it has no more triangles than this.
const FEWEST_TEXTURED: u64 = 1 << 13;
/// The quality that loses nothing.
const LOSSLESS: &str = "lossless";
const AUTO: &str = "auto";

/// How much run time a build may spend to save bytes. Every error bound is certified at every effort.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Effort {
    /// Charts as large as pays, tight certificates.
    #[default]
    Default,
    /// Larger charts, so fewer bytes and triangles; a region of a given size takes more of them.
    Best,
}

/// Which fillings a build may use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Fillings {
    /// No grids, and so a tree.
    #[default]
    IrregularOnly,
    /// For each chart the smaller one at equal error.
    Smaller,
    /// A grid for every chart that can be one within the tolerance, whatever it costs. For tests and comparisons.
    GridWherePossible,
}

/// Which levels a build makes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum LevelChoice {
    /// Every level from the finest to one of a few triangles per chart.
    #[default]
    All,
    /// The finest level alone, in larger charts: a compressed mesh with a certified error, without levels of detail.
    Finest,
}

impl LevelChoice {
    /// Name, choice and description of each.
    pub const ALL: [(&str, Self, &str); 2] = [
        ("all", Self::All, "Every level, from the finest to a few triangles per chart"),
        ("finest", Self::Finest, "The finest level alone, in larger charts: a plain compressed mesh"),
    ];
}

/// How good stored colours are, and normals and factors, which are coded in the same way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "u8", from = "u8")]
pub enum ColourQuality {
    /// As good as the input: what images have lost when they were coded is not coded again.
    #[default]
    Auto,
    /// From 1 (smallest) to 100 (almost exact).
    Lossy(u8),
    /// Texels come back as they were made, in 8 bits.
    Lossless,
}

impl ColourQuality {
    /// What [`Self::Auto`] is where nothing is known to be lost.
    const USUAL: u8 = 85;

    /// The step of quantisation, of 255: 1 for a quality of 100, 9 for 80, 21 for 50; 0 for none.
    pub(crate) fn step(self) -> u8 {
        match self {
            Self::Auto => Self::Lossy(Self::USUAL).step(),
            Self::Lossy(quality) => 1 + (100 - quality.clamp(1, 100)) * 2 / 5,
            Self::Lossless => 0,
        }
    }

    /// The step for images of which at least one was coded with a step, if that is known.
    pub(crate) fn step_of_coded(self, coded: Option<f64>) -> u8 {
        match (self, coded) {
            (Self::Auto, Some(coded)) => (coded * OF_CODED).round().clamp(STEPS_OF_CODED[0], STEPS_OF_CODED[1]) as u8,
            _ => self.step(),
        }
    }

    /// The step for what looks like this. Materials without images make pieces of a few colours, which take fewer bytes
    /// without loss than they do at the usual quality: a model of an engine 182 kB in place of 189.
    pub(crate) fn step_of(self, appearance: &Appearance) -> u8 {
        let usual = Self::Lossy(Self::USUAL).step();
        let step = self.step_of_coded(appearance.coded_step);
        if appearance.is_even() && step <= usual { 0 } else { step }
    }
}

/// The step for each of those by which an image was quantised before: it loses about as much again.
const OF_CODED: f64 = 2.2;
/// The least and the largest step of that, those of qualities of 90 and 25. Below the least nothing is gained, because
/// texels of a surface lie elsewhere than those of an image: photographs with JPEG at quality 95 show 1 dB more with a
/// step of 3, for twice the bytes.
const STEPS_OF_CODED: [f64; 2] = [5.0, 31.0];

impl std::fmt::Display for ColourQuality {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Self::Auto => f.write_str(AUTO),
            Self::Lossy(quality) => quality.fmt(f),
            Self::Lossless => f.write_str(LOSSLESS),
        }
    }
}

impl std::str::FromStr for ColourQuality {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse() {
            Ok(quality @ 1..=100) => Ok(Self::Lossy(quality)),
            _ if text == AUTO => Ok(Self::Auto),
            _ if text == LOSSLESS => Ok(Self::Lossless),
            _ => Err(format!("'{text}' is neither a number from 1 to 100 nor {AUTO} nor {LOSSLESS}")),
        }
    }
}

/// Jobs hold a number; 0 stands for no loss, 255 for that of the input.
impl From<ColourQuality> for u8 {
    fn from(quality: ColourQuality) -> Self {
        match quality {
            ColourQuality::Auto => u8::MAX,
            ColourQuality::Lossy(quality) => quality,
            ColourQuality::Lossless => 0,
        }
    }
}

impl From<u8> for ColourQuality {
    fn from(number: u8) -> Self {
        match number {
            0 => Self::Lossless,
            u8::MAX => Self::Auto,
            quality => Self::Lossy(quality),
        }
    }
}

impl Effort {
    /// Name, effort and description of each, the fastest first.
    pub const ALL: [(&str, Self, &str); 2] = [
        ("default", Self::Default, "Charts as large as pays, tight bounds"),
        (
            "best",
            Self::Best,
            "Larger charts: fewer bytes and triangles for a fifth more time, but a small region takes more of them",
        ),
    ];
}

impl Fillings {
    /// Name, choice and description of each.
    pub const ALL: [(&str, Self, &str); 3] = [
        ("irregular-only", Self::IrregularOnly, "No grids"),
        (
            "smaller",
            Self::Smaller,
            "The smaller one for each chart at equal error: some four times as long, for smooth surfaces",
        ),
        ("grid-where-possible", Self::GridWherePossible, "A grid for every chart that can be one"),
    ];
}

impl std::fmt::Display for Effort {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(name_of(&Self::ALL, *self))
    }
}

impl std::fmt::Display for LevelChoice {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(name_of(&Self::ALL, *self))
    }
}

impl std::fmt::Display for Fillings {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(name_of(&Self::ALL, *self))
    }
}

impl std::str::FromStr for Effort {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        named(&Self::ALL, text)
    }
}

impl std::str::FromStr for LevelChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        named(&Self::ALL, text)
    }
}

impl std::str::FromStr for Fillings {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        named(&Self::ALL, text)
    }
}

fn name_of<T: PartialEq>(all: &[(&'static str, T, &str)], value: T) -> &'static str {
    all.iter().find(|(_, other, _)| *other == value).map_or("", |(name, ..)| name)
}

fn named<T: Copy>(all: &[(&str, T, &str)], text: &str) -> Result<T, String> {
    let names = || all.iter().map(|(name, ..)| *name).collect::<Vec<_>>().join(", ");
    let found = all.iter().find(|(name, ..)| *name == text);
    found.map(|&(_, value, _)| value).ok_or_else(|| format!("'{text}' is none of {}", names()))
}

/// The options that the bytes of a file depend on, beside the input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelOptions {
    /// Bound on the certified error of the finest level.
    pub tolerance: Tolerance,
    /// Unit of the input's coordinates, where it is known. Inputs that are all glTF are in metres without it.
    pub unit: Option<Unit>,
    /// Where the surface is in the world, if it is known; it only goes into the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub placement: Option<Placement>,
    /// Run time against bytes.
    pub effort: Effort,
    /// Fillings that may be used.
    pub fillings: Fillings,
    /// Levels to make.
    pub levels: LevelChoice,
    /// Input triangles per chart to aim for at tolerances up to the automatic one; coarser tolerances get larger
    /// charts. By default the effort and the smoothness of the surface decide. Smaller charts cost bytes for their
    /// borders, larger ones stream in coarser steps.
    pub chart_triangles: Option<u32>,
    /// The most triangles in a region; see [`crate::region`].
    pub region_triangles: u64,
    /// Whether regions, lattice and charts should stay as they are when more is added to the input later. This takes a
    /// tolerance that does not depend on the input.
    pub extensible: bool,
    /// Channels of the input to keep beside its shape.
    pub channels: Channels,
    /// How good stored colours are.
    pub colour_quality: ColourQuality,
    /// Whether the surface is cut into charts where the input, an atlas, is cut into charts already.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub new_charts: bool,
    /// What becomes of the objects that inputs name; `kept_objects` says what is done.
    #[serde(default, skip_serializing_if = "Objects::is_default")]
    pub objects: Objects,
    /// How rasters become surfaces.
    #[serde(default, skip_serializing_if = "RasterOptions::is_default")]
    pub raster: RasterOptions,
}

impl Default for ModelOptions {
    fn default() -> Self {
        Self {
            tolerance: Tolerance::Auto,
            unit: None,
            placement: None,
            effort: Effort::Default,
            fillings: Fillings::IrregularOnly,
            levels: LevelChoice::All,
            chart_triangles: None,
            region_triangles: REGION_TRIANGLES,
            extensible: false,
            channels: Channels::Auto,
            colour_quality: ColourQuality::default(),
            new_charts: false,
            objects: Objects::default(),
            raster: RasterOptions::default(),
        }
    }
}

impl ModelOptions {
    /// How an input is divided into regions, given its number of triangles: those of textured inputs have fewer
    /// triangles where these have many texels.
    pub(crate) fn division(&self, triangles: u64, appearance: &Appearance) -> Division {
        let texels = appearance.texels_each(triangles);
        let most = REGION_TEXELS.checked_div(texels).map_or(u64::MAX, |most| most.max(FEWEST_TEXTURED));
        Division { triangles: self.region_triangles.min(most), is_fixed: self.extensible }
    }

    /// What becomes of the objects that inputs name: where more can be added later, they are joined, because numbers of
    /// objects would change.
    pub(crate) fn kept_objects(&self) -> Objects {
        if self.extensible { Objects::Join } else { self.objects }
    }

    /// Whether charts get groups above them. Grids have nested levels of their own.
    pub(crate) fn has_tree(&self) -> bool {
        self.levels == LevelChoice::All && self.fillings == Fillings::IrregularOnly
    }
}

/// Why the pipeline refused an input or stopped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// The tolerance does not fit the input.
    #[error("{what}")]
    Tolerance {
        /// What is wrong and what would work.
        what: String,
    },
    /// Lengths beyond the range of the arithmetic.
    #[error(
        "the model reaches over {size:e} units: only sizes from {smallest:e} to {largest:e} can be built; scale its coordinates"
    )]
    Size {
        /// Extent, or distance from the origin.
        size: f64,
        /// Smallest possible extent.
        smallest: f64,
        /// Largest possible coordinate.
        largest: f64,
    },
    /// Repair left nothing of the input.
    #[error("no triangle with an area is left after repair ({dropped} degenerate or duplicate triangles were dropped)")]
    Empty {
        /// How many triangles were dropped.
        dropped: u64,
    },
    /// The memory limit or the disk space is too small, or a temporary file is unusable.
    #[error(transparent)]
    Region(#[from] RegionError),
    /// The format layer refused the model, or the output cannot be written.
    #[error("cannot write the file: {0}")]
    Write(#[from] lodpack::Error),
}

impl PipelineError {
    /// The tolerance has a unit, but the coordinates have none.
    pub(crate) fn unit_missing() -> Self {
        let what = "the tolerance has a unit but the input has none; pass --unit mm (or m, cm, ...) to say what the coordinates are \
                    in, or give the tolerance without a unit";
        Self::Tolerance { what: what.into() }
    }
}

impl From<WorkError> for PipelineError {
    fn from(error: WorkError) -> Self {
        Self::Region(error.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodpack_mesh::attributes::AttributeLayout;

    #[test]
    fn qualities_are_numbers_or_lossless_and_survive_in_jobs() {
        for (text, step) in [("1", 40), ("50", 21), ("80", 9), ("85", 7), ("100", 1), ("lossless", 0)] {
            let quality: ColourQuality = text.parse().unwrap();
            assert_eq!((quality.step(), quality.to_string().as_str()), (step, text));
            assert_eq!(ColourQuality::from(u8::from(quality)), quality);
        }
        assert_eq!((ColourQuality::Auto.step(), "auto".parse()), (7, Ok(ColourQuality::Auto)));
        for quality in [ColourQuality::Auto, ColourQuality::Lossless, ColourQuality::Lossy(85)] {
            let written = serde_json::to_string(&quality).unwrap();
            assert_eq!(serde_json::from_str::<ColourQuality>(&written).unwrap(), quality);
        }
        let even = Appearance { has_colour: true, ..Appearance::default() };
        assert_eq!(["75", "85", "95"].map(|text| text.parse::<ColourQuality>().unwrap().step_of(&even)), [11, 0, 0]);
        let textured = Appearance { layout: AttributeLayout { colour: Some(0), ..Default::default() }, ..even };
        assert_eq!(ColourQuality::default().step_of(&textured), 7);
        let coded = |step| Appearance { coded_step: Some(step), ..textured.clone() };
        assert_eq!([0.1, 5.0, 100.0].map(|step| ColourQuality::Auto.step_of(&coded(step))), [5, 11, 31]);
        assert_eq!(ColourQuality::Lossy(85).step_of(&coded(5.0)), 7);
        for text in ["0", "101", "256", "-1", "", "Lossless", "85.5"] {
            assert!(text.parse::<ColourQuality>().is_err(), "{text}");
        }
    }

    #[test]
    fn regions_have_fewer_triangles_where_these_have_many_texels() {
        let options = ModelOptions::default();
        let division = |triangles: u64, texels: u64| {
            options.division(triangles, &Appearance { texels, ..Appearance::default() }).triangles
        };
        assert_eq!(division(1 << 20, 0), REGION_TRIANGLES);
        assert_eq!(division(1 << 20, 1 << 19), REGION_TRIANGLES);
        // All of it fits in one region.
        assert!(division(50_000, REGION_TEXELS) >= 50_000);
        assert_eq!(division(1 << 20, 1 << 30), REGION_TEXELS >> 10);
        // A little more of either changes nothing.
        assert_eq!(division(1 << 20, (1 << 30) + (1 << 28)), REGION_TEXELS >> 10);
        assert_eq!(division(12, 1 << 28), FEWEST_TEXTURED);
    }
}
