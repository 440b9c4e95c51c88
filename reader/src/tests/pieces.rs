//! A file that is written piece by piece is the file of the whole.

use std::collections::BTreeMap;
use std::io::Cursor;

use proptest::prelude::*;

use super::synthetic::{Options, add_channels, cube, model};
use crate::{
    File, Limits, Result,
    format::records::HalfArc,
    write::{Above, ArcRecord, Assembly, Model, Output, Piece, RootRecord, Share, Shares, write_file},
};

const OPTIONS: Options = Options { levels: 4, seed: 3, grids_of_four: 1, heights: 0 };

/// Some roots of a model with the arcs and corners that they use, and which of these `others` use, too.
struct Cut {
    model: Model,
    arcs: Vec<u32>,
    corners: Vec<u32>,
}

fn cut(whole: &Model, roots: &[RootRecord]) -> Cut {
    let mut arcs: Vec<u32> = roots.iter().flat_map(|root| root.loops.iter().flatten()).map(|half| half.arc).collect();
    arcs.sort_unstable();
    arcs.dedup();
    let mut corners: Vec<u32> = arcs.iter().flat_map(|&arc| whole.arcs[arc as usize].ends).collect();
    corners.sort_unstable();
    corners.dedup();
    let place = |all: &[u32], one: u32| all.binary_search(&one).unwrap() as u32;
    let arc_record = |&arc: &u32| {
        let ArcRecord { ends, samples } = whole.arcs[arc as usize].clone();
        ArcRecord { ends: ends.map(|end| place(&corners, end)), samples }
    };
    let mut roots = roots.to_vec();
    for HalfArc { arc, .. } in roots.iter_mut().flat_map(|root| root.loops.iter_mut().flatten()) {
        *arc = place(&arcs, *arc);
    }
    let model = Model {
        arcs: arcs.iter().map(arc_record).collect(),
        corners: corners.iter().map(|&corner| whole.corners[corner as usize]).collect(),
        roots,
        ..whole.clone()
    };
    Cut { model, arcs, corners }
}

fn pieces(whole: &Model, root_counts: &[usize]) -> Vec<Piece> {
    let mut left = &whole.roots[..];
    let mut cuts = Vec::new();
    for &count in root_counts {
        let (roots, rest) = left.split_at(count);
        cuts.push(cut(whole, roots));
        left = rest;
    }
    assert!(left.is_empty());
    // Numbers of what is shared have nothing to do with other numbers.
    let shares = |things: &dyn Fn(&Cut) -> &Vec<u32>, piece: usize| -> Vec<Option<Share>> {
        let mut users: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for (number, cut) in cuts.iter().enumerate() {
            things(cut).iter().for_each(|&thing| users.entry(thing).or_default().push(number));
        }
        let share = |thing: &u32| {
            let users = &users[thing];
            (users.len() > 1).then(|| Share { number: 1000 - thing, is_first: users[0] == piece })
        };
        things(&cuts[piece]).iter().map(share).collect()
    };
    let piece = |number: usize| {
        let shares = Shares { corners: shares(&|cut| &cut.corners, number), arcs: shares(&|cut| &cut.arcs, number) };
        Piece::new(&cuts[number].model, &shares).unwrap()
    };
    (0..cuts.len()).map(piece).collect()
}

fn written(head: &Model, pieces: &[Piece]) -> Result<Vec<u8>> {
    let mut assembly = Assembly::new(head)?;
    pieces.iter().try_for_each(|piece| assembly.count(&piece.index))?;
    let encoder = assembly.arrange()?.seal(None);
    #[cfg(feature = "serde")]
    let elsewhere = written_elsewhere(&encoder, pieces)?;
    let mut output = Output::new(encoder, || Ok(Cursor::new(Vec::new())))?;
    // They may come in any order now, and so may clusters be encoded.
    pieces.iter().enumerate().rev().try_for_each(|(number, piece)| output.take(number, piece))?;
    let mut encoded = Vec::new();
    for cluster in (0..output.encoder().cluster_count()).rev() {
        let symbols = output.symbols(cluster)?;
        encoded.push(output.encoder().encode(&symbols)?);
    }
    encoded.into_iter().rev().try_for_each(|cluster| output.add(cluster))?;
    let mut bytes = Vec::new();
    output.finish(&mut bytes)?;
    #[cfg(feature = "serde")]
    assert!(bytes == elsewhere, "clusters encoded elsewhere make another file");
    Ok(bytes)
}

/// The same, with clusters that are encoded piece by piece.
#[cfg(feature = "serde")]
fn written_elsewhere(encoder: &crate::write::Encoder, pieces: &[Piece]) -> Result<Vec<u8>> {
    let mut output = Output::new(encoder.head().encoder()?, || Ok(Cursor::new(Vec::new())))?;
    let owner = |cluster| encoder.pieces_of(cluster).map(|pieces| *pieces.last_key_value().unwrap().0);
    let owners = (0..encoder.cluster_count()).map(owner).collect::<Result<Vec<u32>>>()?;
    let mut of_pieces = Vec::new();
    for owner in 0..pieces.len() as u32 {
        let own: Vec<usize> = (0..owners.len()).filter(|&cluster| owners[cluster] == owner).collect();
        let mut share = encoder.share(&own)?;
        for number in share.pieces().into_iter().rev() {
            share.take(number, &pieces[number as usize])?;
        }
        let encoded = if own.is_empty() { Vec::new() } else { share.encode()?.collect::<Result<Vec<_>>>()? };
        of_pieces.push(encoded.into_iter());
    }
    // Each has its clusters in the order of the file.
    for owner in owners {
        output.add(of_pieces[owner as usize].next().unwrap())?;
    }
    let mut bytes = Vec::new();
    output.finish(&mut bytes)?;
    Ok(bytes)
}

#[cfg(feature = "serde")]
#[test]
fn shares_refuse_other_pieces() {
    let (whole, _) = model(&cube(3), OPTIONS);
    let half = whole.roots.len() / 2;
    let pieces = pieces(&whole, &[half, whole.roots.len() - half]);
    let mut assembly = Assembly::new(&whole).unwrap();
    pieces.iter().for_each(|piece| assembly.count(&piece.index).unwrap());
    let encoder = assembly.arrange().unwrap().seal(None);
    let count = encoder.cluster_count();
    assert!(encoder.share(&[count]).is_err() && encoder.pieces_of(count).is_err());
    let all: Vec<usize> = (0..count).collect();
    let share = || encoder.share(&all).unwrap();
    assert_eq!(share().pieces(), [0, 1]);
    assert!(share().encode().is_err(), "no piece was taken");
    assert!(share().take(0, &Piece::default()).is_err(), "a piece without roots");
    let mut lacking = share();
    lacking.take(0, &pieces[0]).unwrap();
    assert!(lacking.encode().is_err(), "a piece is missing");
}

/// All triangles by their positions, sorted.
fn triangles(bytes: &[u8], level: u8) -> Vec<[[u64; 3]; 3]> {
    let file = File::open(bytes, Limits::default()).unwrap();
    file.verify().unwrap();
    let mesh = file.extract(&file.uniform_cut(level).unwrap()).unwrap();
    let corners = |triangle: &[u32; 3]| triangle.map(|v| mesh.positions[v as usize].map(f64::to_bits));
    let mut all: Vec<_> = mesh.triangles.iter().map(corners).collect();
    all.iter_mut().for_each(|corners| {
        let least = (0..3).min_by_key(|&k| corners[k]).unwrap();
        corners.rotate_left(least);
    });
    all.sort_unstable();
    all
}

#[test]
fn pieces_show_what_the_whole_shows() {
    let (whole, _) = model(&cube(3), OPTIONS);
    let mut bytes = Vec::new();
    write_file(&whole, &mut bytes).unwrap();
    let in_pieces = written(&whole, &pieces(&whole, &[20, whole.roots.len() - 20])).unwrap();
    for level in 0..4 {
        assert_eq!(triangles(&in_pieces, level), triangles(&bytes, level));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn how_a_model_is_cut_into_pieces_does_not_show_in_the_file(
        shares in prop::collection::vec(0_usize..40, 1..9),
        n in 2_i64..6,
        has_channels: bool,
    ) {
        let (mut whole, _) = model(&cube(n), OPTIONS);
        if has_channels {
            add_channels(&mut whole, 5);
        }
        let mut bytes = Vec::new();
        write_file(&whole, &mut bytes).unwrap();
        let (total, mut left) = (shares.iter().sum::<usize>().max(1), whole.roots.len());
        let mut root_counts: Vec<usize> = shares.iter().map(|share| share * whole.roots.len() / total).collect();
        root_counts.iter().for_each(|count| left -= count);
        root_counts.push(left);
        prop_assert!(written(&whole, &pieces(&whole, &root_counts)).unwrap() == bytes, "{:?}", root_counts);
    }
}

#[test]
fn nothing_is_asked_for_before_it_is_there_nor_left_out() {
    let (whole, _) = model(&cube(3), OPTIONS);
    let cut = pieces(&whole, &[20, whole.roots.len() - 20]);
    let output = || {
        let mut assembly = Assembly::new(&whole).unwrap();
        cut.iter().try_for_each(|piece| assembly.count(&piece.index)).unwrap();
        Output::new(assembly.arrange().unwrap().seal(None), || Ok(Cursor::new(Vec::new()))).unwrap()
    };
    assert!(output().encoder().cluster_count() > 1);
    // Every piece has something of some cluster.
    let mut missing = output();
    missing.take(1, &cut[1]).unwrap();
    assert!((0..missing.encoder().cluster_count()).any(|cluster| missing.symbols(cluster).is_err()));
    assert!(output().take(0, &cut[1]).is_err());
    assert!(output().take(2, &cut[1]).is_err());
    assert!(output().symbols(99).is_err());
    // Clusters that are left out, or come in another order.
    assert!(output().finish(&mut Vec::new()).is_err());
    let mut late = output();
    cut.iter().enumerate().try_for_each(|(number, piece)| late.take(number, piece)).unwrap();
    let symbols = late.symbols(1).unwrap();
    let encoded = late.encoder().encode(&symbols).unwrap();
    assert!(late.add(encoded).is_err());
}

#[test]
fn the_first_picture_takes_about_what_is_said() {
    for n in [2, 5, 12] {
        let (whole, _) = model(&cube(n), OPTIONS);
        let report = write_file(&whole, &mut Vec::new()).unwrap();
        let before_pages: u64 =
            report.sections.iter().filter(|(name, _)| *name != "pages").map(|section| section.1).sum();
        let exact = before_pages + report.levels[0].iter().sum::<u64>();
        let mut assembly = Assembly::new(&whole).unwrap();
        assembly.count(&pieces(&whole, &[whole.roots.len()])[0].index).unwrap();
        let said = assembly.arrange().unwrap().first_picture_bytes();
        assert!(said.abs_diff(exact) * 20 < exact, "{said} {exact}");
    }
}

#[test]
fn groups_above_pieces_bring_their_texels() {
    let (mut whole, _) = model(&cube(1), Options { heights: 1, ..OPTIONS });
    add_channels(&mut whole, 5);
    let mut bytes = Vec::new();
    write_file(&whole, &mut bytes).unwrap();
    let mut below = whole.clone();
    let group = RootRecord { parent: None, ..below.roots.pop().unwrap() };
    assert!(!group.blocks[0].as_ref().unwrap().texels.concat().is_empty());
    below.roots.iter_mut().for_each(|root| root.parent = None);

    let mut assembly = Assembly::new(&below).unwrap();
    let piece = Piece::new(&below, &Shares::default()).unwrap();
    assembly.count(&piece.index).unwrap();
    let children = (0..6).map(|root| [assembly.root(0, root).unwrap().0, 0]).collect();
    let above = Above { roots: vec![group], children, corner_levels: vec![] };
    let without = Model { channels: vec![], ..below.clone() };
    assert!(assembly.clone().count_above(&without, &above).is_err());
    let above = assembly.count_above(&below, &above).unwrap();
    let mut output = Output::new(assembly.arrange().unwrap().seal(None), || Ok(Cursor::new(Vec::new()))).unwrap();
    output.take(0, &piece).unwrap();
    output.take(1, &above).unwrap();
    for cluster in 0..output.encoder().cluster_count() {
        let symbols = output.symbols(cluster).unwrap();
        let encoded = output.encoder().encode(&symbols).unwrap();
        output.add(encoded).unwrap();
    }
    let mut joined = Vec::new();
    output.finish(&mut joined).unwrap();
    assert!(joined == bytes);
}

#[test]
fn pieces_that_do_not_belong_together_are_refused() {
    let (whole, _) = model(&cube(2), OPTIONS);
    let count = whole.roots.len();
    let sound = pieces(&whole, &[3, count - 3]);
    assert!(written(&whole, &sound).is_ok());
    let [first, second] = [&sound[0], &sound[1]];
    for wrong in [
        // What the second one shares has no number yet; twice the first one has it twice.
        vec![second.clone(), first.clone()],
        vec![second.clone()],
        vec![first.clone(), first.clone(), second.clone()],
        // The symbols of another piece.
        vec![Piece { symbols: second.symbols.clone(), index: first.index.clone() }, second.clone()],
        vec![first.clone(), Piece { symbols: Default::default(), index: second.index.clone() }],
    ] {
        assert!(written(&whole, &wrong).is_err());
    }
    let mut with_channels = whole.clone();
    add_channels(&mut with_channels, 1);
    assert!(written(&with_channels, &sound).is_err());
    let of_channels = pieces(&with_channels, &[3, count - 3]);
    assert!(written(&with_channels, &of_channels).is_ok());
    assert!(written(&whole, &of_channels).is_err());
    let other = Piece { symbols: of_channels[1].symbols.clone(), ..of_channels[0].clone() };
    assert!(written(&with_channels, &[other, of_channels[1].clone()]).is_err());
    let (fewer_levels, _) = model(&cube(2), Options { levels: 3, ..OPTIONS });
    assert!(written(&fewer_levels, &sound).is_err());
}
