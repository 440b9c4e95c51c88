//! TIFF by hand: directories of any entries, and the pieces of their images.

/// The values of an entry.
#[derive(Clone, Debug)]
pub enum Values {
    /// Numbers of 16 bits.
    Short(Vec<u16>),
    /// Numbers of 32 bits.
    Long(Vec<u32>),
    /// Floats of 64 bits.
    Double(Vec<f64>),
    /// Text.
    Text(String),
    /// Bytes of any meaning.
    Bytes(Vec<u8>),
}

/// An image: its entries but for those that say where its pieces are, and the pieces.
#[derive(Clone, Debug, Default)]
pub struct Image {
    /// Tags and values.
    pub tags: Vec<(u16, Values)>,
    /// Strips or, where there is an entry of a tile's width, tiles.
    pub pieces: Vec<Vec<u8>>,
}

impl Image {
    /// Shades of grey of a size in one strip.
    pub fn grey([columns, rows]: [u32; 2], bits: u16, format: u16, piece: Vec<u8>) -> Self {
        let tags = vec![
            (256, Values::Long(vec![columns])),
            (257, Values::Long(vec![rows])),
            (258, Values::Short(vec![bits])),
            (259, Values::Short(vec![1])),
            (262, Values::Short(vec![1])),
            (277, Values::Short(vec![1])),
            (278, Values::Long(vec![rows])),
            (339, Values::Short(vec![format])),
        ];
        Self { tags, pieces: vec![piece] }
    }

    /// With an entry in place of another one of its tag.
    pub fn with(mut self, tag: u16, values: Values) -> Self {
        self.tags.retain(|(other, _)| *other != tag);
        self.tags.push((tag, values));
        self
    }

    /// A mask of a size, one bit a sample, for another image.
    pub fn mask(size: [u32; 2], piece: Vec<u8>) -> Self {
        Self::grey(size, 1, 1, piece).with(254, Values::Long(vec![4])).with(262, Values::Short(vec![4]))
    }

    /// Placed: the corner in the north-west, and the distance of samples.
    pub fn at(self, [x, y, dx, dy]: [f64; 4]) -> Self {
        let place = Values::Double(vec![0.0, 0.0, 0.0, x, y, 0.0]);
        self.with(33550, Values::Double(vec![dx, dy, 0.0])).with(33922, place)
    }
}

/// The bytes of a file of images.
pub fn file(images: &[Image], is_big_endian: bool) -> Vec<u8> {
    let order = |mut bytes: Vec<u8>| {
        if is_big_endian {
            bytes.reverse();
        }
        bytes
    };
    let short = |value: u16| order(value.to_le_bytes().to_vec());
    let long = |value: u32| order(value.to_le_bytes().to_vec());
    let mut out = if is_big_endian { b"MM\0*".to_vec() } else { b"II*\0".to_vec() };
    out.extend(long(8));
    for (number, image) in images.iter().enumerate() {
        let mut tags = image.tags.clone();
        let is_tiled = tags.iter().any(|(tag, _)| *tag == 322);
        let [offsets, counts] = if is_tiled { [324, 325] } else { [273, 279] };
        tags.push((offsets, Values::Long(vec![0; image.pieces.len()])));
        tags.push((counts, Values::Long(image.pieces.iter().map(|piece| piece.len() as u32).collect())));
        tags.sort_by_key(|(tag, _)| *tag);
        let directory_bytes = 2 + 12 * tags.len() + 4;
        let values_at = out.len() + directory_bytes;
        let width = |values: &Values| match values {
            Values::Short(values) => 2 * values.len(),
            Values::Long(values) => 4 * values.len(),
            Values::Double(values) => 8 * values.len(),
            Values::Text(text) => text.len() + 1,
            Values::Bytes(bytes) => bytes.len(),
        };
        let apart: usize = tags.iter().map(|(_, values)| width(values)).filter(|bytes| *bytes > 4).sum();
        let mut piece_at = values_at + apart;
        let (mut directory, mut values_bytes) = (short(tags.len() as u16), vec![]);
        for (tag, values) in tags {
            let (kind, count, bytes): (u16, usize, Vec<u8>) = match values {
                Values::Short(values) => (3, values.len(), values.iter().flat_map(|value| short(*value)).collect()),
                Values::Long(_) if tag == offsets => {
                    let starts = image.pieces.iter().map(|piece| {
                        piece_at += piece.len();
                        (piece_at - piece.len()) as u32
                    });
                    (4, image.pieces.len(), starts.flat_map(long).collect())
                }
                Values::Long(values) => (4, values.len(), values.iter().flat_map(|value| long(*value)).collect()),
                Values::Double(values) => {
                    let bytes = values.iter().flat_map(|value| order(value.to_le_bytes().to_vec()));
                    (12, values.len(), bytes.collect())
                }
                Values::Text(text) => (2, text.len() + 1, [text.into_bytes(), vec![0]].concat()),
                Values::Bytes(bytes) => (7, bytes.len(), bytes),
            };
            directory.extend(short(tag));
            directory.extend(short(kind));
            directory.extend(long(count as u32));
            if bytes.len() > 4 {
                directory.extend(long((values_at + values_bytes.len()) as u32));
                values_bytes.extend(bytes);
            } else {
                directory.extend(bytes.into_iter().chain([0; 4]).take(4));
            }
        }
        let next = if number + 1 < images.len() { piece_at as u32 } else { 0 };
        directory.extend(long(next));
        out.extend(directory);
        out.extend(values_bytes);
        image.pieces.iter().for_each(|piece| out.extend(piece));
    }
    out
}
