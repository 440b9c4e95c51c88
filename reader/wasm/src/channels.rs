//! What the surface carries: which channels there are, their ranges, and meshes with pages of them.

use lodpack::index::{ChannelInfo, ChannelKind};
#[cfg(feature = "channels")]
use lodpack::{
    Error,
    decode::{self, Appearance, Look, PagedMesh, TexturedMesh, texels::Image},
    select,
};

use crate::{
    answer::{Answer, Put},
    state::State,
};
#[cfg(feature = "channels")]
use crate::{
    answer::{put_all, put_triangles, words, wrong},
    pack::{Beside, Painter},
};

impl State {
    /// Seven numbers (f64) for each channel, and their names, each followed by the end of a line: `js/channels.js`
    /// reads it.
    pub fn channels(&mut self) -> Answer {
        if let Ok(index) = self.heights_index() {
            let colour = "colour\n".bytes();
            if index.ramp().is_none() && index.drape().is_none() {
                return Ok(0);
            }
            self.output.put_floats([1.0, 3.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
            self.output.extend(colour);
            return Ok(1);
        }
        let Ok(index) = self.index().cloned() else { return Ok(0) };
        let image_bytes = index.texel_bytes().iter().skip(1);
        for (channel, &bytes) in index.channels().iter().zip(image_bytes) {
            let ChannelInfo { kind, is_exact, low, step, bound, .. } = channel;
            let kind = match kind {
                ChannelKind::Colour => 1,
                ChannelKind::Scalar => 2,
                ChannelKind::Normal => 3,
                ChannelKind::Label => 4,
                ChannelKind::Factor => 5,
                ChannelKind::Drawing => 6,
                _ => 0,
            };
            let (count, lossless) = (channel.value_count() as f64, f64::from(u8::from(*is_exact)));
            self.output.put_floats([kind.into(), count, *low, *step, *bound, bytes as f64, lossless]);
        }
        // Names have no control characters.
        let names = index.channels().iter().flat_map(|channel| [channel.name.as_bytes(), b"\n"]);
        names.for_each(|part| self.output.extend(part));
        Ok(index.channels().len() as u32)
    }

    /// Makes a stream show a channel, or none if there is none of this number; with normals if `beside` is odd, and
    /// with materials if it is 2 or 3. Of heights number 0 is the image or the
    /// ramp.
    pub fn show(&mut self, stream: u32, channel: u32, range: [f64; 2], beside: u32) -> Answer {
        let has_colours = self.heights_index().map(|index| index.ramp().is_some() || index.drape().is_some());
        let Ok(has_colours) = has_colours else { return self.show_of_mesh(stream, channel, range, beside) };
        self.stream(stream)?.0.show_colours(has_colours && channel == 0);
        Ok(0)
    }
}

#[cfg(feature = "channels")]
impl State {
    /// How a channel is shown.
    fn appearance(&self, channel: u32) -> Result<(u8, Appearance), Error> {
        let info = self.index()?.channels().get(channel as usize);
        let info = info.ok_or_else(|| wrong(&format!("there is no channel {channel}")))?;
        Ok((channel as u8, Appearance::new(info)))
    }

    /// The smallest and the largest value of a channel at the coarsest level. Returns whether it has a ramp.
    pub fn channel_range(&mut self, question: u32, channel: u32) -> Answer {
        let (number, mut appearance) = self.appearance(channel)?;
        if appearance.look() != Look::Ramp {
            return Ok(0);
        }
        let index = self.index()?.clone();
        let cut = select::uniform_cut(&index, 0)?;
        let shown = decode::extract_textured(&index, &cut, &[number], self.questions.get(question)?)?;
        appearance.fit(shown.textures.iter().flat_map(|texture| texture.images.iter().flatten()));
        self.output.put_floats(appearance.values().into_iter().flatten());
        Ok(1)
    }

    fn show_of_mesh(&mut self, stream: u32, channel: u32, range: [f64; 2], beside: u32) -> Answer {
        let Ok((number, mut appearance)) = self.appearance(channel) else {
            self.stream(stream)?.0.show(None)?;
            return Ok(0);
        };
        appearance.set_values(range);
        let (numbers, beside) = channels_beside(self.index()?.channels(), number, beside);
        self.stream(stream)?.0.show(Some((numbers, Painter::new(appearance, beside))))?;
        Ok(0)
    }

    /// The mesh of the cut in the input with pages of some channels, whose numbers stand before it.
    pub fn extract_textured(&mut self, question: u32, channel_count: u32, page_side: u32) -> Answer {
        let length = 4 * channel_count as usize;
        let numbers = words(self.input.get(..length).ok_or_else(|| wrong("channels have numbers"))?);
        let channels: Vec<u8> = numbers.map(|number| u8::try_from(number).unwrap_or(u8::MAX)).collect();
        let cut = self.cut(length)?;
        let index = self.index()?.clone();
        let textured = decode::extract_textured(&index, &cut, &channels, self.questions.get(question)?)?;
        let mesh = PagedMesh::new(&textured, page_side);
        put_paged(&mut self.output, &mesh);
        for (number, &channel) in channels.iter().enumerate() {
            let is_of_bytes = index.channels().get(usize::from(channel)).is_some_and(ChannelInfo::is_of_bytes);
            put_pages(&mut self.output, (&mesh, &textured), number, is_of_bytes);
        }
        Ok(mesh.page_sizes.len() as u32)
    }
}

/// The channels of a stream that shows one of them, and which of them come with it.
#[cfg(feature = "channels")]
fn channels_beside(channels: &[ChannelInfo], shown: u8, beside: u32) -> (Vec<u8>, Beside) {
    let mut numbers = vec![shown];
    let mut place = |is_wanted: bool, is_it: &dyn Fn(&ChannelInfo) -> bool| {
        let number = channels.iter().position(is_it).filter(|_| is_wanted)? as u8;
        let known = numbers.iter().position(|&known| known == number);
        Some(known.unwrap_or_else(|| {
            numbers.push(number);
            numbers.len() - 1
        }))
    };
    let normals = place(beside & 1 != 0, &|channel| channel.kind == ChannelKind::Normal);
    let has_material = beside & 2 != 0;
    let mut factor =
        |name: &str| place(has_material, &|channel| channel.kind == ChannelKind::Factor && channel.name == name);
    let material = [factor("occlusion"), factor("roughness"), factor("metallic")];
    let emissive = place(has_material, &|channel| channel.kind == ChannelKind::Colour && channel.name == "emissive");
    let material = material.iter().any(Option::is_some).then_some(material);
    // Colours are nothing without what their opacity means.
    let has_colour = channels.get(usize::from(shown)).is_some_and(|channel| channel.kind == ChannelKind::Colour);
    let drawing = place(has_colour, &|channel| channel.kind == ChannelKind::Drawing);
    (numbers, Beside { normals, material, emissive, drawing })
}

/// What a module without channels answers.
#[cfg(not(feature = "channels"))]
impl State {
    fn without() -> Answer {
        let what = "this module shows no channels; load lodpack.wasm instead of lodpack-geometry.wasm".into();
        Err(lodpack::Error::Unsupported { what })
    }

    pub fn channel_range(&mut self, _question: u32, _channel: u32) -> Answer {
        Self::without()
    }

    fn show_of_mesh(&mut self, stream: u32, channel: u32, _range: [f64; 2], _beside: u32) -> Answer {
        if self.index()?.channels().get(channel as usize).is_some() {
            return Self::without();
        }
        self.stream(stream)?.0.show(None)?;
        Ok(0)
    }

    pub fn extract_textured(&mut self, _question: u32, _channel_count: u32, _page_side: u32) -> Answer {
        Self::without()
    }
}

/// Packs a mesh: its numbers of vertices and triangles (f64), positions (f64), places (f32), triangles, the node of
/// each, for each page and for those without one the number of its triangles, and the sizes of pages.
#[cfg(feature = "channels")]
fn put_paged(output: &mut Vec<u8>, mesh: &PagedMesh) {
    let triangle_count: usize = mesh.triangles.iter().map(Vec::len).sum();
    output.put_floats([mesh.positions.len() as f64, triangle_count as f64]);
    put_all(output, &mesh.positions, |place: &mut [u8; 24], position| {
        place.as_chunks_mut::<8>().0.iter_mut().zip(position).for_each(|(place, x)| *place = x.to_le_bytes());
    });
    put_all(output, &mesh.places, |place: &mut [u8; 8], at| {
        place.as_chunks_mut::<4>().0.iter_mut().zip(at).for_each(|(place, x)| *place = x.to_le_bytes());
    });
    mesh.triangles.iter().for_each(|triangles| put_triangles(output, triangles));
    output.put_words(mesh.triangle_nodes.iter().flatten().copied());
    output.put_words(mesh.triangles.iter().map(|triangles| triangles.len() as u32));
    output.put_words(mesh.page_sizes.iter().flatten().copied());
}

/// Packs the pages of a channel: their components (u32), and the values of each, padded to four bytes: red, green, blue
/// and opacity of colours, in which normals and factors are shown, too, or else numbers (u16).
#[cfg(feature = "channels")]
fn put_pages(output: &mut Vec<u8>, (mesh, textured): (&PagedMesh, &TexturedMesh), channel: usize, is_of_bytes: bool) {
    if is_of_bytes {
        output.put_words([4]);
        for page in mesh.colours(textured, channel) {
            put_colours(output, &page);
        }
        return;
    }
    let pages = mesh.values(textured, channel);
    output.put_words([pages.first().map_or(1, |page| page.components.into())]);
    for page in pages {
        put_all(output, &page.data, |place: &mut [u8; 2], number| *place = number.to_le_bytes());
        output.resize(output.len().next_multiple_of(4), 0);
    }
}

#[cfg(feature = "channels")]
fn put_colours(output: &mut Vec<u8>, page: &Image<u8>) {
    match page.data.as_chunks::<3>() {
        (colours, []) if page.components == 3 => {
            put_all(output, colours, |place: &mut [u8; 4], &[red, green, blue]| *place = [red, green, blue, 255]);
        }
        _ if page.components == 1 => {
            put_all(output, &page.data, |place: &mut [u8; 4], &value| *place = [value, value, value, 255]);
        }
        _ => output.extend(&page.data),
    }
}
