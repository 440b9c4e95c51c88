//! The output of a file: its sections in order.

use std::io::{self, Read, Seek, Write};

use super::{
    assembly::FileHead,
    encoder::{EncodedCluster, Encoder},
    lists::{ListSizes, Lists},
    owners::{self, BlockOwners},
    piece::Piece,
    sorting::{ClusterSymbols, Sorting},
    texels::{EncodedTexels, TexelTable},
};
use crate::{
    codec::entropy::encode,
    error::{Error, Result},
    format::{
        channels::Channels,
        cluster_lists::write_clusters,
        clusters::Cluster,
        error_code::ErrorCode,
        header::{Header, Section, VERSION, VERSION_WITH_CHANNELS, VERSION_WITH_OBJECTS, VERSION_WITH_SCALES, kind},
        overview::OverviewSection,
        sections::write_source,
    },
    objects::{ObjectNode, ObjectsWriter},
};

/// A report on a written file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct WriteReport {
    /// Size of the file.
    pub total_bytes: u64,
    /// Name and size of each section; header and directory first.
    pub sections: Vec<(&'static str, u64)>,
    /// For each level the bytes of arcs and of blocks in pages.
    pub levels: Vec<[u64; 2]>,
    /// For each root of the file its number in the model; empty unless [`crate::write::write_file`] wrote it.
    pub root_order: Vec<u32>,
}

/// A file that takes its pieces, and then its clusters. Pieces arrive in another order than clusters, and pages lie
/// level by level, so both wait until all have arrived: in files or in memory, depending on `S`.
#[derive(Debug)]
pub struct Output<S> {
    encoder: Encoder,
    symbols: Sorting<S>,
    clusters: Vec<Cluster>,
    list_sizes: ListSizes,
    index: Waiting<S>,
    /// For each level the arc pages and the block pages.
    pages: Vec<[Waiting<S>; 2]>,
    texel_table: TexelTable,
    /// Directories and streams; none without channels.
    texels: Option<Waiting<S>>,
    /// Objects and their pages of owners; none in a file without objects.
    objects: Option<(ObjectsWriter, Vec<u8>)>,
}

/// Bytes that wait to be written.
#[derive(Debug)]
struct Waiting<S> {
    bytes: S,
    length: u64,
}

impl<S: Read + Write + Seek> Output<S> {
    /// A file without pieces yet. `scratch` makes an empty store for bytes that wait.
    ///
    /// # Errors
    /// [`Error::Write`] if `scratch` fails.
    pub fn new(encoder: Encoder, mut scratch: impl FnMut() -> io::Result<S>) -> Result<Self> {
        let mut waiting = || match scratch() {
            Ok(bytes) => Ok(Waiting { bytes, length: 0 }),
            Err(source) => Err(Error::Write { source }),
        };
        let symbols = Sorting::new(waiting()?.bytes, encoder.cluster_count(), encoder.stream_count());
        let index = waiting()?;
        let level_count = encoder.head.levels.levels.len();
        let pages = (0..level_count).map(|_| Ok([waiting()?, waiting()?])).collect::<Result<_>>()?;
        let texels = (encoder.stream_count() > 0).then(waiting).transpose()?;
        let texel_table = TexelTable::new(encoder.cluster_count(), &encoder.stream_order());
        let (clusters, list_sizes) = (Vec::new(), ListSizes::default());
        Ok(Self { encoder, symbols, clusters, list_sizes, index, pages, texel_table, texels, objects: None })
    }

    /// Divides the clusters among lists of other sizes than the default ones.
    #[must_use]
    pub fn with_list_sizes(self, list_sizes: ListSizes) -> Self {
        Self { list_sizes, ..self }
    }

    /// Names what the islands of leaves belong to: see [`crate::write::Model::nodes`]. Comes before the first cluster.
    ///
    /// # Errors
    /// [`Error::Model`] if a parent does not exist, parents are in a circle or too deep, or a text is too long.
    pub fn with_nodes(self, nodes: Vec<ObjectNode>) -> Result<Self> {
        let objects = if nodes.is_empty() { None } else { Some((ObjectsWriter::new(nodes)?, vec![])) };
        Ok(Self { objects, ..self })
    }

    /// The encoder of its clusters.
    pub fn encoder(&self) -> &Encoder {
        &self.encoder
    }

    /// Takes the symbols of a piece; `number` is its position in counting order, from 0.
    ///
    /// # Errors
    /// [`Error::Model`] if it is not the piece that was counted, [`Error::Write`].
    pub fn take(&mut self, number: usize, piece: &Piece) -> Result<()> {
        self.symbols.take(&self.encoder.arrangement, number, piece)
    }

    /// The symbols of a cluster, once all pieces have been taken. Can be called once for each cluster.
    ///
    /// # Errors
    /// [`Error::Model`] if a piece is missing, [`Error::Write`].
    pub fn symbols(&mut self, cluster: usize) -> Result<ClusterSymbols> {
        self.symbols.symbols(&self.encoder.arrangement, cluster)
    }

    /// Appends the next cluster.
    ///
    /// # Errors
    /// [`Error::Model`] if the cluster is not the next one, [`Error::Write`].
    pub fn add(&mut self, encoded: EncodedCluster) -> Result<()> {
        let EncodedCluster { cluster, index, pages, texels, owners } = encoded;
        let next = self.encoder.arrangement.clusters.get(self.clusters.len());
        if next.is_none_or(|next| next.first_root != cluster.first_root) {
            return Err(Error::model("clusters do not come in the order of the file"));
        }
        self.clusters.push(cluster);
        self.index.push(&index)?;
        for (waiting, bytes) in self.pages.iter_mut().flatten().zip(pages.iter().flatten()) {
            waiting.push(bytes)?;
        }
        if let Some(waiting) = &mut self.texels {
            self.texel_table.add(&texels)?;
            let EncodedTexels { directory, streams, .. } = texels;
            waiting.push(&directory)?;
            waiting.push(&streams)?;
        }
        match &mut self.objects {
            Some((objects, pages)) => {
                owners::check(&owners)?;
                let of_leaf = |blocks: Vec<BlockOwners>| blocks.into_iter().map(|block| block.owners).collect();
                pages.extend(objects.add(&owners.into_iter().map(of_leaf).collect::<Vec<_>>())?);
                Ok(())
            }
            None if owners.iter().flatten().any(|block| !block.owners.is_empty()) => {
                Err(Error::model("blocks have owners, and the file has no objects"))
            }
            None => Ok(()),
        }
    }

    /// Writes the file.
    ///
    /// # Errors
    /// [`Error::Write`] if `out` fails, [`Error::Model`] if the overview breaks a rule or a cluster is missing.
    pub fn finish(mut self, out: &mut impl Write) -> Result<WriteReport> {
        if self.clusters.len() != self.encoder.cluster_count() {
            return Err(Error::model("a cluster is missing"));
        }
        let level_bytes: Vec<[u64; 2]> = self.pages.iter().map(|[arcs, blocks]| [arcs.length, blocks.length]).collect();
        let page_bytes = level_bytes.iter().flatten().sum();
        let levels = self.encoder.levels_of(&self.clusters, &level_bytes).write();
        let lists = Lists::new(std::mem::take(&mut self.clusters), self.list_sizes)?;
        let index_bytes = lists.index_bytes();
        let Encoder { head, tables, codes, overview, .. } = &self.encoder;
        let FileHead { lattice, source, placement, .. } = head;
        let mut sections = vec![
            ("levels", kind::LEVELS, true, levels),
            ("tables", kind::TABLES, true, tables.write()),
            ("clusters", kind::CLUSTERS, true, write_clusters(&lists.top())),
        ];
        if let Some(overview) = overview {
            let section = OverviewSection {
                error: ErrorCode::at_least(overview.error, lattice)?,
                quantisation: overview.quantisation,
                triangle_count: overview.triangle_count,
                loops: overview.loops.clone(),
                stream: encode(codes, [overview.symbols.iter()])?,
            };
            let bytes = section.write()?;
            sections.insert(2, ("overview", kind::OVERVIEW, false, bytes));
        }
        let texel_table = self.texel_table.write();
        let texel_bytes = self.texels.as_ref().map(|waiting| texel_table.len() as u64 + waiting.length);
        let mut version = VERSION;
        if texel_bytes.is_some() {
            version = VERSION_WITH_CHANNELS;
            let stream_bytes = self.texel_table.stream_bytes().to_vec();
            let section = Channels { channels: head.channels.clone(), stream_bytes };
            sections.insert(sections.len() - 1, ("channels", kind::CHANNELS, false, section.write()));
            if let Some(scales) = section.write_scales() {
                version = VERSION_WITH_SCALES;
                sections.insert(sections.len() - 1, ("scales", kind::SCALES, true, scales));
            }
        }
        let objects = self.objects.take().filter(|(objects, _)| !objects.is_empty());
        let objects = objects.map(|(objects, owners)| Ok::<_, Error>((objects.finish()?, owners))).transpose()?;
        if let Some((objects, _)) = &objects {
            version = VERSION_WITH_OBJECTS;
            sections.insert(sections.len() - 1, ("objects", kind::OBJECTS, false, objects.head.clone()));
        }
        if let Some(placement) = placement {
            sections.insert(0, ("placement", kind::PLACEMENT, false, placement.write()?));
        }
        if *source != Default::default() {
            sections.insert(0, ("source", kind::SOURCE, false, write_source(source)));
        }
        let checked = sections.iter().map(|&(_, kind, required, ref bytes)| {
            let (length, checksum) = (bytes.len() as u64, Some(crc32fast::hash(bytes)));
            Section { kind, required, checksum, offset: 0, length }
        });
        let mut in_parts = vec![("index", kind::INDEX, true, index_bytes), ("pages", kind::PAGES, true, page_bytes)];
        if let Some(length) = texel_bytes {
            in_parts.insert(1, ("texels", kind::TEXELS, false, length));
        }
        let object_pages = objects
            .iter()
            .flat_map(|(objects, owners)| [&objects.before_owners[..], &owners[..], &objects.after_owners[..]]);
        if objects.is_some() {
            let length = object_pages.clone().map(|bytes| bytes.len() as u64).sum();
            in_parts.insert(in_parts.len() - 1, ("object pages", kind::OBJECT_PAGES, false, length));
        }
        let by_parts = in_parts.iter().map(|&(_, kind, required, length)| Section {
            kind,
            required,
            checksum: None,
            offset: 0,
            length,
        });
        let header = Header::new(version, *lattice, checked.chain(by_parts).collect()).write();
        let names = sections.iter().map(|(name, .., bytes)| (*name, bytes.len() as u64));
        let names = [("header", header.len() as u64)].into_iter().chain(names);
        let names: Vec<_> = names.chain(in_parts.iter().map(|&(name, .., length)| (name, length))).collect();

        let mut in_memory = [&header].into_iter().chain(sections.iter().map(|(.., bytes)| bytes));
        let written = in_memory.try_for_each(|bytes| out.write_all(bytes));
        let written = written.and_then(|()| self.index.bytes.rewind());
        let index = &mut self.index.bytes;
        let written =
            written.and_then(|()| lists.write_index(out, &mut |length, out| copy_exactly(index, length, out)));
        let written = written.and_then(|()| out.write_all(&texel_table));
        let written = written.and_then(|()| self.texels.iter_mut().try_for_each(|waiting| waiting.copy_to(out)));
        let mut object_pages = object_pages;
        let written = written.and_then(|()| object_pages.try_for_each(|bytes| out.write_all(bytes)));
        let mut pages = self.pages.iter_mut().flatten();
        let written = written.and_then(|()| pages.try_for_each(|waiting| waiting.copy_to(out)));
        written.map_err(|source| Error::Write { source })?;
        let total_bytes = names.iter().map(|section| section.1).sum();
        Ok(WriteReport { total_bytes, sections: names, levels: level_bytes, root_order: Vec::new() })
    }
}

impl<S: Read + Write + Seek> Waiting<S> {
    fn push(&mut self, bytes: &[u8]) -> Result<()> {
        self.length += bytes.len() as u64;
        self.bytes.write_all(bytes).map_err(|source| Error::Write { source })
    }

    fn copy_to(&mut self, out: &mut impl Write) -> io::Result<()> {
        self.bytes.rewind()?;
        copy_exactly(&mut self.bytes, self.length, out)
    }
}

fn copy_exactly(from: &mut impl Read, length: u64, out: &mut impl Write) -> io::Result<()> {
    let copied = io::copy(&mut from.take(length), out)?;
    if copied == length { Ok(()) } else { Err(io::ErrorKind::UnexpectedEof.into()) }
}
