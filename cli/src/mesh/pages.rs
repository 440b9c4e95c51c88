//! Packs the images of a cut into pages, and gives each corner of a triangle its place in them.

use std::collections::HashMap;

use lodpack::decode::TexturedMesh;
use lodpack::decode::texels::{Image, Map, Piece};

use super::layers::{Layer, Look, frame};

/// Texels between images, which show their last ones.
const GAP: u32 = 1;
/// Texels along each side of a page, at most: unless one image is larger.
pub const PAGE_SIDE: u32 = 4096;

/// A mesh of which each vertex has one place in one page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PagedMesh {
    /// World positions. Where triangles do not agree about the place of a vertex, it is there several times.
    pub positions: Vec<[f64; 3]>,
    /// The place of each vertex, of the page's width and height; the first row of texels is at 0.
    pub places: Vec<[f32; 2]>,
    /// Triangles by page; after those of all pages those without texels.
    pub triangles: Vec<Vec<[u32; 3]>>,
    /// Tangent and normal of each vertex, in which the layer of normals is; empty without it.
    pub frames: Vec<[[f32; 3]; 2]>,
    /// The images of each page, all of one size: one for each layer of the look.
    pub pages: Vec<Page>,
}

/// The images of a page.
pub type Page = Vec<(Layer, Image<u8>)>;

/// Where an image lies.
#[derive(Clone, Copy, Debug)]
struct Placed {
    page: usize,
    corner: [u32; 2],
}

impl PagedMesh {
    /// Packs the images of the nodes.
    pub fn new(textured: &TexturedMesh, look: &Look) -> Self {
        let images: Vec<Vec<Option<Image<u8>>>> = textured
            .textures
            .iter()
            .map(|texture| look.layers.iter().map(|&layer| look.image(texture, layer)).collect())
            .collect();
        let sizes: Vec<Option<[u32; 2]>> =
            images.iter().map(|images| Some(images.iter().flatten().next()?.size)).collect();
        let (placed, page_sizes) = pack(&sizes);
        let mut pages: Vec<Page> = vec![vec![]; page_sizes.len()];
        for (number, &layer) in look.layers.iter().enumerate() {
            let of_layer = || images.iter().map(|images| images[number].as_ref());
            let components = of_layer().flatten().map(|image| image.components).max().unwrap_or(3);
            let [red, green, blue] = layer.blank();
            let blank = &[red, green, blue, 255][..usize::from(components)];
            for (page, &size) in pages.iter_mut().zip(&page_sizes) {
                page.push((layer, Image::filled(size, blank)));
            }
            for (image, placed) in of_layer().zip(&placed) {
                if let (Some(image), Some(placed)) = (image, placed) {
                    copy(image, &mut pages[placed.page][number].1, placed.corner);
                }
            }
        }
        let mut this = Self { triangles: vec![vec![]; pages.len() + 1], pages, ..Self::default() };
        let has_frames = look.layers.contains(&Layer::Normal);
        let mut numbers: HashMap<(u32, usize, [u32; 2]), u32> = HashMap::new();
        let mesh = &textured.mesh;
        for ((corners, places), &node) in mesh.triangles.iter().zip(&textured.places).zip(&mesh.triangle_nodes) {
            let placed = placed.get(node as usize).copied().flatten();
            let page = placed.map_or(this.pages.len(), |placed| placed.page);
            let map = textured.textures.get(node as usize).and_then(|texture| texture.map.as_ref());
            let vertices = [0, 1, 2].map(|k| {
                let place = placed.map_or([0.0; 2], |placed| {
                    let size = page_sizes[placed.page];
                    [0, 1].map(|axis| (places[k][axis] + placed.corner[axis] as f32) / size[axis] as f32)
                });
                *numbers.entry((corners[k], page, place.map(f32::to_bits))).or_insert_with(|| {
                    this.positions.push(mesh.positions[corners[k] as usize]);
                    this.places.push(place);
                    if has_frames {
                        let piece = map.and_then(|map| piece_at(map, places[k]));
                        let own = piece.map_or([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], frame);
                        this.frames.push(own.map(|direction| direction.map(|x| x as f32)));
                    }
                    this.positions.len() as u32 - 1
                })
            });
            this.triangles[page].push(vertices);
        }
        this
    }

    /// The image of a layer on a page.
    pub fn image(&self, page: usize, layer: Layer) -> Option<&Image<u8>> {
        self.pages.get(page)?.iter().find(|(known, _)| *known == layer).map(|(_, image)| image)
    }
}

/// The piece that has a place in an image.
fn piece_at(map: &Map, place: [f32; 2]) -> Option<&Piece> {
    map.pieces.iter().find(|piece| {
        let [low, high] = piece.range();
        (0..2).all(|k| low[k] - 0.5 <= f64::from(place[k]) && f64::from(place[k]) < high[k] + 0.5)
    })
}

/// Packs images into rows of pages, the highest first. Returns where each lies, and the sizes of the pages.
fn pack(images: &[Option<[u32; 2]>]) -> (Vec<Option<Placed>>, Vec<[u32; 2]>) {
    let size = |image: [u32; 2]| image.map(|length| length + 2 * GAP);
    let mut order: Vec<usize> = (0..images.len()).filter(|&number| images[number].is_some()).collect();
    order.sort_by_key(|&number| (std::cmp::Reverse(images[number].map(|[_, height]| height)), number));
    let area: u64 = images.iter().flatten().map(|&image| size(image).map(u64::from).iter().product::<u64>()).sum();
    // A square page for what fits into one.
    let square = (1..=PAGE_SIDE).find(|&side| u64::from(side) * u64::from(side) >= area + area / 16);
    let widest = images.iter().flatten().map(|&image| size(image)[0]).max().unwrap_or(0);
    let width = square.unwrap_or(PAGE_SIDE).max(widest);
    let (mut placed, mut sizes) = (vec![None; images.len()], vec![]);
    let (mut corner, mut row, mut used) = ([0, 0], 0, 0);
    for number in order {
        let Some([w, h]) = images[number].map(size) else { continue };
        if corner[0] + w > width {
            corner = [0, corner[1] + row];
            row = 0;
        }
        if corner[1] > 0 && corner[1] + h > PAGE_SIDE {
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
fn copy(image: &Image<u8>, page: &mut Image<u8>, corner: [u32; 2]) {
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
    use lodpack::Mesh;
    use lodpack::decode::{ChannelImage, Texture};
    use lodpack::index::{ChannelInfo, ChannelKind};

    #[test]
    fn images_lie_apart_and_corners_find_them() {
        let sizes = [[30, 7], [5, 90], [1, 1], [64, 64], [3, 3]];
        let image = |number: usize| Image::filled(sizes[number], &[number as u8 * 10 + 5, 0, 0]);
        let texture =
            |number| Texture { images: vec![Some(ChannelImage::Colours(image(number)))], ..Texture::default() };
        let textured = TexturedMesh {
            mesh: Mesh {
                positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
                triangles: vec![[0, 1, 2]; 6],
                triangle_nodes: (0..6).collect(),
            },
            places: vec![[[0.5, 0.5]; 3]; 6],
            textures: (0..5).map(texture).chain([Texture::default()]).collect(),
        };
        let colour = ChannelInfo {
            name: "colour".into(),
            kind: ChannelKind::Colour,
            components: 3,
            low: 0.0,
            step: 1.0,
            bound: 0.0,
        };
        let (look, wanted) = Look::of(&[colour], true);
        assert_eq!((look.layers.as_slice(), wanted.as_slice()), ([Layer::Colour].as_slice(), [0].as_slice()));
        let paged = PagedMesh::new(&textured, &look);
        assert_eq!((paged.pages.len(), paged.triangles[0].len(), paged.triangles[1].len()), (1, 5, 1));
        let page = paged.image(0, Layer::Colour).unwrap();
        for (number, triangle) in paged.triangles[0].iter().enumerate() {
            let [u, v] = paged.places[triangle[0] as usize];
            let colour = page.interpolated([f64::from(u * page.size[0] as f32), f64::from(v * page.size[1] as f32)]);
            assert!((colour[0] - (number as f64 * 10.0 + 5.0)).abs() < 0.01, "{number} {colour:?}");
        }
        assert!(page.size[0] * page.size[1] < 2 * (64 * 64 + 5 * 90 + 30 * 7 + 600), "{:?}", page.size);
    }
}
