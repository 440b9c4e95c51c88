//! Verifying a whole file: all checksums, then every rule that opening and extracting check only for the parts in use.

mod objects;

use std::{collections::BTreeMap, ops::Range};

use crate::{
    error::{Error, Result},
    file::File,
    format::{header::kind, texels::table_bytes},
    heights::{Heights, TileRecord},
    lattice::LatticePoint,
    select::{Cut, Node},
    source::{ReadAt, requests::Before},
};

/// Tiles of heights that are read together.
const TILES_AT_ONCE: usize = 64;

impl<S: ReadAt> Heights<S> {
    /// Reads and decodes every tile that the file has, and with it every checksum and every rule of the format.
    ///
    /// # Errors
    /// [`Error::Format`] with the location of the first damage, [`Error::Io`], [`Error::Limit`].
    pub fn verify(&self) -> Result<()> {
        let mut waiting = self.roots().to_vec();
        while !waiting.is_empty() {
            let ids = waiting.split_off(waiting.len().saturating_sub(TILES_AT_ONCE));
            let mut read = 0;
            self.for_each_tile(&ids, |_, _| {
                read += 1;
                Ok(())
            })?;
            for &id in &ids {
                let stored = self.record(id)?.filter(|record| !record.is_level);
                waiting.extend(stored.iter().flat_map(TileRecord::child_tiles));
            }
            if read < ids.len() {
                return Err(Error::format("a tile that the file names is not there"));
            }
        }
        self.verify_drape()
    }
}

impl<S: ReadAt> Heights<S> {
    /// Reads and decodes the whole image over the heights, if there is one, and checks all rules of its section.
    ///
    /// # Errors
    /// As [`Self::verify`].
    pub fn verify_drape(&self) -> Result<()> {
        match self.index().open_drape() {
            Some(drape) => drape.verify(&self.index().head, |ranges| self.fetch(ranges)),
            None => Ok(()),
        }
    }
}

impl<S: ReadAt> File<S> {
    /// Reads the whole file and compares all checksums, including those of unknown sections. A ground is decoded: see
    /// [`Heights::verify`].
    ///
    /// # Errors
    /// [`Error::Format`] with the location of the first damage, [`Error::Io`].
    pub fn verify_checksums(&self) -> Result<()> {
        const CHUNK: u64 = 1 << 20;
        for section in &self.index().header().sections {
            let Some(checksum) = section.checksum else { continue };
            let mut hasher = crc32fast::Hasher::new();
            let mut done = 0;
            while done < section.length {
                let length = CHUNK.min(section.length - done);
                hasher.update(&self.read(section.offset + done, length)?);
                done += length;
            }
            if hasher.finalize() != checksum {
                let location = || format!("section of kind {}", section.kind);
                return Err(Error::format("the checksum does not match").at(location));
            }
        }
        if let Some(ground) = self.ground()? {
            ground.heights.verify().map_err(|error| error.at(|| "section ground".to_string()))?;
        }
        // Reading a list checks it, too.
        self.load_lists()?;
        for number in 0..self.index().cluster_count() {
            // Reading an index block checks it; once read it stays.
            self.load_indices([number])?;
            let (cluster, in_index) = (self.cluster_index(number)?, self.index().levels().index_arc_levels);
            for level in 0..self.level_count() as u8 {
                let location = |_: usize| format!("page of level {level}, cluster {number}");
                self.ask(|index, fetched| {
                    index
                        .pages(cluster.parts(in_index, level).enumerate(), fetched, location, || Ok(Before::default()))
                        .map(|_| ())
                })?;
            }
        }
        self.verify_object_lists()?;
        self.verify_texels()
    }

    /// Reads all texels, compares their checksums, and checks that they fill the section TEXELS and have the sizes that
    /// CHANNELS says.
    fn verify_texels(&self) -> Result<()> {
        let Some(section) = self.index().header().section(kind::TEXELS) else { return Ok(()) };
        let cluster_count = self.index().cluster_count();
        let mut next = table_bytes(cluster_count);
        let mut stream_bytes = vec![0_u64; self.index().texel_bytes().len()];
        let location = |cluster: u32| move || format!("texels of cluster {cluster}");
        let gap = || Error::format("there is a gap between the texels of clusters, or they overlap");
        for cluster in 0..cluster_count {
            let entry = self.ask(|index, fetched| index.texel_entry(cluster, fetched))?;
            if entry.directory.offset != next {
                return Err(gap().at(location(cluster)));
            }
            next = entry.end;
            let Some(directory) = self.ask(|index, fetched| index.texel_directory(cluster, fetched))? else { continue };
            let all: Vec<_> = directory.streams().collect();
            // They come level by level.
            for of_level in all.chunk_by(|((one, ..), _), ((other, ..), _)| one == other) {
                for ((.., stream), part) in of_level {
                    let number = self.index().size_of_stream(*stream);
                    stream_bytes[number] = stream_bytes[number].saturating_add(part.length);
                }
                let streams =
                    || of_level.iter().map(|&((level, root, number), part)| ((cluster, level, root, number), part));
                self.ask(|index, fetched| index.texel_streams(streams(), fetched).map(drop))?;
            }
        }
        if next != section.length {
            return Err(gap().at(|| "end of section texels".to_string()));
        }
        if stream_bytes != self.index().texel_bytes() {
            let what = "the texels do not have the sizes that the list of channels says";
            return Err(Error::format(what).at(|| "section channels".to_string()));
        }
        Ok(())
    }

    /// Checks the whole file: [`File::verify_checksums`], then decodes and draws every root at every level.
    ///
    /// # Errors
    /// [`Error::Format`] with the first rule that is broken, [`Error::Io`], [`Error::Limit`].
    pub fn verify(&self) -> Result<()> {
        self.verify_checksums()?;
        self.verify_tree()?;
        self.verify_arc_uses()?;
        self.verify_corners()?;
        self.verify_summaries()?;
        self.verify_owners()?;
        self.overview()?;
        for (number, cluster) in (0..).zip(self.index().clusters()?) {
            for level in 0..self.level_count() as u8 {
                let roots = (cluster.first_root..).zip(&self.cluster_index(number)?.roots);
                let has_level = roots.filter(|(_, root)| root.blocks.iter().any(|block| block.level == level));
                let nodes: Vec<Node> = has_level.map(|(root, _)| Node { root, level }).collect();
                self.verify_nodes(nodes).map_err(|error| error.at(|| format!("level {level}, cluster {number}")))?;
            }
        }
        Ok(())
    }

    /// Checks that every child lies in its parent's box and continues its levels, and that a group has the border of
    /// its children.
    fn verify_tree(&self) -> Result<()> {
        // A prefix has the whole index.
        let uses = self.arc_uses(self.index().levels().levels.len().saturating_sub(1) as u8)?;
        let is_boundary = |arc: u32| uses.get(arc as usize) == Some(&1);
        for root in 0..self.root_count() {
            let children = self.children(root)?;
            if children.is_empty() {
                continue;
            }
            self.verify_group_border(root, children.clone(), is_boundary)?;
            let entry = self.root_entry(root)?;
            let (above, [_, finest]) = (entry.bounds, entry.end_levels());
            for child in children {
                let location = || format!("root {child}");
                let entry = self.root_entry(child)?;
                let (bounds, [coarsest, _]) = (entry.bounds, entry.end_levels());
                if finest.checked_add(1) != Some(coarsest) {
                    return Err(Error::format("a root's levels do not continue its parent's").at(location));
                }
                // Boxes are rounded outward by 1/255 of their clusters'.
                let rounding = self.cluster_extent(child)?;
                let is_outside = |axis: usize| {
                    let reach = rounding[axis] / 255 + 1;
                    bounds[0][axis] + reach < above[0][axis] || bounds[1][axis] - reach > above[1][axis]
                };
                if (0..3).any(is_outside) {
                    return Err(Error::format("a root lies outside its parent's box").at(location));
                }
            }
        }
        Ok(())
    }

    /// Checks that a group uses the arcs that its children use once, but for those around holes that it closes, where
    /// the surface ends; and of their others none or both sides.
    fn verify_group_border(&self, group: u32, children: Range<u32>, is_boundary: impl Fn(u32) -> bool) -> Result<()> {
        // How often children use an arc, less how often the group does; and the same with directions.
        let mut balances: BTreeMap<u32, [i64; 2]> = BTreeMap::new();
        for (root, sign) in children.map(|child| (child, 1)).chain([(group, -1)]) {
            for half_arc in self.root_entry(root)?.half_arcs() {
                let [uses, along] = balances.entry(half_arc.arc).or_default();
                *uses += sign;
                *along += if half_arc.reversed { -sign } else { sign };
            }
        }
        // An arc has at most two users.
        let is_sound =
            |arc: u32, [uses, along]: [i64; 2]| uses == 0 && along == 0 || uses == 2 || uses == 1 && is_boundary(arc);
        match balances.iter().find(|&(&arc, &balance)| !is_sound(arc, balance)) {
            None => Ok(()),
            Some((arc, _)) => {
                let location = || format!("root {group}, arc {arc}");
                Err(Error::format("a group has another border than its children").at(location))
            }
        }
    }

    fn cluster_extent(&self, root: u32) -> Result<LatticePoint> {
        let [low, high] = self.index().cluster(self.index().owner(root, |cluster| cluster.first_root)?)?.bounds;
        Ok([0, 1, 2].map(|axis| high[axis] - low[axis]))
    }

    /// Checks that every arc has a root on one or both sides wherever all that is drawn is of one level.
    fn verify_arc_uses(&self) -> Result<()> {
        // A prefix has the whole index.
        let level_count = self.index().levels().levels.len();
        for level in 0..level_count as u8 {
            let use_counts = self.arc_uses(level)?;
            let is_finest = usize::from(level) + 1 == level_count;
            if let Some(arc) = use_counts.iter().position(|&count| count > 2 || is_finest && count == 0) {
                let location = || format!("arc {arc}, level {level}");
                return Err(Error::format("an arc is used by none or more than twice").at(location));
            }
        }
        Ok(())
    }

    /// How many roots use each arc where all that is drawn is of one level.
    fn arc_uses(&self, level: u8) -> Result<Vec<u8>> {
        let top_count = self.index().top_count();
        let mut use_counts = vec![0_u8; self.index().arc_count() as usize];
        for (number, cluster) in (0..).zip(self.index().clusters()?) {
            let roots = (cluster.first_root..).zip(&self.cluster_index(number)?.roots);
            for (_, root) in roots.filter(|(root, entry)| entry.uniform_block(level, *root < top_count).is_some()) {
                for half_arc in root.half_arcs() {
                    if let Some(count) = use_counts.get_mut(half_arc.arc as usize) {
                        *count = count.saturating_add(1);
                    }
                }
            }
        }
        Ok(use_counts)
    }

    /// Checks that a border runs on through every corner that is no vertex, where all that is drawn is of one level: a
    /// third arc that ends there would open a hole.
    fn verify_corners(&self) -> Result<()> {
        let top_count = self.index().top_count();
        let clusters: Vec<_> = (0..).zip(self.index().clusters()?).collect();
        let (mut corner_levels, mut arc_ends) = (Vec::new(), Vec::new());
        for &(number, _) in &clusters {
            let of_cluster = self.cluster_index(number)?;
            corner_levels.extend_from_slice(&of_cluster.corner_levels);
            arc_ends.extend_from_slice(&of_cluster.arc_ends);
        }
        if corner_levels.iter().all(|&level| level == 0) {
            return Ok(());
        }
        for level in 0..self.index().levels().levels.len() as u8 {
            // Up to two arcs of each corner.
            let mut found = vec![[None; 2]; corner_levels.len()];
            for &(number, cluster) in &clusters {
                for (root, entry) in (cluster.first_root..).zip(&self.cluster_index(number)?.roots) {
                    let Some(block) = entry.uniform_block(level, root < top_count) else { continue };
                    for arc in entry.half_arcs().map(|half_arc| half_arc.arc) {
                        for &corner in arc_ends.get(arc as usize).into_iter().flatten() {
                            let corner = corner as usize;
                            if corner_levels.get(corner).is_none_or(|&coarsest| coarsest <= block.level) {
                                continue;
                            }
                            match found[corner].iter_mut().find(|other| other.is_none_or(|other| other == arc)) {
                                Some(place) => *place = Some(arc),
                                None => {
                                    let location = || format!("corner {corner}, level {level}");
                                    return Err(Error::format("three arcs meet where there is no vertex").at(location));
                                }
                            }
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// Checks that the triangle counts and errors of clusters and levels are those of their roots.
    fn verify_summaries(&self) -> Result<()> {
        for level in 0..self.level_count() as u8 {
            let (mut triangle_count, mut max_error) = (0_u64, 0.0_f64);
            for (number, cluster) in (0..).zip(self.index().clusters()?) {
                let location = || format!("level {level}, cluster {number}");
                let found = &cluster.levels[usize::from(level)];
                let top_count = cluster.top_count(self.index().top_count());
                let summary = self.cluster_index(number)?.summary(level, top_count, &self.lattice());
                let summary = summary.map_err(|_| Error::format("an error is too large").at(location))?;
                if (found.triangle_count, found.max_error) != summary {
                    return Err(Error::format("triangles or error are not those of the roots").at(location));
                }
                triangle_count = triangle_count.saturating_add(summary.0);
                max_error = max_error.max(summary.1.bound(&self.lattice()));
            }
            let record = &self.index().levels().levels[usize::from(level)];
            if record.triangle_count != triangle_count || record.max_error != max_error {
                let location = || format!("level {level}");
                return Err(Error::format("triangles or error are not those of the clusters").at(location));
            }
        }
        Ok(())
    }

    /// Draws some roots, which checks their borders, counts and indices, and then checks their boxes.
    fn verify_nodes(&self, nodes: Vec<Node>) -> Result<()> {
        let cut = Cut { nodes, ..Cut::default() };
        let mesh = self.extract(&cut)?;
        let bounds = |node: &Node| Ok(self.root_entry(node.root)?.bounds.map(|point| self.lattice().world(point)));
        let boxes = cut.nodes.iter().map(bounds).collect::<Result<Vec<_>>>()?;
        for (triangle, &node) in mesh.triangles.iter().zip(&mesh.triangle_nodes) {
            let (root, [low, high]) = (cut.nodes[node as usize].root, boxes[node as usize]);
            let inside = |&vertex: &u32| {
                let position = mesh.positions[vertex as usize];
                (0..3).all(|axis| low[axis] <= position[axis] && position[axis] <= high[axis])
            };
            if !triangle.iter().all(inside) {
                return Err(Error::format("a vertex lies outside its root's box").at(|| format!("root {root}")));
            }
        }
        Ok(())
    }
}
