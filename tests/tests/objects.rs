//! Objects: what a plant names comes back out of its file, with its parts where they were.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;
use lodpack::decode::ChannelImage;
use lodpack::index::Scale;
use lodpack::source::Fetched;
use lodpack::write::ObjectNode;
use lodpack::{File, islands};
use lodpack_tests::hiding::Comparison;
use lodpack_tests::scene::{COLOURS, Scene, Shape, Sharing, plant, write_glb, write_obj};

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

#[test]
fn hiding_and_isolating_changes_the_pixels_that_the_input_names_and_leaves_closed_objects() {
    let scene = plant(80);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plant.glb");
    write_glb(&scene, Sharing::Meshes, &path).unwrap();
    let (bytes, _) = build_file(&path, "0.002");
    let found = Comparison::new(&scene, &open(&bytes), 160).unwrap().random(24).unwrap();
    assert_eq!((found.wrong, found.shown, found.open), (0, 0, 0), "{found:?}");
    assert!(found.changed > 1000 && found.beside < found.changed / 50, "{found:?}");
}

/// The colour that each triangle of a root shows at a level, all over.
fn colours(file: &File<&[u8]>, root: u32, level: u8) -> (lodpack::Mesh, Vec<[u8; 3]>) {
    let cut = lodpack::Cut {
        file: Some(file.index().id()),
        nodes: vec![lodpack::Node { root, level }],
        node_errors: vec![0.0],
        ..lodpack::Cut::default()
    };
    let shown = file.extract_textured(&cut, &[0]).unwrap();
    let Some(ChannelImage::Colours(image)) = &shown.textures[0].images[0] else { panic!("block without colours") };
    let texel = |[x, y]: [f32; 2]| <[u8; 3]>::try_from(image.texel(x as u32, y as u32)).unwrap();
    let of_triangle = |places: &[[f32; 2]; 3]| {
        // What is interpolated there is of texels that look alike.
        let around = places.iter().flat_map(|[x, y]| [-0.5, 0.5].map(|away| texel([x + away, y + away])));
        let colours: BTreeSet<[u8; 3]> = around.collect();
        assert_eq!(colours.len(), 1, "root {root}, level {level}");
        colours.into_iter().next().unwrap()
    };
    let colours = shown.places.iter().map(of_triangle).collect();
    (shown.mesh, colours)
}

#[test]
fn each_object_has_its_colour_at_every_level() {
    let scene = plant(200);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plant.obj");
    write_obj(&scene, &path).unwrap();
    let (bytes, _) = build_file(&path, "0.001");
    let file = open(&bytes);
    let fetched = all_of(&bytes);
    let objects = file.index().objects().unwrap();
    // OBJ files have colours as screens encode them.
    let byte_of = |shape: &Shape| COLOURS[shape.colour].1.map(|share| (share * 255.0).round() as u8);
    let mut of_paths: BTreeMap<String, BTreeSet<[u8; 3]>> = BTreeMap::new();
    let (mut paths, mut all): (Vec<String>, BTreeSet<[u8; 3]>) = (vec![], BTreeSet::new());
    for node in &scene.nodes {
        let above = node.parent.map_or("", |parent| &paths[parent as usize]).to_owned();
        let own = node.name.clone().unwrap_or_default();
        let path = if own.is_empty() || above.is_empty() { own } else { format!("{above}/{own}") };
        paths.push(path.clone());
        let Some(shape) = node.shape else { continue };
        let colour = byte_of(&scene.shapes[shape as usize]);
        of_paths.entry(path).or_default().insert(colour);
        all.insert(colour);
    }
    assert!(all.len() > 3);
    let mut texels = 0;
    for root in 0..file.root_count() {
        let is_leaf = file.children(root).unwrap().is_empty();
        for block in file.root_contents(root).unwrap().blocks {
            let bytes = &file.texels(&[(root, block.level)], &[0], Scale::Full).unwrap()[0];
            texels += bytes.map.len() + bytes.images.iter().flatten().map(Vec::len).sum::<usize>();
            let (mesh, colours) = colours(&file, root, block.level);
            let (labels, _) = islands(&mesh.triangles);
            let owners = if is_leaf { objects.owners(root, block.level, &fetched).unwrap() } else { vec![] };
            for (colour, label) in colours.iter().zip(labels) {
                assert!(all.contains(colour), "root {root}, level {}: {colour:?}", block.level);
                if is_leaf {
                    let name = objects.node(owners[label as usize], &fetched).unwrap().name.unwrap_or_default();
                    assert!(of_paths[&name].contains(colour), "{name}: {colour:?} {:?}", of_paths[&name]);
                }
            }
        }
    }
    // A palette of a colour a material, and a label for each part.
    let blocks: usize = (0..file.root_count()).map(|root| file.root_contents(root).unwrap().blocks.len()).sum();
    assert!(texels < 200 * blocks, "{texels} bytes for {blocks} blocks");
}
