//! Serves a file on loopback, with range requests: serve FILE. Prints its address and keeps running.

use lodpack_tests::server::serve;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: serve FILE")?;
    println!("{}/{}", serve(std::fs::read(&path)?)?, path.rsplit('/').next().unwrap_or_default());
    loop {
        std::thread::park();
    }
}
