//! A web server for a few files: byte ranges for programs and pages (RFC 9110), and what is wrong with other servers.
//!
//! HTTP itself is hyper's. The server has what is on its [`Shelf`] and nothing else, so no address can lead to another
//! file.

mod answer;
mod body;
mod check;
mod clients;
mod range;
mod shelf;

pub use check::{Finding, Verdict, check};
pub use shelf::{Item, Shelf, escape};

use answer::answer;
use body::Sent;
use clients::{Client, Clients};
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Request, Response};
use hyper_util::rt::{TokioIo, TokioTimer};
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio_io_timeout::TimeoutStream;

/// A client has so long for the head of a request, from when it could begin it.
const HEAD: Duration = Duration::from_secs(30);
/// A connection that takes nothing for so long is closed.
const STALLED: Duration = Duration::from_secs(60);
/// Longest head of a request. Browsers stay below 8 KiB.
const HEAD_BYTES: usize = 16 << 10;

/// A server that listens and does not answer yet.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    /// Whether pages of other hosts may read what it has.
    cors: bool,
}

impl Server {
    /// Listens at an address; with port 0 the system chooses one. With `cors`, pages on any host may read the files.
    ///
    /// # Errors
    /// That of the system: the port is taken, or the address is none of this machine.
    pub fn bind(address: SocketAddr, cors: bool) -> io::Result<Self> {
        Ok(Self { listener: TcpListener::bind(address)?, cors })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// That of the system.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Answers requests for ever.
    ///
    /// # Errors
    /// If the system does not let it wait for connections.
    pub fn run(&self, shelf: &Arc<Shelf>) -> io::Result<()> {
        let rules = Rules { cors: self.cors, is_local: self.address()?.ip().is_loopback() };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build()?;
        self.listener.set_nonblocking(true)?;
        runtime.block_on(async {
            let listener = tokio::net::TcpListener::from_std(self.listener.try_clone()?)?;
            let clients = Clients::default();
            loop {
                let Ok((stream, address)) = listener.accept().await else {
                    // No more file handles, for instance: others have to be closed first.
                    tokio::time::sleep(Duration::from_millis(50)).await;
                    continue;
                };
                let shelf = Arc::clone(shelf);
                clients.add(address.ip(), |client| tokio::spawn(serve(stream, shelf, rules, client)).abort_handle());
            }
        })
    }
}

/// Who may read.
#[derive(Clone, Copy, Debug)]
struct Rules {
    /// Pages on any host.
    cors: bool,
    /// Only this machine reaches the server. A page whose name leads here nevertheless is none of ours.
    is_local: bool,
}

/// Answers the requests of a connection, one after the other.
async fn serve(stream: TcpStream, shelf: Arc<Shelf>, rules: Rules, client: Client) {
    // Without it, small answers wait.
    let _ = stream.set_nodelay(true);
    let mut stream = TimeoutStream::new(stream);
    stream.set_write_timeout(Some(STALLED));
    let service = service_fn(|request: Request<Incoming>| {
        let (shelf, busy) = (Arc::clone(&shelf), client.busy());
        async move {
            // Files are opened beside the connections: a disk may be slow.
            let (head, _) = request.into_parts();
            let answer = tokio::task::spawn_blocking(move || answer(&head, &shelf, rules)).await;
            let answer = answer.map_err(io::Error::other)?;
            Ok::<Response<Sent>, io::Error>(answer.map(|content| Sent::new(content, busy)))
        }
    });
    let mut connection = http1::Builder::new();
    connection.timer(TokioTimer::new()).header_read_timeout(HEAD).max_buf_size(HEAD_BYTES);
    // An error is the client's: it went away, or sent nonsense and was told so.
    let _ = connection.serve_connection(TokioIo::new(Box::pin(stream)), service).await;
}
