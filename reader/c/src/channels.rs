//! What the surface carries besides positions, and its values at the vertices of a mesh.
#![expect(unsafe_code, reason = "the names are C's")]

use std::ffi::{CString, c_char};

use lodpack::{
    Opened, ReadAt,
    decode::{Appearance, ChannelImage, TexturedMesh},
    index::{ChannelInfo, ChannelKind},
};

use crate::{
    file::File,
    mesh::Mesh,
    pointer::{borrow, copy_rows, copy_some, write},
    status::{Failure, Status, guard},
};

/// What the values of a channel mean.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub enum Meaning {
    /// This version of lodpack does not know.
    Unknown = 0,
    /// Colours as screens show them (sRGB): three components, or four with opacity.
    Colour = 1,
    /// Measured numbers.
    Scalar = 2,
    /// Directions of length 1.
    Normal = 3,
    /// Numbers of classes, between which nothing lies.
    Label = 4,
    /// Numbers from 0 to 1, such as the roughness of a material.
    Factor = 5,
    /// How the surface is drawn: double-sided, unlit and alpha modes, as bits (SPEC.md, 21.6).
    Drawing = 6,
}

/// What the surface carries besides positions. A value is `low + number * step` of a stored number.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Channel {
    /// In UTF-8; valid until the file is closed.
    pub name: *const c_char,
    /// A lodpack_meaning.
    pub meaning: i32,
    /// Numbers of a value, 1 to 4.
    pub component_count: u32,
    /// Bytes of each of these numbers in pages: 1 (uint8_t), or 2 (uint16_t).
    pub number_bytes: u32,
    /// The value that the number 0 stands for.
    pub low: f64,
    /// What a number adds for each 1.
    pub step: f64,
    /// Stated bound on the error of a value; 0 where none is stated.
    pub bound: f64,
    /// 1 if colours, normals or factors are stored without loss; 0 if not, and for other meanings.
    pub is_lossless: i32,
}

/// Texts of a file as C reads them.
pub struct Names {
    channels: Vec<CString>,
    pub crs: CString,
}

impl Names {
    pub fn new(opened: &Opened<impl ReadAt>) -> Self {
        // Neither has zeros in it: what had would be empty.
        let text = |text: &str| CString::new(text).unwrap_or_default();
        let (channels, placement) = match opened {
            Opened::Mesh(file) => {
                (file.channels().iter().map(|channel| text(&channel.name)).collect(), file.placement())
            }
            Opened::Heights(file) => (vec![c"height".to_owned()], file.placement()),
        };
        Self { channels, crs: text(placement.map_or("", |placement| &placement.crs)) }
    }
}

/// Writes what the file says about a channel. Reads nothing. A file of heights has one: its heights.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_get_channel(file: *const File, number: u32, channel: *mut Channel) -> Status {
    guard(|| {
        let file = borrow(file, "file")?;
        let heights;
        let infos = match file.opened() {
            Opened::Mesh(file) => file.channels(),
            Opened::Heights(file) => {
                heights = [channel_of_heights(file.info())];
                &heights[..]
            }
        };
        let (Some(info), Some(name)) = (infos.get(number as usize), file.names.channels.get(number as usize)) else {
            return Err(Failure::argument(format!("there is no channel {number}; the file has {}", infos.len())));
        };
        let meaning = match info.kind {
            ChannelKind::Colour => Meaning::Colour,
            ChannelKind::Scalar => Meaning::Scalar,
            ChannelKind::Normal => Meaning::Normal,
            ChannelKind::Label => Meaning::Label,
            ChannelKind::Factor => Meaning::Factor,
            ChannelKind::Drawing => Meaning::Drawing,
            _ => Meaning::Unknown,
        };
        let value = Channel {
            name: name.as_ptr(),
            meaning: meaning as i32,
            component_count: info.value_count() as u32,
            number_bytes: if info.is_of_bytes() { 1 } else { 2 },
            low: info.low,
            step: info.step,
            bound: info.bound,
            is_lossless: info.is_exact.into(),
        };
        write(channel, value, "channel")
    })
}

fn channel_of_heights(info: &lodpack::heights::HeightsInfo) -> ChannelInfo {
    ChannelInfo {
        name: "height".into(),
        kind: ChannelKind::Scalar,
        is_exact: false,
        is_scaled: false,
        components: 1,
        low: info.zero,
        step: info.step,
        bound: info.sample_error,
    }
}

/// A mesh with images of some channels.
pub struct Textured {
    pub mesh: TexturedMesh,
    /// The channels that were asked for.
    pub channels: Vec<ChannelInfo>,
}

/// The numbers of a channel at a vertex, as images have them; none where nothing is known.
type Numbers = Option<[f64; 4]>;

impl Textured {
    pub fn channel(&self, number: u32) -> Result<&ChannelInfo, Failure> {
        let count = self.channels.len();
        let wrong = || Failure::argument(format!("there is no channel {number}: the mesh was decoded with {count}"));
        self.channels.get(number as usize).ok_or_else(wrong)
    }

    /// The number of a channel of normals.
    fn normals(&self) -> Option<u32> {
        self.channels.iter().zip(0..).find(|(channel, _)| channel.kind == ChannelKind::Normal).map(|(_, number)| number)
    }

    /// How a channel becomes colours: a ramp goes from the smallest to the largest number of this mesh.
    pub fn appearance(&self, number: u32) -> Result<Appearance, Failure> {
        let mut appearance = Appearance::new(self.channel(number)?);
        let images = self.mesh.textures.iter().filter_map(|texture| texture.images.get(number as usize)?.as_ref());
        appearance.fit(images.collect::<Vec<&ChannelImage>>());
        Ok(appearance)
    }
}

impl Mesh {
    /// The numbers of a channel at each vertex.
    fn numbers(&self, number: u32) -> Result<Vec<Numbers>, Failure> {
        let textured = self.textured()?;
        let values = textured.mesh.vertex_values(number as usize, textured.channel(number)?.kind);
        Ok(match self.source_vertices() {
            None => values,
            Some(sources) => sources.map(|vertex| values.get(vertex).copied().flatten()).collect(),
        })
    }
}

/// Copies the colour of each vertex to `rgba`, which has room for `capacity` vertices, `stride_bytes` from one to the
/// next (0 for no gaps): red, green, blue and opacity as screens show them (sRGB). White where nothing is known.
/// `channel` counts those that the mesh was decoded with. Measured numbers get colours of a ramp from dark blue to
/// yellow, classes one each. Of heights channel 0 has the colours of the file's ramp.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_copy_colours(
    mesh: *const Mesh,
    channel: u32,
    rgba: *mut u8,
    capacity: usize,
    stride_bytes: usize,
) -> Status {
    guard(|| {
        let mesh = borrow(mesh, "mesh")?;
        if let Mesh::Heights(lit) = mesh {
            let without = || Failure::argument("the file of these heights has no ramp of colours".into());
            let colours = lit.of_channel(channel)?.colours.as_ref().ok_or_else(without)?;
            let colours = colours.iter().map(|&[red, green, blue]| [red, green, blue, 255]);
            return copy_rows(colours, rgba, capacity, stride_bytes);
        }
        let textured = mesh.textured()?;
        let (info, appearance) = (textured.channel(channel)?, textured.appearance(channel)?);
        let has_opacity = info.kind == ChannelKind::Colour;
        let colours = mesh.numbers(channel)?.into_iter().map(|numbers| {
            let Some(numbers) = numbers else { return [255; 4] };
            let [red, green, blue, _] = appearance.colour(numbers.get(..info.value_count()).unwrap_or(&numbers));
            let opacity = if has_opacity && !numbers[3].is_nan() { (numbers[3] + 0.5) as u8 } else { 255 };
            [red, green, blue, opacity]
        });
        copy_rows(colours, rgba, capacity, stride_bytes)
    })
}

/// Copies the values of each vertex to `values`, `component_count` of the channel each: numbers in units of the
/// channel. NaN where nothing is known. `channel` counts those that the mesh was decoded with. Of heights channel 0 has
/// the heights.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_copy_values(
    mesh: *const Mesh,
    channel: u32,
    values: *mut f64,
    capacity: usize,
    stride_bytes: usize,
) -> Status {
    guard(|| {
        let mesh = borrow(mesh, "mesh")?;
        if let Mesh::Heights(lit) = mesh {
            let heights = lit.of_channel(channel)?.heights.iter().map(|&height| [height]);
            return copy_rows(heights, values, capacity, stride_bytes);
        }
        let info = mesh.textured()?.channel(channel)?;
        let (&ChannelInfo { low, step, .. }, count) = (info, info.value_count());
        let rows = mesh.numbers(channel)?.into_iter();
        let rows = rows.map(|numbers| numbers.unwrap_or([f64::NAN; 4]).map(|number| low + step * number));
        copy_some(rows, count, values, capacity, stride_bytes)
    })
}

/// Copies the normal of each vertex to `normals`: of heights, or of a mesh that was decoded with a channel of normals.
/// Length 1, or 0 where nothing is known.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_copy_normals(
    mesh: *const Mesh,
    normals: *mut f32,
    capacity: usize,
    stride_bytes: usize,
) -> Status {
    guard(|| {
        let mesh = borrow(mesh, "mesh")?;
        if let Mesh::Heights(lit) = mesh {
            return copy_rows(lit.normals.iter().copied(), normals, capacity, stride_bytes);
        }
        let without = || Failure::argument("the mesh has no channel of normals; decode it with one".into());
        let channel = mesh.textured()?.normals().ok_or_else(without)?;
        let rows = mesh.numbers(channel)?.into_iter().map(|numbers| {
            let [x, y, z, _] = numbers.unwrap_or([128.0; 4]).map(|number| number - 128.0);
            let length = (x * x + y * y + z * z).sqrt();
            if length > 0.0 { [x, y, z].map(|x| (x / length) as f32) } else { [0.0; 3] }
        });
        copy_rows(rows, normals, capacity, stride_bytes)
    })
}
