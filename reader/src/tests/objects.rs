//! Objects: what a model named comes back, from files written at once and in pieces; what is read for answers; damage.

use std::io::Cursor;

use super::synthetic::Random;
use crate::{
    Error, File, Lattice, Limits, Result,
    index::Ray,
    islands::islands,
    source::Counting,
    write::{
        Assembly, BlockRecord, LevelInfo, Model, ObjectNode, Output, PatchTarget, Piece, Quantisation, RootRecord,
        Shares, Slide, SymbolBuffer, encode_patch, write_file,
    },
};

/// Vertices go to the planes of these points.
struct To<'p>(&'p [[f64; 3]]);

impl Slide for To<'_> {
    fn offset(&self, vertex: u32, point: [f64; 3], normal: [f64; 3]) -> f64 {
        let wanted = self.0[vertex as usize];
        (0..3).map(|k| (wanted[k] - point[k]) * normal[k]).sum()
    }
}

/// Boxes of objects, several a leaf, below groups of eight leaves that show one box each.
pub(crate) struct Boxes {
    pub seed: u64,
    pub leaves: u32,
    /// Boxes in a leaf.
    pub boxes: u32,
    pub nodes: Vec<ObjectNode>,
    /// The nodes that are no objects, from here on.
    pub objects: u32,
}

fn patch_of(boxes: &[([f64; 3], f64)]) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let (mut points, mut triangles) = (vec![], vec![]);
    for &(middle, half) in boxes {
        let first = points.len() as u32;
        for corner in 0..8_u32 {
            points.push([0, 1, 2].map(|k| middle[k] + if corner >> k & 1 == 1 { half } else { -half }));
        }
        for quad in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
            let [a, b, c, d] = quad.map(|corner| first + corner);
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    (points, triangles)
}

/// A block of boxes, and their owners where these are given.
fn block(boxes: &[([f64; 3], f64)], owners: &[u32], level: i32) -> BlockRecord {
    let (interior, triangles) = patch_of(boxes);
    let mut symbols = SymbolBuffer::default();
    let target = PatchTarget { loops: &[], interior: &interior, triangles: &triangles };
    let quantisation = Quantisation { normal_shift: 0, tangent_shift: 0 };
    let (patch, order) = encode_patch(&target, quantisation, &To(&interior), &mut symbols).unwrap();
    let (labels, count) = islands(&patch.triangles);
    let mut of_islands = vec![0; count as usize];
    for (triangle, label) in patch.triangles.iter().zip(labels) {
        let owner = owners.get(order[triangle[0] as usize] as usize / 8).copied().unwrap_or(0);
        of_islands[label as usize] = owner;
    }
    BlockRecord {
        error: 4_f64.powi(-level) / 1024.0,
        triangle_count: patch.triangles.len() as u32,
        symbols,
        owners: if owners.is_empty() { vec![] } else { of_islands },
        ..BlockRecord::default()
    }
}

impl Boxes {
    pub(crate) fn model(&self) -> Model {
        let mut random = Random::new(self.seed);
        let lattice = Lattice { origin: [5.0, 5.0, 5.0], step_log2: -10 };
        let world = |point: [f64; 3]| point.map(|x| 5.0 + x / 1024.0);
        let mut roots: Vec<RootRecord> = vec![];
        let mut groups: Vec<(Vec<u32>, [[f64; 3]; 2])> = vec![];
        // Each object has one box of its own, and others of objects that come again.
        let mut waiting: Vec<u32> = (0..self.objects).collect();
        for leaf in 0..self.leaves {
            let corner = [leaf % 8, leaf / 8 % 8, leaf / 64].map(|x| f64::from(x) * 4000.0);
            let places: Vec<([f64; 3], f64)> = (0..self.boxes)
                .map(|k| {
                    let at = [k % 4, k / 4 % 4, k / 16].map(|x| f64::from(x) * 900.0 + 450.0);
                    let mut half = || 40.0 + random.below(300) as f64;
                    ([0, 1, 2].map(|axis| corner[axis] + at[axis]), half())
                })
                .collect();
            let owners: Vec<u32> = (0..self.boxes)
                .map(|k| match (waiting.is_empty(), k > 0 && random.below(3) == 0) {
                    (false, false) => waiting.swap_remove(random.below(waiting.len() as u64) as usize),
                    _ => random.below(self.objects.into()) as u32,
                })
                .collect();
            // Small boxes are not there at the coarser level.
            let kept: Vec<usize> = (0..places.len()).filter(|&k| k == 0 || places[k].1 > 120.0).collect();
            let coarse: Vec<_> = kept.iter().map(|&k| places[k]).collect();
            let of_coarse: Vec<u32> = kept.iter().map(|&k| owners[k]).collect();
            let bounds = [[-1.0; 3], [3600.0; 3]].map(|point| world([0, 1, 2].map(|k| corner[k] + point[k])));
            let blocks = vec![None, Some(block(&coarse, &of_coarse, 1)), Some(block(&places, &owners, 2))];
            let parent = (leaf / 8) as usize;
            match groups.get_mut(parent) {
                Some((of_group, whole)) => {
                    of_group.push(leaf);
                    whole[0] = [0, 1, 2].map(|k| whole[0][k].min(bounds[0][k]));
                    whole[1] = [0, 1, 2].map(|k| whole[1][k].max(bounds[1][k]));
                }
                None => groups.push((vec![leaf], bounds)),
            }
            roots.push(RootRecord {
                bounds,
                parent: Some(self.leaves + parent as u32),
                blocks,
                ..RootRecord::default()
            });
        }
        assert!(waiting.is_empty(), "more objects than boxes");
        for (_, bounds) in groups {
            let middle = [0, 1, 2].map(|k| ((bounds[0][k] + bounds[1][k]) / 2.0 - 5.0) * 1024.0);
            let blocks = vec![Some(block(&[(middle, 900.0)], &[], 0)), None, None];
            roots.push(RootRecord { bounds, blocks, ..RootRecord::default() });
        }
        let steps = Quantisation { normal_shift: 0, tangent_shift: 0 };
        let levels = (0..3).map(|level| LevelInfo { tolerance: 4_f64.powi(-level), steps: steps.into() }).collect();
        Model { lattice, levels, roots, nodes: self.nodes.clone(), ..Model::default() }
    }
}

/// Nodes of all kinds: names that repeat, are none, empty or long, objects above objects, assemblies that hold nothing.
pub(crate) fn nodes(seed: u64, objects: u32) -> Vec<ObjectNode> {
    let mut random = Random::new(seed);
    let assemblies = objects / 10 + 3;
    let mut nodes: Vec<ObjectNode> = vec![];
    for number in 0..objects + assemblies {
        let kind = random.below(12);
        let name = match kind {
            0 => None,
            1 => Some(String::new()),
            2 => Some("螺栓 M12".to_string()),
            3 => Some("BOLT".to_string()),
            4 if number % 50 == 0 => Some("x".repeat(4096)),
            _ => Some(format!("AREA-{:02}/LINE-{}/FLANGE-{}", random.below(4), number / 20, random.below(9))),
        };
        let id = (random.below(4) > 0).then(|| format!("{:08x}-{number}", random.below(1 << 32)));
        let id = if random.below(30) == 0 { Some("twice".to_string()) } else { id };
        // Assemblies lie below assemblies before them; some objects below another one.
        let parent = match (number < objects, random.below(10)) {
            (_, 0) => None,
            (true, 1) if number > 0 => Some(random.below(number.into()) as u32),
            (true, _) => Some(objects + (u64::from(number) * u64::from(assemblies) / u64::from(objects)) as u32),
            (false, _) if number > objects => Some(objects + random.below((number - objects).into()) as u32),
            _ => None,
        };
        nodes.push(ObjectNode { name, id, parent });
    }
    nodes
}

fn boxes(seed: u64, leaves: u32, of_leaf: u32) -> Boxes {
    let objects = leaves * of_leaf / 3 + 1;
    Boxes { seed, leaves, boxes: of_leaf, nodes: nodes(seed, objects), objects }
}

/// A file of boxes.
pub(crate) fn file_of(seed: u64, leaves: u32, of_leaf: u32) -> Vec<u8> {
    bytes_of(&boxes(seed, leaves, of_leaf).model())
}

fn bytes_of(model: &Model) -> Vec<u8> {
    let mut bytes = vec![];
    write_file(model, &mut bytes).unwrap();
    bytes
}

fn open(bytes: &[u8]) -> File<&[u8]> {
    File::open(bytes, Limits::default()).unwrap()
}

/// The path of a node from the top down, as names and ids.
fn path(mut node: Option<u32>, of: impl Fn(u32) -> ObjectNode) -> Vec<(Option<String>, Option<String>)> {
    let mut path = vec![];
    while let Some(number) = node {
        let known = of(number);
        path.push((known.name, known.id));
        node = known.parent;
    }
    path
}

#[test]
fn what_a_model_named_comes_back_with_the_islands_that_it_owns() {
    for (seed, leaves, of_leaf) in [(1, 1, 1), (2, 3, 5), (3, 40, 7), (4, 130, 30)] {
        let boxes = boxes(seed, leaves, of_leaf);
        let model = boxes.model();
        let mut bytes = vec![];
        let report = write_file(&model, &mut bytes).unwrap();
        let file = open(&bytes);
        file.verify().unwrap();
        assert_eq!(file.index().version(), (4, 6));
        let objects = file.objects().unwrap();
        assert_eq!(objects.count(), boxes.objects);
        // Which node of the model an object is, by what its islands own.
        let mut origins = vec![None; objects.count() as usize];
        for (root, &of_model) in (0..).zip(&report.root_order) {
            let record = &model.roots[of_model as usize];
            if record.parent.is_none() {
                assert!(matches!(objects.of_leaf(root), Err(Error::Query { .. })));
                continue;
            }
            for (level, block) in (0..).zip(&record.blocks) {
                let Some(block) = block else { continue };
                let owners = objects.owners(root, level).unwrap();
                assert_eq!(owners.len(), block.owners.len());
                for (&owner, &wanted) in owners.iter().zip(&block.owners) {
                    let origin = origins[owner as usize].get_or_insert(wanted);
                    assert_eq!(*origin, wanted);
                    assert!(objects.leaves(owner).unwrap().contains(&root));
                    assert!(objects.of_leaf(root).unwrap().contains(&owner));
                }
            }
        }
        let of_file = |number: u32| objects.node(number).unwrap();
        let of_model = |number: u32| model.nodes[number as usize].clone();
        for (object, origin) in (0..).zip(&origins) {
            assert_eq!(path(Some(object), of_file), path(*origin, of_model), "{object}");
        }
        // Nodes that are on no path to an object are left out.
        let mut kept: Vec<u32> = origins.iter().map(|origin| origin.unwrap()).collect();
        let mut waiting = kept.clone();
        while let Some(node) = waiting.pop() {
            waiting.extend(model.nodes[node as usize].parent);
            kept.push(node);
        }
        kept.sort_unstable();
        kept.dedup();
        assert_eq!(objects.node_count() as usize, kept.len());
    }
}

#[test]
fn nodes_are_found_by_name_and_id_and_below_their_parents() {
    let boxes = boxes(9, 300, 30);
    let bytes = bytes_of(&boxes.model());
    let counting = Counting::new(bytes.as_slice());
    let file = File::open(counting, Limits::default()).unwrap();
    let objects = file.objects().unwrap();
    let all: Vec<ObjectNode> = (0..objects.page_count()).flat_map(|page| objects.page(page).unwrap()).collect();
    assert_eq!(all.len(), objects.node_count() as usize);
    let find = |wanted: &dyn Fn(&ObjectNode) -> bool| -> Vec<u32> {
        (0..).zip(&all).filter(|(_, node)| wanted(node)).map(|(number, _)| number).collect()
    };
    for number in (0..all.len() as u32).step_by(37) {
        let node = objects.node(number).unwrap();
        assert_eq!(node, all[number as usize]);
        if let Some(name) = &node.name {
            assert_eq!(objects.find_name(name).unwrap(), find(&|other| other.name.as_ref() == Some(name)));
        }
        if let Some(id) = &node.id {
            assert_eq!(objects.find_id(id).unwrap(), find(&|other| other.id.as_ref() == Some(id)));
        }
        assert_eq!(objects.children(node.parent).unwrap(), find(&|other| other.parent == node.parent));
        assert_eq!(objects.above(number).unwrap().first().copied(), node.parent);
    }
    assert!(objects.find_name("nothing").unwrap().is_empty() && objects.find_id("BOLT").unwrap().is_empty());
    for wrong in [objects.node_count(), u32::MAX] {
        assert!(matches!(objects.node(wrong), Err(Error::Query { .. })));
        assert!(matches!(objects.children(Some(wrong)), Err(Error::Query { .. })));
        assert!(matches!(objects.leaves(wrong), Err(Error::Query { .. })));
    }
}

#[test]
fn a_name_is_found_with_three_requests_and_opening_reads_none_of_the_lists() {
    let boxes = boxes(5, 500, 30);
    let bytes = bytes_of(&boxes.model());
    let file = File::open(Counting::new(bytes.as_slice()), Limits::default()).unwrap();
    let pages = file.index().sections().into_iter().find(|section| section.0 == 18).unwrap();
    assert!(file.index().fetched().ranges().all(|range| range.end <= pages.1 || range.start >= pages.1 + pages.2));
    let before = file.source().read_count();
    let objects = file.objects().unwrap();
    assert_eq!(objects.find_name("AREA-01/LINE-3/FLANGE-2").unwrap().len(), {
        let all = (0..objects.page_count()).flat_map(|page| objects.page(page).unwrap());
        all.filter(|node| node.name.as_deref() == Some("AREA-01/LINE-3/FLANGE-2")).count()
    });
    let file = File::open(Counting::new(bytes.as_slice()), Limits::default()).unwrap();
    let opened = file.source().read_count();
    file.objects().unwrap().find_name("AREA-01/LINE-3/FLANGE-2").unwrap();
    assert!(file.source().read_count() - opened <= 3 && before > 0);
}

#[test]
fn files_of_several_pieces_in_any_order_of_taking_number_objects_alike() {
    let boxes = boxes(7, 24, 6);
    let whole = boxes.model();
    let group = |first: usize| {
        let mut roots = whole.roots[first..first + 8].to_vec();
        roots.iter_mut().for_each(|root| root.parent = Some(8));
        roots.push(whole.roots[24 + first / 8].clone());
        Piece::new(&Model { roots, ..whole.clone() }, &Shares::default()).unwrap()
    };
    let pieces = [group(0), group(8), group(16)];
    let written = |order: [usize; 3]| {
        let mut assembly = Assembly::new(&whole).unwrap();
        pieces.iter().for_each(|piece| assembly.count(&piece.index).unwrap());
        let encoder = assembly.arrange().unwrap().seal(None);
        let output = Output::new(encoder, || Ok(Cursor::new(vec![]))).unwrap();
        let mut output = output.with_nodes(whole.nodes.clone()).unwrap();
        order.into_iter().for_each(|piece| output.take(piece, &pieces[piece]).unwrap());
        for cluster in 0..output.encoder().cluster_count() {
            let symbols = output.symbols(cluster).unwrap();
            let encoded = output.encoder().encode(&symbols).unwrap();
            output.add(encoded).unwrap();
        }
        let mut bytes = vec![];
        output.finish(&mut bytes).unwrap();
        bytes
    };
    let bytes = bytes_of(&whole);
    assert!(written([0, 1, 2]) == bytes && written([2, 0, 1]) == bytes);
}

#[test]
fn models_whose_objects_a_file_cannot_have_are_refused() {
    let boxes = boxes(3, 4, 3);
    let refused = |change: &dyn Fn(&mut Model)| {
        let mut model = boxes.model();
        change(&mut model);
        match write_file(&model, &mut vec![]) {
            Err(Error::Model { what }) => what,
            other => panic!("{other:?}"),
        }
    };
    let owners = |model: &mut Model, owners: &[u32]| {
        model.roots[0].blocks[2].as_mut().unwrap().owners = owners.to_vec();
    };
    assert!(refused(&|model| owners(model, &[1000, 0, 0])).contains("beyond"));
    assert!(refused(&|model| owners(model, &[])).contains("owners"));
    assert!(refused(&|model| owners(model, &[0; 1000])).contains("owners"));
    assert!(refused(&|model| model.nodes.clear()).contains("no objects"));
    assert!(refused(&|model| model.roots[4].blocks[0].as_mut().unwrap().owners = vec![0]).contains("group"));
    assert!(refused(&|model| model.nodes[0].parent = Some(1 << 20)).contains("missing"));
    assert!(refused(&|model| model.nodes[0].name = Some("x".repeat(4097))).contains("4097 bytes"));
    assert!(refused(&|model| (model.nodes[0].parent, model.nodes[1].parent) = (Some(1), Some(0))).contains("circle"));
    let deep = |model: &mut Model, count: u32| {
        let first = model.nodes.len() as u32;
        let chain = (0..count).map(|k| ObjectNode { parent: (k > 0).then_some(first + k - 1), ..Default::default() });
        model.nodes.extend(chain);
        model.nodes[0].parent = Some(first + count - 1);
    };
    assert!(refused(&|model| deep(model, 4097)).contains("4096 deep"));
    let mut model = boxes.model();
    deep(&mut model, 4096 - 10);
    let bytes = bytes_of(&model);
    open(&bytes).verify().unwrap();
}

#[test]
fn picks_are_what_all_triangles_say() {
    let boxes = boxes(11, 70, 9);
    let bytes = bytes_of(&boxes.model());
    let file = open(&bytes);
    let objects = file.objects().unwrap();
    // Every triangle at the finest level, with its object.
    let mut triangles = vec![];
    for root in 0..file.root_count() {
        if !file.children(root).unwrap().is_empty() {
            continue;
        }
        let patch = file.decode_root(root, 2).unwrap().patch;
        let owners = objects.owners(root, 2).unwrap();
        let points: Vec<[f64; 3]> = patch.interior.iter().map(|&point| file.lattice().world(point)).collect();
        for (triangle, label) in patch.triangles.iter().zip(islands(&patch.triangles).0) {
            triangles.push((triangle.map(|vertex| points[vertex as usize]), owners[label as usize]));
        }
    }
    let mut random = Random::new(1);
    let [low, high] = file.bounds().unwrap();
    let mut point = || [0, 1, 2].map(|k| low[k] - 1.0 + (high[k] - low[k] + 2.0) * random.unit());
    let mut hits = 0;
    for _ in 0..300 {
        let (origin, to) = (point(), point());
        let direction = [0, 1, 2].map(|k| to[k] - origin[k]);
        let ray = Ray { origin, direction };
        let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
        let unit = Ray { direction: direction.map(|x| x / length), ..ray };
        let met =
            triangles.iter().filter_map(|(corners, owner)| Some((crate::decode::meets(&unit, *corners)?, *owner)));
        let nearest = met.min_by(|a, b| a.0.total_cmp(&b.0));
        match (file.pick(ray).unwrap(), nearest) {
            (None, None) => {}
            (Some(pick), Some((distance, owner))) => {
                assert!((pick.distance - distance).abs() < 1e-9);
                assert_eq!((pick.object, pick.error), (Some(owner), 1.0 / 16.0 / 1024.0));
                assert!((0..3).all(|k| (pick.point[k] - origin[k] - unit.direction[k] * distance).abs() < 1e-9));
                hits += 1;
            }
            other => panic!("{other:?}"),
        }
    }
    assert!((30..290).contains(&hits), "{hits}");
    assert!(file.pick(Ray { origin: [0.0; 3], direction: [0.0; 3] }).is_err());
}

#[test]
fn damaged_objects_are_refused_and_never_panic() {
    let boxes = boxes(2, 3, 5);
    let bytes = bytes_of(&boxes.model());
    let sections = open(&bytes).index().sections();
    for kind in [17, 18] {
        let (_, offset, length) = sections.iter().copied().find(|section| section.0 == kind).unwrap();
        for at in offset..offset + length {
            let mut damaged = bytes.clone();
            damaged[at as usize] ^= 1 << (at % 8);
            let result = File::open(damaged.as_slice(), Limits::default()).and_then(|file| file.verify());
            assert!(matches!(result, Err(Error::Format { .. })), "{kind}, {at}");
        }
    }
    // With checksums that are right, answers are errors or keep their promises.
    crate::codec::bytes::ANY_CHECKSUM.set(true);
    let mut random = Random::new(4);
    let mut refused = 0;
    for _ in 0..2000 {
        let (_, offset, length) = sections.iter().copied().find(|section| section.0 == 18).unwrap();
        let mut damaged = bytes.clone();
        damaged[(offset + random.below(length)) as usize] = random.below(256) as u8;
        let ask = || -> Result<()> {
            let file = File::open(damaged.as_slice(), Limits::default())?;
            let objects = file.objects().unwrap();
            for number in 0..objects.node_count() {
                objects.node(number)?;
                objects.above(number)?;
                objects.children(Some(number))?;
            }
            (0..objects.count()).try_for_each(|object| objects.leaves(object).map(drop))?;
            file.verify()
        };
        refused += usize::from(ask().is_err());
    }
    crate::codec::bytes::ANY_CHECKSUM.set(false);
    assert!(refused > 1000, "{refused}");
}
