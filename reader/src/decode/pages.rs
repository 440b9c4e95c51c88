//! Packs what a cut shows of its images into pages, and gives each vertex one place in one of them: what programs draw
//! that know textures and texture coordinates.

use std::collections::HashMap;

use super::islands::{Island, NONE, find_islands};
use super::packing::{Placed, pack};
use super::{ChannelImage, TexturedMesh};
use crate::codec::texels::Image;

/// A mesh of which each vertex has one place in one page. All channels of a mesh share these places.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PagedMesh {
    /// World positions. Where triangles do not agree about the place of a vertex, it is there several times.
    pub positions: Vec<[f64; 3]>,
    /// The place of each vertex, of the page's width and height; the first row of texels is at 0.
    pub places: Vec<[f32; 2]>,
    /// Triangles by page; after those of all pages those without texels.
    pub triangles: Vec<Vec<[u32; 3]>>,
    /// For each of these triangles the index of its node in the cut.
    pub triangle_nodes: Vec<Vec<u32>>,
    /// For each of these triangles its number in the textured mesh.
    pub triangle_numbers: Vec<Vec<u32>>,
    /// For each vertex a triangle of the textured mesh and one of its corners, 0 to 2, that lie at its place.
    pub corners: Vec<(u32, u8)>,
    /// Texels in a row of each page, and rows.
    pub page_sizes: Vec<[u32; 2]>,
    /// Texels that belong together, and where they lie.
    islands: Vec<Island>,
    placed: Vec<Placed>,
}

impl ChannelImage {
    /// Texels in a row, and rows.
    pub(crate) fn size(&self) -> [u32; 2] {
        match self {
            Self::Colours(image) | Self::Normals(image) | Self::Factors(image) => image.size,
            Self::Values(image) => image.size,
        }
    }
}

impl PagedMesh {
    /// Texels along each side of a page, at most, where a program does not know better.
    pub const SIDE: u32 = 4096;

    /// Packs the texels that a mesh shows into pages of at most `side` texels along each side. Texels that are read
    /// together stay together; where they are more than a page holds, they have a page of their own.
    pub fn new(textured: &TexturedMesh, side: u32) -> Self {
        let (islands, island_of) = islands(textured);
        let (placed, page_sizes) = pack(&islands, side.max(1));
        let parts = page_sizes.len() + 1;
        let mut this = Self {
            triangles: vec![vec![]; parts],
            triangle_nodes: vec![vec![]; parts],
            triangle_numbers: vec![vec![]; parts],
            page_sizes,
            islands,
            placed,
            ..Self::default()
        };
        let mut numbers: HashMap<(u32, usize, [u32; 2]), u32> = HashMap::new();
        let mesh = &textured.mesh;
        let triangles = mesh.triangles.iter().zip(&textured.places).zip(&mesh.triangle_nodes);
        for (number, ((corners, places), &node)) in (0..).zip(triangles) {
            let island = island_of[number as usize];
            let known = this.islands.get(island as usize).zip(this.placed.get(island as usize).copied());
            let page = known.map_or(parts - 1, |(_, placed)| placed.page);
            let places = places.map(|place| {
                known.map_or([0.0; 2], |(island, placed)| {
                    let size = this.page_sizes[placed.page];
                    [0, 1].map(|k| {
                        let moved = place[k] - island.corner[k] as f32 + placed.corner[k] as f32;
                        moved.clamp(0.0, size[k] as f32) / size[k] as f32
                    })
                })
            });
            let vertices = [0, 1, 2].map(|k| {
                *numbers.entry((corners[k], page, places[k].map(f32::to_bits))).or_insert_with(|| {
                    this.positions.push(mesh.positions[corners[k] as usize]);
                    this.places.push(places[k]);
                    this.corners.push((number, k as u8));
                    this.positions.len() as u32 - 1
                })
            });
            this.triangles[page].push(vertices);
            this.triangle_nodes[page].push(node);
            this.triangle_numbers[page].push(number);
        }
        this
    }

    /// The pages of a channel of colours, normals or factors, which was asked for as number `channel`. Where nothing is
    /// known they are black.
    pub fn colours(&self, textured: &TexturedMesh, channel: usize) -> Vec<Image<u8>> {
        let images = images(textured, channel, |image| match image {
            ChannelImage::Colours(image) | ChannelImage::Normals(image) | ChannelImage::Factors(image) => Some(image),
            ChannelImage::Values(_) => None,
        });
        self.filled(&images, 3, &[0, 0, 0, 255])
    }

    /// The pages of a channel of numbers, which was asked for as number `channel`. Where nothing is known they are 0.
    pub fn values(&self, textured: &TexturedMesh, channel: usize) -> Vec<Image<u16>> {
        let images = images(textured, channel, |image| match image {
            ChannelImage::Values(image) => Some(image),
            _ => None,
        });
        self.filled(&images, 1, &[0; 4])
    }

    /// Pages of an image for each node of the cut, all of the size of the node's own images. `components` is their
    /// number where there is no image, and `empty` what nodes without an image show. Texels that nothing shows are
    /// those of the closest one that is shown.
    pub fn filled<T: Copy + Default>(
        &self,
        images: &[Option<&Image<T>>],
        components: u8,
        empty: &[T; 4],
    ) -> Vec<Image<T>> {
        let components = images.iter().flatten().map(|image| image.components).max().unwrap_or(components);
        let empty = empty.get(..usize::from(components)).unwrap_or(empty);
        let mut pages: Vec<(Image<T>, Vec<bool>)> = self
            .page_sizes
            .iter()
            .map(|&size| (Image::filled(size, empty), vec![false; size[0] as usize * size[1] as usize]))
            .collect();
        for (island, placed) in self.islands.iter().zip(&self.placed) {
            let image = images.get(island.node as usize).copied().flatten();
            let (page, drawn) = &mut pages[placed.page];
            for run in &island.runs {
                let first = |size: [u32; 2], corner: [u32; 2]| {
                    (corner[1] + run.row) as usize * size[0] as usize + (corner[0] + run.first) as usize
                };
                let (to, count) = (first(page.size, placed.corner), (run.end - run.first) as usize);
                drawn[to..to + count].fill(true);
                if let Some(image) = image {
                    copy(image, first(image.size, island.corner), page, to, count);
                }
            }
        }
        let extruded = |(mut page, drawn): (Image<T>, Vec<bool>)| {
            page.extrude(&drawn);
            page
        };
        pages.into_iter().map(extruded).collect()
    }
}

/// Copies texels from an image to a page, which has as many components or more.
fn copy<T: Copy>(image: &Image<T>, from: usize, page: &mut Image<T>, to: usize, count: usize) {
    let [of_image, of_page] = [image.components, page.components].map(usize::from);
    let texels = image.data.get(from * of_image..(from + count) * of_image).unwrap_or_default();
    let room = &mut page.data[to * of_page..(to + count) * of_page];
    if of_image == of_page && texels.len() == room.len() {
        room.copy_from_slice(texels);
        return;
    }
    for (to, from) in room.chunks_exact_mut(of_page.max(1)).zip(texels.chunks_exact(of_image.max(1))) {
        to.iter_mut().zip(from).for_each(|(to, &from)| *to = from);
    }
}

/// The islands of all nodes, and the number of that of each triangle; [`NONE`] for triangles without texels.
fn islands(textured: &TexturedMesh) -> (Vec<Island>, Vec<u32>) {
    let mesh = &textured.mesh;
    let mut of_nodes = vec![(vec![], vec![]); textured.textures.len()];
    for ((number, &node), &places) in (0..mesh.triangles.len() as u32).zip(&mesh.triangle_nodes).zip(&textured.places) {
        if let Some((numbers, all_places)) = of_nodes.get_mut(node as usize) {
            numbers.push(number);
            all_places.push(places);
        }
    }
    let (mut islands, mut island_of) = (vec![], vec![NONE; mesh.triangles.len()]);
    for (node, (texture, (numbers, places))) in (0..).zip(textured.textures.iter().zip(of_nodes)) {
        // All images of a node have the size of its map.
        let Some(size) = texture.images.iter().flatten().map(ChannelImage::size).next() else { continue };
        let (of_node, of_triangles) = find_islands(node, size, &places);
        for (number, island) in numbers.into_iter().zip(of_triangles).filter(|&(_, island)| island != NONE) {
            island_of[number as usize] = islands.len() as u32 + island;
        }
        islands.extend(of_node);
    }
    (islands, island_of)
}

/// The image of each node.
fn images<'t, T>(
    textured: &'t TexturedMesh,
    channel: usize,
    of_kind: impl Fn(&'t ChannelImage) -> Option<&'t Image<T>>,
) -> Vec<Option<&'t Image<T>>> {
    textured.textures.iter().map(|texture| texture.images.get(channel)?.as_ref().and_then(&of_kind)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::{Mesh, Texture};

    /// A number for each texel of the images of a node.
    fn number(node: usize, [x, y]: [u32; 2]) -> u32 {
        node as u32 * 20 + x + y % 50
    }

    /// Five nodes with images of these sizes, half of which a triangle shows, and one node without.
    fn textured(sizes: [[u32; 2]; 5]) -> TexturedMesh {
        let texels = |size: [u32; 2]| (0..size[1]).flat_map(move |y| (0..size[0]).map(move |x| [x, y]));
        let images = |node: usize| {
            let size = sizes[node];
            let colours = texels(size).flat_map(|at| [number(node, at) as u8, 7, at[0] as u8]).collect();
            let values = texels(size).map(|at| number(node, at) as u16 * 100).collect();
            vec![
                Some(ChannelImage::Colours(Image { size, components: 3, data: colours })),
                Some(ChannelImage::Values(Image { size, components: 1, data: values })).filter(|_| node != 3),
            ]
        };
        let texture = |node| Texture { images: images(node), ..Texture::default() };
        let corners = |[w, h]: [u32; 2]| {
            let [right, bottom] = [w, h].map(|length| length as f32 - 0.5);
            [[0.5, 0.5], [right, 0.5], [0.5, bottom]]
        };
        TexturedMesh {
            mesh: Mesh {
                positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
                triangles: vec![[0, 1, 2]; 6],
                triangle_nodes: (0..6).collect(),
            },
            places: sizes.into_iter().map(corners).chain([[[f32::NAN; 2]; 3]]).collect(),
            textures: (0..5).map(texture).chain([Texture::default()]).collect(),
        }
    }

    #[test]
    fn pages_show_what_the_images_of_nodes_do() {
        let textured = textured([[30, 7], [5, 90], [1, 1], [64, 64], [3, 3]]);
        for side in [PagedMesh::SIDE, 70, 32] {
            let paged = PagedMesh::new(&textured, side);
            assert_eq!(paged.triangles.iter().map(Vec::len).sum::<usize>(), 6);
            let last = paged.page_sizes.len();
            assert_eq!((&paged.triangle_nodes[last], &paged.triangle_numbers[last]), (&vec![5], &vec![5]));
            let (pages, values) = (paged.colours(&textured, 0), paged.values(&textured, 1));
            for (page, triangles) in paged.triangles.iter().enumerate().take(last) {
                for (triangle, &node) in triangles.iter().zip(&paged.triangle_nodes[page]) {
                    let node = node as usize;
                    let own = textured.textures[node].images[0].as_ref();
                    let Some(ChannelImage::Colours(own)) = own else { panic!("all nodes have colours") };
                    for (i, j) in (0..=20).flat_map(|i| (0..=20 - i).map(move |j| (i, j))) {
                        let weights = [20 - i - j, i, j].map(|share| f64::from(share) / 20.0);
                        let mixed = |places: [[f32; 2]; 3]| {
                            [0, 1].map(|k| (0..3).map(|c| weights[c] * f64::from(places[c][k])).sum::<f64>())
                        };
                        let at = mixed(triangle.map(|vertex| paged.places[vertex as usize]));
                        let at = [0, 1].map(|k| at[k] * f64::from(paged.page_sizes[page][k]));
                        let expected = own.interpolated(mixed(textured.places[node]));
                        let shown = pages[page].interpolated(at);
                        assert!(
                            (0..3).all(|k| (shown[k] - expected[k]).abs() < 0.01),
                            "{node}: {shown:?} {expected:?}"
                        );
                        let known = if node == 3 { 0.0 } else { expected[0] * 100.0 };
                        assert!((values[page].interpolated(at)[0] - known).abs() < 1.0, "{node}");
                    }
                }
            }
            // Nothing is black beside what is shown.
            assert!(pages.iter().all(|page| page.data.as_chunks::<3>().0.iter().all(|texel| texel[1] == 7)));
        }
    }

    #[test]
    fn pages_hold_little_else_and_are_no_larger_than_somebody_asks_for() {
        let textured = textured([[30, 7], [5, 90], [1, 1], [64, 64], [3, 3]]);
        let paged = PagedMesh::new(&textured, PagedMesh::SIDE);
        let [page] = paged.page_sizes[..] else { panic!("one page: {:?}", paged.page_sizes) };
        // Of the image of 64 x 64, half is shown; the others fit into its corner but for one.
        assert!(page[0] * page[1] <= 90 * 72, "{page:?}");
        let small = PagedMesh::new(&textured, 32);
        let larger = |size: &&[u32; 2]| size.iter().any(|&length| length > 32);
        assert!(small.page_sizes.len() > 2 && small.page_sizes.iter().filter(larger).count() == 2, "{small:?}");
        // What an image has that nobody sees is not there.
        let mut bare = textured.clone();
        bare.places = vec![[[f32::NAN; 2]; 3]; 6];
        let bare = PagedMesh::new(&bare, PagedMesh::SIDE);
        assert_eq!((bare.page_sizes.len(), bare.triangles.len(), bare.triangles[0].len()), (0, 1, 6));
    }
}
