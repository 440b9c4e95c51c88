//! Islands of an image: the texels that triangles are interpolated between, divided where no triangle needs texels of
//! both sides.
//!
//! A piece of a map is one island, or several where the surface over it is not connected. The rest of its rectangle
//! shows nothing.

/// Stands for no triangle and no island.
pub(super) const NONE: u32 = u32::MAX;

/// Texels of a node's images that are read together.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Island {
    /// The node, by its number in the cut.
    pub node: u32,
    /// The first column and the first row of the rectangle around it.
    pub corner: [u32; 2],
    /// Columns and rows of the rectangle.
    pub size: [u32; 2],
    /// Its texels, row after row.
    pub runs: Vec<Run>,
}

/// Texels of a row that follow each other. They count from the corner of their island.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Run {
    /// The row.
    pub row: u32,
    /// The first column.
    pub first: u32,
    /// The column after the last one.
    pub end: u32,
}

/// Finds the islands of a node's images, which have this size. Corners of triangles are places in texels. Returns the
/// islands in the order of their first texels, and the number of each triangle's island: [`NONE`] for a triangle beside
/// the images.
pub(super) fn find_islands(node: u32, size: [u32; 2], triangles: &[[[f32; 2]; 3]]) -> (Vec<Island>, Vec<u32>) {
    let width = size[0] as usize;
    let mut owners = vec![NONE; width * size[1] as usize];
    let mut groups = Groups((0..triangles.len() as u32).collect());
    for (number, &corners) in (0..).zip(triangles) {
        let mut last = number;
        for_each_run(size, corners, |row, columns| {
            let first = row as usize * width;
            for owner in &mut owners[first + columns.start as usize..first + columns.end as usize] {
                if *owner != NONE && *owner != last {
                    last = *owner;
                    groups.join(number, last);
                }
                *owner = number;
            }
        });
    }
    groups.flatten();
    let mut island_of = vec![NONE; triangles.len()];
    let mut islands: Vec<Island> = vec![];
    for (row, owners) in (0..).zip(owners.chunks_exact(width.max(1))) {
        let mut end = 0;
        for same in owners.chunk_by(|&a, &b| a == b || a != NONE && b != NONE && groups.first(a) == groups.first(b)) {
            let first = end;
            end += same.len() as u32;
            if same[0] == NONE {
                continue;
            }
            let number = &mut island_of[groups.first(same[0]) as usize];
            if *number == NONE {
                *number = islands.len() as u32;
                islands.push(Island { node, corner: [first, row], size: [end, row], runs: vec![] });
            }
            let island = &mut islands[*number as usize];
            island.corner[0] = island.corner[0].min(first);
            island.size = [island.size[0].max(end), row + 1];
            island.runs.push(Run { row, first, end });
        }
    }
    for island in &mut islands {
        let [left, top] = island.corner;
        island.size = [island.size[0] - left, island.size[1] - top];
        for run in &mut island.runs {
            *run = Run { row: run.row - top, first: run.first - left, end: run.end - left };
        }
    }
    let of_triangles = (0..triangles.len() as u32).map(|number| island_of[groups.first(number) as usize]).collect();
    (islands, of_triangles)
}

/// Triangles that belong together: each names an earlier one of its group, or itself if it is the first.
struct Groups(Vec<u32>);

impl Groups {
    fn join(&mut self, a: u32, b: u32) {
        let [a, b] = [self.find(a), self.find(b)];
        let (first, other) = (a.min(b), a.max(b));
        self.0[other as usize] = first;
    }

    /// The first triangle of a group, to which the way is shorter afterwards.
    fn find(&mut self, mut triangle: u32) -> u32 {
        while self.0[triangle as usize] != triangle {
            let next = self.0[triangle as usize];
            self.0[triangle as usize] = self.0[next as usize];
            triangle = next;
        }
        triangle
    }

    /// Has all name the first triangle of their group. No more groups can be joined after that.
    fn flatten(&mut self) {
        for triangle in 0..self.0.len() {
            self.0[triangle] = self.0[self.0[triangle] as usize];
        }
    }

    /// The first triangle of a group, once all is flat.
    fn first(&self, triangle: u32) -> u32 {
        self.0[triangle as usize]
    }
}

/// Calls a function for each row of texels that a triangle is interpolated between, with their columns.
fn for_each_run([width, height]: [u32; 2], corners: [[f32; 2]; 3], mut run: impl FnMut(u32, std::ops::Range<u32>)) {
    let [mut low, mut high] = [f32::INFINITY, f32::NEG_INFINITY];
    corners.iter().for_each(|corner| (low, high) = (low.min(corner[1]), high.max(corner[1])));
    for row in texels_with(low, high, height) {
        // A texel counts up to the middles of those beside it.
        let rows = [row as f32 - 0.5, row as f32 + 1.5];
        if let Some([left, right]) = extent(corners, rows) {
            let columns = texels_with(left, right, width);
            if !columns.is_empty() {
                run(row, columns);
            }
        }
    }
}

/// The texels of a line that are interpolated with from one place to another.
fn texels_with(low: f32, high: f32, count: u32) -> std::ops::Range<u32> {
    // Conversions saturate, and NaN becomes 0.
    let first = (low - 1.5).ceil().max(0.0) as u32;
    let end = (high + 0.5).floor().max(-1.0) + 1.0;
    first..(end as u32).min(count)
}

/// How far a triangle reaches to the left and to the right between two heights.
fn extent(corners: [[f32; 2]; 3], [top, bottom]: [f32; 2]) -> Option<[f32; 2]> {
    let mut reached = [f32::INFINITY, f32::NEG_INFINITY];
    let mut reach = |x: f32| reached = [reached[0].min(x), reached[1].max(x)];
    for k in 0..3 {
        let [[x, y], [next_x, next_y]] = [corners[k], corners[(k + 1) % 3]];
        if (top..=bottom).contains(&y) {
            reach(x);
        }
        for height in [top, bottom] {
            if (y < height) != (next_y < height) {
                reach(x + (next_x - x) * ((height - y) / (next_y - y)));
            }
        }
    }
    (reached[0] <= reached[1]).then_some(reached)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Which texels an island has.
    fn texels(size: [u32; 2], island: &Island) -> Vec<bool> {
        let mut texels = vec![false; (size[0] * size[1]) as usize];
        for run in &island.runs {
            let row = (run.row + island.corner[1]) * size[0] + island.corner[0];
            texels[(row + run.first) as usize..(row + run.end) as usize].fill(true);
        }
        texels
    }

    #[test]
    fn all_that_is_interpolated_with_is_drawn_and_little_else() {
        let corners = [[3.2, 2.1], [14.7, 5.0], [6.0, 13.4]];
        let (islands, of_triangles) = find_islands(7, [20, 18], &[corners]);
        assert_eq!((islands.len(), islands[0].node, of_triangles), (1, 7, vec![0]));
        let drawn = texels([20, 18], &islands[0]);
        let mut seen = vec![false; drawn.len()];
        for (i, j) in (0..=200).flat_map(|i| (0..=200 - i).map(move |j| (i, j))) {
            let [b, c] = [i, j].map(|share| share as f32 / 200.0);
            let place = [0, 1].map(|k| corners[0][k] * (1.0 - b - c) + corners[1][k] * b + corners[2][k] * c - 0.5);
            for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                seen[(place[1] as usize + y) * 20 + place[0] as usize + x] = true;
            }
        }
        assert!(seen.iter().zip(&drawn).all(|(seen, drawn)| !seen || *drawn));
        let [seen, drawn] = [seen, drawn].map(|all| all.into_iter().filter(|is| *is).count());
        assert!(drawn < seen + seen / 3, "{drawn} texels for {seen}");
    }

    #[test]
    fn triangles_that_share_texels_are_one_island_and_others_are_not() {
        let triangle = |x: f32, y: f32| [[x, y], [x + 6.0, y], [x, y + 6.0]];
        // The second and the third touch nothing of the first; the last one joins these two.
        let triangles = [[30.0, 3.0], [2.0, 3.0], [2.0, 15.0], [5.0, 9.0]].map(|[x, y]| triangle(x, y));
        let (islands, of_triangles) = find_islands(0, [40, 24], &triangles);
        assert_eq!(of_triangles, [1, 0, 0, 0]);
        assert_eq!(islands.len(), 2);
        assert!(islands[0].corner[0] + islands[0].size[0] <= islands[1].corner[0], "{islands:?}");
        // Each texel is in one of them at most, and rectangles are as small as they can be.
        let [a, b] = [0, 1].map(|number| texels([40, 24], &islands[number]));
        assert!(a.iter().zip(&b).all(|(a, b)| !a || !b));
        for island in &islands {
            let most = |of: fn(&Run) -> u32| island.runs.iter().map(of).max();
            assert_eq!([most(|run| run.end), most(|run| run.row + 1)].map(Option::unwrap_or_default), island.size);
            assert_eq!(island.runs.iter().map(|run| run.first).min(), Some(0));
            assert_eq!(island.runs[0].row, 0);
        }
        let three = find_islands(0, [40, 24], &triangles[..3]);
        assert_eq!((three.0.len(), three.1), (3, vec![1, 0, 2]));
    }

    #[test]
    fn places_beyond_an_image_are_not_drawn() {
        for x in [f32::NAN, -1e30, 1e30, f32::INFINITY] {
            let (islands, of_triangles) = find_islands(0, [4, 4], &[[[x, 9.0], [x, 20.0], [-3.0, 40.0]]]);
            assert_eq!((islands, of_triangles), (vec![], vec![NONE]));
        }
        let (islands, _) = find_islands(0, [2, 2], &[[[-9.0, -9.0], [30.0, -9.0], [-9.0, 30.0]]]);
        assert_eq!(texels([2, 2], &islands[0]), [true; 4]);
    }
}
