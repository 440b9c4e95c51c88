//! Frames of a moving camera: what is new in each, and what is no longer drawn.
#![expect(unsafe_code, reason = "the names are C's")]

use std::{
    collections::BTreeSet,
    ffi::{CString, c_char},
    sync::Arc,
};

use lodpack::{
    Opened,
    decode::Appearance,
    heights::SIDE,
    index::ChannelInfo,
    stream::{
        ByPiece, Changes, DrawnRoot, DrawnTexture, Mode, Options, Problem, Shows, Streamer, StreamerOptions, TileImages,
    },
};

use crate::{
    file::{AnySource, File},
    mesh::{Lit, Mesh},
    pages::{Images, Page, Paged},
    pointer::{borrow, borrow_mut, give, release, slice, write},
    query::{Query, checked, limiter},
    status::{Failure, Status, guard},
};

/// What a frame draws.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub enum Shown {
    /// Nothing is there yet.
    Nothing = 0,
    /// The overview (lodpack_decode_overview()), until the coarsest level is there.
    Overview = 1,
    /// All roots that were uploaded and not dropped.
    Picture = 2,
}

/// How a stream behaves. lodpack_stream_options_default() fills all of it.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct StreamOptions {
    /// Most bytes of the file that are kept in memory.
    pub page_cache_bytes: u64,
    /// Most bytes of decoded triangles.
    pub mesh_cache_bytes: u64,
    /// Most bytes of decoded images. They are drawn smaller where they would not fit.
    pub texel_cache_bytes: u64,
    /// About how many texels images have along each side of a pixel, as near as halving allows; above 0. 1 by default.
    pub texels_per_pixel: f64,
    /// Most bytes of triangles that are new in a frame; what does not fit waits, and what was drawn stays. One root or
    /// group always goes, and so does what nothing was drawn in place of. UINT64_MAX, the default, for no bound. Those
    /// of heights have none.
    pub upload_bytes: u64,
    /// Threads that read and decode; at least 1, and 256 where it is more.
    pub thread_count: u32,
    /// Whether frames wait until everything that they want is there. By default they do not: what is missing is drawn
    /// coarser.
    pub waits: i32,
    /// The channels to show, by number; by default none. All roots of heights have their normals and colours anyway.
    pub channels: *const u32,
    /// How many these are.
    pub channel_count: usize,
}

/// What is new in a frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct Frame {
    /// A lodpack_shown: what to draw.
    pub shows: i32,
    /// Whether everything is drawn as wanted.
    pub is_complete: i32,
    /// Roots to upload, instead of what they had: see lodpack_get_upload().
    pub upload_count: usize,
    /// Roots to draw no longer: see lodpack_get_drop().
    pub drop_count: usize,
    /// Roots that are drawn coarser than wanted, since they are not there yet.
    pub late_root_count: u64,
    /// Roots to draw.
    pub root_count: u64,
    /// Their triangles.
    pub triangle_count: u64,
    /// Bytes read since the last frame.
    pub byte_count: u64,
    /// Triangles that it would have if everything were there.
    pub wanted_triangle_count: u64,
    /// A lodpack_limiter: why that is not finer.
    pub limited_by: i32,
}

/// A root to upload.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct Upload {
    /// Its number. What had this number before is drawn no longer.
    pub root: u32,
    /// The level at which it is drawn.
    pub level: u32,
    /// Bound of the two-sided distance between it and the input.
    pub error: f64,
}

/// Frames of a moving camera, and threads that load for them.
pub struct Stream {
    streamer: Box<Streamer>,
    channels: Arc<[(ChannelInfo, Appearance)]>,
    uploads: Vec<u32>,
    drops: Vec<u32>,
    problems: Vec<Problem>,
    problem: CString,
}

/// The header promises that a stream may go from thread to thread.
const _: fn() = || {
    fn movable<T: Send>() {}
    movable::<Stream>();
};

/// Options that suit most programs: 64 MiB of the file, 256 MiB of triangles and of images, four threads.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_stream_options_default() -> StreamOptions {
    let (options, StreamerOptions { thread_count, .. }) = (Options::default(), StreamerOptions::default());
    StreamOptions {
        page_cache_bytes: options.byte_cache,
        mesh_cache_bytes: options.decoded_cache,
        texel_cache_bytes: options.texel_cache,
        texels_per_pixel: options.texels_per_pixel,
        upload_bytes: options.upload_bytes,
        thread_count: thread_count as u32,
        waits: 0,
        channels: std::ptr::null(),
        channel_count: 0,
    }
}

/// Starts threads that load a file of either kind for a moving camera; null `options` are the default ones. A stream
/// may be used by one thread at a time. Its file may be closed before it, but what the file is read from has to stay
/// until both are.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_open_stream(
    file: *const File,
    options: *const StreamOptions,
    stream: *mut *mut Stream,
) -> Status {
    guard(|| {
        write(stream, std::ptr::null_mut(), "stream")?;
        let file = borrow(file, "file")?;
        let default = lodpack_stream_options_default();
        let options = if options.is_null() { &default } else { borrow(options, "options")? };
        if options.thread_count == 0 {
            let what = "a thread_count of 0: a stream has at least one thread (lodpack_stream_options_default())";
            return Err(Failure::argument(what.into()));
        }
        give(stream, open(file, options, slice(options.channels, options.channel_count, "options->channels")?)?)
    })
}

fn open(file: &File, options: &StreamOptions, channels: &[u32]) -> Result<Stream, Failure> {
    let mode = if options.waits != 0 { Mode::Synchronous } else { Mode::AsynchronousWithPrefetch };
    let session = Options {
        mode,
        byte_cache: options.page_cache_bytes,
        decoded_cache: options.mesh_cache_bytes,
        texel_cache: options.texel_cache_bytes,
        texels_per_pixel: options.texels_per_pixel,
        upload_bytes: options.upload_bytes,
        ..Options::default()
    };
    let thread_count = options.thread_count.min(256) as usize;
    let streamer_options = StreamerOptions { session, thread_count, ..StreamerOptions::default() };
    let (streamer, channels) = match file.opened() {
        Opened::Mesh(mesh) => {
            let mut streamer = mesh.streamer(streamer_options).map_err(|error| file.blame(error))?;
            let known = known_channels(mesh, channels).map_err(|error| file.blame(error))?;
            let numbers: Vec<u8> = channels.iter().map(|&channel| channel as u8).collect();
            streamer.show_channels(&numbers).map_err(|error| file.blame(error))?;
            (streamer, known)
        }
        Opened::Heights(heights) => (heights.streamer(streamer_options).map_err(|error| file.blame(error))?, vec![]),
    };
    let (uploads, drops, problems, problem) = Default::default();
    Ok(Stream { streamer: Box::new(streamer), channels: channels.into(), uploads, drops, problems, problem })
}

/// Channels by number, and their colours: ramps go from the smallest to the largest number of the coarsest level.
fn known_channels(
    file: &lodpack::File<AnySource>,
    channels: &[u32],
) -> lodpack::Result<Vec<(ChannelInfo, Appearance)>> {
    let mut known = vec![];
    for &number in channels {
        let info = file.channels().get(number as usize);
        let missing = || lodpack::Error::Query { what: format!("there is no channel {number}") };
        let info = info.ok_or_else(missing)?;
        let mut appearance = Appearance::new(info);
        if appearance.values().is_some() {
            let coarsest = file.extract_textured(&file.uniform_cut(0)?, &[number as u8])?;
            appearance.fit(coarsest.textures.iter().flat_map(|texture| texture.images.iter().flatten()));
        }
        known.push((info.clone(), appearance));
    }
    Ok(known)
}

/// Draws a frame: what a query wants, as far as it is loaded, without cracks. It does not wait, unless the stream was
/// opened so. Call it again for the next picture, also where the camera stands still, until the frame is complete. The
/// query needs a view, or a tolerance.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_draw_frame(stream: *mut Stream, query: *const Query, frame: *mut Frame) -> Status {
    guard(|| {
        let stream = borrow_mut(stream, "stream")?;
        let query = checked(borrow(query, "query")?)?;
        let streamed = stream.streamer.frame(&query)?;
        let (wanted_triangle_count, limited_by) = (streamed.wanted_triangle_count, limiter(streamed.limited_by));
        let Changes { surfaces, strips, removed, textures, .. } = streamed.frame.changes;
        let changed: BTreeSet<u32> =
            surfaces.into_iter().chain(strips.into_iter().map(|(root, _)| root)).chain(textures).collect();
        let picture = stream.streamer.picture();
        stream.uploads = changed.into_iter().filter(|&root| picture.root(root).is_some()).collect();
        stream.drops = removed;
        let shows = match streamed.frame.shows {
            Shows::Nothing => Shown::Nothing,
            Shows::Overview => Shown::Overview,
            Shows::Picture => Shown::Picture,
        };
        let value = Frame {
            shows: shows as i32,
            is_complete: (streamed.frame.is_complete && streamed.frame.lost_roots.is_empty()).into(),
            upload_count: stream.uploads.len(),
            drop_count: stream.drops.len(),
            late_root_count: streamed.frame.late_roots.into(),
            root_count: picture.roots().len() as u64,
            triangle_count: picture.triangle_count(),
            byte_count: streamed.bytes_read,
            wanted_triangle_count,
            limited_by: limited_by as i32,
        };
        stream.problems.extend(stream.streamer.take_problems());
        write(frame, value, "frame")
    })
}

/// Writes which root of the last frame to upload, and its mesh, which the caller frees. Where the stream shows channels
/// and the root's images are there, the mesh has one page with all of them, else none. Of heights it has normals, and
/// colours if there is a ramp.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_get_upload(
    stream: *const Stream,
    number: usize,
    upload: *mut Upload,
    mesh: *mut *mut Mesh,
) -> Status {
    guard(|| {
        write(mesh, std::ptr::null_mut(), "mesh")?;
        let stream = borrow(stream, "stream")?;
        let drawn = stream.uploads.get(number).and_then(|&root| stream.streamer.picture().root(root));
        let missing = || format!("there is no upload {number}; the frame has {}", stream.uploads.len());
        let drawn = drawn.ok_or_else(|| Failure::argument(missing()))?;
        let (root, level) = (drawn.surface.root, drawn.surface.level.into());
        write(upload, Upload { root, level, error: drawn.error() }, "upload")?;
        give(mesh, mesh_of(drawn, stream))
    })
}

/// The mesh of a root as it is drawn.
fn mesh_of(drawn: &DrawnRoot, stream: &Stream) -> Mesh {
    if let Some(images) = drawn.images() {
        let (positions, triangles) = drawn.joined();
        return Mesh::Heights(lit(drawn, images, positions, triangles));
    }
    let Some(session) = stream.streamer.session() else { return bare(drawn) };
    let lattice = session.index().lattice();
    let Some((texture, ByPiece { positions, triangles, pieces, .. })) = drawn.texture().zip(drawn.by_piece()) else {
        return bare(drawn);
    };
    let Some(map) = &texture.texture.map else { return bare(drawn) };
    let [width, height] = map.size;
    let place = |(position, &piece): (&[f64; 3], &u32)| {
        let place = map
            .pieces
            .get(piece as usize)
            .map_or([0.0; 2], |piece| piece.place(lattice.units(*position).map(|x| x.round() as i64)));
        [(place[0] / f64::from(width)) as f32, (place[1] / f64::from(height)) as f32]
    };
    let places = positions.iter().zip(&pieces).map(place).collect();
    let pages = vec![Page { width, height, first_triangle: 0, triangle_count: triangles.len() }];
    let images = Images::Drawn(Arc::clone(texture) as Arc<DrawnTexture>, Arc::clone(&stream.channels));
    Mesh::Paged(Box::new(Paged { positions, triangles, sources: vec![], places, pages, images }))
}

fn bare(drawn: &DrawnRoot) -> Mesh {
    let (positions, triangles) = drawn.joined();
    Mesh::Bare(lodpack::Mesh { positions, triangles, ..lodpack::Mesh::default() })
}

/// A tile of heights, with what its images have at its vertices.
fn lit(drawn: &DrawnRoot, images: &TileImages, positions: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> Lit {
    // Vertices lie on samples, but for some on the border, which lie between two.
    let ends = |[x, y]: [f32; 2]| {
        let sample = |x: f32, y: f32| {
            let within = |x: f32| (x.max(0.0) as usize).min(SIDE - 1);
            within(y) * SIDE + within(x)
        };
        [sample(x.floor(), y.floor()), sample(x.ceil(), y.ceil())]
    };
    let normal = |place: [f32; 2]| {
        let [a, b] = ends(place).map(|at| images.normals[at].map(f32::from));
        let sum = [0, 1, 2].map(|k| a[k] + b[k]);
        let length = sum.iter().map(|x| x * x).sum::<f32>().sqrt();
        if length > 0.0 { sum.map(|x| x / length) } else { [0.0; 3] }
    };
    let colours = images.colours.as_ref().map(|colours| {
        let colour = |place: [f32; 2]| {
            let [a, b] = ends(place).map(|at| colours.get(images.texel_of(at)).copied().unwrap_or_default());
            [0, 1, 2].map(|k| (u16::from(a[k]) + u16::from(b[k])).div_ceil(2) as u8)
        };
        drawn.places().map(colour).collect()
    });
    Lit { positions, triangles, normals: drawn.places().map(normal).collect(), heights: vec![], colours }
}

/// Writes the number of a root of the last frame that is drawn no longer.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_get_drop(stream: *const Stream, number: usize, root: *mut u32) -> Status {
    guard(|| {
        let drops = &borrow(stream, "stream")?.drops;
        let missing = || Failure::argument(format!("there is no drop {number}; the frame has {}", drops.len()));
        write(root, *drops.get(number).ok_or_else(missing)?, "root")
    })
}

/// Waits until everything that the last frame wanted is loaded, or given up. The next frame draws it.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_settle(stream: *const Stream) -> Status {
    guard(|| {
        borrow(stream, "stream")?.streamer.settle();
        Ok(())
    })
}

/// The next thing that a stream could not load and draws coarser: a text that is valid until the next call with the
/// stream, or null.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_next_problem(stream: *mut Stream) -> *const c_char {
    let Ok(stream) = borrow_mut(stream, "stream") else { return std::ptr::null() };
    let Some(problem) = stream.problems.pop() else { return std::ptr::null() };
    let text = format!("{}: {}", problem.location, problem.error).replace('\0', " ");
    stream.problem = CString::new(text).unwrap_or_default();
    stream.problem.as_ptr()
}

/// Has later frames try again what could not be loaded.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_retry(stream: *mut Stream) -> Status {
    guard(|| {
        borrow_mut(stream, "stream")?.streamer.retry_failed();
        Ok(())
    })
}

/// Ends the threads of a stream.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_close_stream(stream: *mut Stream) {
    release(stream);
}
