//! What is swept: one setting at a time around the default, and some combinations.

use crate::pipeline::{Effort, Fillings, ModelOptions};
use serde::Serialize;

/// Which knob a build turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Group {
    /// None.
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
    /// Several.
    Combination,
}

/// What a build is asked for.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Setting {
    /// For tables and plots.
    pub name: String,
    /// Which knob is turned.
    pub group: Group,
    /// Over the default tolerance.
    pub tolerance_factor: f64,
    /// Run time against bytes; with `fast` the certificate's gap is loose too.
    pub effort: Effort,
    /// Fillings that may be used.
    pub fillings: Fillings,
    /// Input triangles per chart; none where the build is to choose.
    pub chart_triangles: Option<u32>,
    /// Worker threads, 0 for all cores.
    pub threads: usize,
    /// Triangles per region at most.
    pub region_triangles: u64,
}

/// Tolerances over the default one.
const FACTORS: [f64; 6] = [0.125, 0.25, 0.5, 2.0, 4.0, 8.0];
const CHARTS: [u32; 6] = [2048, 4096, 8192, 16384, 32768, 65536];
/// Inputs of fewer triangles are not divided into regions by anybody.
const REGION_INPUT: u64 = 100_000;

/// The settings to build, the default one first. `base` is the default; `triangles` the input's; `quick` takes a few only.
pub fn settings(base: &ModelOptions, threads: usize, triangles: u64, quick: bool) -> Vec<Setting> {
    let default = Setting {
        name: "default".into(),
        group: Group::Default,
        tolerance_factor: 1.0,
        effort: base.effort,
        fillings: base.fillings,
        chart_triangles: base.chart_triangles,
        threads,
        region_triangles: base.region_triangles,
    };
    let named = |name: &str, group: Group| Setting { name: name.into(), group, ..default.clone() };
    let mut all = vec![default.clone()];
    let factors = if quick { &FACTORS[2..4] } else { &FACTORS };
    all.extend(factors.iter().map(|&tolerance_factor| Setting {
        tolerance_factor,
        ..named(&format!("tolerance x {tolerance_factor}"), Group::Tolerance)
    }));
    for (name, effort) in [("fast", Effort::Fast), ("best", Effort::Best)] {
        all.push(Setting { effort, ..named(&format!("effort {name}"), Group::Effort) });
    }
    if !quick {
        let fillings = Fillings::GridWherePossible;
        all.push(Setting { fillings, ..named("grids where possible", Group::Fillings) });
        let fillings = Fillings::IrregularOnly;
        all.push(Setting { fillings, effort: Effort::Best, ..named("effort best without grids", Group::Fillings) });
        all.extend(CHARTS.iter().map(|&chart_triangles| Setting {
            chart_triangles: Some(chart_triangles),
            ..named(&format!("charts of {chart_triangles}"), Group::Charts)
        }));
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let here = if threads == 0 { cores } else { threads };
    let counts: &[usize] = if quick { &[1] } else { &[1, 2] };
    all.extend(counts.iter().filter(|&&count| count != threads && (count == 1 || count != here)).map(|&threads| {
        Setting {
            threads,
            ..named(&format!("{threads} thread{}", if threads == 1 { "" } else { "s" }), Group::Threads)
        }
    }));
    if quick {
        return all;
    }
    if triangles >= REGION_INPUT {
        all.push(Setting { region_triangles: triangles.div_ceil(4), ..named("four regions or more", Group::Regions) });
    }
    for tolerance_factor in [0.5, 2.0] {
        let at = |name: &str| Setting {
            tolerance_factor,
            ..named(&format!("{name}, tolerance x {tolerance_factor}"), Group::Combination)
        };
        all.push(Setting { effort: Effort::Fast, ..at("fast") });
        all.push(Setting { effort: Effort::Best, ..at("best") });
        all.push(Setting { chart_triangles: Some(32768), ..at("charts of 32768") });
    }
    all.push(Setting {
        effort: Effort::Fast,
        chart_triangles: Some(32768),
        ..named("fast, charts of 32768", Group::Combination)
    });
    all
}

impl Setting {
    /// As the command line has them; `tolerance` in input units, none for the default.
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
