//! Packs islands of texels into pages by their shapes, so that small ones lie in the bays and holes of large ones.
//!
//! A page is a grid of cells, a bit each. The islands come one after another, the highest first, and each goes to the
//! first row of cells, and the first column in it, where all of its own cells are free. All columns of a row are tried
//! at once: a run of n cells fits wherever the n cells from there on are free, which shifts by powers of two tell for
//! 64 columns in an operation. Horizons of columns, as Levy et al. have them (2002, "Least Squares Conformal Maps for
//! Automatic Texture Atlas Generation", section 4), leave the holes empty.

use std::cmp::Reverse;
use std::collections::HashMap;

use super::islands::Island;

/// Texels between islands, which show what is closest to them: half of them belong to either side.
const GAP: u32 = 1;
/// Cells that all islands together have, about. Finer ones pack small islands better, and take time by their cube.
const CELL_COUNT: u64 = 1 << 19;

/// Where an island lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Placed {
    /// The page.
    pub page: usize,
    /// The page's texel that is the corner of the island.
    pub corner: [u32; 2],
}

/// Where islands lie, and the sizes of the pages.
type Packed = (Vec<Placed>, Vec<[u32; 2]>);

/// Packs islands into pages of at most `side` texels along each side; an island that is larger has a page of its own.
/// Returns where each lies, and the sizes of the pages.
pub(super) fn pack(islands: &[Island], side: u32) -> Packed {
    let (fitting, own): (Vec<usize>, Vec<usize>) =
        by_height(islands).into_iter().partition(|&number| islands[number].size.iter().all(|&length| length <= side));
    let area: u64 = fitting.iter().map(|&number| area(&islands[number])).sum();
    let widest = fitting.iter().map(|&number| islands[number].size[0]).max().unwrap_or(0);
    let cell = 1 + (area / CELL_COUNT).isqrt() as u32;
    let shapes: Vec<Shape> = fitting.iter().map(|&number| Shape::new(&islands[number], cell)).collect();
    // Square pages, of which islands have a half to four fifths.
    let width = |quarters: u64| u32::try_from((area * quarters / 4).isqrt()).unwrap_or(u32::MAX).min(side).max(widest);
    let mut widths: Vec<u32> = (5..=8).map(width).collect();
    widths.dedup();
    let tried = widths.into_iter().map(|width| pack_shapes(&shapes, cell, [width, side]));
    let texels = |packed: &Packed| packed.1.iter().map(|&[w, h]| u64::from(w) * u64::from(h)).sum::<u64>();
    let (corners, mut sizes) = tried.min_by_key(texels).unwrap_or_default();

    let mut placed = vec![Placed::default(); islands.len()];
    fitting.into_iter().zip(corners).for_each(|(number, corner)| placed[number] = corner);
    for number in own {
        placed[number] = Placed { page: sizes.len(), corner: [0; 2] };
        sizes.push(islands[number].size);
    }
    (placed, sizes)
}

/// The numbers of islands, the highest one first.
fn by_height(islands: &[Island]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..islands.len()).collect();
    order.sort_by_key(|&number| (Reverse(islands[number].size[1]), number));
    order
}

/// Packs shapes, in this order, into pages with at most the given number of texels in a row, and of rows.
fn pack_shapes(shapes: &[Shape], cell: u32, [width, height]: [u32; 2]) -> Packed {
    let mut pages: Vec<Page> = vec![];
    // Where the search for one more of about a size begins: before it, the last one found no room.
    let mut begin: HashMap<[u32; 2], (usize, u32)> = HashMap::new();
    let mut place = |shape: &Shape| {
        let begin = begin.entry(shape.size.map(|length| length.saturating_mul(length).ilog2())).or_default();
        let (mut page, mut row) = *begin;
        let corner = loop {
            if u64::from(row) * u64::from(cell) + u64::from(shape.size[1]) > u64::from(height) {
                (page, row) = (page + 1, 0);
            }
            if page == pages.len() {
                pages.push(Page::new(width, cell));
            }
            if let Some(column) = pages[page].free_column(shape, row) {
                pages[page].fill(shape, [column, row]);
                break [column, row].map(|cells| cells * cell);
            }
            row += 1;
        };
        *begin = (page, row);
        let used = &mut pages[page].used;
        (0..2).for_each(|axis| used[axis] = used[axis].max(corner[axis] + shape.size[axis]));
        Placed { page, corner }
    };
    let placed = shapes.iter().map(&mut place).collect();
    (placed, pages.iter().map(|page| page.used).collect())
}

/// The texels of an island, and about those of the gap beside it.
fn area(island: &Island) -> u64 {
    let in_runs: u64 = island.runs.iter().map(|run| u64::from(run.end - run.first + GAP)).sum();
    in_runs + u64::from(island.size[0] * GAP)
}

/// The cells of an island, and of the gap to its right and below it.
struct Shape {
    /// In each row of cells the first of some that follow each other, and their number.
    rows: Vec<Vec<[u32; 2]>>,
    /// The rows, those with the longest runs first: there it shows soonest that there is no room.
    order: Vec<usize>,
    /// Texels in a row, and rows, without the gap.
    size: [u32; 2],
}

impl Shape {
    fn new(island: &Island, cell: u32) -> Self {
        let [columns, rows] = island.size.map(|length| (length + GAP).div_ceil(cell) as usize);
        let mut cells = vec![false; columns * rows];
        for run in &island.runs {
            for row in run.row / cell..=(run.row + GAP) / cell {
                let [first, last] =
                    [run.first, run.end - 1 + GAP].map(|x| row as usize * columns + (x / cell) as usize);
                cells[first..=last].fill(true);
            }
        }
        let runs = |row: &[bool]| {
            let mut end = 0;
            let all = row.chunk_by(|a, b| a == b).filter_map(|same| {
                end += same.len();
                same[0].then_some([(end - same.len()) as u32, same.len() as u32])
            });
            all.collect::<Vec<_>>()
        };
        let rows: Vec<Vec<[u32; 2]>> = cells.chunks_exact(columns).map(runs).collect();
        let mut order: Vec<usize> = (0..rows.len()).collect();
        order.sort_by_key(|&row| Reverse(rows[row].iter().map(|run| run[1]).max()));
        Self { rows, order, size: island.size }
    }
}

/// Bits of a row of cells, the first one lowest.
type Bits = Vec<u64>;

/// A page while it is filled.
struct Page {
    /// Texels in a row at most, and in a cell along each side.
    width: u32,
    cell: u32,
    /// The cells that are taken.
    rows: Vec<Bits>,
    /// Texels in a row so far, and rows.
    used: [u32; 2],
    /// The columns at which a shape does not fit, and some cells: their memory.
    blocked: Bits,
    taken: Bits,
}

impl Page {
    fn new(width: u32, cell: u32) -> Self {
        // The gap of the last column may lie beyond the page.
        let words = (width / cell + 3).div_ceil(64) as usize;
        Self { width, cell, rows: vec![], used: [0; 2], blocked: vec![0; words], taken: vec![0; words] }
    }

    /// The first column at which a shape fits if its first row is this one.
    fn free_column(&mut self, shape: &Shape, row: u32) -> Option<u32> {
        let Self { blocked, taken, .. } = self;
        // Beyond this column it would leave the page.
        let last = (self.width - shape.size[0]) / self.cell;
        blocked.iter_mut().zip((0..).step_by(64)).for_each(|(word, first)| {
            *word = if last < first { u64::MAX } else { u64::MAX.checked_shl(last - first + 1).unwrap_or(0) };
        });
        for &number in &shape.order {
            let Some(known) = self.rows.get(row as usize + number) else { continue };
            for &[first, count] in &shape.rows[number] {
                taken.copy_from_slice(known);
                let mut known = 1;
                while known < count {
                    let more = known.min(count - known);
                    for word in 0..taken.len() {
                        taken[word] |= shifted(taken, word, more);
                    }
                    known += more;
                }
                for (word, blocked) in blocked.iter_mut().enumerate() {
                    *blocked |= shifted(taken, word, first);
                }
            }
            if blocked.iter().all(|&word| word == u64::MAX) {
                return None;
            }
        }
        let (word, first) = blocked.iter().zip((0..).step_by(64)).find(|&(&word, _)| word != u64::MAX)?;
        Some(first + word.trailing_ones())
    }

    /// Takes the cells of a shape.
    fn fill(&mut self, shape: &Shape, [column, row]: [u32; 2]) {
        let (row, words) = (row as usize, self.taken.len());
        if self.rows.len() < row + shape.rows.len() {
            self.rows.resize(row + shape.rows.len(), vec![0; words]);
        }
        for (bits, runs) in self.rows[row..].iter_mut().zip(&shape.rows) {
            for &[first, count] in runs {
                for cell in column + first..column + first + count {
                    bits[cell as usize / 64] |= 1 << (cell % 64);
                }
            }
        }
    }
}

/// A word of bits that are moved towards the first one.
fn shifted(bits: &Bits, word: usize, by: u32) -> u64 {
    let from = word + by as usize / 64;
    let at = |word: usize| bits.get(word).copied().unwrap_or(0);
    match by % 64 {
        0 => at(from),
        by => at(from) >> by | at(from + 1) << (64 - by),
    }
}

#[cfg(test)]
mod tests {
    use super::super::islands::Run;
    use super::*;

    /// A ring, or all of it if it is narrow.
    fn ring([width, height]: [u32; 2], thick: u32) -> Island {
        let runs = (0..height).flat_map(|row| {
            let is_whole = row < thick || row + thick >= height || width <= 2 * thick;
            let run = |first, end| Run { row, first, end };
            if is_whole { vec![run(0, width)] } else { vec![run(0, thick), run(width - thick, width)] }
        });
        Island { size: [width, height], runs: runs.collect(), ..Island::default() }
    }

    /// Numbers that seem to be drawn by chance.
    fn lengths(count: u32) -> impl Iterator<Item = u32> {
        (1..=count).map(|number| number.wrapping_mul(2_654_435_761) >> 16)
    }

    /// The share of texels that islands have, where all lie within their pages and a texel apart.
    fn share(islands: &[Island], (placed, sizes): &Packed) -> f64 {
        let mut owners: Vec<Vec<usize>> =
            sizes.iter().map(|size| vec![usize::MAX; (size[0] * size[1]) as usize]).collect();
        let mut count = 0;
        for (number, (island, placed)) in islands.iter().zip(placed).enumerate() {
            let [width, height] = sizes[placed.page];
            for run in &island.runs {
                let (y, [first, end]) =
                    (placed.corner[1] + run.row, [run.first, run.end].map(|x| placed.corner[0] + x));
                assert!(y < height && end <= width, "island {number} leaves its page");
                count += end - first;
                for (x, y) in (first..end).flat_map(|x| (y.saturating_sub(1)..height.min(y + 2)).map(move |y| (x, y))) {
                    for x in x.saturating_sub(1)..width.min(x + 2) {
                        let owner = owners[placed.page][(y * width + x) as usize];
                        assert!(owner == usize::MAX || owner == number, "islands {owner} and {number} touch");
                    }
                }
                let row = (y * width) as usize;
                owners[placed.page][row + first as usize..row + end as usize].fill(number);
            }
        }
        f64::from(count) / owners.iter().map(Vec::len).sum::<usize>() as f64
    }

    #[test]
    fn islands_lie_apart_in_the_holes_of_others() {
        let sizes = lengths(400).zip(lengths(800).skip(400)).map(|(w, h)| [3 + w % 60, 2 + h % 90]);
        let mut islands: Vec<Island> = sizes.map(|size| ring(size, 4)).collect();
        let packed = pack(&islands, 4096);
        assert_eq!(packed.1.len(), 1);
        let full = share(&islands, &packed);
        // Rectangles that leave nothing between them would take more.
        let of_island = |island: &Island| island.runs.iter().map(|run| run.end - run.first).sum::<u32>();
        let rectangles: u32 = islands.iter().map(|island| island.size.iter().product::<u32>()).sum();
        let in_rectangles = f64::from(islands.iter().map(of_island).sum::<u32>()) / f64::from(rectangles);
        assert!(full > in_rectangles, "{full}, and {in_rectangles} of the rectangles");
        // Others lie in a large ring.
        islands.push(ring([800, 700], 3));
        let with_ring = pack(&islands, 4096);
        share(&islands, &with_ring);
        let [texels, more] = [packed, with_ring].map(|(_, sizes)| sizes[0][0] * sizes[0][1]);
        assert!(more < texels + 800 * 700 / 2, "{more} texels with a ring, {texels} without");
    }

    #[test]
    fn pages_are_full_before_the_next_one_and_large_islands_have_their_own() {
        let islands: Vec<Island> = (0..40).map(|number| ring([30 + number % 5, 20 + number % 7], 40)).collect();
        let packed = pack(&islands, 100);
        assert!(packed.1.len() >= 4 && packed.1.iter().flatten().all(|&length| length <= 100), "{:?}", packed.1);
        assert!(share(&islands, &packed) > 0.7);
        let with_large = [islands.as_slice(), &[ring([101, 3], 9), ring([5, 300], 1)]].concat();
        let packed = pack(&with_large, 100);
        assert_eq!(packed.1[packed.1.len() - 2..], [[5, 300], [101, 3]]);
        share(&with_large, &packed);
        // An island that is as large as a page fits into it.
        assert_eq!(pack(&[ring([100, 100], 2)], 100).1, [[100, 100]]);
        assert_eq!(pack(&[], 100), (vec![], vec![]));
    }

    #[test]
    fn many_texels_have_larger_cells() {
        let islands: Vec<Island> =
            lengths(60).map(|length| ring([200 + length % 400, 250 + length % 300], 300)).collect();
        let packed = pack(&islands, u32::MAX);
        assert_eq!(packed.1.len(), 1);
        assert!(share(&islands, &packed) > 0.75);
    }
}
