//! Hides and isolates random sets of a scene's nodes in the file that was built from it, and compares pixels with a
//! picture of the scene that says what is seen where. Only the drawing is shared: the scene is read without lodpack.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::DVec3;
use lodpack::objects::ObjectFilter;
use lodpack::{Cut, File, Mesh, Query};
use rayon::prelude::*;

use crate::id_picture::{IdPicture, NOTHING};
use crate::raster::View;
use crate::rays::{Object, brute, placed};
use crate::scene::Scene;

/// How much farther apart than the error two surfaces may be that a picture takes for one another: they are seen at a
/// slant.
const SLANT: f64 = 20.0;
/// Directions from which pictures are taken: azimuth and elevation, degrees.
const VIEWS: [[f64; 2]; 6] = [[30.0, 15.0], [120.0, 40.0], [215.0, -20.0], [300.0, 60.0], [75.0, 5.0], [160.0, -50.0]];

/// What was found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    /// Pixels that change although they should not, or do not although they should, and lie at no silhouette.
    pub wrong: u64,
    /// The same, where the drawn surface may show either within its error.
    pub beside: u64,
    /// Pixels that had to change, and did.
    pub changed: u64,
    /// Pixels of all pictures.
    pub pixels: u64,
    /// Triangles and groups of coarser cuts that show something hidden.
    pub shown: u64,
    /// Edges of cuts, coarse or fine, that are open or lie between two objects.
    pub open: u64,
    /// Triangles of cuts whose edges were looked at.
    pub triangles: u64,
}

impl Tally {
    fn plus(self, other: Self) -> Self {
        Self {
            wrong: self.wrong + other.wrong,
            beside: self.beside + other.beside,
            changed: self.changed + other.changed,
            pixels: self.pixels + other.pixels,
            shown: self.shown + other.shown,
            open: self.open + other.open,
            triangles: self.triangles + other.triangles,
        }
    }
}

type Key = (Option<String>, Option<String>);

/// A scene and its file, ready to be compared.
pub struct Comparison<'a> {
    scene: &'a Scene,
    file: &'a File<&'a [u8]>,
    input: Vec<Object>,
    /// Nodes of the file by what they are called.
    numbers: BTreeMap<Key, Vec<u32>>,
    /// For each root the objects of the leaves below it.
    below: Vec<BTreeSet<u32>>,
    /// The scene and the whole surface, from each of [`VIEWS`].
    pictures: Vec<(View, IdPicture, IdPicture)>,
    error: f64,
    size: f64,
}

impl<'a> Comparison<'a> {
    /// The file is built from the GLB of the scene.
    ///
    /// # Errors
    /// Those of the file.
    pub fn new(scene: &'a Scene, file: &'a File<&'a [u8]>, pixels: usize) -> Result<Self, lodpack::Error> {
        let input = placed(scene);
        let mut numbers: BTreeMap<Key, Vec<u32>> = BTreeMap::new();
        let objects = file.objects().expect("the scene has objects");
        // What has nothing above it only turns the others.
        for (number, node) in (0..).zip(objects.nodes()?).filter(|(_, node)| node.parent.is_some()) {
            numbers.entry((node.name, node.id)).or_default().push(number);
        }
        // Children have higher numbers than what is above them.
        let mut below = vec![BTreeSet::new(); file.root_count() as usize];
        for root in (0..file.root_count()).rev() {
            let children = file.children(root)?;
            below[root as usize] = match children.is_empty() {
                true => objects.of_leaf(root)?.into_iter().collect(),
                false => children.into_iter().flat_map(|child| below[child as usize].clone()).collect(),
            };
        }
        let bounds = file.bounds().expect("the scene is not empty").map(DVec3::from);
        let cut = file.select(&Query::default())?;
        let whole = file.extract(&cut)?;
        let picture = |&[azimuth, elevation]: &[f64; 2]| {
            let view = View::around(bounds, azimuth, elevation, pixels);
            let of_input =
                input.iter().flat_map(|object| object.triangles.iter().map(|&corners| (corners, object.node)));
            (view, IdPicture::of(&view, pixels, of_input), drawn(&view, pixels, &whole))
        };
        let pictures = VIEWS.par_iter().map(picture).collect();
        let size = (bounds[1] - bounds[0]).length();
        Ok(Self { scene, file, input, numbers, below, pictures, error: cut.error, size })
    }

    /// Hides or isolates some random sets.
    ///
    /// # Errors
    /// Those of the file.
    pub fn random(&self, sets: u32) -> Result<Tally, lodpack::Error> {
        let all: Vec<Tally> = (0..sets).into_par_iter().map(|number| self.one(number)).collect::<Result<_, _>>()?;
        Ok(all.into_iter().fold(Tally::default(), Tally::plus))
    }

    fn one(&self, number: u32) -> Result<Tally, lodpack::Error> {
        let mut random = Random(u64::from(number) + 1);
        // From a single node to half of them, as often hidden as shown alone.
        let most = 1 << random.below(u64::from(self.scene.nodes.len().ilog2()));
        let count = 1 + random.below(most);
        let key = |node: &crate::scene::Node| (node.name.clone(), node.id.clone());
        let chosen: BTreeSet<Key> =
            (0..count).map(|_| key(&self.scene.nodes[random.below(self.scene.nodes.len() as u64) as usize])).collect();
        let mut is_in = vec![];
        for node in &self.scene.nodes {
            is_in.push(chosen.contains(&key(node)) || node.parent.is_some_and(|parent| is_in[parent as usize]));
        }
        let numbers: Vec<u32> = chosen.iter().flat_map(|key| self.numbers.get(key)).flatten().copied().collect();
        let hides = number.is_multiple_of(2);
        let filter = if hides { self.file.hide(&numbers)? } else { self.file.only(&numbers)? };
        let is_hidden: Vec<bool> = is_in.into_iter().map(|is_in| is_in == hides).collect();
        let tally = self.compare_pixels(number, &filter, &is_hidden)?;
        let factor = (4.0_f64).powi(random.below(9) as i32);
        Ok(tally.plus(self.check_coarse(&filter, &numbers, hides, self.error * factor)?))
    }

    /// The finest surface without what is hidden, beside the whole one.
    fn compare_pixels(
        &self,
        number: u32,
        filter: &Arc<ObjectFilter>,
        is_hidden: &[bool],
    ) -> Result<Tally, lodpack::Error> {
        let (view, of_input, before) = &self.pictures[number as usize / 2 % VIEWS.len()];
        let cut = self.file.select(&Query { objects: Some(Arc::clone(filter)), ..Query::default() })?;
        let after = drawn(view, of_input.size, &self.file.extract(&cut)?);
        let mut tally = Tally { pixels: of_input.ids.len() as u64, ..Tally::default() };
        for (pixel, &id) in of_input.ids.iter().enumerate() {
            let expected = id != NOTHING && is_hidden[id as usize];
            let changes = before.depths[pixel] != after.depths[pixel];
            match changes == expected {
                true => tally.changed += u64::from(changes),
                false if self.may_show_either(view, of_input, pixel, is_hidden, changes) => tally.beside += 1,
                false => tally.wrong += 1,
            }
        }
        Ok(tally)
    }

    /// Whether the surface, moved by up to its error, shows something hidden in a pixel where it should not, or the
    /// other way round.
    fn may_show_either(
        &self,
        view: &View,
        picture: &IdPicture,
        pixel: usize,
        is_hidden: &[bool],
        changes: bool,
    ) -> bool {
        let [from, direction] = picture.ray(view, pixel, self.size);
        let across = direction.any_orthonormal_vector();
        let up = direction.cross(across);
        let steps = || (-4..=4).map(|step| f64::from(step) / 2.0 * self.error);
        steps().flat_map(|x| steps().map(move |y| across * x + up * y)).any(|away| {
            let first = |hidden: bool| {
                let own = self.input.iter().filter(|object| is_hidden[object.node as usize] == hidden);
                brute(own, from + away, direction).map_or(f64::INFINITY, |(distance, _)| distance)
            };
            let [hidden, other] = [first(true), first(false)];
            (hidden < other) == changes || (hidden - other).abs() <= SLANT * self.error
        })
    }

    /// A cut of a tolerance shows nothing that is hidden, and is as closed as the objects are.
    fn check_coarse(
        &self,
        filter: &Arc<ObjectFilter>,
        numbers: &[u32],
        hides: bool,
        tolerance: f64,
    ) -> Result<Tally, lodpack::Error> {
        let query = Query { tolerance: Some(tolerance), objects: Some(Arc::clone(filter)), ..Query::default() };
        let cut = self.file.select(&query)?;
        let objects = self.file.objects().expect("the scene has objects");
        let chosen: BTreeSet<u32> = objects.below(numbers)?.into_iter().collect();
        let is_hidden = |object: &u32| chosen.contains(object) == hides;
        let (mesh, of_triangles) = self.file.extract_objects_with_borders(&cut, 0)?;
        let mut tally = Tally { triangles: mesh.triangles.len() as u64, ..Tally::default() };
        tally.shown += of_triangles.iter().flatten().filter(|object| is_hidden(object)).count() as u64;
        for node in self.groups(&cut)? {
            tally.shown += u64::from(self.below[node as usize].iter().any(is_hidden));
        }
        tally.open = open_edges(&mesh, &of_triangles);
        Ok(tally)
    }

    fn groups(&self, cut: &Cut) -> Result<Vec<u32>, lodpack::Error> {
        let mut groups = vec![];
        for node in &cut.nodes {
            if !self.file.children(node.root)?.is_empty() {
                groups.push(node.root);
            }
        }
        Ok(groups)
    }
}

/// Two vertices, the lower number first.
type Edge = (u32, u32);
/// A triangle at an edge: whether it passes it upward, and its object.
type Side = (bool, Option<u32>);

/// The edges that do not lie between two triangles of one object. What groups show has no object that is known.
fn open_edges(mesh: &Mesh, objects: &[Option<u32>]) -> u64 {
    let mut sides: BTreeMap<Edge, Vec<Side>> = BTreeMap::new();
    for (corners, &object) in mesh.triangles.iter().zip(objects) {
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            if a != b {
                sides.entry((a.min(b), a.max(b))).or_default().push((a < b, object));
            }
        }
    }
    let is_open = |sides: &Vec<Side>| {
        let forward = sides.iter().filter(|(is_forward, _)| *is_forward).count();
        let owners: BTreeSet<u32> = sides.iter().filter_map(|&(_, object)| object).collect();
        2 * forward != sides.len() || owners.len() > 1
    };
    sides.values().filter(|sides| is_open(sides)).count() as u64
}

fn drawn(view: &View, size: usize, mesh: &Mesh) -> IdPicture {
    let corners = |triangle: &[u32; 3]| triangle.map(|vertex| DVec3::from(mesh.positions[vertex as usize]));
    IdPicture::of(view, size, mesh.triangles.iter().map(|triangle| (corners(triangle), 0)))
}

/// Numbers that are the same every time.
struct Random(u64);

impl Random {
    fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % end.max(1)
    }
}
