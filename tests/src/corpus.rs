//! Hostile files: changed copies of sound ones, the same on every machine, whose checksums are right.
//!
//! A flipped byte alone says little about a reader, since a checksum finds it before anything else looks. So [`Seed`]
//! finds the checksums of a file and what each covers, by trying every range: that needs no knowledge of the format,
//! holds for files of every kind, and shares nothing with the reader. After a change it makes them right again, from
//! the innermost to the header's.

use std::collections::{BTreeSet, HashMap};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Files above this are left out: the search for checksums takes quadratic time.
const MOST_BYTES: usize = 1 << 15;
/// Checksums lie in checksums: pages, index block, cluster lists (nested), section, directory, header.
const DEPTH: usize = 10;

/// Random numbers that are the same everywhere (splitmix64).
#[derive(Clone, Debug)]
pub struct Dice(pub u64);

impl Dice {
    /// A number below `bound`, or 0.
    pub fn below(&mut self, bound: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ (mixed >> 31)) % bound.max(1) as u64) as usize
    }
}

/// A file to change.
#[derive(Clone, Debug)]
pub struct Seed {
    /// Of the file, without its ending.
    pub name: String,
    /// All of it.
    pub bytes: Vec<u8>,
    /// Where a checksum stands, and what it may be the checksum of: several ranges, if these hold the same.
    checksums: Vec<(usize, Vec<Range<usize>>)>,
}

impl Seed {
    /// Finds the checksums of a file, in a time that grows with the square of its size: a second for 30 kB.
    #[must_use]
    pub fn new(name: &str, bytes: Vec<u8>) -> Self {
        let checksums = find_checksums(&bytes);
        Self { name: name.to_owned(), bytes, checksums }
    }

    /// How many checksums were found.
    #[must_use]
    pub fn checksum_count(&self) -> usize {
        self.checksums.len()
    }

    /// Makes the checksums of a changed copy right again, which has as many bytes.
    #[must_use]
    pub fn reseal(&self, mut changed: Vec<u8>) -> Vec<u8> {
        for _ in 0..DEPTH {
            let before = changed.clone();
            for (place, ranges) in &self.checksums {
                // What has not changed keeps its checksum, so that a change of the checksum itself may stay.
                let mut has_changed =
                    ranges.iter().filter(|&range| changed[range.clone()] != self.bytes[range.clone()]);
                if let Some(range) = has_changed.next() {
                    let sum = checksum(&changed[range.clone()]);
                    changed[*place..place + 4].copy_from_slice(&sum.to_le_bytes());
                }
            }
            if changed == before {
                break;
            }
        }
        changed
    }

    /// A changed copy, and how it was changed.
    #[must_use]
    pub fn change(&self, dice: &mut Dice, others: &[Self]) -> (&'static str, Vec<u8>) {
        let mut bytes = self.bytes.clone();
        let length = bytes.len();
        // As likely in a small part as in a large one, and rather in what is sealed last: a change of the directory or
        // of the tables, which are half of a small file, ends everything at once.
        let count = self.checksums.len() + 1;
        let place = |dice: &mut Dice| match self.checksums.get(dice.below(count).max(dice.below(count))) {
            Some((_, ranges)) => ranges[0].start + dice.below(ranges[0].len()),
            None => dice.below(length),
        };
        match dice.below(14) {
            0..5 => {
                for _ in 0..=dice.below(4) {
                    bytes[place(dice)] ^= 1 << dice.below(8);
                }
                ("flipped", self.reseal(bytes))
            }
            5..9 => {
                for _ in 0..=dice.below(4) {
                    bytes[place(dice)] = [0, 1, 0x7f, 0x80, 0xff, dice.below(256) as u8][dice.below(6)];
                }
                ("set", self.reseal(bytes))
            }
            9 => {
                // As lengths and counts these are the largest.
                let at = place(dice);
                let end = (at + [1, 2, 4, 8, 16][dice.below(5)]).min(length);
                bytes[at..end].fill(0xff);
                ("long", self.reseal(bytes))
            }
            10 => {
                let other = &others[dice.below(others.len())].bytes;
                let size = 1 + dice.below(length.min(other.len()).min(64));
                let (from, to) = (dice.below(other.len() + 1 - size), place(dice).min(length - size));
                bytes[to..to + size].copy_from_slice(&other[from..from + size]);
                ("spliced", self.reseal(bytes))
            }
            11 => {
                bytes.truncate(dice.below(length));
                ("short", bytes)
            }
            12 => {
                let at = place(dice);
                let end = (at + 1 + dice.below(8)).min(length);
                if dice.below(2) == 0 {
                    drop(bytes.drain(at..end));
                } else {
                    drop(bytes.splice(at..at, bytes[at..end].to_vec()));
                }
                ("moved", bytes)
            }
            _ => {
                bytes[place(dice)] ^= 1 << dice.below(8);
                ("damaged", bytes)
            }
        }
    }
}

/// The sound and the invalid vectors of the format, files of heights among them.
///
/// # Panics
///
/// If they cannot be read.
#[must_use]
pub fn vectors() -> Vec<Seed> {
    let vectors = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|folder| folder.join("format-spec/vectors"));
    let vectors = vectors.into_iter().find(|folder| folder.is_dir()).expect("the vectors are there");
    let mut seeds = vec![];
    for (prefix, folder) in [("", ""), ("heights-", "heights"), ("invalid-", "invalid")] {
        let entries = std::fs::read_dir(vectors.join(folder)).expect("a readable folder");
        let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("a readable folder").path()).collect();
        paths.retain(|path| path.extension().is_some_and(|ending| ending == "lodpack"));
        paths.sort();
        for path in paths {
            let stem = path.file_stem().expect("a name").to_string_lossy();
            let bytes = std::fs::read(&path).expect("a readable vector");
            if (1..=MOST_BYTES).contains(&bytes.len()) {
                seeds.push(Seed::new(&format!("{prefix}{stem}"), bytes));
            }
        }
    }
    seeds
}

/// The seeds, and changed copies of each: `count` of a sound file, an eighth as many of what is refused anyway.
#[must_use]
pub fn corpus(seeds: &[Seed], count: usize) -> Vec<(String, Vec<u8>)> {
    let mut dice = Dice(17);
    let mut files = vec![];
    for seed in seeds {
        files.push((seed.name.clone(), seed.bytes.clone()));
        let count = if seed.name.starts_with("invalid-") { count / 8 } else { count };
        for number in 0..count {
            let (how, bytes) = seed.change(&mut dice, seeds);
            files.push((format!("{}-{number}-{how}", seed.name), bytes));
        }
    }
    files
}

/// Writes a corpus into a folder.
///
/// # Errors
///
/// If the folder cannot be written.
pub fn write_corpus(folder: &Path, files: &[(String, Vec<u8>)]) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    files.iter().try_for_each(|(name, bytes)| std::fs::write(folder.join(format!("{name}.lodpack")), bytes))
}

/// The remainders of CRC-32 for each byte (SPEC.md, chapter 2).
const REMAINDERS: [u32; 256] = {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut sum = byte as u32;
        let mut bit = 0;
        while bit < 8 {
            sum = if sum & 1 == 1 { sum >> 1 ^ 0xedb8_8320 } else { sum >> 1 };
            bit += 1;
        }
        table[byte] = sum;
        byte += 1;
    }
    table
};

fn step(sum: u32, byte: u8) -> u32 {
    REMAINDERS[((sum ^ u32::from(byte)) & 0xff) as usize] ^ (sum >> 8)
}

fn checksum(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |sum, &byte| step(sum, byte))
}

/// Every place whose four bytes are the checksum of a range that does not touch them, with these ranges.
///
/// By chance a number that is none looks like one about once in a file of 3 kB, and two of these could contradict each
/// other for ever. But what checksums cover lies apart or one in the other, so a range that overlaps a shorter one in
/// part is none.
fn find_checksums(bytes: &[u8]) -> Vec<(usize, Vec<Range<usize>>)> {
    let mut places: HashMap<u32, Vec<usize>> = HashMap::new();
    for (place, four) in bytes.windows(4).enumerate() {
        let sum = u32::from_le_bytes([four[0], four[1], four[2], four[3]]);
        // Zeros and the like stand everywhere, and are hardly ever checksums.
        if BTreeSet::from_iter(four).len() > 2 {
            places.entry(sum).or_default().push(place);
        }
    }
    // Most sums are in no map: a bit for each value of their lower half says so sooner.
    let mut is_there = vec![false; 1 << 16];
    places.keys().for_each(|sum| is_there[(sum & 0xffff) as usize] = true);
    let mut found: HashMap<usize, Vec<Range<usize>>> = HashMap::new();
    for start in 0..bytes.len() {
        let mut sum = !0;
        for end in start + 1..=bytes.len() {
            sum = step(sum, bytes[end - 1]);
            if !is_there[(!sum & 0xffff) as usize] {
                continue;
            }
            for &place in places.get(&!sum).into_iter().flatten() {
                if place + 4 <= start || place >= end {
                    found.entry(place).or_default().push(start..end);
                }
            }
        }
    }
    let sure: Vec<Range<usize>> = found.values().filter(|ranges| ranges.len() == 1).flatten().cloned().collect();
    let cuts = |long: &Range<usize>, short: &Range<usize>| {
        short.len() < long.len() && (long.contains(&short.start) != long.contains(&(short.end - 1)))
    };
    found.values_mut().for_each(|ranges| ranges.retain(|range| !sure.iter().any(|short| cuts(range, short))));
    let mut found: Vec<_> = found.into_iter().filter(|(_, ranges)| !ranges.is_empty()).collect();
    found.sort_unstable_by_key(|(place, _)| *place);
    found
}
