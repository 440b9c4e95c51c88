//! The controller of a wall: adapts the cuts of all displays, and says when they show what they have drawn.

use std::{
    collections::BTreeMap,
    io::BufReader,
    net::{SocketAddr, TcpListener, TcpStream},
    sync::{
        Arc,
        mpsc::{Receiver, RecvTimeoutError, TryRecvError, channel},
    },
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail};
use lodpack::{
    Node, Query, View,
    select::{Coherence, Hierarchy, Tiles, Unification},
};

use super::{Answer, Drawn, Frame, Order, PROTOCOL, receive, send};
use crate::args::Size;

/// How long all displays wait for one: afterwards they go on without it until it has caught up.
const PATIENCE: Duration = Duration::from_secs(1);
/// How long a program that has connected may take to say who it is, and a display to load its first frame.
const GREETING: Duration = Duration::from_secs(5);
const FIRST_FRAME: Duration = Duration::from_secs(60);
/// A display that says nothing for so long is dropped.
const LONGEST_SILENCE: Duration = Duration::from_secs(10);

/// What the controller knows of a display.
struct Seat {
    stream: TcpStream,
    answers: Receiver<Drawn>,
    /// The nodes that it has.
    nodes: BTreeMap<u32, u8>,
    is_fresh: bool,
    last: Drawn,
    heard: Instant,
    /// Whether the others wait for it.
    is_awaited: bool,
}

/// A frame of all displays, ready to be sent.
pub(crate) struct Adapted {
    views: Vec<View>,
    nodes: Vec<Vec<Node>>,
}

/// What a frame has cost.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub(crate) struct WallReport {
    pub frame: u64,
    /// Displays that have drawn it in time.
    pub displays: usize,
    /// Of all of them.
    pub triangles: u64,
    pub late: u32,
    pub slowest_ms: f64,
    /// How long the frame took, from the first message to the last.
    pub frame_ms: f64,
    /// Bytes that the controller has sent so far, and that the displays have read of the file.
    pub sent: u64,
    pub read: u64,
}

/// The wall.
pub(crate) struct Controller {
    hierarchy: Arc<Hierarchy>,
    /// Which file it shows.
    file: [u32; 2],
    counts: Size,
    /// Of the whole picture, pixels.
    size: Size,
    seats: Vec<Option<Seat>>,
    joining: Receiver<(TcpStream, Answer)>,
    tiles: Option<Tiles>,
    number: u64,
    sent: u64,
    begun: Instant,
}

impl Controller {
    /// Waits for displays at an address. Returns the one at which they reach it.
    ///
    /// # Errors
    /// If the address cannot be listened at, or the picture cannot be divided.
    pub fn listen(
        address: &str,
        (hierarchy, file): (Hierarchy, [u32; 2]),
        counts: Size,
        size: Size,
    ) -> Result<(Self, SocketAddr)> {
        let [[columns, rows], [width, height]] = [counts, size];
        if !width.is_multiple_of(columns) || !height.is_multiple_of(rows) {
            bail!("{width}x{height} pixels cannot be divided into {columns}x{rows} displays of equal size");
        }
        let listener = TcpListener::bind(address).with_context(|| format!("cannot listen at {address}"))?;
        let at = listener.local_addr()?;
        let (found, joining) = channel();
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let found = found.clone();
                // Whoever says nothing keeps nobody from joining.
                std::thread::spawn(move || {
                    let greeting = greeting_of(&stream);
                    greeting.is_ok_and(|greeting| found.send((stream, greeting)).is_ok())
                });
            }
        });
        let seats = (0..columns * rows).map(|_| None).collect();
        let hierarchy = Arc::new(hierarchy);
        let begun = Instant::now();
        let this = Self { hierarchy, file, counts, size, seats, joining, tiles: None, number: 0, sent: 0, begun };
        Ok((this, at))
    }

    /// How many displays there are.
    pub fn display_count(&self) -> usize {
        self.seats.iter().flatten().count()
    }

    /// Seats those who have come since the last call. Waits for the first one for a time.
    pub fn seat(&mut self, wait: Duration) {
        let mut next = self.joining.recv_timeout(wait).ok();
        while let Some((stream, greeting)) = next {
            if let Err(error) = self.welcome(stream, greeting) {
                eprintln!("lodpack-view: a display could not join: {error:#}");
            }
            next = self.joining.try_recv().ok();
        }
    }

    fn welcome(&mut self, mut stream: TcpStream, greeting: Answer) -> Result<()> {
        let place = match self.place_for(&greeting) {
            Ok(place) => place,
            Err(why) => {
                send(&mut stream, &Order::Refused { why: why.clone() })?;
                bail!(why);
            }
        };
        let [columns, rows] = self.counts;
        let at = [place as u32 % columns, place as u32 / columns];
        let size = [self.size[0] / columns, self.size[1] / rows];
        self.sent += send(&mut stream, &Order::Welcome { place: at, size })?;
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(PATIENCE))?;
        stream.set_read_timeout(None)?;
        let mut from = BufReader::new(stream.try_clone()?);
        let (said, answers) = channel();
        std::thread::spawn(move || {
            while let Ok(Some(Answer::Drawn(drawn))) = receive(&mut from) {
                if said.send(drawn).is_err() {
                    break;
                }
            }
        });
        let (nodes, last, heard) = (BTreeMap::new(), Drawn::default(), Instant::now());
        self.seats[place] = Some(Seat { stream, answers, nodes, is_fresh: true, last, heard, is_awaited: true });
        eprintln!("lodpack-view: display {},{} has joined", at[0], at[1]);
        Ok(())
    }

    /// The seat for whoever has come, or why there is none.
    fn place_for(&self, greeting: &Answer) -> Result<usize, String> {
        let Answer::Hello { protocol, version, file, place } = greeting else {
            return Err("a display says first who it is".into());
        };
        let own = env!("CARGO_PKG_VERSION");
        if *protocol != PROTOCOL || version != own {
            return Err(format!("the controller is lodpack-view {own}, the display {version}: use the same on both"));
        }
        if *file != self.file {
            return Err("the display has opened another file than the controller".into());
        }
        let [columns, rows] = self.counts;
        match *place {
            Some([x, y]) if x >= columns || y >= rows => {
                Err(format!("there is no display {x},{y} in a wall of {columns}x{rows}"))
            }
            Some([x, y]) => {
                let place = (y * columns + x) as usize;
                let is_free = self.seats[place].is_none();
                is_free.then_some(place).ok_or_else(|| format!("there is a display {x},{y} already"))
            }
            None => self.seats.iter().position(Option::is_none).ok_or_else(|| "the wall has all its displays".into()),
        }
    }

    /// Finds what all displays draw for a query.
    ///
    /// # Errors
    /// As [`Tiles::update`].
    pub fn adapt(&mut self, query: &Query, coherence: Coherence) -> Result<Adapted> {
        let view = query.view.context("a wall needs a view")?;
        let [columns, rows] = self.counts.map(f64::from);
        let share = |budget: Option<u64>| budget.map(|budget| budget / self.seats.len() as u64);
        let (mut views, mut queries) = (Vec::new(), Vec::new());
        for [x, y] in (0..self.counts[1]).flat_map(|y| (0..self.counts[0]).map(move |x| [x, y].map(f64::from))) {
            let window = [[x / columns, 1.0 - (y + 1.0) / rows], [(x + 1.0) / columns, 1.0 - y / rows]];
            let view = View { window, viewport: self.size, ..view };
            views.push(view);
            queries.push(Query {
                view: Some(view),
                max_triangles: share(query.max_triangles),
                max_nodes: share(query.max_nodes),
                max_bytes: share(query.max_bytes),
                ..query.clone()
            });
        }
        let tiles = match &mut self.tiles {
            Some(tiles) => tiles,
            none => none.insert(Tiles::new(&self.hierarchy, &queries, coherence, Unification::Quality)?),
        };
        let report = tiles.update(&queries)?;
        Ok(Adapted { views, nodes: tiles.with_neighbours(&report.unified) })
    }

    /// Sends a frame to all displays.
    pub fn draw(&mut self, frame: &Adapted) {
        (self.number, self.begun) = (self.number + 1, Instant::now());
        let number = self.number;
        for ((seat, view), nodes) in self.seats.iter_mut().zip(&frame.views).zip(&frame.nodes) {
            let Some(known) = seat else { continue };
            let wanted: BTreeMap<u32, u8> = nodes.iter().map(|node| (node.root, node.level)).collect();
            let new = wanted.iter().filter(|(root, level)| known.nodes.get(root) != Some(level));
            let gone = known.nodes.keys().filter(|root| !wanted.contains_key(root));
            let mut nodes: Vec<(u32, Option<u8>)> = new.map(|(&root, &level)| (root, Some(level))).collect();
            nodes.extend(gone.map(|&root| (root, None)));
            let order = Order::Draw(Frame { number, camera: (*view).into(), is_first: known.is_fresh, nodes });
            known.nodes = wanted;
            match send(&mut known.stream, &order) {
                Ok(bytes) => self.sent += bytes,
                Err(error) => drop_seat(seat, &error.to_string()),
            }
        }
    }

    /// Waits until all displays have drawn what they were sent, and has them show it.
    pub fn show(&mut self) -> WallReport {
        let number = self.number;
        let mut report = WallReport { frame: number, ..WallReport::default() };
        for seat in &mut self.seats {
            let Some(known) = seat else { continue };
            let patience = if known.is_fresh { FIRST_FRAME } else { PATIENCE };
            let until = self.begun + if known.is_awaited { patience } else { Duration::ZERO };
            match known.wait_for(number, until) {
                Ok(true) => {
                    report.displays += 1;
                    report.triangles += known.last.triangles;
                    report.late += known.last.late;
                    report.slowest_ms = report.slowest_ms.max(known.last.milliseconds);
                }
                Ok(false) if known.heard.elapsed() > LONGEST_SILENCE.max(patience) => {
                    drop_seat(seat, "it says nothing");
                }
                Ok(false) => {}
                Err(error) => drop_seat(seat, &error.to_string()),
            }
        }
        for seat in &mut self.seats {
            let Some(known) = seat.as_mut().filter(|known| known.last.number == number) else { continue };
            match send(&mut known.stream, &Order::Show { number }) {
                Ok(bytes) => self.sent += bytes,
                Err(error) => drop_seat(seat, &error.to_string()),
            }
        }
        report.frame_ms = self.begun.elapsed().as_secs_f64() * 1e3;
        let read = self.seats.iter().flatten().map(|seat| seat.last.bytes_read).sum();
        (report.sent, report.read) = (self.sent, read);
        report
    }

    /// Has all displays show the last frame, and draw the next one: what a query wants.
    ///
    /// # Errors
    /// As [`Controller::adapt`].
    pub fn follow(&mut self, query: &Query) -> Result<()> {
        let adapted = self.adapt(query, Coherence::default())?;
        self.show();
        // Whoever comes now has not been sent the last frame, so nobody waits for that.
        self.seat(Duration::ZERO);
        self.draw(&adapted);
        Ok(())
    }

    /// Sends the displays home.
    pub fn end(&mut self) {
        for mut seat in self.seats.iter_mut().filter_map(Option::take) {
            let _ = send(&mut seat.stream, &Order::End);
        }
    }
}

impl Seat {
    /// Waits until it has drawn a frame. Returns whether it has.
    fn wait_for(&mut self, number: u64, until: Instant) -> Result<bool> {
        while self.last.number != number {
            let left = until.saturating_duration_since(Instant::now());
            let answer = if left.is_zero() {
                self.answers.try_recv().map_err(|error| error == TryRecvError::Disconnected)
            } else {
                self.answers.recv_timeout(left).map_err(|error| error == RecvTimeoutError::Disconnected)
            };
            match answer {
                Ok(drawn) if drawn.number > number => bail!("it has drawn a frame that it was not sent"),
                Ok(drawn) => (self.last, self.heard) = (drawn, Instant::now()),
                Err(true) => bail!("the connection has ended"),
                Err(false) => {
                    self.is_awaited = false;
                    return Ok(false);
                }
            }
        }
        (self.is_awaited, self.is_fresh) = (true, false);
        Ok(true)
    }
}

fn drop_seat(seat: &mut Option<Seat>, why: &str) {
    eprintln!("lodpack-view: a display has left: {why}");
    *seat = None;
}

/// The first message of whoever has connected.
fn greeting_of(stream: &TcpStream) -> Result<Answer> {
    stream.set_read_timeout(Some(GREETING))?;
    // A byte at a time, so that nothing of the next message is taken.
    let mut from = BufReader::with_capacity(1, stream);
    receive(&mut from)?.context("nothing was said")
}
