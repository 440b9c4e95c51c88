//! What the input named: found, looked at, picked, hidden and shown alone.
#![expect(unsafe_code, reason = "the names are C's")]

use std::{
    ffi::{CString, c_char},
    sync::Arc,
};

use lodpack::{index::Ray, objects::ObjectChoice};

use crate::{
    file::{AnySource, File},
    pointer::{borrow, copy_rows, give, release, slice, text, write},
    status::{Failure, Status, guard},
};

/// Stands for no object, no parent, and all that is a part of nothing.
const NONE: u32 = u32::MAX;

/// What the input named: an object, or an assembly of others.
pub struct Object {
    name: Option<CString>,
    id: Option<CString>,
    parent: Option<u32>,
}

/// What is drawn of the objects of a file. A query holds one: see lodpack_hide_objects() and lodpack_show_only().
pub struct ObjectFilter(pub Arc<lodpack::objects::ObjectFilter>);

/// The header promises that threads may share a filter.
const _: fn() = || {
    fn shared<T: Send + Sync>() {}
    shared::<ObjectFilter>();
    shared::<Object>();
};

/// What a ray meets first.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct Pick {
    /// Where.
    pub point: [f64; 3],
    /// How far that is from where the ray begins.
    pub distance: f64,
    /// Bound of the distance between the surface that was met and the input.
    pub error: f64,
    /// The root that was met, at its finest level.
    pub root: u32,
    /// Its object; UINT32_MAX in a file without objects.
    pub object: u32,
    /// Whether anything was met: if not, nothing else here means anything.
    pub is_hit: i32,
}

fn objects(file: &File) -> Result<lodpack::FileObjects<'_, AnySource>, Failure> {
    let missing = || Failure::argument("it has no objects; build it with --objects keep".into()).of(file.name());
    file.mesh()?.objects().ok_or_else(missing)
}

/// The number of objects, which have the numbers from 0, and that of objects and assemblies, which follow: both 0 in a
/// file without objects.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_object_count(file: *const File, object_count: *mut u32, node_count: *mut u32) -> Status {
    guard(|| {
        let objects = borrow(file, "file")?.mesh().ok().and_then(lodpack::File::objects);
        let counts = objects.map_or([0; 2], |objects| [objects.count(), objects.node_count()]);
        write(object_count, counts[0], "object_count")?;
        write(node_count, counts[1], "node_count")
    })
}

/// Reads name, id and parent of an object or assembly.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_open_object(file: *const File, number: u32, object: *mut *mut Object) -> Status {
    guard(|| {
        write(object, std::ptr::null_mut(), "object")?;
        let file = borrow(file, "file")?;
        let node = objects(file)?.node(number).map_err(|error| file.blame(error))?;
        // A zero within would end it.
        let text =
            |text: Option<String>| text.map(|text| CString::new(text.replace('\0', "\u{fffd}")).unwrap_or_default());
        give(object, Object { name: text(node.name), id: text(node.id), parent: node.parent })
    })
}

/// The name of an object in UTF-8, for as long as it is open; null if it has none.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_object_name(object: *const Object) -> *const c_char {
    let object = borrow(object, "object");
    object.ok().and_then(|object| object.name.as_ref()).map_or(std::ptr::null(), |name| name.as_ptr())
}

/// What other programs know an object by, in UTF-8, for as long as it is open; null if it has no id.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_object_id(object: *const Object) -> *const c_char {
    let object = borrow(object, "object");
    object.ok().and_then(|object| object.id.as_ref()).map_or(std::ptr::null(), |id| id.as_ptr())
}

/// What an object is a part of; UINT32_MAX if it is a part of nothing.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_object_parent(object: *const Object) -> u32 {
    borrow(object, "object").ok().and_then(|object| object.parent).unwrap_or(NONE)
}

/// Closes an object; null is nothing.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_free_object(object: *mut Object) {
    release(object);
}

fn copy(found: &[u32], numbers: *mut u32, capacity: usize, count: *mut usize) -> Result<(), Failure> {
    write(count, found.len(), "count")?;
    copy_rows(found.iter().take(capacity).map(|&number| [number]), numbers, capacity, 0)
}

/// The numbers of all objects and assemblies of a name or, if there is none, of an id, ascending: `capacity` of them at
/// most. `count` says how many there are.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_find_objects(
    file: *const File,
    name_or_id: *const c_char,
    numbers: *mut u32,
    capacity: usize,
    count: *mut usize,
) -> Status {
    guard(|| {
        let (file, wanted) = (borrow(file, "file")?, text(name_or_id, "name_or_id")?);
        let objects = objects(file)?;
        let mut found = objects.find_name(wanted).map_err(|error| file.blame(error))?;
        if found.is_empty() {
            found = objects.find_id(wanted).map_err(|error| file.blame(error))?;
        }
        copy(&found, numbers, capacity, count)
    })
}

/// The numbers of what an object or assembly consists of, ascending, or with UINT32_MAX of all that is a part of
/// nothing: `capacity` of them at most. `count` says how many there are.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_object_children(
    file: *const File,
    parent: u32,
    numbers: *mut u32,
    capacity: usize,
    count: *mut usize,
) -> Status {
    guard(|| {
        let file = borrow(file, "file")?;
        let found = objects(file)?.children((parent != NONE).then_some(parent)).map_err(|error| file.blame(error))?;
        copy(&found, numbers, capacity, count)
    })
}

/// A box around some objects and assemblies with everything below them. `is_there` says whether there is anything of
/// them; if not, the box stays as it was.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_object_bounds(
    file: *const File,
    numbers: *const u32,
    count: usize,
    low: *mut f64,
    high: *mut f64,
    is_there: *mut i32,
) -> Status {
    guard(|| {
        let (file, numbers) = (borrow(file, "file")?, slice(numbers, count, "numbers")?);
        let bounds = objects(file)?.bounds(numbers).map_err(|error| file.blame(error))?;
        write(is_there, i32::from(bounds.is_some()), "is_there")?;
        let Some([least, most]) = bounds else { return Ok(()) };
        copy_rows([least].into_iter(), low, 1, 0)?;
        copy_rows([most].into_iter(), high, 1, 0)
    })
}

fn filter(
    file: *const File,
    (numbers, count): (*const u32, usize),
    out: *mut *mut ObjectFilter,
    choice: impl FnOnce(&[u32]) -> ObjectChoice,
) -> Status {
    guard(|| {
        write(out, std::ptr::null_mut(), "filter")?;
        let (file, numbers) = (borrow(file, "file")?, slice(numbers, count, "numbers")?);
        objects(file)?;
        let filter = file.mesh()?.filter_objects(&choice(numbers)).map_err(|error| file.blame(error))?;
        give(out, ObjectFilter(filter))
    })
}

/// A filter that draws everything but some objects and assemblies with everything below them. It is found once; queries
/// that hold it read no more of the objects.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_hide_objects(
    file: *const File,
    numbers: *const u32,
    count: usize,
    filter: *mut *mut ObjectFilter,
) -> Status {
    self::filter(file, (numbers, count), filter, ObjectChoice::hide)
}

/// A filter that draws nothing but some objects and assemblies with everything below them.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_show_only(
    file: *const File,
    numbers: *const u32,
    count: usize,
    filter: *mut *mut ObjectFilter,
) -> Status {
    self::filter(file, (numbers, count), filter, ObjectChoice::only)
}

/// Frees a filter; null is nothing. Cuts and streams that were asked for with it keep what they need.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_free_filter(filter: *mut ObjectFilter) {
    release(filter);
}

/// What a ray meets first of the finest surface, from either side. `origin` and `direction` have three numbers; a
/// filter lets it pass what it hides, and may be null.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_pick_surface(
    file: *const File,
    origin: *const f64,
    direction: *const f64,
    filter: *const ObjectFilter,
    pick: *mut Pick,
) -> Status {
    guard(|| {
        let file = borrow(file, "file")?;
        let point = |numbers, name| slice(numbers, 3, name).map(|numbers: &[f64]| [0, 1, 2].map(|k| numbers[k]));
        let ray = Ray { origin: point(origin, "origin")?, direction: point(direction, "direction")? };
        let filter = if filter.is_null() { None } else { Some(&*borrow(filter, "filter")?.0) };
        let found = file.mesh()?.pick_shown(ray, filter).map_err(|error| file.blame(error))?;
        let found = found.map_or(Pick { object: NONE, ..Pick::default() }, |found| Pick {
            point: found.point,
            distance: found.distance,
            error: found.error,
            root: found.root,
            object: found.object.unwrap_or(NONE),
            is_hit: 1,
        });
        write(pick, found, "pick")
    })
}
