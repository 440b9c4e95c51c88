//! What tasks have read of texts, as vertices and triangles that can be looked up.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::obj::ObjObjects;
use super::objects::ObjectSink;
use super::polygon::Triangulator;
use lodpack_mesh::{Mesh, NONE};
use lodpack_runtime::storage::{DAMAGED, Lookup, Record, RecordReader, Windows, WorkDirectory, WorkError};

/// What a task has read of a file.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TextPiece {
    /// The number of the file.
    pub file: u32,
    /// Vertices.
    pub vertices: u64,
    /// Triangles in the order of the file, and behind them those of polygons that precede a vertex of theirs.
    pub triangles: [u64; 2],
    /// Their extent.
    pub bounds: [DVec3; 2],
    /// What was skipped, and how often.
    pub skipped: BTreeMap<String, u64>,
    /// What there is beside the surface.
    pub left_out: BTreeSet<String>,
    /// The objects and groups that begin.
    pub names: Vec<TextName>,
}

/// An object or a group of an OBJ file that begins.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TextName {
    /// Whether it is an object.
    pub is_object: bool,
    /// Its name.
    pub rest: Vec<u8>,
    /// How many triangles precede it, in the order of the file, and of those behind them.
    pub at: [u64; 2],
}

impl TextPiece {
    /// Nothing of a file yet.
    pub(super) fn of(file: u32) -> Self {
        let (skipped, left_out, names) = Default::default();
        Self { file, vertices: 0, triangles: [0; 2], bounds: Mesh::default().bounds(), skipped, left_out, names }
    }
}

/// The names of the files of a task: positions, triangles, and the corners of polygons.
pub(super) fn file_names(task: u32) -> [String; 3] {
    ["vertices", "triangles", "polygons"].map(|what| format!("text-{task}.{what}"))
}

/// What the tasks of a job have read of its texts.
#[derive(Clone, Copy, Debug)]
pub struct TextFiles<'a> {
    /// The job's directory.
    pub folder: &'a Path,
    /// Of each task what it has read of each file.
    pub pieces: &'a [Vec<TextPiece>],
}

/// Removes the files of a task.
pub fn remove_text_files(directory: &WorkDirectory, task: u32) {
    file_names(task).iter().for_each(|name| directory.remove(&directory.path(name)));
}

/// The vertices and triangles of one text.
pub(super) struct TextPlaces {
    tasks: Vec<Files>,
    /// Vertices in order of their numbers.
    vertices: Vec<Run>,
    /// Triangles in order.
    triangles: Vec<Run>,
    /// The objects and groups that begin, each behind how many triangles of the file.
    names: Vec<TextName>,
    /// How many triangles are not behind all others.
    triangles_in_order: u64,
    windows: Windows,
}

/// The files of a task.
struct Files {
    vertices: Lookup,
    triangles: PathBuf,
    polygons: (PathBuf, Lookup),
}

/// Records that follow each other in a file of a task.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Run {
    /// The number of the first, and how many there are.
    first: u64,
    count: u64,
    /// The place of the task's files, and that of the first record in its file.
    files: usize,
    at: u64,
}

impl Run {
    /// Adds a run behind others.
    fn push(runs: &mut Vec<Self>, count: u64, files: usize, at: u64) {
        let first = runs.last().map_or(0, |run| run.first + run.count);
        if count > 0 {
            runs.push(Self { first, count, files, at });
        }
    }

    fn end(&self) -> u64 {
        self.first + self.count
    }
}

impl Files {
    /// Opens the files of a task, which have to have the given numbers of vertices and triangles.
    fn open(folder: &Path, task: u32, vertices: u64, triangles: u64) -> Result<Self, WorkError> {
        let [vertex_file, triangle_file, polygon_file] = file_names(task).map(|name| folder.join(name));
        let (lookup, reader) = (Lookup::open(&vertex_file)?, RecordReader::<[u32; 3]>::open(&triangle_file)?);
        for (path, is_whole) in
            [(&vertex_file, lookup.count() == vertices), (&triangle_file, reader.count == triangles)]
        {
            if !is_whole {
                return Err(WorkError::damaged(path, DAMAGED));
            }
        }
        let polygons = Lookup::open(&polygon_file)?;
        Ok(Self { vertices: lookup, triangles: triangle_file, polygons: (polygon_file, polygons) })
    }
}

impl TextPlaces {
    /// What tasks have read of a file.
    pub fn open(texts: TextFiles, file: u32) -> Result<Self, WorkError> {
        let (mut tasks, mut vertices, mut triangles, mut late) = (vec![], vec![], vec![], vec![]);
        let (mut names, mut passed) = (vec![], [0; 2]);
        for (task, pieces) in (0..).zip(texts.pieces) {
            let all = |count: fn(&TextPiece) -> u64, pieces: &[TextPiece]| pieces.iter().map(count).sum::<u64>();
            let of_vertices: fn(&TextPiece) -> u64 = |piece| piece.vertices;
            let of_triangles: fn(&TextPiece) -> u64 = |piece| piece.triangles[0] + piece.triangles[1];
            let Some(place) = pieces.iter().position(|piece| piece.file == file) else { continue };
            let (piece, before) = (&pieces[place], &pieces[..place]);
            let files = tasks.len();
            tasks.push(Files::open(texts.folder, task, all(of_vertices, pieces), all(of_triangles, pieces))?);
            Run::push(&mut vertices, piece.vertices, files, all(of_vertices, before));
            let at = all(of_triangles, before);
            Run::push(&mut triangles, piece.triangles[0], files, at);
            late.push((piece.triangles[1], files, at + piece.triangles[0]));
            let behind = |at: [u64; 2]| [0, 1].map(|k| passed[k] + at[k]);
            names.extend(piece.names.iter().map(|name| TextName { at: behind(name.at), ..name.clone() }));
            passed = behind(piece.triangles);
        }
        let triangles_in_order = passed[0];
        late.into_iter().for_each(|(count, files, at)| Run::push(&mut triangles, count, files, at));
        let bytes = vertices.last().map_or(0, |run: &Run| run.end() as usize * DVec3::BYTES);
        Ok(Self { tasks, vertices, triangles, names, triangles_in_order, windows: Windows::new(bytes) })
    }

    /// Adds the objects of the file, whose first triangle is given, as reading all of it would.
    pub fn add_objects(&self, first_triangle: u64, sink: &mut ObjectSink) {
        let mut objects = ObjObjects::new();
        let start = objects.place();
        for (k, first) in [first_triangle, first_triangle + self.triangles_in_order].into_iter().enumerate() {
            sink.set(objects.go_back(start), first);
            for name in &self.names {
                let node = objects.begin(name.is_object, &name.rest, |node| sink.add(node));
                sink.set(node, first + name.at[k]);
            }
        }
    }

    /// The number of vertices and that of triangles.
    pub fn counts(&self) -> [u64; 2] {
        [&self.vertices, &self.triangles].map(|runs| runs.last().map_or(0, Run::end))
    }

    /// The position of a vertex; none where there is no such vertex.
    #[inline]
    pub fn position(&self, vertex: u64) -> Option<DVec3> {
        let run = self.vertices.partition_point(|run| run.end() <= vertex);
        let run = self.vertices.get(run)?;
        self.windows.touch(vertex as usize * DVec3::BYTES, || self.drop_pages());
        Some(self.tasks[run.files].vertices.position((run.at + vertex - run.first) as u32))
    }

    /// Visits a range of triangles, each by the numbers of its vertices within the file.
    pub fn for_each_triangle(&self, range: Range<u64>, mut visit: impl FnMut([u32; 3])) -> Result<(), WorkError> {
        let [vertex_count, _] = self.counts();
        let mut polygon = Polygon::default();
        let first = self.triangles.partition_point(|run| run.end() <= range.start);
        for run in self.triangles[first..].iter().take_while(|run| run.first < range.end) {
            let files = &self.tasks[run.files];
            let wanted = [range.start, range.end].map(|at| at.clamp(run.first, run.end()) - run.first + run.at);
            let mut is_sound = true;
            RecordReader::<[u32; 3]>::open(&files.triangles)?.for_each_of(wanted[0]..wanted[1], |record| {
                let triangle = match record {
                    [NONE, place, k] => polygon.triangle(self, run.files, place, k),
                    triangle => Some(triangle),
                };
                match triangle.filter(|corners| corners.iter().all(|&corner| u64::from(corner) < vertex_count)) {
                    Some(triangle) if is_sound => visit(triangle),
                    _ => is_sound = false,
                }
            })?;
            if !is_sound {
                return Err(WorkError::damaged(&files.polygons.0, DAMAGED));
            }
        }
        self.drop_pages();
        Ok(())
    }

    fn drop_pages(&self) {
        for files in &self.tasks {
            files.vertices.drop_pages();
            files.polygons.1.drop_pages();
        }
    }
}

/// The polygon whose triangles are visited.
#[derive(Default)]
struct Polygon {
    place: Option<(usize, u32)>,
    corners: Vec<u32>,
    triangles: Vec<[u32; 3]>,
    triangulator: Triangulator,
}

impl Polygon {
    /// A triangle of the polygon at a place in a file of corners; none where the file is damaged.
    fn triangle(&mut self, of: &TextPlaces, files: usize, place: u32, k: u32) -> Option<[u32; 3]> {
        if self.place != Some((files, place)) {
            self.place = Some((files, place));
            self.triangles.clear();
            of.tasks[files].polygons.1.list(u64::from(place), &mut self.corners)?;
            let position = |vertex: u32| of.position(u64::from(vertex)).unwrap_or(DVec3::NAN);
            self.triangulator.push_polygon(&self.corners, position, &mut self.triangles);
        }
        let corners = self.triangles.get(k as usize)?;
        Some(corners.map(|corner| self.corners[corner as usize]))
    }
}
