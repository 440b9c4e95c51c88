//! Ctrl-C while something takes long.

use pyo3::{PyResult, Python, exceptions::PyRuntimeError};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

/// How long a signal may wait.
const PATIENCE: Duration = Duration::from_millis(50);

/// Does some work on a thread of its own, while this one waits for it and for signals. After a signal whose handler
/// raises, such as Ctrl-C, the work goes on unheeded until it ends, and its result is dropped.
///
/// # Errors
/// What a signal's handler raises; `RuntimeError` if the work panics.
pub fn interruptible<T: Send + 'static>(py: Python<'_>, work: impl FnOnce() -> T + Send + 'static) -> PyResult<T> {
    let (send, mut receive) = sync_channel(1);
    // Nobody receives what comes too late.
    std::thread::Builder::new().name("lodpack".into()).spawn(move || drop(send.send(work())))?;
    loop {
        let answer;
        (answer, receive) = py.detach(move || (receive.recv_timeout(PATIENCE), receive));
        match answer {
            Ok(answer) => return Ok(answer),
            Err(RecvTimeoutError::Timeout) => py.check_signals()?,
            Err(RecvTimeoutError::Disconnected) => {
                return Err(PyRuntimeError::new_err("a thread of lodpack ended early; this is a defect of lodpack"));
            }
        }
    }
}
