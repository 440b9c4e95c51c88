//! Objects: what a plant names comes back out of its file, with its parts where they were.

use std::collections::BTreeMap;

use glam::DVec3;
use lodpack::source::Fetched;
use lodpack::write::ObjectNode;
use lodpack::{File, islands};
use lodpack_tests::scene::{Scene, Sharing, plant, write_glb, write_obj};

use super::{build_file, open};

const TOLERANCE: f64 = 0.001;

/// The triangles, the area and the box of an object.
#[derive(Clone, Copy, Debug)]
struct Extent {
    triangles: u64,
    area: f64,
    bounds: [DVec3; 2],
}

impl Extent {
    const NOTHING: Self = Self { triangles: 0, area: 0.0, bounds: [DVec3::INFINITY, DVec3::NEG_INFINITY] };

    fn add(&mut self, corners: [DVec3; 3]) {
        self.triangles += 1;
        self.area += 0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
        let [low, high] = self.bounds;
        self.bounds = corners.iter().fold([low, high], |[low, high], &p| [low.min(p), high.max(p)]);
    }
}

/// Objects by their path of names, "-" where there is none, and their id.
type ByPath = BTreeMap<String, Vec<Extent>>;

fn sorted(mut objects: ByPath) -> ByPath {
    let key = |extent: &Extent| (extent.bounds[0] + extent.bounds[1]).to_array().map(|x| (x * 100.0).round() as i64);
    objects.values_mut().for_each(|of_path| of_path.sort_by_key(key));
    objects
}

/// What a scene has, with y up where `is_glb`; an OBJ joins those of one path.
fn named(scene: &Scene, is_glb: bool) -> ByPath {
    let (mut paths, mut objects): (Vec<String>, ByPath) = (vec![], BTreeMap::new());
    for (node, to) in scene.nodes.iter().zip(scene.in_world()) {
        let own = node.name.clone().unwrap_or_default();
        let above = node.parent.map_or("", |parent| &paths[parent as usize]);
        paths.push(match is_glb {
            true => format!("{above}/{}={}", if own.is_empty() { "-" } else { &own }, node.id.as_deref().unwrap_or("")),
            false if own.is_empty() => String::new(),
            false if above.is_empty() => own,
            false => format!("{above}/{own}"),
        });
        let Some(shape) = node.shape.map(|shape| &scene.shapes[shape as usize]) else { continue };
        let mut extent = Extent::NOTHING;
        for corners in &shape.triangles {
            extent.add(corners.map(|v| {
                let p = to.transform_point3(shape.positions[v as usize]);
                if is_glb { DVec3::new(p.x, p.z, -p.y) } else { p }
            }));
        }
        let path = paths.last().cloned().unwrap_or_default();
        let of_path = objects.entry(path.clone()).or_default();
        match of_path.first_mut().filter(|_| !is_glb && !path.is_empty()) {
            Some(same) => {
                (same.triangles, same.area) = (same.triangles + extent.triangles, same.area + extent.area);
                let [low, high] = same.bounds;
                same.bounds = [low.min(extent.bounds[0]), high.max(extent.bounds[1])];
            }
            None => of_path.push(extent),
        }
    }
    sorted(objects)
}

/// Everything of a file, so that nothing is missing.
fn all_of(bytes: &[u8]) -> Fetched {
    let mut fetched = Fetched::default();
    fetched.insert(0, bytes.to_vec());
    fetched
}

/// What the finest blocks of all leaves own.
fn owned(file: &File<&[u8]>, bytes: &[u8], is_glb: bool) -> ByPath {
    let fetched = all_of(bytes);
    let objects = file.index().objects().expect("the plant has objects");
    let mut extents = vec![Extent::NOTHING; objects.count() as usize];
    let world = |point: &lodpack::LatticePoint| DVec3::from(file.lattice().world(*point));
    for root in 0..file.root_count() {
        if !file.children(root).unwrap().is_empty() {
            continue;
        }
        let decoded = file.decode_root(root, file.level_count() as u8 - 1).unwrap();
        let border = decoded.loops.iter().flatten().map(|vertex| &vertex.position);
        let positions: Vec<DVec3> = border.chain(&decoded.patch.interior).map(world).collect();
        let owners = objects.owners(root, decoded.level, &fetched).unwrap();
        let (labels, count) = islands(&decoded.patch.triangles);
        assert_eq!(owners.len(), count as usize);
        for (corners, island) in decoded.patch.triangles.iter().zip(labels) {
            extents[owners[island as usize] as usize].add(corners.map(|v| positions[v as usize]));
        }
    }
    let path_of = |number: u32| {
        let above = objects.above(number, &fetched).unwrap();
        let nodes = above.iter().rev().chain([&number]).map(|&node| objects.node(node, &fetched).unwrap());
        if is_glb {
            // The first node only turns the others.
            let nodes = nodes.skip(1);
            let part =
                |node: ObjectNode| format!("/{}={}", node.name.unwrap_or("-".into()), node.id.unwrap_or_default());
            return nodes.map(part).collect::<String>();
        }
        nodes.map(|node| node.name.unwrap_or_default()).collect::<Vec<_>>().join("|")
    };
    let mut by_path: ByPath = BTreeMap::new();
    for (number, extent) in (0..).zip(extents) {
        by_path.entry(path_of(number)).or_default().push(extent);
    }
    sorted(by_path)
}

#[test]
fn each_object_of_a_plant_owns_what_it_was() {
    let scene = plant(200);
    let folder = tempfile::tempdir().unwrap();
    for (name, sharing) in
        [("shared.glb", Some(Sharing::Meshes)), ("baked.glb", Some(Sharing::Nothing)), ("plant.obj", None)]
    {
        let (path, is_glb) = (folder.path().join(name), sharing.is_some());
        sharing.map_or_else(|| write_obj(&scene, &path), |sharing| write_glb(&scene, sharing, &path)).unwrap();
        let (bytes, summary) = build_file(&path, "0.001");
        let (expected, found) = (named(&scene, is_glb), owned(&open(&bytes), &bytes, is_glb));
        let count = |objects: &ByPath| objects.values().map(Vec::len).sum::<usize>();
        assert_eq!((count(&found), summary.objects as usize), (count(&expected), count(&expected)), "{name}");
        for ((path, expected), (found_path, found)) in expected.iter().zip(&found) {
            assert_eq!((path, expected.len()), (found_path, found.len()), "{name}");
            for (expected, found) in expected.iter().zip(found) {
                let [low, high] = [0, 1].map(|k| (expected.bounds[k] - found.bounds[k]).abs().max_element());
                assert!(low.max(high) < 3.0 * TOLERANCE, "{name} {path} {expected:?} {found:?}");
                assert!((found.area / expected.area - 1.0).abs() < 0.1, "{name} {path} {expected:?} {found:?}");
                assert!(found.triangles <= expected.triangles, "{name} {path} {expected:?} {found:?}");
            }
        }
    }
}
