//! Sources that fail while the file is being viewed.

use std::{
    io,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use lodpack::{ReadAt, View, stream::Mode};
use lodpack_view::scene::Scene;

use crate::Model;

/// A server that can stop and come back.
struct Server {
    bytes: Arc<Vec<u8>>,
    is_gone: AtomicBool,
}

impl ReadAt for Server {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        if self.is_gone.load(Ordering::Relaxed) {
            return Err(io::ErrorKind::ConnectionRefused.into());
        }
        self.bytes.read_at(offset, buf)
    }

    fn size(&self) -> io::Result<u64> {
        self.bytes.size()
    }
}

#[test]
fn a_server_that_stops_leaves_the_picture_and_may_come_back() {
    let server = Arc::new(Server { bytes: Model::sphere().bytes.clone(), is_gone: AtomicBool::new(false) });
    let mut scene = Scene::open(server.clone(), Mode::Asynchronous).unwrap();
    let whole = View::around(scene.bounds, [0.0, 1.0, 0.0], 0.5, 0.25);
    let view = View { pixel_tolerance: 0.1, viewport: [640, 480], ..whole };
    server.is_gone.store(true, Ordering::Relaxed);
    let begun = Instant::now();
    let problems = loop {
        let report = scene.follow(&view).unwrap();
        assert!(report.surface == 1 && report.triangles > 0, "the coarsest level stays");
        let problems = scene.take_problems();
        if !problems.is_empty() {
            break problems;
        }
        assert!(begun.elapsed() < Duration::from_secs(40), "no failure is reported");
        std::thread::sleep(Duration::from_millis(20));
    };
    println!("{problems:?}");
    let coarse = scene.first.picture().triangle_count();
    server.is_gone.store(false, Ordering::Relaxed);
    scene.retry_failed();
    let begun = Instant::now();
    while scene.first.picture().triangle_count() == coarse || !scene.follow(&view).unwrap().is_complete {
        assert!(begun.elapsed() < Duration::from_secs(40), "failed reads are not repeated");
        scene.follow(&view).unwrap();
        std::thread::sleep(Duration::from_millis(20));
    }
}
