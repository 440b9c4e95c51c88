//! From the views of frames to two cuts: the one that a frame wants, and the one that later frames will probably want.

use std::{sync::Arc, time::Duration};

use super::Expecter;
use crate::{
    error::Result,
    select::{Adapter, Coherence, Cut, Hierarchy, Node, Query},
};

/// Follows a camera with two cuts that adapt from frame to frame: one to its view, the other to the view that its
/// motion predicts.
#[derive(Clone, Debug)]
pub struct Follower {
    hierarchy: Arc<Hierarchy>,
    coherence: Coherence,
    expecter: Expecter,
    /// Made by the first frames that need them.
    now: Option<Adapter>,
    later: Option<Adapter>,
}

impl Follower {
    /// A follower that looks this far ahead: a few times the duration of a read, or zero to disable prediction.
    pub fn new(hierarchy: Arc<Hierarchy>, coherence: Coherence, ahead: Duration) -> Self {
        Self { hierarchy, coherence, expecter: Expecter::new(ahead), now: None, later: None }
    }

    /// The cut that a query wants at a time, and the nodes of the predicted view's cut. There are none if the query has
    /// no view, the camera stands still, or the prediction is no view. Hand both to [`super::Session::begin`].
    ///
    /// # Errors
    /// As [`Adapter::update`].
    pub fn follow(&mut self, query: &Query, now: Duration) -> Result<(Cut, Vec<Node>)> {
        let wanted = adapted(&mut self.now, &self.hierarchy, query, self.coherence)?;
        let Some(query) = self.expecter.expect(query, now) else { return Ok((wanted, Vec::new())) };
        // A view that is only predicted must not fail the frame.
        let expected = adapted(&mut self.later, &self.hierarchy, &query, self.coherence);
        Ok((wanted, expected.map_or(Vec::new(), |expected| expected.nodes)))
    }

    /// Follows with a cut of a hierarchy that has other parts of the same file.
    pub fn replace(&mut self, adapter: Adapter) {
        self.hierarchy = Arc::clone(adapter.whole());
        self.later = self.later.is_some().then(|| adapter.clone());
        self.now = Some(adapter);
    }

    /// The hierarchy that cuts are chosen from.
    pub fn hierarchy(&self) -> &Arc<Hierarchy> {
        &self.hierarchy
    }
}

fn adapted(
    adapter: &mut Option<Adapter>,
    hierarchy: &Arc<Hierarchy>,
    query: &Query,
    coherence: Coherence,
) -> Result<Cut> {
    let adapter = match adapter {
        Some(adapter) => {
            adapter.update(query)?;
            adapter
        }
        none => none.insert(Adapter::new(hierarchy.clone(), query, coherence)?),
    };
    Ok(adapter.cut())
}
