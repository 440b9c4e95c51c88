//! The functions that JavaScript calls.
#![expect(
    unsafe_code,
    reason = "exported names have to be unmangled, which the language counts as unsafe because two of them could collide; \
              these all begin with `lodpack_`. No pointer is followed here: JavaScript writes only to buffers of the size that it asked for"
)]

use std::{cell::RefCell, io};

use lodpack::stream::Options;

use crate::{
    answer::{Answer, floats, refuse},
    query,
    state::State,
    stream::{Polled, time},
};

thread_local! {
    static STATE: RefCell<State> = RefCell::default();
}

/// Empties the output, calls, and puts an error into the output.
fn call(function: impl FnOnce(&mut State) -> Answer) -> i32 {
    STATE.with_borrow_mut(|state| {
        state.output.clear();
        match function(state) {
            // Answers are numbers of things in memory, which has no more bytes.
            Ok(number) => i32::try_from(number).unwrap_or(i32::MAX),
            Err(error) => refuse(&mut state.output, &error) as i32,
        }
    })
}

/// Makes room for an argument of this many bytes. Returns where to write it, or 0 if there is no memory.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_input(length: usize) -> *mut u8 {
    STATE.with_borrow_mut(|state| {
        state.input.clear();
        if state.input.try_reserve_exact(length).is_err() {
            return std::ptr::null_mut();
        }
        state.input.resize(length, 0);
        state.input.as_mut_ptr()
    })
}

/// Where the result of the last call begins.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_output() -> *const u8 {
    STATE.with_borrow(|state| state.output.as_ptr())
}

/// How many bytes the result of the last call has.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_output_length() -> usize {
    STATE.with_borrow(|state| state.output.len())
}

/// Gives the memory of the last result back.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_forget() {
    STATE.with_borrow_mut(|state| state.output = Vec::new());
}

/// Begins to open a file of this size; the input has its first bytes.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_start(size: f64, part_bytes: f64) -> i32 {
    call(|state| state.start(size, part_bytes))
}

/// Takes bytes that opening lacks, from the input.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_insert(offset: f64) -> i32 {
    call(|state| state.insert(offset))
}

/// Opens the file.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_finish() -> i32 {
    call(State::finish)
}

/// What the index says at once. Returns 1 for a file of heights, else 0.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_info() -> i32 {
    call(State::info)
}

/// What a file of heights says about its grid.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_heights() -> i32 {
    call(State::heights)
}

/// Where the ground of a mesh lies in the file, and where the mesh is; returns 0 if there is none.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_ground() -> i32 {
    call(State::ground)
}

/// Where an open ground is in the space of the mesh, whose place is in the input.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_ground_frame() -> i32 {
    call(State::ground_frame)
}

/// The overview's mesh; with light followed by the normals of its vertices, and vertices on creases are there more than
/// once. Returns 0 if there is none.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_overview(light: u32) -> i32 {
    call(|state| state.overview(light != 0))
}

/// Returns a new question.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_ask() -> i32 {
    call(State::ask)
}

/// Takes bytes that a question lacks, from the input.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_tell(question: u32, offset: f64) -> i32 {
    call(|state| state.tell(question, offset))
}

/// Keeps the index blocks among the bytes of a question.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_supply(question: u32) -> i32 {
    call(|state| state.supply(question))
}

/// Closes a question.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_close_question(question: u32) -> i32 {
    call(|state| state.close_question(question))
}

/// The cut of the query in the input. Returns its number of nodes.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_select(question: u32) -> i32 {
    call(|state| state.select(question))
}

/// The cut that draws everything at a level. Returns its number of nodes.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_uniform_cut(level: u32) -> i32 {
    call(|state| state.uniform_cut(level))
}

/// The mesh of the cut in the input.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_extract(question: u32) -> i32 {
    call(|state| state.extract(question))
}

/// The channels of the file. Returns their number.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_channels() -> i32 {
    call(State::channels)
}

/// The values of the ends of a channel's ramp (f64); returns 0 if it has none.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_channel_range(question: u32, channel: u32) -> i32 {
    call(|state| state.channel_range(question, channel))
}

/// The mesh of the cut in the input with pages of some channels, whose numbers are before it. Returns the number of
/// pages of each.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_extract_textured(question: u32, channel_count: u32, page_side: u32) -> i32 {
    call(|state| state.extract_textured(question, channel_count, page_side))
}

/// Makes a stream show a channel, with these values at the ends of its ramp; none if the number is that of no channel.
/// `beside` is the sum of 1, if normals are to come with it, and 2, if what else materials have is.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_show(stream: u32, channel: u32, low: f64, high: f64, beside: u32) -> i32 {
    call(|state| state.show(stream, channel, [low, high], beside))
}

/// How many boundary edges the mesh of the cut in the input has.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_boundary_edge_count() -> i32 {
    call(State::boundary_edge_count)
}

/// Opens a stream and returns it, with normals for smooth light unless `light` is 0. Needs the whole index.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_open_stream(
    byte_cache: f64,
    decoded_cache: f64,
    texel_cache: f64,
    texels_per_pixel: f64,
    max_reads: u32,
    ahead_ms: f64,
    light: u32,
    x: f64,
    y: f64,
    z: f64,
    upload_bytes: f64,
) -> i32 {
    let options = Options {
        byte_cache: byte_cache as u64,
        decoded_cache: decoded_cache as u64,
        texel_cache: texel_cache as u64,
        texels_per_pixel,
        max_reads: max_reads as usize,
        upload_bytes: upload_bytes as u64,
        // As the native viewer.
        sample_px: 3.0,
        light: light != 0,
        ..Options::default()
    };
    call(|state| state.open_stream(options, ahead_ms, [x, y, z]))
}

/// Draws a frame for the query in the input, and packs what is new in it.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_frame(stream: u32, now_ms: f64) -> i32 {
    call(|state| {
        let (stream, input, output) = state.stream(stream)?;
        let query = query::unpack(floats(input))?;
        stream.frame(query, time(now_ms), output).map(|()| 0)
    })
}

/// Makes the next frame pack everything.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_lose(stream: u32) -> i32 {
    call(|state| {
        state.stream(stream)?.0.lose();
        Ok(0)
    })
}

/// Does the next job of a stream: 0 if there is none, 1 if the output holds a read to start, 2 if something was
/// decoded.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_poll(stream: u32, now_ms: f64) -> i32 {
    call(|state| {
        let (stream, _, output) = state.stream(stream)?;
        Ok(match stream.poll(time(now_ms), output) {
            Polled::Idle => 0,
            Polled::Read => 1,
            Polled::Decoded => 2,
        })
    })
}

/// Takes the bytes of a read from the input.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_supply_read(stream: u32, read: f64, now_ms: f64) -> i32 {
    call(|state| {
        let (stream, input, _) = state.stream(stream)?;
        stream.supply(read, Ok(std::mem::take(input)), time(now_ms));
        Ok(0)
    })
}

/// Takes the reason, from the input, why a read has no bytes.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_fail_read(stream: u32, read: f64, now_ms: f64) -> i32 {
    call(|state| {
        let (stream, input, _) = state.stream(stream)?;
        let reason = String::from_utf8_lossy(input).into_owned();
        stream.supply(read, Err(io::Error::other(reason)), time(now_ms));
        Ok(0)
    })
}

/// Whether anything still wants a read: 1 or 0.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_is_wanted(stream: u32, read: f64) -> i32 {
    call(|state| Ok(u32::from(state.stream(stream)?.0.is_wanted(read))))
}

/// When the next failed read is to be retried: 1 and the time (f64, ms), or 0.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_next_due(stream: u32) -> i32 {
    call(|state| {
        let (stream, _, output) = state.stream(stream)?;
        let due = stream.next_due();
        output.extend(due.into_iter().flat_map(f64::to_le_bytes));
        Ok(u32::from(due.is_some()))
    })
}

/// What a stream has given up since the last call: a line for each.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_problems(stream: u32) -> i32 {
    call(|state| {
        let (stream, _, output) = state.stream(stream)?;
        output.extend(stream.problems().into_bytes());
        Ok(0)
    })
}

/// Makes a stream try again what it has given up.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_retry(stream: u32) -> i32 {
    call(|state| {
        state.stream(stream)?.0.retry();
        Ok(0)
    })
}

/// Closes a stream.
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_close_stream(stream: u32) -> i32 {
    call(|state| state.close_stream(stream))
}

/// The numbers of objects and of objects and assemblies; returns 0 if the file has none.
#[cfg(feature = "channels")]
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_objects(_question: u32) -> i32 {
    call(State::objects)
}

/// The nodes whose numbers are in the input: parents and lengths of names and ids, then these.
#[cfg(feature = "channels")]
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_object_nodes(question: u32) -> i32 {
    call(|state| state.object_nodes(question))
}

/// The nodes of the name, or else the id, in the input. Returns their number.
#[cfg(feature = "channels")]
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_find_objects(question: u32) -> i32 {
    call(|state| state.find_objects(question))
}

/// The pages of nodes in which a node has children. Returns their number.
#[cfg(feature = "channels")]
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_object_child_pages(question: u32, parent: u32) -> i32 {
    call(|state| state.object_child_pages(question, parent))
}

/// The children of a node in a page. Returns their number.
#[cfg(feature = "channels")]
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_object_children(question: u32, parent: u32, page: u32) -> i32 {
    call(|state| state.object_children(question, parent, page))
}

/// What lies above a node, its parent first. Returns its number.
#[cfg(feature = "channels")]
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_objects_above(question: u32, number: u32) -> i32 {
    call(|state| state.objects_above(question, number))
}

/// A box around the nodes in the input (f64); returns 0 if there is nothing of them.
#[cfg(feature = "channels")]
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_object_bounds(question: u32) -> i32 {
    call(|state| state.object_bounds(question))
}

/// Returns a new filter for the choice in the input.
#[cfg(feature = "channels")]
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_filter_objects(question: u32) -> i32 {
    call(|state| state.filter_objects(question))
}

/// Closes a filter. Streams that show it keep it.
#[cfg(feature = "channels")]
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_close_filter(_question: u32, filter: u32) -> i32 {
    call(|state| state.close_filter(filter))
}

/// The mesh of the query in the input, of what a filter shows.
#[cfg(feature = "channels")]
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_extract_objects(question: u32, filter: u32) -> i32 {
    call(|state| state.extract_objects(question, filter))
}

/// What the ray in the input meets first of what a filter shows (f64): object, root, distance, error, point; returns 0
/// if it meets nothing.
#[cfg(feature = "channels")]
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_pick(question: u32, filter: u32) -> i32 {
    call(|state| state.pick(question, filter))
}

/// Draws what a filter shows from the next frame of a stream on; everything without one.
#[cfg(feature = "channels")]
#[unsafe(no_mangle)]
pub extern "C" fn lodpack_show_objects(stream: u32, filter: u32) -> i32 {
    call(|state| {
        let filter = state.filter(filter)?;
        state.stream(stream)?.0.show_objects(filter);
        Ok(0)
    })
}
