//! A mesh with the pages of its look.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::io;

use lodpack::decode::texels::{Image, Map, Piece};
use lodpack::decode::{self, AlphaMode, Drawing, TexturedMesh};

use super::NONE;
use super::layers::{Layer, Look, frame};
use super::smooth::{Creases, Fans};

/// A mesh of which each vertex has one place in one page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PagedMesh {
    /// World positions. Where triangles do not agree about the place of a vertex, it is there several times.
    pub positions: Vec<[f64; 3]>,
    /// The place of each vertex, of the page's width and height; the first row of texels is at 0.
    pub places: Vec<[f32; 2]>,
    /// Triangles by page; after those of all pages those without texels.
    pub triangles: Vec<Vec<[u32; 3]>>,
    /// How each of these triangles is drawn; empty if the file does not say.
    pub drawings: Vec<Vec<Drawing>>,
    /// For each vertex a triangle of the textured mesh and one of its corners, 0 to 2, that lie at its place.
    pub corners: Vec<(u32, u8)>,
    /// Tangent and normal of each vertex, in which the layer of normals is; empty without it.
    pub frames: Vec<[[f32; 3]; 2]>,
    /// The normal of each vertex, where there is no layer of normals and [`PagedMesh::smooth`] has found them.
    pub normals: Vec<[f32; 3]>,
    /// The images of each page, all of one size: one for each layer of the look.
    pub pages: Vec<Page>,
}

/// Triangles that one material draws.
#[derive(Clone, Debug, PartialEq)]
pub struct Part<'a> {
    /// The number of their page; that behind the last one for triangles without texels.
    pub page: usize,
    /// How they are drawn; none if the file does not say.
    pub drawing: Option<Drawing>,
    /// The triangles.
    pub triangles: Cow<'a, [[u32; 3]]>,
}

/// The colours of an image, without what tells how opaque they are.
fn without_alpha(image: Image<u8>) -> Image<u8> {
    let data = image.data.chunks_exact(4).flat_map(|texel| [texel[0], texel[1], texel[2]]).collect();
    Image { components: 3, data, ..image }
}

/// The images of a page.
pub type Page = Vec<(Layer, Image<u8>)>;

impl PagedMesh {
    /// Packs what the images of nodes show into pages of at most `side` texels along each side: see
    /// [`decode::PagedMesh::new`].
    pub fn new(textured: &TexturedMesh, look: &Look, side: u32) -> Self {
        let paged = decode::PagedMesh::new(textured, side);
        let mut pages: Vec<Page> = vec![vec![]; paged.page_sizes.len()];
        let drawings = look.drawings(textured);
        let of_page = |numbers: &Vec<u32>| numbers.iter().map(|&number| drawings[number as usize]).collect();
        let drawings: Vec<Vec<Drawing>> = match drawings.is_empty() {
            true => vec![],
            false => paged.triangle_numbers.iter().map(of_page).collect(),
        };
        for &layer in &look.layers {
            let images: Vec<Option<Image<u8>>> =
                textured.textures.iter().map(|texture| look.image(texture, layer)).collect();
            let images: Vec<Option<&Image<u8>>> = images.iter().map(Option::as_ref).collect();
            let [red, green, blue] = layer.blank();
            let filled = paged.filled(&images, 3, &[red, green, blue, 255]);
            for (number, (page, image)) in pages.iter_mut().zip(filled).enumerate() {
                let is_opaque =
                    drawings.get(number).is_some_and(|all| all.iter().all(|one| one.alpha == AlphaMode::Opaque));
                let shows_all = || image.data.iter().skip(3).step_by(4).all(|&alpha| alpha == u8::MAX);
                let is_plain = image.components == 4 && (is_opaque || shows_all());
                page.push((layer, if is_plain { without_alpha(image) } else { image }));
            }
        }
        let frame_of = |&(triangle, corner): &(u32, u8)| {
            let node = textured.mesh.triangle_nodes[triangle as usize];
            let map = textured.textures.get(node as usize).and_then(|texture| texture.map.as_ref());
            let place = textured.places[triangle as usize][usize::from(corner)];
            let own = map.and_then(|map| piece_at(map, place)).map_or([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], frame);
            own.map(|direction| direction.map(|x| x as f32))
        };
        let has_frames = look.layers.contains(&Layer::Normal);
        let frames = if has_frames { paged.corners.iter().map(frame_of).collect() } else { vec![] };
        let decode::PagedMesh { positions, places, triangles, corners, .. } = paged;
        Self { positions, places, triangles, drawings, corners, frames, pages, ..Self::default() }
    }

    /// A mesh without pages and without normals.
    pub fn without_normals(mesh: lodpack::Mesh) -> Self {
        Self { positions: mesh.positions, triangles: vec![mesh.triangles], ..Self::default() }
    }

    /// A mesh without pages, with normals.
    ///
    /// # Errors
    /// As [`Fans::new`].
    pub fn bare(mesh: &lodpack::Mesh) -> io::Result<Self> {
        let Fans { vertices, normals, triangles } = Fans::new(&mesh.positions, &mesh.triangles, Creases::Kept)?;
        let positions = vertices.iter().map(|&vertex| mesh.positions[vertex as usize]).collect();
        Ok(Self { positions, triangles: vec![triangles], normals, ..Self::default() })
    }

    /// Gives each vertex a normal, unless a layer has them or all is drawn without light. Vertices on creases are there
    /// once more for each further normal. `mesh` is that of which this one has been made, whose vertices are those
    /// around which triangles meet.
    ///
    /// # Errors
    /// As [`Fans::new`].
    pub fn smooth(mut self, mesh: &lodpack::Mesh) -> io::Result<Self> {
        if !self.frames.is_empty() || self.is_unlit() {
            return Ok(self);
        }
        let at = |vertex: u32| {
            let (triangle, corner) = self.corners[vertex as usize];
            mesh.triangles[triangle as usize][usize::from(corner)]
        };
        let triangles: Vec<[u32; 3]> = self.triangles.iter().flatten().map(|corners| corners.map(at)).collect();
        let fans = Fans::new(&mesh.positions, &triangles, Creases::Kept)?;
        let mut fan_of = vec![NONE; self.positions.len()];
        let mut more: HashMap<(u32, u32), u32> = HashMap::new();
        for (corners, of_corners) in self.triangles.iter_mut().flatten().zip(&fans.triangles) {
            for (corner, &fan) in corners.iter_mut().zip(of_corners) {
                let vertex = *corner as usize;
                if fan_of[vertex] == NONE {
                    fan_of[vertex] = fan;
                } else if fan_of[vertex] != fan {
                    *corner = *more.entry((*corner, fan)).or_insert_with(|| {
                        self.positions.push(self.positions[vertex]);
                        self.places.push(self.places[vertex]);
                        self.corners.push(self.corners[vertex]);
                        fan_of.push(fan);
                        fan_of.len() as u32 - 1
                    });
                }
            }
        }
        self.normals = fan_of.iter().map(|&fan| fans.normals[fan as usize]).collect();
        Ok(self)
    }

    /// Whether nothing has light.
    fn is_unlit(&self) -> bool {
        let of_page = |page: usize| self.drawings.get(page).filter(|_| page < self.pages.len());
        let pages = self.triangles.iter().enumerate().filter(|(_, triangles)| !triangles.is_empty());
        pages.map(|(page, _)| of_page(page)).all(|all| all.is_some_and(|all| all.iter().all(|one| one.is_unlit)))
    }

    /// The triangles page by page, and those of a page by how they are drawn: the page, the drawing if the file says
    /// one, and the triangles. After those of all pages come those without texels.
    pub fn parts(&self) -> Vec<Part<'_>> {
        let mut parts = vec![];
        for (page, triangles) in self.triangles.iter().enumerate() {
            let Some(drawings) = self.drawings.get(page).filter(|_| page < self.pages.len()) else {
                parts.push(Part { page, drawing: None, triangles: triangles.into() });
                continue;
            };
            let mut of_drawings: BTreeMap<u16, Vec<[u32; 3]>> = BTreeMap::new();
            for (&triangle, drawing) in triangles.iter().zip(drawings) {
                of_drawings.entry(drawing.number()).or_default().push(triangle);
            }
            let part = |(number, triangles): (u16, Vec<[u32; 3]>)| Part {
                page,
                drawing: Some(Drawing::of_number(number)),
                triangles: triangles.into(),
            };
            parts.extend(of_drawings.into_iter().map(part));
        }
        parts.retain(|part| !part.triangles.is_empty());
        parts
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
