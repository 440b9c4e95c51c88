//! What the input named: found, picked, hidden and shown alone. `js/objects.js` makes these calls and reads answers.

use std::sync::Arc;

use lodpack::{
    Error, Fetched, Index, decode,
    index::{Objects, Ray},
    objects::{ObjectChoice, ObjectFilter},
    select,
};

use crate::{
    answer::{Answer, Put, floats, put_mesh, words, wrong},
    query,
    state::State,
};

/// Stands for no node, name, id, list or filter.
const NONE: u32 = u32::MAX;

fn of(index: &Index) -> Result<Objects<'_>, Error> {
    index.objects().ok_or_else(|| wrong("this file has no objects; build it with --objects keep"))
}

impl State {
    /// The numbers of objects and of nodes; returns 0 if there are none.
    pub fn objects(&mut self) -> Answer {
        // Heights have none.
        let Ok(index) = self.index().cloned() else { return Ok(0) };
        let Some(objects) = index.objects() else { return Ok(0) };
        self.output.put_words([objects.count(), objects.node_count()]);
        Ok(1)
    }

    fn ask_objects<T>(
        &mut self,
        question: u32,
        answer: impl FnOnce(Objects<'_>, &Fetched) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let index = Arc::clone(self.index()?);
        answer(of(&index)?, self.questions.get(question)?)
    }

    /// The nodes whose numbers are in the input: for each its parent and how long name and id are, and then these.
    pub fn object_nodes(&mut self, question: u32) -> Answer {
        let numbers: Vec<u32> = words(&self.input).collect();
        let nodes = self.ask_objects(question, |objects, fetched| {
            numbers.iter().map(|&number| objects.node(number, fetched)).collect::<Result<Vec<_>, _>>()
        })?;
        let length = |text: &Option<String>| text.as_ref().map_or(NONE, |text| text.len() as u32);
        let of_node = nodes.iter().flat_map(|node| [node.parent.unwrap_or(NONE), length(&node.name), length(&node.id)]);
        self.output.put_words(of_node);
        let texts = nodes.iter().flat_map(|node| [&node.name, &node.id]).flatten();
        texts.for_each(|text| self.output.extend(text.bytes()));
        Ok(nodes.len() as u32)
    }

    fn put_numbers(&mut self, numbers: Vec<u32>) -> Answer {
        let count = numbers.len() as u32;
        self.output.put_words(numbers);
        Ok(count)
    }

    /// The nodes of the name in the input or, if there are none, of that id.
    pub fn find_objects(&mut self, question: u32) -> Answer {
        let text = String::from_utf8_lossy(&self.input).into_owned();
        let found = self.ask_objects(question, |objects, fetched| {
            let found = objects.find_name(&text, fetched)?;
            if found.is_empty() { objects.find_id(&text, fetched) } else { Ok(found) }
        })?;
        self.put_numbers(found)
    }

    /// The pages of nodes in which a node has children, or those that are a part of nothing.
    pub fn object_child_pages(&mut self, question: u32, parent: u32) -> Answer {
        let parent = (parent != NONE).then_some(parent);
        let pages = self.ask_objects(question, |objects, fetched| objects.child_pages(parent, fetched))?;
        self.put_numbers(pages)
    }

    /// The children of a node in such a page.
    pub fn object_children(&mut self, question: u32, parent: u32, page: u32) -> Answer {
        let parent = (parent != NONE).then_some(parent);
        let children = self.ask_objects(question, |objects, fetched| objects.children_in(parent, page, fetched))?;
        self.put_numbers(children)
    }

    /// What lies above a node, its parent first.
    pub fn objects_above(&mut self, question: u32, number: u32) -> Answer {
        let above = self.ask_objects(question, |objects, fetched| objects.above(number, fetched))?;
        self.put_numbers(above)
    }

    /// A box around the nodes in the input; returns 0 if there is nothing of them.
    pub fn object_bounds(&mut self, question: u32) -> Answer {
        let numbers: Vec<u32> = words(&self.input).collect();
        let index = Arc::clone(self.index()?);
        let bounds = decode::object_bounds(&index, &numbers, self.questions.get(question)?)?;
        self.output.put_floats(bounds.into_iter().flatten().flatten());
        Ok(u32::from(bounds.is_some()))
    }

    /// A filter for the choice in the input: 1 if only what is marked is drawn, and three lists, each after its length.
    pub fn filter_objects(&mut self, question: u32) -> Answer {
        let input = std::mem::take(&mut self.input);
        let mut numbers = words(&input);
        let only_marked = numbers.next() == Some(1);
        let mut list = || -> Option<Vec<u32>> {
            let count = numbers.next().filter(|&count| count != NONE)?;
            Some(numbers.by_ref().take(count as usize).collect())
        };
        let (only, hidden, marked) = (list(), list().unwrap_or_default(), list().unwrap_or_default());
        let choice = ObjectChoice { only, hidden, marked, only_marked };
        let filter = self.ask_objects(question, |objects, fetched| objects.filter(&choice, fetched))?;
        Ok(self.filters.add(filter))
    }

    /// Gives a filter back.
    pub fn close_filter(&mut self, filter: u32) -> Answer {
        self.filters.close(filter);
        Ok(0)
    }

    /// A filter by its number; none for that of none.
    pub fn filter(&mut self, filter: u32) -> Result<Option<Arc<ObjectFilter>>, Error> {
        if filter == NONE { Ok(None) } else { self.filters.get(filter).map(|filter| Some(Arc::clone(filter))) }
    }

    /// The mesh of the query in the input, of the objects that a filter shows.
    pub fn extract_objects(&mut self, question: u32, filter: u32) -> Answer {
        let mut query = query::unpack(floats(&self.input))?;
        query.objects = self.filter(filter)?;
        let index = Arc::clone(self.index()?);
        let cut = select::select_cut(&index, &query)?;
        let mesh = decode::extract(&index, &cut, self.questions.get(question)?)?;
        put_mesh(&mut self.output, &mesh);
        Ok(0)
    }

    /// What the ray in the input meets first of what a filter shows; returns 0 if it meets nothing.
    pub fn pick(&mut self, question: u32, filter: u32) -> Answer {
        let input = std::mem::take(&mut self.input);
        let mut numbers = floats(&input);
        let mut point = || [0; 3].map(|_| numbers.next().unwrap_or(f64::NAN));
        let ray = Ray { origin: point(), direction: point() };
        let filter = self.filter(filter)?;
        let index = Arc::clone(self.index()?);
        let pick = decode::pick_shown(&index, ray, filter.as_deref(), self.questions.get(question)?)?;
        let Some(pick) = pick else { return Ok(0) };
        let object = pick.object.map_or(f64::NAN, f64::from);
        self.output.put_floats([object, f64::from(pick.root), pick.distance, pick.error].into_iter().chain(pick.point));
        Ok(1)
    }
}
