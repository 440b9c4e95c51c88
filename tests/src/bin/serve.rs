//! Serves a file on the loopback, range requests and all: serve FILE; prints its address and stays.

use lodpack_tests::server::serve;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: serve FILE")?;
    println!("{}/{}", serve(std::fs::read(&path)?)?, path.rsplit('/').next().unwrap_or_default());
    loop {
        std::thread::park();
    }
}
