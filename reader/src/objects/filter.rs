//! What is drawn of objects: which roots show what alone, and of leaves that show several things, which islands.

use crate::{
    error::{Error, Result},
    format::header::FileId,
    islands::islands,
    sorted::SortedMap,
};

/// What is to be drawn of objects. A number stands for its node and everything below it; the default draws everything.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ObjectChoice {
    /// Objects and assemblies outside which nothing is drawn; without any list, everything is.
    pub only: Option<Vec<u32>>,
    /// Objects and assemblies that are not drawn, even if they are in `only`.
    pub hidden: Vec<u32>,
    /// Objects and assemblies that are told apart where they are drawn, as a selection is.
    pub marked: Vec<u32>,
    /// Whether nothing is drawn but what is marked, of what would be drawn without this: a selection as a picture of
    /// its own.
    pub only_marked: bool,
}

impl ObjectChoice {
    /// Everything but these.
    pub fn hide(nodes: &[u32]) -> Self {
        Self { hidden: nodes.to_vec(), ..Self::default() }
    }

    /// Nothing but these.
    pub fn only(nodes: &[u32]) -> Self {
        Self { only: Some(nodes.to_vec()), ..Self::default() }
    }

    /// Whether it draws everything alike.
    pub fn is_everything(&self) -> bool {
        self.only.is_none() && self.hidden.is_empty() && self.marked.is_empty() && !self.only_marked
    }
}

/// How an object is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ObjectState {
    /// Not at all.
    Hidden,
    /// As always.
    #[default]
    Shown,
    /// As a part of a selection.
    Marked,
}

/// An [`ObjectChoice`] for a file: what it says of roots. [`crate::index::Objects::filter`] finds it once; queries and
/// extractions take it without reading more of the objects.
///
/// A leaf may hold objects of several states; then its islands have one each. A group whose leaves have several states
/// cannot be drawn as what it is: cuts have what is below it instead, and its triangles only stand in while that is
/// being loaded.
#[derive(Clone, Debug)]
pub struct ObjectFilter {
    pub(crate) file: FileId,
    pub(crate) choice: ObjectChoice,
    /// Of all roots but those below.
    pub(crate) rest: ObjectState,
    /// Leaves and groups: None where they are of several states.
    pub(crate) roots: SortedMap<u32, Option<ObjectState>>,
    /// Leaves of several states: for each level with a block the states of its islands.
    pub(crate) leaves: SortedMap<u32, Vec<(u8, Vec<ObjectState>)>>,
    pub(crate) has: HasFilters,
}

/// What has this needs the feature `channels`. Without the feature nothing has it, and compilers leave out all code for
/// what nothing has.
#[derive(Clone, Copy, Debug)]
pub(crate) enum HasFilters {
    #[cfg(feature = "channels")]
    Yes,
}

/// Proof that this reader draws some of a file's objects.
///
/// # Errors
/// [`Error::Unsupported`] without the feature `channels`.
pub(crate) fn has_filters() -> Result<HasFilters> {
    #[cfg(feature = "channels")]
    return Ok(HasFilters::Yes);
    #[cfg(not(feature = "channels"))]
    return Err(Error::Unsupported {
        what: "this one hides no objects (it was compiled without its feature `channels`)".into(),
    });
}

/// Two filters of a file are the same if their choices are.
impl PartialEq for ObjectFilter {
    fn eq(&self, other: &Self) -> bool {
        self.is_there();
        self.file == other.file && self.choice == other.choice
    }
}

impl Eq for ObjectFilter {}

impl ObjectFilter {
    /// What was chosen.
    pub fn choice(&self) -> &ObjectChoice {
        &self.choice
    }

    /// What comes after this is compiled only where filters are.
    #[inline(always)]
    pub(crate) fn is_there(&self) {
        match self.has {
            #[cfg(feature = "channels")]
            HasFilters::Yes => {}
        }
    }

    /// How all of a root is drawn; None if it shows objects of several states.
    pub fn state(&self, root: u32) -> Option<ObjectState> {
        self.is_there();
        self.roots.get(&root).copied().unwrap_or(Some(self.rest))
    }

    /// Whether a root is a group that cannot be drawn as what it is.
    pub(crate) fn splits(&self, root: u32) -> bool {
        self.state(root).is_none() && !self.leaves.contains_key(&root)
    }

    /// The states of the islands of a leaf at a level; None unless it is of several states and has a block there.
    pub(crate) fn islands(&self, root: u32, level: u8) -> Option<&[ObjectState]> {
        self.is_there();
        let levels = self.leaves.get(&root)?;
        levels.iter().find(|(at, _)| *at == level).map(|(_, states)| &states[..])
    }

    /// The states of a block's triangles.
    ///
    /// # Errors
    /// [`Error::Query`] if the root is a group of several states; [`Error::Format`].
    pub(crate) fn states(&self, root: u32, level: u8, triangles: &[[u32; 3]]) -> Result<TriangleStates<'_>> {
        self.is_there();
        if let Some(state) = self.state(root) {
            return Ok(TriangleStates { all: state, islands: None });
        }
        let what =
            || Error::Query { what: "a group shows hidden objects beside others; select with the filter".into() };
        let states = self.islands(root, level).ok_or_else(what)?;
        let (labels, count) = islands(triangles);
        if states.len() != count as usize {
            return Err(Error::format("a block has other islands than owners"));
        }
        Ok(TriangleStates { all: ObjectState::Shown, islands: Some((labels, states)) })
    }
}

/// The states of a block's triangles, in the order of its patch.
pub(crate) struct TriangleStates<'f> {
    all: ObjectState,
    /// Each triangle's island, and each island's state.
    islands: Option<(Vec<u32>, &'f [ObjectState])>,
}

impl TriangleStates<'_> {
    pub fn of(&self, triangle: u32) -> ObjectState {
        let Some((labels, states)) = &self.islands else { return self.all };
        let label = labels.get(triangle as usize).copied().unwrap_or(u32::MAX);
        states.get(label as usize).copied().unwrap_or(self.all)
    }
}
