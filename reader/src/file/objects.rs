//! The objects of an open file, which reads what an answer needs.

use std::sync::Arc;

use super::File;
use crate::{
    decode::{self, Mesh, Pick},
    error::{Error, Result},
    index::{Objects, Ray},
    objects::{ObjectChoice, ObjectFilter, ObjectNode},
    select::Cut,
    source::{Fetched, ReadAt},
};

/// What the input named, with a source: see [`Objects`], whose questions it answers.
#[derive(Debug)]
pub struct FileObjects<'f, S> {
    file: &'f File<S>,
    objects: Objects<'f>,
}

impl<S: ReadAt> File<S> {
    /// What the input named, if the file says so.
    pub fn objects(&self) -> Option<FileObjects<'_, S>> {
        Some(FileObjects { file: self, objects: self.index().objects()? })
    }

    /// [`File::extract`] for a cut of leaves, and for each triangle the object that it belongs to.
    ///
    /// # Errors
    /// As [`decode::extract_objects`]; [`crate::Error::Io`].
    pub fn extract_objects(&self, cut: &Cut) -> Result<(Mesh, Vec<u32>)> {
        self.ask(|index, fetched| decode::extract_objects(index, cut, fetched))
    }

    /// [`File::extract_with_borders`], and for each triangle of a leaf the object that it belongs to. Groups have none.
    ///
    /// # Errors
    /// As [`decode::extract_objects_with_borders`]; [`crate::Error::Io`].
    pub fn extract_objects_with_borders(&self, cut: &Cut, border_level: u8) -> Result<(Mesh, Vec<Option<u32>>)> {
        self.ask(|index, fetched| decode::extract_objects_with_borders(index, cut, border_level, fetched))
    }

    /// The first point of the finest surface that a ray meets, from either side, and the object that it belongs to.
    ///
    /// # Errors
    /// As [`decode::pick`]; [`crate::Error::Io`].
    pub fn pick(&self, ray: Ray) -> Result<Option<Pick>> {
        self.ask(|index, fetched| decode::pick(index, ray, fetched))
    }

    /// As [`File::pick`], past the objects that a filter hides.
    ///
    /// # Errors
    /// As [`decode::pick_shown`]; [`crate::Error::Io`].
    pub fn pick_shown(&self, ray: Ray, filter: Option<&ObjectFilter>) -> Result<Option<Pick>> {
        self.ask(|index, fetched| decode::pick_shown(index, ray, filter, fetched))
    }

    /// What a choice of objects says of this file's roots, for [`crate::Query::objects`]: it is found once, and queries
    /// and extractions read no more of the objects.
    ///
    /// # Errors
    /// As [`Objects::filter`]; [`crate::Error::Io`]; [`Error::Query`] if the file has no objects.
    pub fn filter_objects(&self, choice: &ObjectChoice) -> Result<Arc<ObjectFilter>> {
        let what = || Error::Query { what: "this file has no objects; build it with --objects keep".into() };
        self.objects().ok_or_else(what)?.ask(|objects, fetched| objects.filter(choice, fetched))
    }

    /// A filter that hides some objects and assemblies, with everything below them.
    ///
    /// # Errors
    /// As [`File::filter_objects`].
    pub fn hide(&self, nodes: &[u32]) -> Result<Arc<ObjectFilter>> {
        self.filter_objects(&ObjectChoice::hide(nodes))
    }

    /// A filter that shows nothing but some objects and assemblies, with everything below them.
    ///
    /// # Errors
    /// As [`File::filter_objects`].
    pub fn only(&self, nodes: &[u32]) -> Result<Arc<ObjectFilter>> {
        self.filter_objects(&ObjectChoice::only(nodes))
    }
}

impl<S: ReadAt> FileObjects<'_, S> {
    fn ask<T>(&self, question: impl Fn(&Objects<'_>, &Fetched) -> Result<T>) -> Result<T> {
        self.file.ask(|_, fetched| question(&self.objects, fetched))
    }

    /// How many objects there are.
    pub fn count(&self) -> u32 {
        self.objects.count()
    }

    /// How many objects and assemblies there are.
    pub fn node_count(&self) -> u32 {
        self.objects.node_count()
    }

    /// Name, id and parent of an object or assembly.
    ///
    /// # Errors
    /// As [`Objects::node`], but that what is missing is read; [`crate::Error::Io`].
    pub fn node(&self, number: u32) -> Result<ObjectNode> {
        self.ask(|objects, fetched| objects.node(number, fetched))
    }

    /// The objects and assemblies of a name, ascending.
    ///
    /// # Errors
    /// As [`Self::node`].
    pub fn find_name(&self, name: &str) -> Result<Vec<u32>> {
        self.ask(|objects, fetched| objects.find_name(name, fetched))
    }

    /// The objects and assemblies of an id, ascending.
    ///
    /// # Errors
    /// As [`Self::node`].
    pub fn find_id(&self, id: &str) -> Result<Vec<u32>> {
        self.ask(|objects, fetched| objects.find_id(id, fetched))
    }

    /// What an object or assembly consists of, ascending; without a number, all that is a part of nothing.
    ///
    /// # Errors
    /// As [`Self::node`].
    pub fn children(&self, parent: Option<u32>) -> Result<Vec<u32>> {
        self.ask(|objects, fetched| objects.children(parent, fetched))
    }

    /// The pages of nodes in which children of an object or assembly are.
    ///
    /// # Errors
    /// As [`Self::node`].
    pub fn child_pages(&self, parent: Option<u32>) -> Result<Vec<u32>> {
        self.ask(|objects, fetched| objects.child_pages(parent, fetched))
    }

    /// The children of an object or assembly in a page of nodes, ascending.
    ///
    /// # Errors
    /// As [`Self::node`].
    pub fn children_in(&self, parent: Option<u32>, page: u32) -> Result<Vec<u32>> {
        self.ask(|objects, fetched| objects.children_in(parent, page, fetched))
    }

    /// The objects among some nodes and everything below these, ascending.
    ///
    /// # Errors
    /// As [`Self::node`].
    pub fn below(&self, nodes: &[u32]) -> Result<Vec<u32>> {
        self.ask(|objects, fetched| objects.below(nodes, fetched))
    }

    /// A world box around some objects and assemblies with everything below them; None if the file has nothing of them.
    ///
    /// # Errors
    /// As [`decode::object_bounds`]; [`crate::Error::Io`].
    pub fn bounds(&self, nodes: &[u32]) -> Result<Option<[[f64; 3]; 2]>> {
        self.file.ask(|index, fetched| decode::object_bounds(index, nodes, fetched))
    }

    /// What an object or assembly is a part of: its parent, that one's parent, and so on.
    ///
    /// # Errors
    /// As [`Self::node`].
    pub fn above(&self, number: u32) -> Result<Vec<u32>> {
        self.ask(|objects, fetched| objects.above(number, fetched))
    }

    /// The objects of a leaf.
    ///
    /// # Errors
    /// As [`Objects::of_leaf`]; [`crate::Error::Io`].
    pub fn of_leaf(&self, root: u32) -> Result<Vec<u32>> {
        self.ask(|objects, fetched| objects.of_leaf(root, fetched))
    }

    /// For each of [`crate::islands`] of a leaf's block the object that it belongs to.
    ///
    /// # Errors
    /// As [`Objects::owners`]; [`crate::Error::Io`].
    pub fn owners(&self, root: u32, level: u8) -> Result<Vec<u32>> {
        self.ask(|objects, fetched| objects.owners(root, level, fetched))
    }

    /// The leaves that hold an object, ascending.
    ///
    /// # Errors
    /// As [`Objects::leaves`]; [`crate::Error::Io`].
    pub fn leaves(&self, object: u32) -> Result<Vec<u32>> {
        self.ask(|objects, fetched| objects.leaves(object, fetched))
    }

    /// All objects, then all assemblies, by their numbers.
    ///
    /// # Errors
    /// As [`Self::node`].
    pub fn nodes(&self) -> Result<Vec<ObjectNode>> {
        let mut nodes = vec![];
        for page in 0..self.page_count() {
            nodes.extend(self.page(page)?);
        }
        Ok(nodes)
    }

    /// How many pages of up to 1024 nodes there are, for those that want many.
    pub fn page_count(&self) -> u32 {
        self.node_count().div_ceil(1024)
    }

    /// The nodes of a page, from 1024 times its number on.
    ///
    /// # Errors
    /// As [`Self::node`].
    pub fn page(&self, page: u32) -> Result<Vec<ObjectNode>> {
        self.ask(|objects, fetched| Ok(objects.open().nodes(page, fetched)?.to_vec()))
    }
}
