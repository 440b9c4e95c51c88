//! Header and section directory (SPEC.md, chapters 4 and 5), with sound checksums around whatever is put in.

/// A section.
#[derive(Clone, Debug)]
pub struct Section {
    /// Which one it is.
    pub kind: u32,
    /// Bit 0: required; bit 1: checked by parts.
    pub flags: u32,
    /// Its bytes.
    pub content: Vec<u8>,
    /// The directory entry's reserved bytes.
    pub reserved: u32,
}

/// A file as header and sections.
#[derive(Clone, Debug)]
pub struct Container {
    /// Major and minor version.
    pub version: [u16; 2],
    /// The header's flags.
    pub flags: u32,
    /// Lattice origin.
    pub origin: [f64; 3],
    /// Lattice step.
    pub step_log2: i32,
    /// Where the header says that the directory is.
    pub directory_offset: u64,
    /// In the order of the file.
    pub sections: Vec<Section>,
    /// Bytes between one section and the next.
    pub gap: usize,
}

impl Default for Container {
    fn default() -> Self {
        let (version, origin, directory_offset) = ([4, 0], [0.0; 3], 64);
        Self { version, flags: 0, origin, step_log2: 0, directory_offset, sections: vec![], gap: 0 }
    }
}

impl Container {
    /// A section of a kind that is there.
    pub fn section(&mut self, kind: u32) -> &mut Section {
        self.sections.iter_mut().find(|section| section.kind == kind).expect("the kind is one of those put in")
    }

    /// The file.
    pub fn bytes(&self) -> Vec<u8> {
        let (mut directory, mut contents) = (vec![], vec![]);
        let directory_end = 64 + 32 * self.sections.len();
        for (k, section) in self.sections.iter().enumerate() {
            contents.resize(contents.len() + if k > 0 { self.gap } else { 0 }, 0);
            let checksum = if section.flags & 2 == 0 { crc32fast::hash(&section.content) } else { 0 };
            directory.extend(section.kind.to_le_bytes());
            directory.extend(section.flags.to_le_bytes());
            directory.extend(((directory_end + contents.len()) as u64).to_le_bytes());
            directory.extend((section.content.len() as u64).to_le_bytes());
            directory.extend(checksum.to_le_bytes());
            directory.extend(section.reserved.to_le_bytes());
            contents.extend(&section.content);
        }
        let mut bytes = b"\x8fLOD\r\n\x1a\n".to_vec();
        self.version.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend(self.flags.to_le_bytes());
        self.origin.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend(self.step_log2.to_le_bytes());
        bytes.extend((self.sections.len() as u32).to_le_bytes());
        bytes.extend(self.directory_offset.to_le_bytes());
        bytes.extend(crc32fast::hash(&directory).to_le_bytes());
        bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
        [bytes, directory, contents].concat()
    }
}
