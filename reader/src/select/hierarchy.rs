//! Hierarchies: nodes with several resolutions, the tree above them, and the borders that they share (Niski 2007,
//! section 3.4). They hold no geometry.

use std::{ops::Range, sync::Arc};

use crate::{
    error::{Error, Result},
    format::{error_code::sum_of_bounds, header::FileId},
    objects::{ObjectFilter, ObjectState},
};

/// One way to draw a node.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Resolution {
    /// Its density on a scale that all nodes share; larger is finer.
    pub level: u8,
    /// Bound of the error, world units.
    pub error: f64,
    /// Added to the error where a neighbour has more samples on a shared border, world units.
    pub border_deviation: f64,
    /// Triangles, without those that stitching adds.
    pub triangle_count: u64,
    /// Pages of the file that are needed besides those of the node's coarser resolutions.
    pub pages: Vec<u32>,
}

/// A node: one piece of surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HierarchyNode {
    /// World box around everything that it draws and stands for.
    pub bounds: [[f64; 3]; 2],
    /// The node that it replaces together with its siblings. A parent comes before its children.
    pub parent: Option<u32>,
    /// Coarse to fine, at least one.
    pub resolutions: Vec<Resolution>,
    /// Its borders, each as often as the node's outline runs along it. A parent has the borders of its children except
    /// those between them.
    pub borders: Vec<u32>,
}

/// A resolution without its pages.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Grade {
    pub level: u8,
    pub error: f64,
    /// The error where a neighbour has more samples.
    pub refined_error: f64,
    pub triangle_count: u64,
    /// Where its pages begin.
    first_page: u32,
}

/// Lists of different lengths in one.
#[derive(Clone, Debug, Default)]
struct Lists {
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Lists {
    fn push(&mut self, items: impl IntoIterator<Item = u32>) {
        self.starts.push(self.items.len() as u32);
        self.items.extend(items);
    }

    fn range(&self, index: u32) -> Range<usize> {
        let start = self.starts[index as usize] as usize;
        start..self.starts.get(index as usize + 1).map_or(self.items.len(), |&end| end as usize)
    }

    fn get(&self, index: u32) -> &[u32] {
        &self.items[self.range(index)]
    }
}

/// All nodes, resolutions and borders that a cut is chosen from. It stays valid as long as the file stays the same.
#[derive(Clone, Debug, Default)]
pub struct Hierarchy {
    bounds: Vec<[[f64; 3]; 2]>,
    parents: Vec<u32>,
    children: Lists,
    grade_starts: Vec<u32>,
    grades: Vec<Grade>,
    pages: Vec<u32>,
    page_bytes: Vec<u64>,
    /// Per node its borders, each once.
    borders: Lists,
    /// Per border its users, once for each use.
    users: Lists,
    sample_counts: Vec<u32>,
    level_count: usize,
    roots: Vec<u32>,
    /// Per bundle of roots, which lie next to each other, the box around them.
    bundle_bounds: Vec<[[f64; 3]; 2]>,
    /// Per bundle the roots and all below them.
    bundle_nodes: Lists,
    /// Per node its bundle.
    bundles: Vec<u32>,
    /// The names of the nodes in cuts, ascending; empty where nodes are named by their numbers.
    ids: Vec<u32>,
    /// The file that it was made from, if it was made from one.
    file: Option<FileId>,
    /// The objects that its nodes show; none where they show everything.
    filter: Option<Arc<ObjectFilter>>,
}

/// Roots of a bundle: few enough for a tight box, many enough that looking at it saves work.
const BUNDLE_SIZE: usize = 16;

/// No node.
pub(crate) const NONE: u32 = u32::MAX;

impl Hierarchy {
    /// Makes a hierarchy of nodes. `sample_counts` holds, border by border, how many samples the border has at each of
    /// `level_count` levels, never decreasing; `page_bytes` holds the sizes of the pages.
    ///
    /// # Errors
    /// [`Error::Query`] if a node names something that does not exist, has no resolution or more than 254, or has an
    /// error that is not zero or more.
    pub fn new(
        nodes: &[HierarchyNode],
        sample_counts: Vec<u32>,
        level_count: u8,
        page_bytes: Vec<u64>,
    ) -> Result<Self> {
        let wrong = |node: usize, what: &str| Err(Error::Query { what: format!("node {node} of a hierarchy {what}") });
        let level_count = usize::from(level_count);
        let border_count = sample_counts.len().checked_div(level_count).unwrap_or(0);
        let mut this = Self { sample_counts, level_count, page_bytes, ..Self::default() };
        let mut child_lists = vec![Vec::new(); nodes.len()];
        let mut user_lists = vec![Vec::new(); border_count];
        for (number, node) in nodes.iter().enumerate() {
            match node.parent {
                Some(parent) if parent as usize >= number => return wrong(number, "comes before its parent"),
                Some(parent) => child_lists[parent as usize].push(number as u32),
                None => this.roots.push(number as u32),
            }
            if node.resolutions.is_empty() || node.resolutions.len() > 254 {
                return wrong(number, "has no resolution, or more than 254");
            }
            this.bounds.push(node.bounds);
            this.parents.push(node.parent.unwrap_or(NONE));
            this.grade_starts.push(this.grades.len() as u32);
            for resolution in &node.resolutions {
                let Resolution { level, error, border_deviation, triangle_count, ref pages } = *resolution;
                if !(error >= 0.0 && border_deviation >= 0.0 && usize::from(level) < level_count) {
                    return wrong(number, "has a resolution without error or level");
                }
                if pages.iter().any(|&page| page as usize >= this.page_bytes.len()) {
                    return wrong(number, "needs a page that does not exist");
                }
                let refined_error = sum_of_bounds(error, border_deviation);
                let first_page = this.pages.len() as u32;
                this.grades.push(Grade { level, error, refined_error, triangle_count, first_page });
                this.pages.extend(pages);
            }
            for &border in &node.borders {
                match user_lists.get_mut(border as usize) {
                    Some(users) => users.push(number as u32),
                    None => return wrong(number, "has a border that does not exist"),
                }
            }
            let mut borders = node.borders.clone();
            borders.sort_unstable();
            borders.dedup();
            this.borders.push(borders);
        }
        this.bundle_roots();
        child_lists.into_iter().for_each(|list| this.children.push(list));
        user_lists.into_iter().for_each(|list| this.users.push(list));
        Ok(this)
    }

    /// Bundles roots that follow each other: in a file neighbours do.
    fn bundle_roots(&mut self) {
        let mut bundle_of_root = vec![0; self.parents.len()];
        for (bundle, roots) in (0_u32..).zip(self.roots.chunks(BUNDLE_SIZE)) {
            let boxes = roots.iter().map(|&root| self.bounds[root as usize]);
            let join = |[low, high]: [[f64; 3]; 2], other: [[f64; 3]; 2]| {
                [[0, 1, 2].map(|k| low[k].min(other[0][k])), [0, 1, 2].map(|k| high[k].max(other[1][k]))]
            };
            self.bundle_bounds.extend(boxes.reduce(join));
            roots.iter().for_each(|&root| bundle_of_root[root as usize] = bundle);
        }
        let mut lists = vec![Vec::new(); self.bundle_bounds.len()];
        for (node, &parent) in self.parents.iter().enumerate() {
            let bundle = if parent == NONE { bundle_of_root[node] } else { self.bundles[parent as usize] };
            self.bundles.push(bundle);
            lists[bundle as usize].push(node as u32);
        }
        lists.into_iter().for_each(|list| self.bundle_nodes.push(list));
    }

    pub(crate) fn bundle(&self, node: u32) -> u32 {
        self.bundles[node as usize]
    }

    pub(crate) fn bundle_bounds(&self) -> &[[[f64; 3]; 2]] {
        &self.bundle_bounds
    }

    pub(crate) fn bundle_nodes(&self, bundle: u32) -> &[u32] {
        self.bundle_nodes.get(bundle)
    }

    /// Names the nodes in cuts by other numbers, which ascend.
    pub(crate) fn with_ids(self, ids: Vec<u32>) -> Self {
        Self { ids, ..self }
    }

    /// Says which file it was made from.
    pub(crate) fn of_file(self, file: FileId) -> Self {
        Self { file: Some(file), ..self }
    }

    /// Says that its nodes are those that show these objects.
    pub(crate) fn of_objects(self, filter: Option<Arc<ObjectFilter>>) -> Self {
        Self { filter, ..self }
    }

    /// The objects that its nodes show.
    pub(crate) fn filter(&self) -> Option<&Arc<ObjectFilter>> {
        self.filter.as_ref()
    }

    /// The hierarchy of the nodes that show these objects: nodes with nothing of them are gone, and those below groups
    /// that show some of them have no parent. A node that cannot be split here, as in the beginning of a file, is gone,
    /// too.
    ///
    /// # Errors
    /// [`Error::Query`] if the filter is of another file, or the nodes are those of another filter.
    pub(crate) fn showing(self: &Arc<Self>, filter: Option<&Arc<ObjectFilter>>) -> Result<Arc<Self>> {
        match (filter, &self.filter) {
            (None, None) => Ok(Arc::clone(self)),
            (Some(filter), Some(own)) if filter == own => Ok(Arc::clone(self)),
            (Some(filter), None) if self.file == Some(filter.file) => Ok(Arc::new(self.filtered(filter))),
            (Some(_), None) => Err(Error::Query { what: "the filter of objects is one of another file".into() }),
            _ => Err(Error::Query { what: "the hierarchy was made for other objects than the query's".into() }),
        }
    }

    fn filtered(&self, filter: &Arc<ObjectFilter>) -> Self {
        filter.is_there();
        let mut this = Self {
            sample_counts: self.sample_counts.clone(),
            level_count: self.level_count,
            page_bytes: self.page_bytes.clone(),
            file: self.file,
            filter: Some(Arc::clone(filter)),
            ..Self::default()
        };
        let mut numbers = vec![NONE; self.parents.len()];
        let mut child_lists: Vec<Vec<u32>> = Vec::new();
        for node in 0..self.node_count() {
            let id = self.id(node);
            if filter.state(id) == Some(ObjectState::Hidden) || filter.splits(id) {
                continue;
            }
            let number = this.parents.len() as u32;
            numbers[node as usize] = number;
            child_lists.push(Vec::new());
            this.ids.push(id);
            this.bounds.push(self.bounds(node));
            let parent = self.parent(node).map_or(NONE, |parent| numbers[parent as usize]);
            this.parents.push(parent);
            match child_lists.get_mut(parent as usize) {
                Some(children) => children.push(number),
                None => this.roots.push(number),
            }
            this.grade_starts.push(this.grades.len() as u32);
            for (resolution, grade) in (0..).zip(self.grades(node)) {
                this.grades.push(Grade { first_page: this.pages.len() as u32, ..*grade });
                this.pages.extend(self.pages(node, resolution));
            }
            this.borders.push(self.borders(node).iter().copied());
        }
        this.bundle_roots();
        child_lists.into_iter().for_each(|list| this.children.push(list));
        for border in 0..self.border_count() as u32 {
            let users = self.users(border).iter().map(|&user| numbers[user as usize]);
            this.users.push(users.filter(|&user| user != NONE));
        }
        this
    }

    /// The file that it was made from.
    pub(crate) fn file(&self) -> Option<FileId> {
        self.file
    }

    /// The number that names a node in cuts.
    pub fn id(&self, node: u32) -> u32 {
        self.ids.get(node as usize).copied().unwrap_or(node)
    }

    /// The number of nodes. They are numbered from 0.
    pub fn node_count(&self) -> u32 {
        self.parents.len() as u32
    }

    /// The nodes without a parent, which make up the coarsest cut.
    pub fn roots(&self) -> &[u32] {
        &self.roots
    }

    /// The nodes that a node splits into.
    pub fn children(&self, node: u32) -> &[u32] {
        self.children.get(node)
    }

    /// The node that a node and its siblings merge into.
    pub fn parent(&self, node: u32) -> Option<u32> {
        Some(self.parents[node as usize]).filter(|&parent| parent != NONE)
    }

    /// A node's box.
    pub fn bounds(&self, node: u32) -> [[f64; 3]; 2] {
        self.bounds[node as usize]
    }

    /// The box of the node that a number names in cuts, if there is one.
    pub(crate) fn bounds_of(&self, id: u32) -> Option<[[f64; 3]; 2]> {
        let node = if self.ids.is_empty() { Some(id as usize) } else { self.ids.binary_search(&id).ok() };
        node.and_then(|node| self.bounds.get(node).copied())
    }

    /// The level of one of a node's resolutions.
    pub fn level(&self, node: u32, resolution: u8) -> u8 {
        self.grade(node, resolution).level
    }

    /// Index of the finest resolution of a node that is not finer than a level, or else its coarsest.
    pub fn resolution_at(&self, node: u32, level: u8) -> u8 {
        self.grades(node).partition_point(|grade| grade.level <= level).saturating_sub(1) as u8
    }

    pub(crate) fn has_children(&self) -> bool {
        !self.children.items.is_empty()
    }

    pub(crate) fn grades(&self, node: u32) -> &[Grade] {
        let start = self.grade_starts[node as usize] as usize;
        let end = self.grade_starts.get(node as usize + 1).map_or(self.grades.len(), |&end| end as usize);
        &self.grades[start..end]
    }

    pub(crate) fn grade(&self, node: u32, resolution: u8) -> &Grade {
        &self.grades[self.grade_starts[node as usize] as usize + usize::from(resolution)]
    }

    /// The pages that a resolution needs besides those of coarser ones.
    pub(crate) fn pages(&self, node: u32, resolution: u8) -> &[u32] {
        let at = self.grade_starts[node as usize] as usize + usize::from(resolution);
        let end = self.grades.get(at + 1).map_or(self.pages.len(), |grade| grade.first_page as usize);
        &self.pages[self.grades[at].first_page as usize..end]
    }

    pub(crate) fn page_bytes(&self) -> &[u64] {
        &self.page_bytes
    }

    pub(crate) fn borders(&self, node: u32) -> &[u32] {
        self.borders.get(node)
    }

    pub(crate) fn users(&self, border: u32) -> &[u32] {
        self.users.get(border)
    }

    /// The users of all borders, one border's after the other's.
    pub(crate) fn all_users(&self) -> &[u32] {
        &self.users.items
    }

    /// Where those of a border are among these.
    pub(crate) fn users_of(&self, border: u32) -> Range<usize> {
        self.users.range(border)
    }

    pub(crate) fn border_count(&self) -> usize {
        self.users.starts.len()
    }

    pub(crate) fn sample_count(&self, border: u32, level: u8) -> u32 {
        self.sample_counts[border as usize * self.level_count + usize::from(level)]
    }
}
