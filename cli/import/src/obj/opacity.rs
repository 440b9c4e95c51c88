//! The opacity of MTL. `d` is opacity, and `Tr` what is missing of it; but some programs write opacity there, too.

use crate::scan::Scanner;

/// What a material says of its opacity.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StatedOpacity {
    d: Option<f64>,
    tr: Option<f64>,
}

/// What `Tr` means in a library.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum MeaningOfTr {
    /// What is missing of opacity.
    Missing,
    /// Opacity: the program that wrote it is known for it.
    OpacityByName,
    /// Opacity: materials would be invisible otherwise, and none says that it is opaque.
    OpacityByNumbers,
}

/// What comments call the programs that write opacity as `Tr`: VTK's exporter, and MeshLab.
const WRITERS_OF_OPACITY: [&[u8]; 2] = [b"visualization toolkit", b"meshlab"];

impl MeaningOfTr {
    /// The meaning in a library, given its text and what its materials say.
    pub fn of(text: &[u8], stated: impl Iterator<Item = StatedOpacity>) -> Self {
        let lines = text.split(|&byte| byte == b'\n' || byte == b'\r').map(<[u8]>::trim_ascii);
        let mut comments = lines.take_while(|line| line.is_empty() || line.starts_with(b"#"));
        let names = |line: &[u8]| {
            let line = line.to_ascii_lowercase();
            WRITERS_OF_OPACITY.iter().any(|name| line.windows(name.len()).any(|part| part == *name))
        };
        if comments.any(names) {
            return Self::OpacityByName;
        }
        let alone: Vec<f64> = stated.filter(|of| of.d.is_none()).filter_map(|of| of.tr).collect();
        let has = |number: f64| alone.contains(&number);
        if has(1.0) && !has(0.0) { Self::OpacityByNumbers } else { Self::Missing }
    }
}

impl StatedOpacity {
    /// Reads a statement.
    pub fn read(&mut self, keyword: &[u8], rest: &[u8]) {
        let mut words = Scanner::new(rest, 0);
        if rest.starts_with(b"-halo") {
            words.word();
        }
        let value = words.float().ok().filter(|value| value.is_finite());
        let target = if keyword == b"d" { &mut self.d } else { &mut self.tr };
        *target = value.or(*target);
    }

    /// The opacity, if it is stated. Some programs write both with the same number, so `d` alone counts then.
    pub fn value(&self, tr: MeaningOfTr) -> Option<f32> {
        let of_tr = |value: f64| if tr == MeaningOfTr::Missing { 1.0 - value } else { value };
        self.d.or(self.tr.map(of_tr)).map(|opacity| opacity.clamp(0.0, 1.0) as f32)
    }
}
