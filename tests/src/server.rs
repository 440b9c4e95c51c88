//! A small web server on loopback that supports range requests.

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Serves bytes under any name while the process runs. Returns the address of the server.
///
/// # Errors
///
/// If the system provides no port.
pub fn serve(bytes: Vec<u8>) -> std::io::Result<String> {
    Ok(serve_counted(bytes)?.0)
}

/// [`serve`], also with the number of bytes of the file that have been sent.
///
/// # Errors
///
/// If the system provides no port.
pub fn serve_counted(bytes: Vec<u8>) -> std::io::Result<(String, Arc<AtomicU64>)> {
    let listener = TcpListener::bind("127.0.0.1:0")?;
    let address = format!("http://{}", listener.local_addr()?);
    let (bytes, sent) = (Arc::new(bytes), Arc::new(AtomicU64::new(0)));
    let of_all = sent.clone();
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let (bytes, sent) = (bytes.clone(), of_all.clone());
            std::thread::spawn(move || answer(stream, &bytes, &sent));
        }
    });
    Ok((address, sent))
}

/// Answers requests until the client closes the connection.
fn answer(mut stream: TcpStream, bytes: &[u8], sent: &AtomicU64) -> Option<()> {
    let mut lines = BufReader::new(stream.try_clone().ok()?).lines();
    loop {
        let mut range = None;
        loop {
            let line = lines.next()?.ok()?.to_ascii_lowercase();
            if let Some((first, last)) = line.strip_prefix("range: bytes=").and_then(|range| range.split_once('-')) {
                range = Some((first.parse::<usize>().ok()?, last.trim().parse::<usize>().ok()? + 1));
            }
            if line.is_empty() {
                break;
            }
        }
        let (start, end) = range.unwrap_or((0, bytes.len()));
        let body = bytes.get(start..end.min(bytes.len()))?;
        let head = format!(
            "HTTP/1.1 206 Partial Content\r\nETag: \"1\"\r\nContent-Range: bytes {start}-{}/{}\r\nContent-Length: {}\r\n\r\n",
            start + body.len() - 1,
            bytes.len(),
            body.len()
        );
        sent.fetch_add(body.len() as u64, Ordering::Relaxed);
        stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(body)).ok()?;
    }
}

/// Answers every request, after a delay, with this status line and body, whatever is asked for.
///
/// # Errors
///
/// If the system provides no port.
pub fn serve_answer(status: &'static str, body: &'static str, after: Duration) -> std::io::Result<String> {
    let listener = TcpListener::bind("127.0.0.1:0")?;
    let address = format!("http://{}", listener.local_addr()?);
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            std::thread::spawn(move || {
                let lines = BufReader::new(stream.try_clone()?).lines();
                let _asked: Vec<_> = lines.map_while(Result::ok).take_while(|line| !line.is_empty()).collect();
                std::thread::sleep(after);
                let length = body.len();
                write!(
                    stream,
                    "HTTP/1.1 {status}\r\nContent-Type: text/html\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n{body}"
                )
            });
        }
    });
    Ok(address)
}
