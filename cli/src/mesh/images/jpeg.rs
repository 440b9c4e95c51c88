//! Whether all data of a JPEG are there: decoders fill what is missing with grey and say nothing.
//!
//! The Huffman codes of all scans are followed as ITU T.81 describes them (annexes B, F and G), without making texels of them. Each scan,
//! and each interval between its restart markers, must end with the block that is its last one. Where bytes are missing or others stand in
//! their place, codes stop too early, or do not exist, or there are bytes left; only where they hold as many blocks does nobody notice.

mod bits;

use bits::{BROKEN, Bits, SHORT, Table};

/// So many bytes behind the last block of an interval are no sign of damage: some programs fill their words.
const MOST_BYTES_LEFT: usize = 8;

/// Follows all scans of a JPEG. What this cannot follow (arithmetic coding, frames without a loss, damaged headers) is left to the decoder.
///
/// # Errors
/// How its data are damaged.
pub(super) fn check_jpeg(bytes: &[u8]) -> Result<(), &'static str> {
    let mut jpeg = Jpeg { bytes, ..Jpeg::default() };
    let mut at = 2;
    while let Some((marker, behind)) = next_marker(bytes, at) {
        at = behind;
        match marker {
            0xD9 => return Ok(()),
            // These have no length.
            0x01 | 0xD0..=0xD8 => continue,
            _ => {}
        }
        let Some(segment) = segment_at(bytes, at) else { break };
        at += 2 + segment.len();
        let is_read = match marker {
            0xC4 => jpeg.read_tables(segment),
            0xC0..=0xC2 => jpeg.read_frame(segment, marker == 0xC2)?,
            0xC3..=0xCF => None,
            0xDD => segment.get(..2).map(|two| jpeg.interval = usize::from(u16::from_be_bytes([two[0], two[1]]))),
            0xDA => match jpeg.read_scan(segment) {
                Some(scan) => {
                    at = jpeg.follow(&scan, at)?;
                    Some(())
                }
                None => None,
            },
            _ => Some(()),
        };
        if is_read.is_none() {
            return Ok(());
        }
    }
    // There is no marker of the end, but all that it would end may be there.
    if jpeg.is_complete() { Ok(()) } else { Err(SHORT) }
}

/// The next marker from a place on, and the place behind it.
fn next_marker(bytes: &[u8], mut at: usize) -> Option<(u8, usize)> {
    loop {
        match bytes.get(at..at + 2)? {
            [0xFF, 0 | 0xFF] => at += 1,
            [0xFF, marker] => return Some((*marker, at + 2)),
            _ => at += 1,
        }
    }
}

/// The content of a segment whose length is at a place.
fn segment_at(bytes: &[u8], at: usize) -> Option<&[u8]> {
    let length = usize::from(u16::from_be_bytes([*bytes.get(at)?, *bytes.get(at + 1)?]));
    bytes.get(at + 2..at + length)
}

/// What is known of an image so far.
#[derive(Default)]
struct Jpeg<'a> {
    bytes: &'a [u8],
    components: Vec<Component>,
    /// Columns and rows of the units of scans of several components.
    units: [usize; 2],
    is_progressive: bool,
    /// Tables of the first and of the other coefficients.
    tables: [[Option<Table>; 4]; 2],
    /// Units between restart markers; 0 where there are none.
    interval: usize,
}

struct Component {
    id: u8,
    /// Its blocks in a unit, in each direction.
    sampling: [usize; 2],
    /// The columns and rows of its blocks without those that only fill units.
    blocks: [usize; 2],
    /// Which coefficients of each block are not zero, where later scans depend on it.
    known: Vec<u64>,
    /// The bits that each coefficient still lacks.
    lacks: [u8; 64],
}

/// The components of a scan, with the numbers of their two tables, and which part of their coefficients it has.
struct Scan {
    components: Vec<(usize, [usize; 2])>,
    first: u8,
    last: u8,
    is_refinement: bool,
    low: u8,
}

impl<'a> Jpeg<'a> {
    fn read_tables(&mut self, mut segment: &[u8]) -> Option<()> {
        while let Some((&kind, rest)) = segment.split_first() {
            let counts: &[u8; 16] = rest.first_chunk()?;
            let symbols = rest.get(16..16 + counts.iter().map(|&count| usize::from(count)).sum::<usize>())?;
            let table = Table::new(counts, symbols)?;
            *self.tables.get_mut(usize::from(kind >> 4))?.get_mut(usize::from(kind & 15))? = Some(table);
            segment = &rest[16 + symbols.len()..];
        }
        Some(())
    }

    /// An error if the file has less than a bit for each block, which every block takes.
    fn read_frame(&mut self, segment: &[u8], is_progressive: bool) -> Result<Option<()>, &'static str> {
        let Some((size, components)) = frame_of(segment) else { return Ok(None) };
        let most = [0, 1].map(|axis| components.iter().map(|(_, sampling)| sampling[axis]).max().unwrap_or(1));
        self.units = [0, 1].map(|axis| size[axis].div_ceil(8 * most[axis]));
        self.is_progressive = is_progressive;
        self.components.clear();
        let mut block_count = 0;
        for (id, sampling) in components {
            let blocks = [0, 1].map(|axis| (size[axis] * sampling[axis]).div_ceil(most[axis]).div_ceil(8));
            block_count += blocks[0] * blocks[1];
            self.components.push(Component { id, sampling, blocks, known: vec![], lacks: [u8::MAX; 64] });
        }
        if block_count > 8 * self.bytes.len() {
            return Err(SHORT);
        }
        for component in self.components.iter_mut().filter(|_| is_progressive) {
            let [columns, rows] = [0, 1].map(|axis| self.units[axis] * component.sampling[axis]);
            component.known = vec![0; columns * rows];
        }
        Ok(Some(()))
    }

    fn read_scan(&self, segment: &[u8]) -> Option<Scan> {
        let (&count, rest) = segment.split_first()?;
        let count = usize::from(count);
        let mut components = vec![];
        for pair in rest.get(..2 * count)?.chunks_exact(2) {
            let number = self.components.iter().position(|component| component.id == pair[0])?;
            components.push((number, [usize::from(pair[1] >> 4) & 3, usize::from(pair[1]) & 3]));
        }
        let &[first, last, bits] = rest.get(2 * count..2 * count + 3)? else { return None };
        let [first, last, high, low] = match self.is_progressive {
            true => [first, last, bits >> 4, bits & 15],
            false => [0, 63, 0, 0],
        };
        let is_sound = first <= last && last < 64 && !components.is_empty();
        // Only the first coefficients of several components are in one scan.
        let is_known = !self.is_progressive || if first == 0 { last == 0 } else { count == 1 };
        (is_sound && is_known).then_some(Scan { components, first, last, is_refinement: high > 0, low })
    }

    /// Follows a scan from a place on; returns the place of the marker behind it.
    fn follow(&mut self, scan: &Scan, at: usize) -> Result<usize, &'static str> {
        let mut bits = Bits::new(self.bytes, at);
        let is_alone = scan.components.len() == 1;
        let [columns, rows] = if is_alone { self.components[scan.components[0].0].blocks } else { self.units };
        let mut run = 0;
        for unit in 0..columns * rows {
            if self.interval > 0 && unit > 0 && unit.is_multiple_of(self.interval) {
                if bits.leave_interval() > MOST_BYTES_LEFT {
                    return Err(BROKEN);
                }
                bits.pass_restart()?;
                run = 0;
            }
            for &(number, tables) in &scan.components {
                let component = &mut self.components[number];
                let [width, height] = if is_alone { [1, 1] } else { component.sampling };
                let stride = self.units[0] * component.sampling[0];
                for block in 0..width * height {
                    let column = unit % columns * width + block % width;
                    let row = unit / columns * height + block / width;
                    let mut nothing = 0;
                    let known = component.known.get_mut(row * stride + column).unwrap_or(&mut nothing);
                    let tables = [0, 1].map(|kind| self.tables[kind][tables[kind]].as_ref());
                    if !follow_block(&mut bits, scan, self.is_progressive, tables, known, &mut run)? {
                        // A table is missing: the decoder may know another one.
                        return Ok(bits.leave_interval_at());
                    }
                }
            }
        }
        for &(number, _) in &scan.components {
            self.components[number].lacks[usize::from(scan.first)..=usize::from(scan.last)].fill(scan.low);
        }
        let left = bits.leave_interval();
        // Where no marker follows, anything may: it is no part of the image.
        if left > MOST_BYTES_LEFT && bits.at() < self.bytes.len() { Err(BROKEN) } else { Ok(bits.at()) }
    }

    /// Whether all coefficients of all components are there in full.
    fn is_complete(&self) -> bool {
        !self.components.is_empty() && self.components.iter().all(|component| component.lacks == [0; 64])
    }
}

/// Columns and rows of a frame, and its components, with their blocks in a unit.
#[expect(clippy::type_complexity, reason = "it is taken apart at once")]
fn frame_of(segment: &[u8]) -> Option<([usize; 2], Vec<(u8, [usize; 2])>)> {
    let &[precision, y0, y1, x0, x1, count] = segment.first_chunk()?;
    let size = [[x0, x1], [y0, y1]].map(|two| usize::from(u16::from_be_bytes(two)));
    let components = segment.get(6..6 + 3 * usize::from(count))?.chunks_exact(3);
    let components: Vec<_> =
        components.map(|three| (three[0], [usize::from(three[1] >> 4), usize::from(three[1] & 15)])).collect();
    let is_sampling = |sampling: &[usize; 2]| sampling.iter().all(|blocks| (1..=4).contains(blocks));
    let is_known = precision == 8 && !components.is_empty() && components.len() <= 4 && !size.contains(&0);
    (is_known && components.iter().all(|(_, sampling)| is_sampling(sampling))).then_some((size, components))
}

/// Follows a block. `known` says which of its coefficients are not zero, and `run` how many blocks have nothing more in this scan.
/// False if a table is missing.
#[inline]
fn follow_block(
    bits: &mut Bits,
    scan: &Scan,
    is_progressive: bool,
    [first, others]: [Option<&Table>; 2],
    known: &mut u64,
    run: &mut u32,
) -> Result<bool, &'static str> {
    if scan.first == 0 {
        match (scan.is_refinement, first) {
            (true, _) => bits.skip(1)?,
            (false, Some(table)) => {
                let size = bits.symbol(table)?;
                if size > 16 {
                    return Err(BROKEN);
                }
                bits.skip(u32::from(size))?;
            }
            (false, None) => return Ok(false),
        }
        if is_progressive {
            return Ok(true);
        }
    }
    let Some(table) = others else { return Ok(false) };
    let range = [scan.first.max(1), scan.last].map(u32::from);
    match (is_progressive, scan.is_refinement) {
        (true, true) => refine(bits, table, range, known, run)?,
        (true, false) if *run > 0 => *run -= 1,
        _ => coefficients(bits, table, range, known, run)?,
    }
    Ok(true)
}

/// The coefficients of a block for the first time (figures F.13 and G.3 of ITU T.81).
#[inline]
fn coefficients(
    bits: &mut Bits,
    table: &Table,
    [mut at, last]: [u32; 2],
    known: &mut u64,
    run: &mut u32,
) -> Result<(), &'static str> {
    while at <= last {
        let symbol = bits.symbol(table)?;
        let (zeros, size) = (u32::from(symbol >> 4), u32::from(symbol & 15));
        match (zeros, size) {
            (15, 0) => at += 16,
            (_, 0) => {
                *run = (1 << zeros) + bits.take(zeros)? - 1;
                break;
            }
            _ => {
                at += zeros;
                if at > last {
                    return Err(BROKEN);
                }
                bits.skip(size)?;
                *known |= 1 << at;
                at += 1;
            }
        }
    }
    Ok(())
}

/// One more bit of the coefficients of a block (figure G.7).
fn refine(
    bits: &mut Bits,
    table: &Table,
    [mut at, last]: [u32; 2],
    known: &mut u64,
    run: &mut u32,
) -> Result<(), &'static str> {
    while *run == 0 && at <= last {
        let symbol = bits.symbol(table)?;
        let (mut zeros, size) = (u32::from(symbol >> 4), symbol & 15);
        if size == 0 && zeros < 15 {
            *run = (1 << zeros) + bits.take(zeros)?;
            break;
        }
        bits.skip(u32::from(size > 0))?;
        while at <= last {
            if *known >> at & 1 == 1 {
                bits.skip(1)?;
            } else if zeros == 0 {
                break;
            } else {
                zeros -= 1;
            }
            at += 1;
        }
        if size > 0 {
            if at > last {
                return Err(BROKEN);
            }
            *known |= 1 << at;
        }
        at += 1;
    }
    if *run > 0 {
        *run -= 1;
        let rest = (at..=last).filter(|&at| *known >> at & 1 == 1).count();
        for _ in 0..rest {
            bits.skip(1)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
