//! The same bytes on any number of threads, every time.

use crate::{build_file, scan};

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let build_with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
        pool.install(|| build_file(&scan(), "auto").0)
    };
    let one = build_with(1);
    for threads in [2, 7, 1] {
        assert!(one == build_with(threads), "{threads} threads give a different file");
    }
}
