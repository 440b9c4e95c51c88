//! A square form of the errors of a block's texels: what each counts, and what it counts together with those around it.

use super::transform::{AREA, COSINES_OF, SIDE};

/// Texels in a row of a block, with one more on either side, so that nothing is special at its rim.
const WIDE: usize = SIDE + 2;
/// All of them.
const ALL: usize = WIDE * WIDE;

/// For each texel what the products of its error with its own and with those of its neighbours count.
pub(super) struct Form {
    own: [f32; ALL],
    right: [f32; ALL],
    below: [f32; ALL],
    right_below: [f32; ALL],
    left_below: [f32; ALL],
    /// A bit for each row that has any product of neighbours.
    rows: u32,
}

impl Form {
    /// What the squares of texels count.
    pub fn new(weights: &[f32; AREA]) -> Self {
        let mut own = [0.0; ALL];
        for (y, row) in weights.as_chunks::<SIDE>().0.iter().enumerate() {
            own[(y + 1) * WIDE + 1..][..SIDE].copy_from_slice(row);
        }
        let [right, below, right_below, left_below] = [[0.0; ALL]; 4];
        Self { own, right, below, right_below, left_below, rows: 0 }
    }

    /// Adds what the square of a point counts, which lies between four texels. The first of them has a column and a
    /// row, counted from one, and the others are beside it and below.
    pub fn add(&mut self, [x, y]: [usize; 2], [right, down]: [f32; 2], weight: f32) {
        let at = y * WIDE + x;
        let (left, up) = (1.0 - right, 1.0 - down);
        let shares = [left * up, right * up, left * down, right * down];
        let [a, b, c, d] = shares.map(|share| weight * share);
        self.own[at] += a * shares[0];
        self.own[at + 1] += b * shares[1];
        self.own[at + WIDE] += c * shares[2];
        self.own[at + WIDE + 1] += d * shares[3];
        self.right[at] += a * shares[1];
        self.right[at + WIDE] += c * shares[3];
        self.below[at] += a * shares[2];
        self.below[at + 1] += b * shares[3];
        self.right_below[at] += a * shares[3];
        self.left_below[at + 1] += b * shares[2];
        self.rows |= 3 << y;
    }

    /// Half of how much the form grows for each texel whose error does.
    pub fn times(&self, errors: &[f32; AREA]) -> [f32; AREA] {
        let mut wide = [0.0; ALL];
        for (y, row) in errors.as_chunks::<SIDE>().0.iter().enumerate() {
            wide[(y + 1) * WIDE + 1..][..SIDE].copy_from_slice(row);
        }
        let mut result = [0.0; AREA];
        for (y, row) in result.as_chunks_mut::<SIDE>().0.iter_mut().enumerate() {
            let at = (y + 1) * WIDE + 1;
            let product = |weights: &[f32; ALL], first: usize, other: usize| -> [f32; SIDE] {
                let (weights, errors) = (&weights[first..first + SIDE], &wide[other..other + SIDE]);
                std::array::from_fn(|x| weights[x] * errors[x])
            };
            *row = product(&self.own, at, at);
            if self.rows >> (y + 1) & 1 == 0 {
                continue;
            }
            for (weights, step) in
                [(&self.right, 1), (&self.below, WIDE), (&self.right_below, WIDE + 1), (&self.left_below, WIDE - 1)]
            {
                let [after, before] = [product(weights, at, at + step), product(weights, at - step, at - step)];
                (0..SIDE).for_each(|x| row[x] += after[x] + before[x]);
            }
        }
        result
    }

    /// What the square of each coefficient counts.
    pub fn curvature(&self) -> [f32; AREA] {
        type Row = [f32; SIDE];
        let Squares { own, beside } = &SQUARES;
        let add = |sums: &mut Row, factor: f32, row: &Row| (0..SIDE).for_each(|k| sums[k] += factor * row[k]);
        // Along rows.
        let (mut of_rows, mut between_rows) = ([[0.0; SIDE]; SIDE], [[0.0; SIDE]; SIDE]);
        for y in 0..SIDE {
            let at = (y + 1) * WIDE + 1;
            let of = |weights: &[f32; ALL], x: usize| weights[at + x];
            let has_products = self.rows >> (y + 1) & 1 == 1;
            for x in 0..SIDE / 2 {
                let last = SIDE - 1 - x;
                add(&mut of_rows[y], of(&self.own, x) + of(&self.own, last), &own[x]);
                if has_products {
                    add(&mut between_rows[y], of(&self.below, x) + of(&self.below, last), &own[x]);
                }
            }
            if has_products {
                for x in 0..SIDE - 1 {
                    add(&mut of_rows[y], 2.0 * of(&self.right, x), &beside[x]);
                    let both = of(&self.right_below, x) + of(&self.left_below, x + 1);
                    add(&mut between_rows[y], both, &beside[x]);
                }
            }
        }
        // Along columns.
        let mut result = [0.0; AREA];
        for (j, sums) in result.as_chunks_mut::<SIDE>().0.iter_mut().enumerate() {
            for y in 0..SIDE / 2 {
                add(sums, of_rows[y][j] + of_rows[SIDE - 1 - y][j], &own[y]);
            }
            if self.rows != 0 {
                (0..SIDE - 1).for_each(|y| add(sums, 2.0 * between_rows[y][j], &beside[y]));
            }
        }
        result
    }
}

/// Products of cosines, for each place along a side.
struct Squares {
    /// Each with itself; those of the other half are the same.
    own: [[f32; SIDE]; SIDE / 2],
    /// And with the one beside it.
    beside: [[f32; SIDE]; SIDE - 1],
}

static SQUARES: Squares = {
    let (mut own, mut beside) = ([[0.0; SIDE]; SIDE / 2], [[0.0; SIDE]; SIDE - 1]);
    let mut x = 0;
    while x < SIDE - 1 {
        let mut k = 0;
        while k < SIDE {
            if x < SIDE / 2 {
                own[x][k] = COSINES_OF[k][x] * COSINES_OF[k][x];
            }
            beside[x][k] = COSINES_OF[k][x] * COSINES_OF[k][x + 1];
            k += 1;
        }
        x += 1;
    }
    Squares { own, beside }
};

#[cfg(test)]
mod tests {
    use super::super::transform::forward;
    use super::*;

    /// Texels with their shares of a point.
    type Shares = Vec<(usize, f32)>;

    /// A form, what the squares of texels count in it, and the texels of each of its points with their shares.
    fn form() -> (Form, [f32; AREA], Vec<Shares>) {
        let weights = std::array::from_fn(|at| if at % 8 + at / 16 < 6 { 1.0 } else { 0.1 });
        let (mut form, mut points) = (Form::new(&weights), vec![]);
        // Some lie between texels of the block and those around it.
        for (x, y, right, down) in
            [(3, 4, 0.3, 0.6), (3, 4, 0.9, 0.1), (0, 2, 0.5, 0.5), (8, 0, 0.2, 0.7), (5, 8, 0.4, 0.3)]
        {
            form.add([x, y], [right, down], 4.0);
            let all = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(beside, below)| {
                let share = |far: usize, share: f32| if far == 1 { share } else { 1.0 - share };
                (x + beside, y + below, share(beside, right) * share(below, down))
            });
            let within = all.into_iter().filter(|(x, y, _)| (1..=SIDE).contains(x) && (1..=SIDE).contains(y));
            points.push(within.map(|(x, y, share)| ((y - 1) * SIDE + x - 1, share)).collect());
        }
        (form, weights, points)
    }

    #[test]
    fn products_are_those_of_all_points() {
        let (form, weights, points) = form();
        let errors: [f32; AREA] = std::array::from_fn(|at| ((at * 37 + at * at * 11) % 19) as f32 - 9.0);
        let mut expected: [f32; AREA] = std::array::from_fn(|at| weights[at] * errors[at]);
        for point in &points {
            let sum: f32 = point.iter().map(|&(at, share)| share * errors[at]).sum();
            point.iter().for_each(|&(at, share)| expected[at] += 4.0 * share * sum);
        }
        let found = form.times(&errors);
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4), "{found:?} {expected:?}");
    }

    #[test]
    fn what_a_coefficient_counts_is_its_own_slope() {
        let (form, ..) = form();
        let curvature = form.curvature();
        for at in 0..AREA {
            let basis = std::array::from_fn(|t| COSINES_OF[at / SIDE][t % SIDE] * COSINES_OF[at % SIDE][t / SIDE]);
            let own = forward(&form.times(&basis))[at];
            assert!((own - curvature[at]).abs() < 1e-4, "{at}: {own} {}", curvature[at]);
        }
    }
}
