//! Packs the images of a cut into pages, and gives each vertex one place in one of them: what programs draw that know textures and
//! texture coordinates.

use std::collections::HashMap;

use super::{ChannelImage, TexturedMesh};
use crate::codec::texels::Image;

/// Texels between images, which show their last ones.
const GAP: u32 = 1;

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
    /// For each vertex a triangle of the textured mesh and one of its corners, 0 to 2, that lie at its place.
    pub corners: Vec<(u32, u8)>,
    /// Texels in a row of each page, and rows.
    pub page_sizes: Vec<[u32; 2]>,
    /// For each node of the cut where its images lie.
    placed: Vec<Option<Placed>>,
}

/// Where an image lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Placed {
    page: usize,
    corner: [u32; 2],
}

impl ChannelImage {
    /// Texels in a row, and rows.
    fn size(&self) -> [u32; 2] {
        match self {
            Self::Colours(image) | Self::Normals(image) | Self::Factors(image) => image.size,
            Self::Values(image) => image.size,
        }
    }
}

impl PagedMesh {
    /// Texels along each side of a page, at most, where a program does not know better.
    pub const SIDE: u32 = 4096;

    /// Packs the images of a mesh into pages of at most `side` texels along each side, unless one image is larger.
    pub fn new(textured: &TexturedMesh, side: u32) -> Self {
        // All images of a node have the size of its map.
        let image = |images: &Vec<Option<ChannelImage>>| images.iter().flatten().map(ChannelImage::size).next();
        let sizes: Vec<Option<[u32; 2]>> = textured.textures.iter().map(|texture| image(&texture.images)).collect();
        let (placed, page_sizes) = pack(&sizes, side.max(1));
        let parts = page_sizes.len() + 1;
        let mut this = Self {
            triangles: vec![vec![]; parts],
            triangle_nodes: vec![vec![]; parts],
            page_sizes,
            placed,
            ..Self::default()
        };
        let mut numbers: HashMap<(u32, usize, [u32; 2]), u32> = HashMap::new();
        let mesh = &textured.mesh;
        let triangles = mesh.triangles.iter().zip(&textured.places).zip(&mesh.triangle_nodes);
        for (number, ((corners, places), &node)) in (0..).zip(triangles) {
            let placed = this.placed.get(node as usize).copied().flatten();
            let page = placed.map_or(parts - 1, |placed| placed.page);
            let vertices = [0, 1, 2].map(|k| {
                let place = placed.map_or([0.0; 2], |placed| {
                    let size = this.page_sizes[placed.page];
                    [0, 1].map(|axis| (places[k][axis] + placed.corner[axis] as f32) / size[axis] as f32)
                });
                *numbers.entry((corners[k], page, place.map(f32::to_bits))).or_insert_with(|| {
                    this.positions.push(mesh.positions[corners[k] as usize]);
                    this.places.push(place);
                    this.corners.push((number, k as u8));
                    this.positions.len() as u32 - 1
                })
            });
            this.triangles[page].push(vertices);
            this.triangle_nodes[page].push(node);
        }
        this
    }

    /// The pages of a channel of colours, normals or factors, which was asked for as number `channel`. Where nothing is known they are black.
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

    /// Pages of an image for each node of the cut, all of the size of the node's own images. `components` is their number where there is
    /// no image, and `empty` what texels are beside images.
    pub fn filled<T: Copy + Default>(
        &self,
        images: &[Option<&Image<T>>],
        components: u8,
        empty: &[T; 4],
    ) -> Vec<Image<T>> {
        let components = images.iter().flatten().map(|image| image.components).max().unwrap_or(components);
        let empty = empty.get(..usize::from(components)).unwrap_or(empty);
        let mut pages: Vec<Image<T>> = self.page_sizes.iter().map(|&size| Image::filled(size, empty)).collect();
        for (image, placed) in images.iter().zip(&self.placed) {
            if let (Some(image), Some(placed)) = (image, placed) {
                copy(image, &mut pages[placed.page], placed.corner);
            }
        }
        pages
    }
}

/// The image of each node.
fn images<'t, T>(
    textured: &'t TexturedMesh,
    channel: usize,
    of_kind: impl Fn(&'t ChannelImage) -> Option<&'t Image<T>>,
) -> Vec<Option<&'t Image<T>>> {
    textured.textures.iter().map(|texture| texture.images.get(channel)?.as_ref().and_then(&of_kind)).collect()
}

/// Packs images into rows of pages, the highest first. Returns where each lies, and the sizes of the pages.
fn pack(images: &[Option<[u32; 2]>], side: u32) -> (Vec<Option<Placed>>, Vec<[u32; 2]>) {
    let with_gap = |size: [u32; 2]| size.map(|length| length + 2 * GAP);
    let mut order: Vec<usize> = (0..images.len()).filter(|&number| images[number].is_some()).collect();
    order.sort_by_key(|&number| (std::cmp::Reverse(images[number].map(|size| size[1])), number));
    let sizes = || images.iter().flatten().copied().map(with_gap);
    let area: u64 = sizes().map(|size| size.map(u64::from).iter().product::<u64>()).sum();
    // A square page for what fits into one.
    let square = (1..=side).find(|&side| u64::from(side) * u64::from(side) >= area + area / 16);
    let widest = sizes().map(|size| size[0]).max().unwrap_or(0);
    let width = square.unwrap_or(side).max(widest);
    let (mut placed, mut sizes) = (vec![None; images.len()], vec![]);
    let (mut corner, mut row, mut used) = ([0, 0], 0, 0);
    for number in order {
        let Some([w, h]) = images[number].map(with_gap) else { continue };
        if corner[0] + w > width {
            corner = [0, corner[1] + row];
            row = 0;
        }
        if corner[1] > 0 && corner[1] + h > side {
            sizes.push([used, corner[1] + row]);
            (corner, row, used) = ([0, 0], 0, 0);
        }
        placed[number] = Some(Placed { page: sizes.len(), corner: corner.map(|x| x + GAP) });
        corner[0] += w;
        (row, used) = (row.max(h), used.max(corner[0]));
    }
    if used > 0 {
        sizes.push([used, corner[1] + row]);
    }
    (placed, sizes)
}

/// Copies an image into a page, with its last texels around it.
fn copy<T: Copy + Default>(image: &Image<T>, page: &mut Image<T>, corner: [u32; 2]) {
    let components = usize::from(page.components);
    let [width, height] = image.size;
    for y in 0..height + 2 * GAP {
        for x in 0..width + 2 * GAP {
            let from = [x, y].map(|x| x.saturating_sub(GAP));
            let texel = image.texel(from[0].min(width - 1), from[1].min(height - 1));
            let at =
                ((corner[1] + y - GAP) as usize * page.size[0] as usize + (corner[0] + x - GAP) as usize) * components;
            page.data[at..at + components].iter_mut().zip(texel).for_each(|(to, &from)| *to = from);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::{Mesh, Texture};

    #[test]
    fn images_lie_apart_and_corners_find_them() {
        let sizes = [[30, 7], [5, 90], [1, 1], [64, 64], [3, 3]];
        let colours = |number: usize| Image::filled(sizes[number], &[number as u8 * 10 + 5, 0, 0]);
        let values = |number: usize| Image::filled(sizes[number], &[number as u16 * 1000]);
        let images =
            |number| vec![Some(ChannelImage::Colours(colours(number))), Some(ChannelImage::Values(values(number)))];
        let texture = |number| Texture { images: images(number), ..Texture::default() };
        let textured = TexturedMesh {
            mesh: Mesh {
                positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
                triangles: vec![[0, 1, 2]; 6],
                triangle_nodes: (0..6).collect(),
            },
            places: vec![[[0.5, 0.5]; 3]; 6],
            textures: (0..5).map(texture).chain([Texture::default()]).collect(),
        };
        let paged = PagedMesh::new(&textured, PagedMesh::SIDE);
        assert_eq!((paged.page_sizes.len(), paged.triangles[0].len(), paged.triangles[1].len()), (1, 5, 1));
        assert_eq!(paged.triangle_nodes, [vec![0, 1, 2, 3, 4], vec![5]]);
        let (page, numbers) = (&paged.colours(&textured, 0)[0], &paged.values(&textured, 1)[0]);
        for (number, triangle) in paged.triangles[0].iter().enumerate() {
            let place = paged.places[triangle[0] as usize];
            let at = [0, 1].map(|k| f64::from(place[k] * page.size[k] as f32));
            let colour = page.interpolated(at);
            assert!((colour[0] - (number as f64 * 10.0 + 5.0)).abs() < 0.01, "{number} {colour:?}");
            assert!((numbers.interpolated(at)[0] - number as f64 * 1000.0).abs() < 1.0);
        }
        assert!(page.size[0] * page.size[1] < 2 * (64 * 64 + 5 * 90 + 30 * 7 + 600), "{:?}", page.size);
        // Smaller pages hold less each, but for an image that is larger.
        let small = PagedMesh::new(&textured, 32);
        assert!(
            small.page_sizes.len() > 2 && small.page_sizes.iter().any(|size| size[0] > 64),
            "{:?}",
            small.page_sizes
        );
        assert_eq!(small.triangles.iter().map(Vec::len).sum::<usize>(), 6);
    }
}
