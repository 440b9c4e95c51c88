//! The rules that a model has to keep.

use crate::{
    codec::{
        arc::{MAX_TANGENT_SHIFT, PARAM_END},
        filling::{Filling, Quantisation},
    },
    error::{Error, Result},
    format::{
        channels::{self, ChannelInfo, ChannelKind},
        error_code::ErrorCode,
        records::MAX_LEVELS,
    },
    write::model::{ArcRecord, Model, RootRecord},
};

/// Checks everything that the numbering and encoding rely on.
pub(super) fn check(model: &Model) -> Result<()> {
    model.lattice.check().map_err(|error| Error::model(error.to_string()))?;
    let mut steps = model.levels.iter().flat_map(|level| Filling::all().map(|filling| level.steps[filling]));
    let shifts_fit = steps.all(Quantisation::is_valid);
    if !shifts_fit || model.arc_tangent_shift > MAX_TANGENT_SHIFT {
        return Err(Error::model("a shift is above 40"));
    }
    if model.levels.is_empty() || model.levels.len() > MAX_LEVELS {
        return Err(Error::model(format!("a model has 1 to {MAX_LEVELS} levels, not {}", model.levels.len())));
    }
    if [model.corners.len(), model.arcs.len(), model.roots.len()].iter().any(|&count| count >= 1 << 31) {
        return Err(Error::model("2^31 or more corners, arcs or roots"));
    }
    if let Some(corner) = model.corners.iter().position(|p| p.iter().any(|x| x.unsigned_abs() > 1 << 40)) {
        return Err(Error::model(format!("corner {corner} lies beyond 2^40 lattice steps; choose a larger step")));
    }
    check_channels(&model.channels)?;
    let is_level = |&level: &u8| usize::from(level) < model.levels.len();
    if ![0, model.corners.len()].contains(&model.corner_levels.len()) || !model.corner_levels.iter().all(is_level) {
        return Err(Error::model("a corner has no level, or one out of range"));
    }
    for (index, arc) in model.arcs.iter().enumerate() {
        check_arc(model, arc).map_err(|what| Error::model(format!("arc {index}: {what}")))?;
    }
    let mut is_end = vec![false; model.corners.len()];
    model.arcs.iter().flat_map(|arc| arc.ends).for_each(|corner| is_end[corner as usize] = true);
    if let Some(corner) = is_end.iter().position(|&is_end| !is_end) {
        return Err(Error::model(format!("corner {corner} is the end of no arc")));
    }
    let mut has_child = vec![false; model.roots.len()];
    for (index, root) in model.roots.iter().enumerate() {
        let result = check_root(model, root).and_then(|()| check_parent(model, root, &mut has_child));
        result.map_err(|what| Error::model(format!("root {index}: {what}")))?;
    }
    check_arc_uses(model, &has_child)
}

/// Checks the list of channels.
pub(super) fn check_channels(channels: &[ChannelInfo]) -> Result<()> {
    let is_unknown = |channel: &ChannelInfo| matches!(channel.kind, ChannelKind::Unknown(_));
    match channels::broken_rule(channels) {
        Some(rule) => Err(Error::model(rule)),
        None if channels.iter().any(is_unknown) => Err(Error::model("a channel is of an unknown kind")),
        None => Ok(()),
    }
}

/// The coarsest and the finest level at which a root has a block.
fn end_levels(root: &RootRecord) -> Option<[usize; 2]> {
    Some([root.blocks.iter().position(Option::is_some)?, root.blocks.iter().rposition(Option::is_some)?])
}

/// Levels ascend from parent to child, so there are no cycles.
fn check_parent(model: &Model, root: &RootRecord, has_child: &mut [bool]) -> std::result::Result<(), &'static str> {
    let Some(parent) = root.parent else { return Ok(()) };
    let above = model.roots.get(parent as usize).ok_or("its parent does not exist")?;
    match (end_levels(above), end_levels(root)) {
        (Some([_, finest]), Some([coarsest, _])) if coarsest == finest + 1 => {}
        _ => return Err("its coarsest level does not follow its parent's finest one"),
    }
    if (0..3).any(|k| above.bounds[0][k] > root.bounds[0][k] || above.bounds[1][k] < root.bounds[1][k]) {
        return Err("it reaches out of its parent's bounds");
    }
    has_child[parent as usize] = true;
    Ok(())
}

/// At every level an arc has at most two users, and what has no children uses all arcs.
fn check_arc_uses(model: &Model, has_child: &[bool]) -> Result<()> {
    let mut use_counts = vec![0_u8; model.arcs.len() * model.levels.len()];
    for (root, &has_child) in model.roots.iter().zip(has_child) {
        let Some([coarsest, finest]) = end_levels(root) else { continue };
        let first = if root.parent.is_none() { 0 } else { coarsest };
        let last = if has_child { finest } else { model.levels.len() - 1 };
        for half_arc in root.loops.iter().flatten() {
            for count in &mut use_counts[half_arc.arc as usize * model.levels.len()..][first..=last] {
                *count = count.saturating_add(1);
            }
        }
    }
    for (arc, counts) in use_counts.chunks(model.levels.len()).enumerate() {
        let finest = counts[counts.len() - 1];
        if finest == 0 || counts.iter().any(|&count| count > 2) {
            let count = counts.iter().max().unwrap_or(&0);
            return Err(Error::model(format!("arc {arc} is used {count} times; once or twice it must be")));
        }
    }
    Ok(())
}

/// The codes of the levels' tolerances, against which errors are stored.
pub(super) fn tolerance_codes(model: &Model) -> Result<Vec<ErrorCode>> {
    let mut coarser = f64::INFINITY;
    for level in &model.levels {
        if !(level.tolerance >= 0.0 && level.tolerance <= coarser && level.tolerance.is_finite()) {
            return Err(Error::model("a tolerance is negative, not finite or larger than the coarser level's"));
        }
        coarser = level.tolerance;
    }
    model.levels.iter().map(|level| ErrorCode::at_least(level.tolerance, &model.lattice)).collect()
}

fn check_arc(model: &Model, arc: &ArcRecord) -> std::result::Result<(), &'static str> {
    let [first, second] = arc.ends;
    if first == second || first.max(second) as usize >= model.corners.len() {
        return Err("its ends are the same corner, or do not exist");
    }
    if arc.samples.windows(2).any(|pair| pair[0].param >= pair[1].param) {
        return Err("its samples are not in order of their parameters");
    }
    if arc.samples.iter().any(|s| s.param == 0 || s.param >= PARAM_END || usize::from(s.level) >= model.levels.len()) {
        return Err("a sample has a parameter or level out of range");
    }
    Ok(())
}

fn check_root(model: &Model, root: &RootRecord) -> std::result::Result<(), &'static str> {
    if root.blocks.len() != model.levels.len() || root.blocks.iter().all(Option::is_none) {
        return Err("it needs an entry for every level, and at least one block");
    }
    for half_arcs in &root.loops {
        if half_arcs.len() < 2 {
            return Err("a loop has fewer than two half-arcs");
        }
        let mut ends = Vec::with_capacity(half_arcs.len());
        for half_arc in half_arcs {
            let arc = model.arcs.get(half_arc.arc as usize).ok_or("an arc does not exist")?;
            let [first, second] = arc.ends;
            ends.push(if half_arc.reversed { [second, first] } else { [first, second] });
        }
        if (0..ends.len()).any(|i| ends[i][1] != ends[(i + 1) % ends.len()][0]) {
            return Err("a half-arc does not end where the next one begins");
        }
        let coarsest = end_levels(root).map_or(0, |[coarsest, _]| coarsest);
        if model.corner_levels.get(ends[0][0] as usize).is_some_and(|&level| usize::from(level) > coarsest) {
            return Err("a loop does not begin with a corner that is a vertex at the root's coarsest level");
        }
    }
    Ok(())
}
