//! Walls: displays that draw one picture together, each in a process and on a machine of its own (Niski 2007, chapters
//! 5 and 7).
//!
//! One process, the controller, adapts the cuts of all displays and sends each its camera and what has changed of its
//! nodes. A display loads and draws these, and answers. When all have answered, one word makes them show what they have
//! drawn. So a frame takes two exchanges, and the controller adapts to the next camera while the displays draw.
//!
//! Messages are lines of JSON over TCP. Nobody is asked for a password: a wall belongs in a network of its own.

mod controller;
mod display;
mod run;

use std::io::{BufRead, Read, Write};

use anyhow::{Context, Result, bail};
use lodpack::View;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use crate::{
    args::{Args, Size},
    scene::Scene,
};
pub(crate) use controller::Controller;
pub(crate) use display::{Display, Wanted};
pub use run::{control_wall, join_wall};

/// What a window is in a wall.
pub(crate) enum Role {
    /// Its camera is that of all displays.
    Controls(Box<Controller>),
    /// It shows what the controller wants.
    Shows(Box<Display>),
}

impl Role {
    /// As the command line says; none without a wall.
    ///
    /// # Errors
    /// As [`control_wall`] and [`join_wall`].
    pub fn of(args: &Args, scene: &Scene) -> Result<Option<Self>> {
        if let Some(address) = &args.join {
            return Ok(Some(Self::Shows(Box::new(run::display_of(args, scene, address)?))));
        }
        let (Some(counts), Some(address)) = (args.wall, &args.listen) else { return Ok(None) };
        Ok(Some(Self::Controls(Box::new(run::controller_of(args, scene, counts, address)?))))
    }
}

/// What this program speaks. Others are refused.
const PROTOCOL: u32 = 1;
/// The longest message, bytes: a cut of a million nodes.
const LONGEST: u64 = 1 << 24;

/// From a display.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Answer {
    /// The first message.
    Hello {
        protocol: u32,
        version: String,
        /// Which file it has opened ([`lodpack::index::FileId`]).
        file: [u32; 2],
        /// The display it wants to be, column and row from the upper left one; any that is free if it does not say.
        place: Option<Size>,
    },
    /// A frame is drawn, but not shown yet.
    Drawn(Drawn),
}

/// A frame of a display.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Drawn {
    number: u64,
    triangles: u64,
    /// Bytes of the file that it has read so far.
    bytes_read: u64,
    /// Roots that are drawn coarser than asked for.
    late: u32,
    milliseconds: f64,
}

/// From the controller.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Order {
    /// The first message: the display's place, and its size in pixels.
    Welcome {
        place: Size,
        size: Size,
    },
    /// The first and last message.
    Refused {
        why: String,
    },
    Draw(Frame),
    /// What was drawn last is shown.
    Show {
        number: u64,
    },
    /// The last message.
    End,
}

/// What a display is to draw.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Frame {
    number: u64,
    camera: Camera,
    /// Whether the display forgets the nodes that it had.
    is_first: bool,
    /// Nodes that are new or have another level, and nodes that have gone: root and level.
    nodes: Vec<(u32, Option<u8>)>,
}

/// A [`View`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Camera {
    position: [f64; 3],
    forward: [f64; 3],
    up: [f64; 3],
    vertical_fov: f64,
    near: f64,
    viewport: Size,
    window: [[f64; 2]; 2],
    pixel_tolerance: f64,
}

impl From<View> for Camera {
    fn from(view: View) -> Self {
        let View { position, forward, up, vertical_fov, near, viewport, window, pixel_tolerance } = view;
        Self { position, forward, up, vertical_fov, near, viewport, window, pixel_tolerance }
    }
}

impl From<Camera> for View {
    fn from(camera: Camera) -> Self {
        let Camera { position, forward, up, vertical_fov, near, viewport, window, pixel_tolerance } = camera;
        Self { position, forward, up, vertical_fov, near, viewport, window, pixel_tolerance }
    }
}

/// Sends a message. Returns its size in bytes.
fn send(to: &mut impl Write, message: &impl Serialize) -> Result<u64> {
    let mut line = serde_json::to_vec(message)?;
    line.push(b'\n');
    to.write_all(&line)?;
    Ok(line.len() as u64)
}

/// Receives a message; none at the end.
fn receive<T: DeserializeOwned>(from: &mut impl BufRead) -> Result<Option<T>> {
    let mut line = Vec::new();
    let length = from.by_ref().take(LONGEST).read_until(b'\n', &mut line)?;
    if length == 0 {
        return Ok(None);
    }
    if line.pop() != Some(b'\n') {
        bail!("a message is cut off, or longer than {LONGEST} bytes");
    }
    serde_json::from_slice(&line).map(Some).context("this is no message of a wall")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_come_back_to_the_last_bit_and_others_are_refused() {
        let view = View { position: [0.1, 1e-300, -1.0 / 3.0], near: f64::MIN_POSITIVE, ..View::default() };
        let frame = Frame { number: 7, camera: view.into(), is_first: true, nodes: vec![(3, Some(2)), (9, None)] };
        let mut bytes = Vec::new();
        for order in [Order::Draw(frame.clone()), Order::Show { number: 7 }] {
            send(&mut bytes, &order).unwrap();
        }
        let mut from = &bytes[..];
        assert_eq!(receive(&mut from).unwrap(), Some(Order::Draw(frame)));
        assert_eq!(receive(&mut from).unwrap(), Some(Order::Show { number: 7 }));
        assert_eq!(receive::<Order>(&mut from).unwrap(), None);
        for text in ["{}\n", "GET / HTTP/1.1\r\n", "\"end\"", "\n", "{\"show\":{\"number\":-1}}\n"] {
            assert!(receive::<Order>(&mut text.as_bytes()).is_err(), "{text}");
        }
        assert!(receive::<Order>(&mut std::io::BufReader::new(std::io::repeat(b'[').take(1 << 30))).is_err());
    }
}
