//! Arcs: from index blocks and arc streams to paths with samples.

use crate::{
    codec::arc::Path,
    error::{Error, Result},
    index::{
        Index,
        needs::{ArcRunNeed, Needs, PartKey, corner_owners, raise},
    },
    lattice::LatticePoint,
    sorted::SortedMap,
};

/// Decodes the arc runs that are needed.
pub(super) fn decode_arcs<'b>(
    index: &Index,
    needs: &Needs,
    part: &dyn Fn(PartKey) -> &'b [u8],
) -> Result<SortedMap<u32, Vec<Path>>> {
    let mut paths = place_arcs(index, needs)?;
    let scheme = index.scheme();
    let mut finest: SortedMap<u32, u8> = SortedMap::new();
    for (&(cluster, _), need) in needs.arc_runs.iter() {
        raise(&mut finest, cluster, need.finest);
    }
    for (&cluster, &finest) in finest.iter() {
        let Some(paths) = paths.get_mut(&cluster) else { continue };
        let result = index.cluster_index(cluster)?.place_arcs(&scheme, paths, finest);
        result.map_err(|error| error.at(|| format!("arcs of the index block of cluster {cluster}")))?;
    }
    for (&(cluster, run), need) in needs.arc_runs.iter() {
        let Some(paths) = paths.get_mut(&cluster) else { continue };
        let cluster_index = index.cluster_index(cluster)?;
        for level in scheme.levels.index_arc_levels..=need.finest {
            let key = PartKey::Arcs { level, cluster, run };
            let result = cluster_index.decode_arc_run(&scheme, paths, (level, run, need.last), part(key));
            result.map_err(|error| error.at(|| key.location()))?;
        }
    }
    Ok(paths)
}

/// The arcs of all clusters that own a needed arc, without samples. Needed arcs get the positions of their ends. The
/// others have none, so that the index blocks that own their corners are not needed.
fn place_arcs(index: &Index, needs: &Needs) -> Result<SortedMap<u32, Vec<Path>>> {
    let mut ends: Vec<(u32, u32, [u32; 2])> = Vec::with_capacity(needs.arcs.len());
    index.load_indices(corner_owners(index, needs)?)?;
    for &arc in needs.arcs.keys() {
        let owner = index.owner(arc, |cluster| cluster.first_arc)?;
        let local = arc - index.cluster(owner)?.first_arc;
        let corners = index.cluster_index(owner)?.arc_ends.get(local as usize).copied();
        let corners = corners.ok_or_else(|| Error::format("an arc does not exist"))?;
        ends.push((owner, local, corners));
    }
    let index_arc_levels = index.levels().index_arc_levels;
    let corner = |id: u32| -> Result<(LatticePoint, u8)> {
        let owner = index.owner(id, |cluster| cluster.first_corner)?;
        let local = (id - index.cluster(owner)?.first_corner) as usize;
        let of_cluster = index.cluster_index(owner)?;
        let corner = of_cluster.corners.get(local).copied().zip(of_cluster.corner_levels.get(local).copied());
        corner.ok_or_else(|| Error::format("a corner does not exist"))
    };
    let mut paths: SortedMap<u32, Vec<Path>> = SortedMap::new();
    for (owner, local, corners) in ends {
        let arc_count = index.cluster_index(owner)?.arc_ends.len();
        let paths = paths.or_insert_with(owner, || vec![Path::absent(); arc_count]);
        let [(first, first_level), (second, second_level)] = [corner(corners[0])?, corner(corners[1])?];
        paths[local as usize] = Path::new([first, second]).with_end_levels([first_level, second_level]);
    }
    // Arcs before them in the streams of their runs are decoded and skipped.
    for (&(owner, run), &ArcRunNeed { finest, last }) in needs.arc_runs.iter() {
        let (Some(paths), index) = (paths.get_mut(&owner), index.cluster_index(owner)?) else { continue };
        for local in index.arc_run(run).start..last + 1 {
            let Some(path) = paths.get_mut(local as usize) else { continue };
            if path.is_absent() && finest >= index_arc_levels {
                *path = Path::skipped();
            }
            if !path.is_absent() {
                path.reserve(index.sample_count(local, finest));
            }
        }
    }
    Ok(paths)
}
