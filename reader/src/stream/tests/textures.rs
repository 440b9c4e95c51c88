//! Texels beside geometry: the right ones, in order of need, and never in the way.

use super::*;
use crate::{
    decode::ChannelImage,
    format::header::kind,
    select::View,
    stream::{Frame, Job, Mode, Picture, Simulation},
    tests::painted::painted_file,
};

fn painted(n: i64, heights: u8) -> Arc<File<Vec<u8>>> {
    let bytes = painted_file(&cube(n), ModelOptions { levels: 3, seed: 8, grids_of_four: 1, heights });
    Arc::new(File::open(bytes, Limits::default()).unwrap())
}

/// Where texels begin in the file, and where they end.
fn texels(file: &File<Vec<u8>>) -> std::ops::Range<u64> {
    let section = file.index().header().section(kind::TEXELS).unwrap();
    section.offset..section.offset + section.length
}

/// What is shown in the middle of a triangle: its corners, the places of these, and the values of each channel.
type Shown = (Points, [[u32; 2]; 3], Vec<Option<[u64; 4]>>);

fn value(image: &ChannelImage, place: [f64; 2]) -> [u64; 4] {
    match image {
        ChannelImage::Values(image) => [image.texel(place[0] as u32, place[1] as u32)[0].into(), 0, 0, 0],
        ChannelImage::Colours(image) | ChannelImage::Normals(image) | ChannelImage::Factors(image) => {
            image.interpolated(place).map(f64::to_bits)
        }
    }
}

fn shown(points: [[f64; 3]; 3], places: [[f64; 2]; 3], images: &[Option<ChannelImage>]) -> Shown {
    let mut corners: [_; 3] = std::array::from_fn(|k| (points[k].map(f64::to_bits), places[k].map(|x| x as f32)));
    let least = (0..3).min_by_key(|&k| corners[k].0).unwrap();
    // The order decides about the last digit of the mean.
    corners.rotate_left(least);
    let middle = [0, 1].map(|k| corners.iter().map(|(_, place)| f64::from(place[k])).sum::<f64>() / 3.0);
    let has_place = middle[0].is_finite();
    let values = images.iter().map(|image| image.as_ref().filter(|_| has_place).map(|image| value(image, middle)));
    (corners.map(|corner| corner.0), corners.map(|corner| corner.1.map(f32::to_bits)), values.collect())
}

/// What a picture shows.
fn shown_of(file: &File<Vec<u8>>, picture: &Picture) -> Vec<Shown> {
    let mut all = Vec::new();
    for drawn in picture.roots() {
        let surface = &drawn.surface;
        let texture = &drawn.texture().expect("all are there").texture;
        let strips =
            drawn.strips.iter().flat_map(|strip| strip.triangles.iter().zip(&strip.origins).map(move |t| (strip, t)));
        let inner = surface.triangles.iter().zip(&surface.origins);
        let own = surface.positions.len();
        let mut add = |points: [[f64; 3]; 3], origin: u32| {
            let place = |point: [f64; 3]| match &texture.map {
                Some(map) => map.piece(origin as usize).place(file.lattice().units(point).map(|x| x.round() as i64)),
                None => [f64::NAN; 2],
            };
            all.push(shown(points, points.map(place), &texture.images));
        };
        inner.for_each(|(corners, &origin)| add(corners.map(|k| surface.positions[k as usize]), origin));
        strips.for_each(|(strip, (corners, &origin))| {
            let position =
                |k: u32| surface.positions.get(k as usize).unwrap_or_else(|| &strip.positions[k as usize - own]);
            add(corners.map(|k| *position(k)), origin);
        });
    }
    all.sort_unstable();
    all
}

/// What a file shows of a cut.
fn expected(file: &File<Vec<u8>>, nodes: &[Node], channels: &[u8]) -> Vec<Shown> {
    let cut = file.extract_textured(&cut_of(nodes), channels).unwrap();
    let triangles = cut.mesh.triangles.iter().zip(&cut.places).zip(&cut.mesh.triangle_nodes);
    let mut all: Vec<Shown> = triangles
        .map(|((corners, places), &node)| {
            let points = corners.map(|corner| cut.mesh.positions[corner as usize]);
            shown(points, places.map(|place| place.map(f64::from)), &cut.textures[node as usize].images)
        })
        .collect();
    all.sort_unstable();
    all
}

/// All places are the same, and so is what is shown there: except on folds and slivers of these random surfaces, where
/// texels are not stored and have the values of others.
fn assert_same(shown: &[Shown], expected: &[Shown]) {
    assert_eq!(shown.len(), expected.len());
    let places = |shown: &[Shown]| shown.iter().map(|&(points, places, _)| (points, places)).collect::<Vec<_>>();
    assert!(places(shown) == places(expected));
    let different: Vec<_> = shown.iter().zip(expected).filter(|(a, b)| a != b).collect();
    assert!(different.len() * 30 <= shown.len(), "{} of {}, {:?}", different.len(), shown.len(), different[0]);
}

/// Draws until nothing is missing.
fn draw(simulation: &mut Simulation<&Vec<u8>>, session: &mut Session, nodes: &[Node]) -> Frame {
    loop {
        let frame = simulation.frame(session, nodes, &[]).unwrap();
        if frame.is_complete {
            return frame;
        }
        simulation.settle(session);
    }
}

#[test]
fn every_triangle_shows_what_its_block_says_at_mixed_levels_too() {
    for (file, mode) in
        [(painted(3, 0), Mode::Asynchronous), (painted(3, 0), Mode::Synchronous), (painted(4, 3), Mode::Asynchronous)]
    {
        let mut session = session(&file, Options { mode, ..APART });
        let mut simulation = Simulation::new(file.source(), Duration::from_millis(3));
        let mut random = Random::new(3);
        for channels in [&[0_u8][..], &[1, 0], &[1]] {
            session.show_channels(channels).unwrap();
            for _ in 0..4 {
                let wanted: Vec<Node> = random_cut(&file, &mut random);
                // In a tree only the leaves are no roots above others.
                let is_leaf = |node: &Node| file.children(node.root).unwrap().is_empty();
                let wanted: Vec<Node> = wanted.into_iter().filter(is_leaf).collect();
                draw(&mut simulation, &mut session, &wanted);
                let nodes = session.picture().nodes();
                assert_same(&shown_of(&file, session.picture()), &expected(&file, &nodes, channels));
            }
        }
        assert!(session.take_problems().is_empty());
        session.show_channels(&[]).unwrap();
        assert!(session.picture().roots().all(|drawn| drawn.texture().is_none() && drawn.mean(0).is_none()));
    }
}

#[test]
fn texels_are_read_after_geometry_and_only_if_they_are_shown() {
    let file = painted(3, 0);
    let texels = texels(&file);
    for (channels, max_reads) in [(&[][..], 4), (&[0_u8][..], 1), (&[0, 1], 16)] {
        let mut session = session(&file, Options { max_reads, ..APART });
        session.show_channels(channels).unwrap();
        let mut simulation = Simulation::new(file.source(), Duration::ZERO);
        draw(&mut simulation, &mut session, &uniform(&file, 0));
        // A frame wants other geometry, while images of the last one are missing: all pages come before them.
        session.show_channels(channels).unwrap();
        let wanted = uniform(&file, 2);
        session.begin(&wanted, &[], simulation.now()).unwrap();
        let first = session.end(simulation.now()).unwrap();
        assert_eq!(first.late_textures > 0, !channels.is_empty());
        let (mut kinds, mut flying) = (Vec::new(), Vec::new());
        loop {
            while let Some(job) = session.poll(simulation.now()) {
                match job {
                    Job::Read(read) => {
                        kinds.push(texels.contains(&read.offset));
                        flying.push(read);
                    }
                    Job::Decode(decoding) => session.finish(decoding.run(), simulation.now()),
                }
            }
            if flying.is_empty() {
                break;
            }
            let read = flying.remove(0);
            session.supply(&read, read.run(file.source()), simulation.now());
        }
        assert_eq!(kinds.contains(&true), !channels.is_empty());
        let last_page = kinds.iter().rposition(|is_texels| !is_texels).unwrap();
        let first_texel = kinds.iter().position(|&is_texels| is_texels).unwrap_or(kinds.len());
        assert!(last_page < first_texel, "{kinds:?}");
    }
}

#[test]
fn roots_that_look_largest_come_first_and_those_that_nobody_sees_not_at_all() {
    let file = painted(5, 0);
    let [low, high] = file.bounds().unwrap();
    // Straight down along an edge, which is in the middle of the picture.
    let position = [low[0], 0.5 * (low[1] + high[1]), high[2] + 0.3 * (high[2] - low[2])];
    let view = View { position, viewport: [800, 600], vertical_fov: 0.4, ..View::default() };
    let mut session = session(&file, Options { max_reads: 1, ..APART });
    let mut simulation = Simulation::new(file.source(), Duration::ZERO);
    let wanted = uniform(&file, 2);
    draw(&mut simulation, &mut session, &wanted);
    session.show_channels(&[1]).unwrap();
    session.look_from(Some(&view)).unwrap();
    let pixels = |root: u32| {
        let bounds = file.root_bounds(root).unwrap();
        let size = (0..3).map(|k| (bounds[1][k] - bounds[0][k]).powi(2)).sum::<f64>().sqrt();
        view.error_px(bounds, size).unwrap()
    };
    let mut came = Vec::new();
    let mut changed: BTreeSet<u32> = BTreeSet::new();
    loop {
        session.begin(&wanted, &[], simulation.now()).unwrap();
        let frame = session.end(simulation.now()).unwrap();
        for &root in &frame.changes.textures {
            // They come once more when they become finer.
            if changed.insert(root) {
                came.push(pixels(root));
            }
        }
        if frame.is_complete {
            break;
        }
        // One read at a time.
        for _ in 0..2 {
            let Some(job) = session.poll(simulation.now()) else { break };
            match job {
                Job::Read(read) => session.supply(&read, read.run(file.source()), simulation.now()),
                Job::Decode(decoding) => session.finish(decoding.run(), simulation.now()),
            }
        }
    }
    let seen = (0..file.root_count()).filter(|&root| pixels(root) > 1.0).count();
    assert_eq!(came.len(), seen);
    assert!(seen > 20 && seen < file.root_count() as usize / 2, "{seen}");
    // Sizes are told apart by their logarithms; what lies beside images in the file is read with them.
    let class = |pixels: f64| pixels.log2().floor();
    let pairs = || (0..came.len()).flat_map(|later| (0..later).map(move |earlier| (earlier, later)));
    let unlike = pairs().filter(|&(a, b)| class(came[a]) != class(came[b])).count();
    let late = pairs().filter(|&(a, b)| class(came[a]) < class(came[b])).count();
    assert!(5 * late < unlike, "{late} of {unlike} {came:?}");
    // From far away a root is no larger than a pixel, and its mean does.
    let far = View { position: [position[0], position[1], position[2] + 1e6], ..view };
    session.show_channels(&[1]).unwrap();
    session.look_from(Some(&far)).unwrap();
    let frame = simulation.frame(&mut session, &wanted, &[]).unwrap();
    assert_eq!((frame.is_complete, frame.late_textures), (true, 0));
    assert!(session.look_from(Some(&View { near: -1.0, ..view })).is_err());
}

#[test]
fn images_are_as_fine_as_they_look_and_keep_to_their_budget() {
    let file = painted(5, 0);
    let [low, high] = file.bounds().unwrap();
    let step = file.lattice().step();
    let wanted = uniform(&file, 2);
    let size = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
    let view = |distance: f64| View {
        position: [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), high[2] + distance * size],
        viewport: [800, 600],
        ..View::default()
    };
    for texel_cache in [64 << 20, 60_000] {
        let mut session = session(&file, Options { texel_cache, ..APART });
        session.show_channels(&[0, 1]).unwrap();
        let mut simulation = Simulation::new(file.source(), Duration::from_millis(1));
        let mut halvings = BTreeSet::new();
        for distance in [60.0, 15.0, 3.0, 0.3, 0.02, 0.3, 15.0] {
            let view = view(distance);
            session.look_from(Some(&view)).unwrap();
            draw(&mut simulation, &mut session, &wanted);
            let mut shown = 0;
            for drawn in session.picture().roots() {
                let Some(texture) = drawn.texture() else { continue };
                let Some(map) = &texture.texture.map else { continue };
                shown += map.size[0] * map.size[1] * 5;
                let bounds = file.root_bounds(drawn.surface.root).unwrap();
                // All pieces have texels of the same size.
                let texel = view.error_px(bounds, map.pieces[0].texel_size() * step).unwrap();
                assert!(texture.halvings == 0 || texel <= 1.42 || texel_cache < 1 << 20, "{distance} {texel}");
                halvings.insert(texture.halvings);
            }
            assert!(u64::from(shown) <= texel_cache, "{shown}");
        }
        assert!(halvings.len() > 1, "{halvings:?}");
        assert_eq!(session.texel_counters().failures, 0);
    }
}

#[test]
fn means_stand_for_images_until_these_are_there() {
    let file = painted(4, 3);
    let mut session = session(&file, APART);
    session.show_channels(&[1]).unwrap();
    let mut simulation = Simulation::new(file.source(), Duration::from_millis(5));
    let top: Vec<Node> = (0..file.top_count()).map(|root| Node { root, level: 0 }).collect();
    draw(&mut simulation, &mut session, &top);
    let mean = session.picture().root(0).unwrap().mean(0).expect("the top has an image");
    let of_image = match session.picture().root(0).unwrap().texture().unwrap().texture.images[0].as_ref().unwrap() {
        ChannelImage::Values(image) => image.data.iter().map(|&x| f64::from(x)).sum::<f64>() / image.data.len() as f64,
        _ => panic!("numbers"),
    };
    assert!((mean[0] / of_image - 1.0).abs() < 0.3, "{mean:?} {of_image}");
    // Its children are drawn with that until they have their own.
    let fine: Vec<Node> = file.children(0).unwrap().map(|root| Node { root, level: 1 }).collect();
    loop {
        let frame = simulation.frame(&mut session, &fine, &[]).unwrap();
        if session.picture().roots().len() > 1 {
            assert!(frame.late_textures > 0 && !frame.is_complete);
            break;
        }
        simulation.advance(&session, Duration::from_millis(1));
    }
    for drawn in session.picture().roots() {
        assert_eq!(drawn.mean(0), Some(mean));
        assert!(drawn.texture().is_none());
    }
    draw(&mut simulation, &mut session, &fine);
    assert!(session.picture().roots().all(|drawn| drawn.texture().is_some()));
}

#[test]
fn the_cache_keeps_its_bound_and_images_come_again() {
    let file = painted(4, 0);
    let texel_cache = 40_000;
    let mut session = session(&file, Options { texel_cache, ..APART });
    session.show_channels(&[0, 1]).unwrap();
    let mut simulation = Simulation::new(file.source(), Duration::from_millis(1));
    let mut decoded = 0;
    for _ in 0..3 {
        for first in (0..file.root_count()).step_by(8) {
            let wanted: Vec<Node> =
                (first..(first + 8).min(file.root_count())).map(|root| Node { root, level: 2 }).collect();
            draw(&mut simulation, &mut session, &wanted);
            assert_eq!(session.texel_counters().failures, 0);
            let drawn: u64 = session
                .picture()
                .roots()
                .map(|drawn| {
                    let images = &drawn.texture().unwrap().texture.images;
                    images
                        .iter()
                        .flatten()
                        .map(|image| match image {
                            ChannelImage::Values(image) => 2 * image.data.len() as u64,
                            ChannelImage::Colours(image)
                            | ChannelImage::Normals(image)
                            | ChannelImage::Factors(image) => image.data.len() as u64,
                        })
                        .sum::<u64>()
                })
                .sum();
            let [_, images] = session.texel_cached_bytes();
            assert!(images <= texel_cache.max(drawn + 20_000), "{images} {drawn}");
        }
        let now = session.texel_counters().decoded;
        assert!(now > decoded, "what was evicted is decoded again");
        decoded = now;
    }
    assert!(session.texel_counters().evictions > 0);
}

#[test]
fn damaged_texels_are_reported_once_and_the_root_is_drawn_without() {
    let file = painted(3, 0);
    let texels = texels(&file);
    let mut source = Faulty::new(file.source());
    // Not the table and the directory.
    source.damaged.extend((texels.start + (texels.end - texels.start) / 2..texels.end).step_by(1500));
    let mut session = session(&file, APART);
    session.show_channels(&[0, 1]).unwrap();
    let mut simulation = Simulation::new(&source, Duration::from_millis(1));
    let wanted = uniform(&file, 2);
    let mut frame = simulation.frame(&mut session, &wanted, &[]).unwrap();
    while !frame.is_complete {
        simulation.settle(&session);
        frame = simulation.frame(&mut session, &wanted, &[]).unwrap();
    }
    let problems = session.take_problems();
    let lost = session.picture().roots().filter(|drawn| drawn.texture().is_none()).count();
    assert!(lost > 0 && lost < session.picture().roots().len());
    assert!(!problems.is_empty() && problems.len() <= 3 * lost);
    assert!(problems.iter().all(|problem| problem.error.to_string().contains("checksum")), "{problems:?}");
    assert_eq!(triangles(&session.picture().mesh()), triangles(&file.extract(&cut_of(&wanted)).unwrap()));
    simulation.frame(&mut session, &wanted, &[]).unwrap();
    assert!(session.take_problems().is_empty());
    // A source that has become sound is read again when asked to.
    session.retry_failed();
    let mut simulation = Simulation::new(file.source(), Duration::from_millis(1));
    simulation.advance(&session, Duration::from_secs(100));
    draw(&mut simulation, &mut session, &wanted);
    assert!(
        session.picture().roots().all(|drawn| drawn.texture().is_some()),
        "{:?} {:?}",
        session.take_problems(),
        session.texel_counters()
    );
    assert_same(&shown_of(&file, session.picture()), &expected(&file, &session.picture().nodes(), &[0, 1]));
}

#[test]
fn what_comes_of_channels_that_are_not_shown_any_more_is_ignored() {
    let file = painted(2, 0);
    let mut session = session(&file, APART);
    let wanted = uniform(&file, 2);
    let mut simulation = Simulation::new(file.source(), Duration::ZERO);
    draw(&mut simulation, &mut session, &wanted);
    session.show_channels(&[0]).unwrap();
    let now = simulation.now();
    let (mut reads, mut decodings) = (Vec::new(), Vec::new());
    for _ in 0..20 {
        session.begin(&wanted, &[], now).unwrap();
        session.end(now).unwrap();
        while let Some(job) = session.poll(now) {
            match job {
                Job::Read(read) => reads.push(read),
                Job::Decode(decoding) => decodings.push(decoding),
            }
        }
        // Some stay in flight.
        if reads.len() > 1 {
            let read = reads.remove(0);
            session.supply(&read, read.run(file.source()), now);
        }
    }
    assert!(!decodings.is_empty() && !reads.is_empty());
    session.show_channels(&[1]).unwrap();
    for read in reads {
        session.supply(&read, read.run(file.source()), now);
    }
    decodings.into_iter().for_each(|decoding| session.finish(decoding.run(), now));
    draw(&mut simulation, &mut session, &wanted);
    assert_same(&shown_of(&file, session.picture()), &expected(&file, &session.picture().nodes(), &[1]));
    assert!(session.take_problems().is_empty());
    for wrong in [&[2_u8][..], &[0, 0], &[0, 255]] {
        assert!(matches!(session.show_channels(wrong), Err(crate::Error::Query { .. })));
    }
}

#[test]
fn a_file_without_channels_keeps_nothing_for_them() {
    let file = model(2);
    let mut session = session(&file, APART);
    assert!(session.show_channels(&[0]).is_err());
    let mut simulation = Simulation::new(file.source(), Duration::ZERO);
    let frame = draw(&mut simulation, &mut session, &random_cut(&file, &mut Random::new(1)));
    assert_eq!(frame.late_textures, 0);
    for drawn in session.picture().roots() {
        assert!(drawn.surface.origins.is_empty() && drawn.strips.iter().all(|strip| strip.origins.is_empty()));
    }
    assert_eq!((session.texel_cached_bytes(), session.texel_counters()), ([0; 2], Default::default()));
}

#[cfg(feature = "threads")]
#[test]
fn threads_load_texels_too_even_one_alone() {
    let file = painted(3, 0);
    for (mode, count) in [(Mode::Synchronous, 1), (Mode::Asynchronous, 1), (Mode::AsynchronousWithPrefetch, 3)] {
        let mut session = session(&file, Options { mode, ..APART });
        session.show_channels(&[1]).unwrap();
        let loaders = crate::stream::Loaders::spawn(&session, Arc::new(file.source().clone()), count);
        let mut random = Random::new(2);
        for _ in 0..4 {
            let wanted = random_cut(&file, &mut random);
            let mut frame = loaders.frame(&mut session, &wanted, &[]).unwrap();
            assert!(mode != Mode::Synchronous || frame.is_complete);
            while !frame.is_complete {
                loaders.settle();
                frame = loaders.frame(&mut session, &wanted, &[]).unwrap();
            }
            assert_same(&shown_of(&file, session.picture()), &expected(&file, &session.picture().nodes(), &[1]));
        }
    }
}
