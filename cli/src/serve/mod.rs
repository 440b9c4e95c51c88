//! A web server for a few files: byte ranges for programs and pages on any host (RFC 9110), and what is wrong with
//! other servers.
//!
//! It serves what is on its [`Shelf`] and nothing else, so no address can lead to another file. Every connection has a
//! thread.

mod answer;
mod check;
mod range;
mod request;
mod shelf;

pub use check::{Finding, Verdict, check};
pub use shelf::{Item, Shelf, escape};

use answer::answer;
use request::Head;
use std::io;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

/// A connection without a request for this long is closed, and so is one that takes nothing.
const IDLE: Duration = Duration::from_secs(60);
/// Most connections at once; a browser opens six. Further ones are refused, so that no one can start threads without
/// end.
const CONNECTIONS: usize = 256;

/// A server that listens and does not answer yet.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
}

impl Server {
    /// Listens at an address; with port 0 the system chooses one.
    ///
    /// # Errors
    /// That of the system: the port is taken, or the address is none of this machine.
    pub fn bind(address: SocketAddr) -> io::Result<Self> {
        Ok(Self { listener: TcpListener::bind(address)? })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// That of the system.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Answers requests for ever.
    pub fn run(&self, shelf: &Arc<Shelf>) {
        let open = Arc::new(AtomicUsize::new(0));
        for stream in self.listener.incoming() {
            let Ok(stream) = stream else {
                // No more file handles, for instance: others have to be closed first.
                std::thread::sleep(Duration::from_millis(50));
                continue;
            };
            let (guard, shelf) = (Guard::new(&open), Arc::clone(shelf));
            if open.load(Ordering::Relaxed) <= CONNECTIONS {
                // Without a thread the connection is closed, and the client tries again.
                let _ = std::thread::Builder::new().spawn(move || {
                    let _guard = guard;
                    // An error is the client's: it went away.
                    let _ = serve(&stream, &shelf);
                });
            }
        }
    }
}

/// Counts a connection while it is open.
struct Guard(Arc<AtomicUsize>);

impl Guard {
    fn new(open: &Arc<AtomicUsize>) -> Self {
        open.fetch_add(1, Ordering::Relaxed);
        Self(Arc::clone(open))
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Answers the requests of a connection, one after the other.
fn serve(stream: &TcpStream, shelf: &Shelf) -> io::Result<()> {
    stream.set_read_timeout(Some(IDLE))?;
    stream.set_write_timeout(Some(IDLE))?;
    stream.set_nodelay(true)?;
    let mut head = Head::default();
    while let Some(request) = head.next(stream)? {
        let is_last = request.as_ref().is_none_or(|request| request.is_last);
        answer(request.as_ref(), shelf)?.send(stream, is_last)?;
        if is_last {
            break;
        }
    }
    Ok(())
}
