//! Who is connected: at most so many, and none for ever at the cost of others.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::task::AbortHandle;

/// Most connections of one address; a browser opens six.
const OF_ADDRESS: usize = 128;
/// Most connections at once.
const ALL: usize = 1024;

/// The connections, by number: the oldest first.
#[derive(Clone, Debug, Default)]
pub(super) struct Clients(Arc<Mutex<Open>>);

#[derive(Debug, Default)]
struct Open {
    next: u64,
    connections: BTreeMap<u64, Connection>,
}

#[derive(Debug)]
struct Connection {
    address: IpAddr,
    task: AbortHandle,
    /// Answers that are being sent.
    answers: Arc<AtomicUsize>,
}

/// A connection, as long as it is open.
#[derive(Debug)]
pub(super) struct Client {
    clients: Clients,
    number: u64,
    answers: Arc<AtomicUsize>,
}

/// An answer, as long as it is being sent.
#[derive(Debug)]
pub(super) struct Busy(Arc<AtomicUsize>);

impl Clients {
    fn lock(&self) -> MutexGuard<'_, Open> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Starts to serve a connection. Where there are too many, that of the same address (or of any, if all together are
    /// too many) which waits for its next request for longest has to go; if all are being answered, the new one.
    pub fn add(&self, address: IpAddr, start: impl FnOnce(Client) -> AbortHandle) {
        let mut open = self.lock();
        let of_address = |connection: &Connection| connection.address == address;
        let is_full = open.connections.len() >= ALL;
        if is_full || open.connections.values().filter(|connection| of_address(connection)).count() >= OF_ADDRESS {
            let waits = |connection: &Connection| connection.answers.load(Ordering::Relaxed) == 0;
            let oldest = open.connections.iter().find(|(_, other)| (is_full || of_address(other)) && waits(other));
            let Some(number) = oldest.map(|(&number, _)| number) else { return };
            if let Some(connection) = open.connections.remove(&number) {
                connection.task.abort();
            }
        }
        let number = open.next;
        open.next += 1;
        let answers = Arc::<AtomicUsize>::default();
        let task = start(Client { clients: self.clone(), number, answers: Arc::clone(&answers) });
        open.connections.insert(number, Connection { address, task, answers });
    }
}

impl Client {
    /// Marks it as being answered.
    pub fn busy(&self) -> Busy {
        self.answers.fetch_add(1, Ordering::Relaxed);
        Busy(Arc::clone(&self.answers))
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        self.clients.lock().connections.remove(&self.number);
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}
