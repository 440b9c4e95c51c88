//! A display of a wall: loads and draws what the controller wants, and shows it when all others have drawn theirs.

use std::{collections::BTreeMap, io::BufReader, net::TcpStream, time::Instant};

use anyhow::{Context, Result, bail};
use lodpack::{Node, View};

use super::{Answer, Drawn, Frame, Order, PROTOCOL, receive, send};
use crate::{
    args::Size,
    scene::{Report, Scene},
};

/// A place in a wall.
pub(super) struct Display {
    stream: TcpStream,
    from: BufReader<TcpStream>,
    nodes: BTreeMap<u32, u8>,
    bytes_read: u64,
    pub place: Size,
    pub size: Size,
}

/// What the controller wants.
pub(super) enum Wanted {
    /// A frame to draw, and then to answer.
    Frame(Box<Begun>),
    /// What was drawn is shown.
    Show(u64),
    /// Nothing more.
    End,
}

/// A frame whose surfaces are in the scene.
pub(super) struct Begun {
    number: u64,
    at: Instant,
    pub view: View,
    pub report: Report,
}

impl Display {
    /// Joins the wall at an address.
    ///
    /// # Errors
    /// If there is no wall, or it does not want this display.
    pub fn join(address: &str, file: [u32; 2], place: Option<Size>) -> Result<Self> {
        let stream = TcpStream::connect(address).with_context(|| format!("there is no wall at {address}"))?;
        stream.set_nodelay(true)?;
        let mut from = BufReader::new(stream.try_clone()?);
        let mut stream = stream;
        let version = env!("CARGO_PKG_VERSION").to_string();
        send(&mut stream, &Answer::Hello { protocol: PROTOCOL, version, file, place })?;
        match receive(&mut from)? {
            Some(Order::Welcome { place, size }) => {
                Ok(Self { stream, from, nodes: BTreeMap::new(), bytes_read: 0, place, size })
            }
            Some(Order::Refused { why }) => bail!("the wall at {address} refuses: {why}"),
            _ => bail!("what answers at {address} is no wall"),
        }
    }

    /// The next thing to do. Frames have their surfaces in the scene then, as far as they are loaded, or all of them if
    /// it waits.
    ///
    /// # Errors
    /// If the controller has gone or says something that makes no sense.
    pub fn next(&mut self, scene: &mut Scene, waits: bool) -> Result<Wanted> {
        match receive(&mut self.from)?.context("the controller has gone")? {
            Order::Draw(frame) => self.follow(frame, scene, waits),
            Order::Show { number } => Ok(Wanted::Show(number)),
            Order::End => Ok(Wanted::End),
            Order::Welcome { .. } | Order::Refused { .. } => bail!("the controller says the same twice"),
        }
    }

    fn follow(&mut self, frame: Frame, scene: &mut Scene, waits: bool) -> Result<Wanted> {
        let at = Instant::now();
        if frame.is_first {
            self.nodes.clear();
        }
        for (root, level) in frame.nodes {
            match level {
                Some(level) => {
                    scene.know(root)?;
                    self.nodes.insert(root, level)
                }
                None => self.nodes.remove(&root),
            };
        }
        let nodes: Vec<Node> = self.nodes.iter().map(|(&root, &level)| Node { root, level }).collect();
        let view = View::from(frame.camera);
        let whole = View { window: View::default().window, ..view };
        let report = scene.show_tile(&nodes, &whole, waits)?;
        self.bytes_read += report.bytes;
        Ok(Wanted::Frame(Box::new(Begun { number: frame.number, at, view, report })))
    }

    /// Tells the controller that a frame is drawn.
    ///
    /// # Errors
    /// If it has gone.
    pub fn answer(&mut self, Begun { number, at, report, .. }: &Begun) -> Result<()> {
        let (bytes_read, milliseconds) = (self.bytes_read, at.elapsed().as_secs_f64() * 1e3);
        let (number, triangles, late) = (*number, report.triangles, report.late);
        let drawn = Drawn { number, triangles, bytes_read, late, milliseconds };
        send(&mut self.stream, &Answer::Drawn(drawn)).context("the controller has gone").map(drop)
    }
}
