//! A display of a wall: loads and draws what the controller wants, and shows it when all others have drawn theirs.

use std::{
    collections::BTreeMap,
    io::BufReader,
    net::TcpStream,
    sync::mpsc::{Receiver, RecvTimeoutError, channel},
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail};
use lodpack::{Node, View};

use super::{Answer, Drawn, Frame, Order, PROTOCOL, receive, send};
use crate::{args::Size, report::Report, scene::Scene};

/// A place in a wall.
pub(crate) struct Display {
    stream: TcpStream,
    orders: Receiver<Result<Order>>,
    nodes: BTreeMap<u32, u8>,
    bytes_read: u64,
    pub place: Size,
    pub size: Size,
}

/// What the controller wants.
pub(crate) enum Wanted {
    /// A frame to draw, and then to answer.
    Frame(Box<Begun>),
    /// What was drawn is shown.
    Show(u64),
    /// Nothing more.
    End,
}

/// A frame whose surfaces are in the scene.
pub(crate) struct Begun {
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
                let (said, orders) = channel();
                std::thread::spawn(move || {
                    loop {
                        let order = receive(&mut from).and_then(|order| order.context("the controller has gone"));
                        let is_last = !matches!(order, Ok(Order::Draw(_) | Order::Show { .. }));
                        if said.send(order).is_err() || is_last {
                            break;
                        }
                    }
                });
                Ok(Self { stream, orders, nodes: BTreeMap::new(), bytes_read: 0, place, size })
            }
            Some(Order::Refused { why }) => bail!("the wall at {address} refuses: {why}"),
            _ => bail!("what answers at {address} is no wall"),
        }
    }

    /// Waits for the next thing to do. Frames have their surfaces in the scene then, as far as they are loaded, or all
    /// of them if it waits for these, too.
    ///
    /// # Errors
    /// If the controller has gone or says something that makes no sense.
    pub fn next(&mut self, scene: &mut Scene, waits: bool) -> Result<Wanted> {
        let order = self.orders.recv().context("the controller has gone")?;
        self.obey(order?, scene, waits)
    }

    /// The next thing to do, if there is one within two milliseconds.
    ///
    /// # Errors
    /// As [`Display::next`].
    pub fn poll(&mut self, scene: &mut Scene) -> Result<Option<Wanted>> {
        match self.orders.recv_timeout(Duration::from_millis(2)) {
            Ok(order) => self.obey(order?, scene, false).map(Some),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => bail!("the controller has gone"),
        }
    }

    fn obey(&mut self, order: Order, scene: &mut Scene, waits: bool) -> Result<Wanted> {
        match order {
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
                    scene.first.know(root)?;
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
