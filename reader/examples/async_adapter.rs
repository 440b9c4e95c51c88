//! Reads a file asynchronously: the opener and the index say which bytes they miss, and the program supplies them.
//!
//! async_adapter FILE

use std::{future::Future, ops::Range, pin::pin, task};

use lodpack::{Error, Fetched, Index, Limits, Opener, Query, Result, View, decode::extract, select::select_cut};

/// Stands for whatever reads asynchronously: a browser's fetch, an object store, a database.
async fn read(file: &[u8], range: Range<u64>) -> Vec<u8> {
    file[range.start as usize..(range.end as usize).min(file.len())].to_vec()
}

/// Opens a file. In your program `file` is whatever your `read` needs.
async fn open(file: &[u8]) -> Result<Index> {
    let mut opener = Opener::new(Limits::default());
    opener.start(read(file, Opener::FIRST_READ).await, file.len() as u64);
    loop {
        let Err(Error::Missing { ranges }) = opener.finish() else { return opener.finish() };
        for range in ranges {
            opener.insert(range.start, read(file, range).await);
        }
    }
}

/// Asks until nothing is missing. All ranges may be read at once.
async fn ask<T>(file: &[u8], index: &Index, question: impl Fn(&Index, &Fetched) -> Result<T>) -> Result<T> {
    let mut fetched = index.fetched();
    loop {
        match question(index, &fetched) {
            Err(Error::Missing { ranges }) => {
                for range in ranges {
                    fetched.insert(range.start, read(file, range).await);
                }
                index.supply(&fetched);
            }
            answer => return answer,
        }
    }
}

async fn draw(file: &[u8]) -> Result<()> {
    let index = open(file).await?;
    let view = index.bounds().map(|bounds| View::around(bounds, [0.0, 1.0, 0.0], 0.5, 0.25));
    let query = Query { view, max_triangles: Some(10_000), ..Query::default() };
    let cut = ask(file, &index, |index, _| select_cut(index, &query)).await?;
    let mesh = ask(file, &index, |index, fetched| extract(index, &cut, fetched)).await?;
    println!("{} triangles, error at most {}", mesh.triangles.len(), cut.error);
    Ok(())
}

fn main() -> std::result::Result<(), Box<dyn std::error::Error>> {
    let file = std::fs::read(std::env::args().nth(1).ok_or("name a file")?)?;
    // Nothing here ever waits, so one poll is enough. Use your program's executor instead.
    let mut future = pin!(draw(&file));
    match future.as_mut().poll(&mut task::Context::from_waker(task::Waker::noop())) {
        task::Poll::Ready(result) => Ok(result?),
        task::Poll::Pending => Err("it waits".into()),
    }
}
