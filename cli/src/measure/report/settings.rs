//! The settings of a sweep: each option varied alone around the default, and some combinations.

use crate::pipeline::{Effort, Fillings, ModelOptions};
use serde::Serialize;

/// The option that a build varies against the default.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Varied {
    /// No option: this build is the default.
    Default,
    /// `--tolerance`.
    Tolerance,
    /// `--effort`.
    Effort,
    /// `--fillings`.
    Fillings,
    /// Input triangles per chart.
    Charts,
    /// `--threads`.
    Threads,
    /// Triangles per region.
    Regions,
    /// Several options.
    Combination,
}

/// The options of one build.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Setting {
    /// For tables and plots.
    pub name: String,
    /// The option that is varied.
    pub varied: Varied,
    /// Tolerance relative to the default.
    pub tolerance_factor: f64,
    /// Run time against bytes; with `fast` the certificate's gap is loose too.
    pub effort: Effort,
    /// Fillings that may be used.
    pub fillings: Fillings,
    /// Input triangles per chart; none if the build chooses.
    pub chart_triangles: Option<u32>,
    /// Worker threads, 0 for all cores.
    pub threads: usize,
    /// The most triangles of a region.
    pub region_triangles: u64,
}

/// Tolerances relative to the default.
const FACTORS: [f64; 6] = [0.125, 0.25, 0.5, 2.0, 4.0, 8.0];
const CHARTS: [u32; 6] = [2048, 4096, 8192, 16384, 32768, 65536];
/// Inputs of fewer triangles are not divided into regions.
const REGION_INPUT: u64 = 100_000;

/// The settings to build, the default first. `base` is the default, `triangles` the size of the input; `quick` takes
/// only a few settings.
pub fn settings(base: &ModelOptions, threads: usize, triangles: u64, quick: bool) -> Vec<Setting> {
    let default = Setting {
        name: "default".into(),
        varied: Varied::Default,
        tolerance_factor: 1.0,
        effort: base.effort,
        fillings: base.fillings,
        chart_triangles: base.chart_triangles,
        threads,
        region_triangles: base.region_triangles,
    };
    let named = |name: &str, varied: Varied| Setting { name: name.into(), varied, ..default.clone() };
    let mut all = vec![default.clone()];
    let factors = if quick { &FACTORS[2..4] } else { &FACTORS };
    all.extend(factors.iter().map(|&tolerance_factor| Setting {
        tolerance_factor,
        ..named(&format!("tolerance x {tolerance_factor}"), Varied::Tolerance)
    }));
    all.push(Setting { effort: Effort::Best, ..named("effort best", Varied::Effort) });
    if !quick {
        let grids = [("grids where possible", Fillings::GridWherePossible), ("grids where smaller", Fillings::Smaller)];
        all.extend(grids.map(|(name, fillings)| Setting { fillings, ..named(name, Varied::Fillings) }));
        all.extend(CHARTS.iter().map(|&chart_triangles| Setting {
            chart_triangles: Some(chart_triangles),
            ..named(&format!("charts of {chart_triangles}"), Varied::Charts)
        }));
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let here = if threads == 0 { cores } else { threads };
    let counts: &[usize] = if quick { &[1] } else { &[1, 2] };
    all.extend(counts.iter().filter(|&&count| count != threads && (count == 1 || count != here)).map(|&threads| {
        Setting {
            threads,
            ..named(&format!("{threads} thread{}", if threads == 1 { "" } else { "s" }), Varied::Threads)
        }
    }));
    if quick {
        return all;
    }
    if triangles >= REGION_INPUT {
        all.push(Setting { region_triangles: triangles.div_ceil(4), ..named("four regions or more", Varied::Regions) });
    }
    for tolerance_factor in [0.5, 2.0] {
        let at = |name: &str| Setting {
            tolerance_factor,
            ..named(&format!("{name}, tolerance x {tolerance_factor}"), Varied::Combination)
        };
        all.push(Setting { effort: Effort::Best, ..at("best") });
        all.push(Setting { chart_triangles: Some(32768), ..at("charts of 32768") });
    }
    all
}

impl Setting {
    /// The setting as command line arguments. `tolerance` is in input units, none for the default.
    pub fn arguments(&self, tolerance: Option<f64>) -> Vec<String> {
        let (effort, fillings) = (self.effort.to_string(), self.fillings.to_string());
        let mut arguments = vec!["--effort".into(), effort, "--fillings".into(), fillings];
        for (name, value) in [
            ("--chart-triangles", self.chart_triangles.map(u64::from)),
            ("--threads", Some(self.threads as u64)),
            ("--region-triangles", Some(self.region_triangles)),
        ] {
            if let Some(value) = value {
                arguments.extend([name.to_string(), value.to_string()]);
            }
        }
        if let Some(tolerance) = tolerance {
            arguments.extend(["--tolerance".to_string(), format!("{tolerance:e}")]);
        }
        arguments
    }
}
