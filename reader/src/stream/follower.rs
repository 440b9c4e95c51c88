//! From the views of frames to cuts: the one that is wanted, and the one that will probably be wanted.

use std::{sync::Arc, time::Duration};

use super::{Motion, Pose};
use crate::{
    error::Result,
    select::{Adapter, Coherence, Cut, Hierarchy, Node, Query, View},
};

/// Follows a camera: two cuts that adapt from frame to frame, one to where it is and one to where its motion leads.
#[derive(Clone, Debug)]
pub struct Follower {
    hierarchy: Arc<Hierarchy>,
    coherence: Coherence,
    ahead: Duration,
    motion: Motion,
    /// From the first frames on that need them.
    now: Option<Adapter>,
    later: Option<Adapter>,
}

impl Follower {
    /// Looks so far ahead: a few times what a read takes; zero for not at all.
    pub fn new(hierarchy: Arc<Hierarchy>, coherence: Coherence, ahead: Duration) -> Self {
        Self { hierarchy, coherence, ahead, motion: Motion::new(), now: None, later: None }
    }

    /// The cut that a query wants at a time, and the nodes that the motion of its view lets expect: none where that has no
    /// view, stands still, or leads to no view. Both are what [`super::Session::begin`] takes.
    ///
    /// # Errors
    /// As [`Adapter::update`].
    pub fn follow(&mut self, query: &Query, now: Duration) -> Result<(Cut, Vec<Node>)> {
        let wanted = adapted(&mut self.now, &self.hierarchy, query, self.coherence)?;
        if let (Some(view), false) = (query.view, self.ahead.is_zero()) {
            self.motion.observe(now, Pose::from(&view));
            if let Some(Pose { position, forward, up }) = self.motion.predict(self.ahead) {
                let query = Query { view: Some(View { position, forward, up, ..view }), ..*query };
                // A view that is only expected stops no frame.
                let expected = adapted(&mut self.later, &self.hierarchy, &query, self.coherence);
                return Ok((wanted, expected.map_or(Vec::new(), |expected| expected.nodes)));
            }
        }
        Ok((wanted, Vec::new()))
    }

    /// What cuts are made from.
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
