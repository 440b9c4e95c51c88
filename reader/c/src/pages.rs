//! Meshes of which each vertex has a place in an image: for programs that draw with textures.
#![expect(unsafe_code, reason = "the names are C's")]

use std::{borrow::Cow, sync::Arc};

use lodpack::{
    decode::{Appearance, ChannelImage, PagedMesh, texels::Image},
    index::{ChannelInfo, ChannelKind},
    stream::DrawnTexture,
};

use crate::{
    channels::Textured,
    mesh::Mesh,
    pointer::{borrow, copy_rows, copy_some, give, write},
    status::{Failure, Status, guard},
};

/// A mesh whose images are packed into pages.
pub struct Paged {
    pub positions: Vec<[f64; 3]>,
    /// Those of the first page, of the next one, ..., and at last those without texels.
    pub triangles: Vec<[u32; 3]>,
    /// For each vertex the one that it is in the mesh without pages, if there is one.
    pub sources: Vec<u32>,
    pub places: Vec<[f32; 2]>,
    pub pages: Vec<Page>,
    pub images: Images,
}

/// Where pages come from.
pub enum Images {
    /// Several images are packed into each.
    Packed(Arc<Textured>, PagedMesh),
    /// A root in a frame has an image of its own for each of these channels.
    Drawn(Arc<DrawnTexture>, Arc<[(ChannelInfo, Appearance)]>),
}

/// A page: an image over a part of a mesh's triangles.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Page {
    /// Texels in a row.
    pub width: u32,
    /// Rows, the first one at the top.
    pub height: u32,
    /// The number of the first triangle that lies in it; the others follow.
    pub first_triangle: usize,
    /// How many these are.
    pub triangle_count: usize,
}

impl Paged {
    fn new(textured: &Arc<Textured>, side: u32) -> Self {
        let mut mesh = PagedMesh::new(&textured.mesh, side);
        let mut first_triangle = 0;
        let page = |(&[width, height], triangles): (&[u32; 2], &Vec<[u32; 3]>)| {
            let page = Page { width, height, first_triangle, triangle_count: triangles.len() };
            first_triangle += triangles.len();
            page
        };
        let pages = mesh.page_sizes.iter().zip(&mesh.triangles).map(page).collect();
        let of_mesh = &textured.mesh.mesh.triangles;
        let source = |&(triangle, corner): &(u32, u8)| of_mesh[triangle as usize][usize::from(corner)];
        Self {
            pages,
            triangles: std::mem::take(&mut mesh.triangles).concat(),
            sources: mesh.corners.iter().map(source).collect(),
            positions: std::mem::take(&mut mesh.positions),
            places: std::mem::take(&mut mesh.places),
            images: Images::Packed(Arc::clone(textured), mesh),
        }
    }

    /// What it was packed from.
    pub fn textured(&self) -> Option<&Textured> {
        match &self.images {
            Images::Packed(textured, _) => Some(textured),
            Images::Drawn(..) => None,
        }
    }

    /// A channel, and its colours.
    fn channel(&self, number: u32) -> Result<(&ChannelInfo, Appearance), Failure> {
        match &self.images {
            Images::Packed(textured, _) => Ok((textured.channel(number)?, textured.appearance(number)?)),
            Images::Drawn(_, channels) => {
                let missing =
                    || Failure::argument(format!("there is no channel {number}: the stream shows {}", channels.len()));
                channels.get(number as usize).map(|(info, appearance)| (info, *appearance)).ok_or_else(missing)
            }
        }
    }

    fn page(&self, number: usize) -> Result<Page, Failure> {
        let missing = || Failure::argument(format!("there is no page {number}; the mesh has {}", self.pages.len()));
        self.pages.get(number).copied().ok_or_else(missing)
    }

    /// The page of a channel of colours, normals or factors.
    fn bytes(&self, channel: u32, page: usize) -> Cow<'_, Image<u8>> {
        match &self.images {
            Images::Packed(textured, mesh) => {
                let pages = mesh.colours(&textured.mesh, channel as usize);
                Cow::Owned(pages.into_iter().nth(page).unwrap_or_default())
            }
            Images::Drawn(drawn, _) => match drawn.texture.images.get(channel as usize) {
                Some(Some(
                    ChannelImage::Colours(image) | ChannelImage::Normals(image) | ChannelImage::Factors(image),
                )) => Cow::Borrowed(image),
                _ => Cow::Owned(self.empty()),
            },
        }
    }

    /// The page of another channel.
    fn words(&self, channel: u32, page: usize) -> Cow<'_, Image<u16>> {
        match &self.images {
            Images::Packed(textured, mesh) => {
                let pages = mesh.values(&textured.mesh, channel as usize);
                Cow::Owned(pages.into_iter().nth(page).unwrap_or_default())
            }
            Images::Drawn(drawn, _) => match drawn.texture.images.get(channel as usize) {
                Some(Some(ChannelImage::Values(image))) => Cow::Borrowed(image),
                _ => Cow::Owned(self.empty()),
            },
        }
    }

    /// What a root shows of a channel that it does not have.
    fn empty<T: Copy + Default>(&self) -> Image<T> {
        let size = self.pages.first().map_or([0; 2], |page| [page.width, page.height]);
        Image::filled(size, &[T::default()])
    }
}

fn paged<'a>(mesh: *const Mesh) -> Result<&'a Paged, Failure> {
    match borrow(mesh, "mesh")? {
        Mesh::Paged(paged) => Ok(paged),
        _ => Err(Failure::argument("the mesh has no pages: make them with lodpack_make_pages()".into())),
    }
}

/// Makes another mesh, whose vertices have a place in a page of images each: those on borders between images are there
/// several times. Pages have at most `most_texels` texels along each side (such as 4096), unless one image is larger.
/// All channels share these places.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_make_pages(mesh: *const Mesh, most_texels: u32, pages: *mut *mut Mesh) -> Status {
    guard(|| {
        write(pages, std::ptr::null_mut(), "pages")?;
        match borrow(mesh, "mesh")? {
            Mesh::Textured(textured) => give(pages, Mesh::Paged(Box::new(Paged::new(textured, most_texels)))),
            Mesh::Paged(_) => Err(Failure::argument("the mesh has pages already".into())),
            mesh => mesh.textured().map(drop),
        }
    })
}

/// Number of pages; 0 for a mesh without.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_page_count(mesh: *const Mesh) -> usize {
    paged(mesh).map_or(0, |paged| paged.pages.len())
}

/// Writes how large a page is, and which triangles lie in it. Triangles after those of the last page have no texels.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_get_page(mesh: *const Mesh, number: usize, page: *mut Page) -> Status {
    guard(|| write(page, paged(mesh)?.page(number)?, "page"))
}

/// Copies the place of each vertex in its page to `places`, which has room for `capacity` vertices, `stride_bytes` from
/// one to the next (0 for no gaps): texture coordinates from 0 to 1, where the first row of texels is at 0.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_copy_places(
    mesh: *const Mesh,
    places: *mut f32,
    capacity: usize,
    stride_bytes: usize,
) -> Status {
    guard(|| copy_rows(paged(mesh)?.places.iter().copied(), places, capacity, stride_bytes))
}

/// Copies a page of a channel to `rgba`, which has room for `capacity` texels of four bytes: row by row from the top,
/// in the colours of lodpack_copy_colours(). `channel` counts those that the mesh was decoded with.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_copy_page_colours(
    mesh: *const Mesh,
    channel: u32,
    number: usize,
    rgba: *mut u8,
    capacity: usize,
) -> Status {
    guard(|| {
        let paged = paged(mesh)?;
        paged.page(number)?;
        let (info, appearance) = paged.channel(channel)?;
        let count = info.value_count();
        let colour = |numbers: [f64; 4]| appearance.colour(numbers.get(..count).unwrap_or(&numbers));
        match info.is_of_bytes() {
            true => {
                let (image, has_opacity) =
                    (paged.bytes(channel, number), info.kind == ChannelKind::Colour && count == 4);
                let texels = texels(&image, count).map(|numbers| {
                    let [red, green, blue, _] = colour(numbers.map(f64::from));
                    [red, green, blue, if has_opacity { numbers[3] } else { 255 }]
                });
                copy_rows(texels, rgba, capacity, 0)
            }
            false => {
                let image = paged.words(channel, number);
                copy_rows(texels(&image, count).map(|numbers| colour(numbers.map(f64::from))), rgba, capacity, 0)
            }
        }
    })
}

/// Copies a page of a channel to `numbers`, which has room for `capacity_bytes`: row by row from the top,
/// `component_count` numbers a texel, of `number_bytes` each (see lodpack_channel). `channel` counts those that the
/// mesh was decoded with. 0 where nothing is known.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_copy_page_numbers(
    mesh: *const Mesh,
    channel: u32,
    number: usize,
    numbers: *mut std::ffi::c_void,
    capacity_bytes: usize,
) -> Status {
    guard(|| {
        let paged = paged(mesh)?;
        paged.page(number)?;
        let (info, _) = paged.channel(channel)?;
        let count = info.value_count().clamp(1, 4);
        match info.is_of_bytes() {
            true => {
                let image = paged.bytes(channel, number);
                copy_some(texels(&image, count), count, numbers.cast::<u8>(), capacity_bytes / count, 0)
            }
            false => {
                let image = paged.words(channel, number);
                let capacity = capacity_bytes / (count * size_of::<u16>());
                copy_some(texels(&image, count), count, numbers.cast::<u16>(), capacity, 0)
            }
        }
    })
}

/// The texels of an image, each with up to `count` numbers.
fn texels<T: Copy + Default>(image: &Image<T>, count: usize) -> impl ExactSizeIterator<Item = [T; 4]> {
    image.data.chunks_exact(usize::from(image.components.max(1))).map(move |texel| {
        let mut numbers = [T::default(); 4];
        numbers.iter_mut().take(count).zip(texel).for_each(|(to, &number)| *to = number);
        numbers
    })
}
