//! Whether the objects of an input are kept.

use lodpack_import::Objects;
use lodpack_mesh::attributes::Attributes;
use lodpack_runtime::progress::Progress;

use super::meeting::{ForEachTriangle, meeting_objects};

/// Joins the objects of an input of some triangles if at least half of them meet others at open edges, unless they are
/// to be kept in any case. A note says what was done.
///
/// # Errors
/// Those of `for_each`.
pub fn settle_objects<E>(
    choice: Objects,
    attributes: &mut Attributes,
    triangles: u64,
    memory: u64,
    progress: &dyn Progress,
    for_each: &mut ForEachTriangle<'_, E>,
) -> Result<(), E> {
    let [objects, _] = attributes.node_counts();
    if choice != Objects::Auto || objects < 2 {
        return Ok(());
    }
    let meeting = meeting_objects(attributes, triangles, memory, for_each)?;
    if 2 * meeting >= objects {
        attributes.join_objects();
        progress.note(&format!(
            "{meeting} of {objects} objects meet others at open edges, as tiles of a scan do: all were joined to one surface \
             without names; --objects keep keeps them"
        ));
    } else if meeting > 0 {
        progress.note(&format!(
            "{meeting} of {objects} objects meet others at open edges and were kept apart: they may come apart there where they are \
             drawn coarsely; --objects join joins all to one surface without names"
        ));
    }
    Ok(())
}
