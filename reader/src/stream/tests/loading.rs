//! The loader against pages that are only numbers, step by step.

use std::{collections::BTreeMap, io, sync::Arc, time::Duration};

use crate::{
    error::{Error, Result},
    stream::{
        job::{Content, Job, Read},
        loader::{Loader, Rules, UnitState},
        queue::{ByteSpan, Class, Joining},
    },
};

const NOW: Duration = Duration::ZERO;
const MILLI: Duration = Duration::from_millis(1);

/// Page `n` holds the byte `n` ten times. A unit needs the pages from the last multiple of ten on. Unit 60 cannot be
/// decoded.
struct Numbers;

impl Content for Numbers {
    type Page = u32;
    type Unit = u32;
    type Data = u32;

    fn pages(&self, unit: u32) -> Result<Vec<u32>> {
        Ok((unit / 10 * 10..=unit).collect())
    }

    fn supply(&self, _offset: u64, _bytes: Vec<u8>) {}

    fn span(&self, page: u32) -> ByteSpan {
        ByteSpan { offset: u64::from(page) * 1000, length: 10 }
    }

    fn is_sound(&self, page: u32, bytes: &[u8]) -> bool {
        bytes == [page as u8; 10]
    }

    fn is_pinned(&self, unit: u32) -> bool {
        unit == 0
    }

    fn decode(&self, unit: u32, pages: &[(u32, Arc<[u8]>)], _: Option<&u32>) -> Result<u32> {
        assert!(pages.iter().map(|(page, _)| *page).eq(self.pages(unit)?));
        assert!(pages.iter().all(|(page, bytes)| self.is_sound(*page, bytes)));
        if unit == 60 { Err(Error::format("this unit is odd")) } else { Ok(unit) }
    }

    fn byte_count(&self, _data: &u32) -> u64 {
        100
    }

    fn page_name(&self, page: u32) -> String {
        format!("page {page}")
    }

    fn unit_name(&self, unit: u32) -> String {
        format!("unit {unit}")
    }
}

fn rules() -> Rules {
    Rules {
        byte_cache: 1000,
        decoded_cache: 10_000,
        max_reads: 4,
        joining: Joining { max_gap: 0, max_length: 100 },
        prefetch_bytes: 20,
        max_attempts: 4,
        retry_delay: 10 * MILLI,
    }
}

fn new() -> Loader<Numbers> {
    Loader::new(Arc::new(Numbers), rules())
}

fn frame(loader: &mut Loader<Numbers>, demand: &[u32], prefetch: &[u32], now: Duration) {
    loader.begin_frame();
    for &unit in demand {
        loader.want(unit, Class::Demand, 1, now);
    }
    for &unit in prefetch {
        loader.want(unit, Class::Prefetch, 1, now);
    }
    loader.end_wants();
}

/// All reads that are asked for now; decodes whatever can be.
fn reads(loader: &mut Loader<Numbers>, now: Duration) -> Vec<Read> {
    let mut reads = Vec::new();
    while let Some(job) = loader.poll(now) {
        match job {
            Job::Read(read) => reads.push(read),
            Job::Decode(task) => loader.finish(task.run(), now),
        }
    }
    reads
}

fn page_of(read: &Read) -> u32 {
    (read.offset / 1000) as u32
}

fn supply(loader: &mut Loader<Numbers>, read: &Read, now: Duration) {
    loader.supply(read.id, Ok(vec![page_of(read) as u8; 10]), now);
}

fn load(loader: &mut Loader<Numbers>, now: Duration) -> u32 {
    let mut count = 0;
    loop {
        let asked = reads(loader, now);
        if asked.is_empty() {
            return count;
        }
        count += asked.len() as u32;
        asked.iter().for_each(|read| supply(loader, read, now));
    }
}

#[test]
fn a_page_is_at_most_once_on_its_way() {
    let mut loader = new();
    frame(&mut loader, &[20, 20], &[20], NOW);
    let asked = reads(&mut loader, NOW);
    assert_eq!(asked.len(), 1);
    for _ in 0..3 {
        frame(&mut loader, &[20], &[], NOW);
        assert_eq!(reads(&mut loader, NOW), []);
    }
    supply(&mut loader, &asked[0], 3 * MILLI);
    let Some(Job::Decode(task)) = loader.poll(NOW) else { panic!("bytes are there") };
    frame(&mut loader, &[20], &[], NOW);
    assert!(loader.poll(NOW).is_none(), "it is being decoded");
    loader.finish(task.run(), 5 * MILLI);
    assert_eq!(loader.take(20).as_deref(), Some(&20));
    assert_eq!((loader.counters.misses, loader.counters.requests, loader.counters.decoded), (1, 1, 1));
    assert_eq!(loader.counters.latency.counts[3], 1, "four to eight milliseconds");
    // A result comes but once.
    supply(&mut loader, &asked[0], 3 * MILLI);
    assert!(loader.poll(NOW).is_none());
}

#[test]
fn what_no_frame_wants_any_more_is_not_read() {
    let mut loader = Loader::new(Arc::new(Numbers), Rules { max_reads: 1, ..rules() });
    frame(&mut loader, &[20, 30], &[], NOW);
    let asked = reads(&mut loader, NOW);
    assert_eq!(asked.iter().map(page_of).collect::<Vec<_>>(), [20]);
    assert!(loader.is_wanted(asked[0].id));
    frame(&mut loader, &[40], &[], NOW);
    assert!(!loader.is_wanted(asked[0].id));
    assert_eq!(loader.counters.cancelled, 1);
    supply(&mut loader, &asked[0], NOW);
    let asked = reads(&mut loader, NOW);
    assert_eq!(asked.iter().map(page_of).collect::<Vec<_>>(), [40]);
    assert_eq!(loader.state(20), UnitState::Coming, "its bytes are kept but not decoded");
    supply(&mut loader, &asked[0], NOW);
    frame(&mut loader, &[20], &[], NOW);
    assert_eq!(load(&mut loader, NOW), 0);
    assert_eq!((loader.state(20), loader.counters.byte_hits), (UnitState::Decoded, 1));
}

#[test]
fn a_unit_is_decoded_once_all_of_its_pages_are_there() {
    let mut loader = new();
    frame(&mut loader, &[53], &[], NOW);
    let asked = reads(&mut loader, NOW);
    assert_eq!(asked.iter().map(page_of).collect::<Vec<_>>(), [50, 51, 52, 53]);
    asked.iter().rev().for_each(|read| supply(&mut loader, read, NOW));
    assert_eq!(load(&mut loader, NOW), 0);
    assert_eq!(loader.state(53), UnitState::Decoded);
}

#[test]
fn failed_reads_are_tried_again_after_doubling_delays_and_given_up_once() {
    let mut loader = new();
    let fail = |loader: &mut Loader<Numbers>, read: &Read, now| {
        loader.supply(read.id, Err(io::ErrorKind::ConnectionReset.into()), now);
    };
    let mut now = NOW;
    frame(&mut loader, &[20, 31], &[], now);
    let delays = [10, 20, 40];
    for (attempt, delay) in (0..).zip(delays) {
        let asked = reads(&mut loader, now);
        assert_eq!(asked.len(), if attempt == 0 { 3 } else { 1 });
        for read in asked {
            if page_of(&read) == 20 { fail(&mut loader, &read, now) } else { supply(&mut loader, &read, now) }
        }
        assert_eq!(reads(&mut loader, now), [], "it waits");
        assert_eq!(loader.next_due(), Some(now + delay * MILLI));
        now += delay * MILLI;
        frame(&mut loader, &[20, 31], &[], now);
    }
    assert_eq!(loader.state(31), UnitState::Decoded);
    let asked = reads(&mut loader, now);
    fail(&mut loader, &asked[0], now);
    let problems = loader.take_problems();
    assert_eq!(problems.len(), 1);
    assert_eq!(problems[0].location, "page 20");
    assert!(matches!(problems[0].error, Error::Io { offset: 20_000, length: 10, .. }));
    // Nobody asks again, nor hears of it again, until told so.
    now += Duration::from_secs(100);
    frame(&mut loader, &[20, 21], &[], now);
    assert_eq!(reads(&mut loader, now), []);
    assert_eq!((loader.state(20), loader.state(21)), (UnitState::Failed, UnitState::Failed));
    assert!(loader.take_problems().is_empty());
    assert_eq!((loader.counters.retries, loader.counters.failures), (3, 1));
    loader.retry_failed();
    frame(&mut loader, &[21], &[], now);
    assert_eq!(load(&mut loader, now), 2);
    assert_eq!(loader.state(21), UnitState::Decoded);
}

#[test]
fn damaged_pages_are_read_twice_and_short_reads_are_failures() {
    let mut loader = new();
    let mut now = NOW;
    for _ in 0..2 {
        frame(&mut loader, &[20], &[], now);
        let asked = reads(&mut loader, now);
        loader.supply(asked[0].id, Ok(vec![0; 10]), now);
        now += Duration::from_secs(1);
    }
    frame(&mut loader, &[20, 30, 60], &[], now);
    let asked = reads(&mut loader, now);
    loader.supply(asked[0].id, Ok(vec![30; 9]), now);
    asked[1..].iter().for_each(|read| supply(&mut loader, read, now));
    assert_eq!(loader.state(20), UnitState::Failed);
    assert_eq!(reads(&mut loader, now), []);
    now += Duration::from_secs(1);
    assert_eq!(load(&mut loader, now), 1, "page 30");
    assert_eq!(loader.state(30), UnitState::Decoded);
    assert_eq!(loader.state(60), UnitState::Failed);
    let pages: Vec<String> = loader.take_problems().into_iter().map(|problem| problem.error.to_string()).collect();
    assert_eq!(
        pages,
        ["damaged file: the checksum does not match (page 20)", "damaged file: this unit is odd (unit 60)"]
    );
}

#[test]
fn prefetch_follows_demand_within_its_budget_and_its_waste_is_counted() {
    let mut loader = new();
    frame(&mut loader, &[20], &[30, 40, 50], NOW);
    let asked = reads(&mut loader, NOW);
    let pages: Vec<(u32, Class)> = asked.iter().map(|read| (page_of(read), read.class)).collect();
    // Twenty bytes a frame.
    assert_eq!(pages, [(20, Class::Demand), (30, Class::Prefetch), (40, Class::Prefetch)]);
    asked.iter().for_each(|read| supply(&mut loader, read, NOW));
    assert_eq!(reads(&mut loader, NOW), []);
    assert_eq!(loader.counters.prefetch_bytes, 20);
    assert_eq!(loader.counters.wasted_prefetch_bytes(), 20);
    frame(&mut loader, &[30], &[], NOW);
    assert_eq!(load(&mut loader, NOW), 0);
    assert_eq!((loader.counters.misses, loader.counters.wasted_prefetch_bytes()), (1, 10));
    // A read stays free for demand.
    let mut loader = Loader::new(Arc::new(Numbers), Rules { prefetch_bytes: 1000, ..rules() });
    frame(&mut loader, &[], &[100, 110, 120, 130, 140], NOW);
    assert_eq!(reads(&mut loader, NOW).len(), 3);
}

#[test]
fn where_surfaces_have_no_room_prefetch_brings_bytes_alone() {
    let mut loader = Loader::new(Arc::new(Numbers), Rules { decoded_cache: 100, ..rules() });
    frame(&mut loader, &[20], &[], NOW);
    assert_eq!(load(&mut loader, NOW), 1);
    frame(&mut loader, &[20], &[30], NOW);
    assert_eq!(load(&mut loader, NOW), 1);
    assert!(loader.byte_cache().contains(&30) && !loader.decoded_cache().contains(&30));
    frame(&mut loader, &[30], &[], NOW);
    assert_eq!(load(&mut loader, NOW), 0);
    assert!(loader.decoded_cache().contains(&30));
    let crate::stream::Counters { misses, byte_hits, .. } = loader.counters;
    assert_eq!((misses, byte_hits, loader.counters.wasted_prefetch_bytes()), (1, 1, 0));
}

#[test]
fn the_byte_bounds_are_exceeded_by_nothing_but_the_frames_own_needs() {
    let tight = Rules { byte_cache: 70, decoded_cache: 700, ..rules() };
    let mut loader = Loader::new(Arc::new(Numbers), tight);
    let mut state = 1_u64;
    let mut random = move |end: u64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 33) % end
    };
    let mut flying: BTreeMap<u64, Read> = BTreeMap::new();
    for step in 0..3000_u64 {
        let now = step as u32 * MILLI;
        if random(4) == 0 {
            let demand: Vec<u32> = (0..random(4)).map(|_| random(60) as u32).chain([0]).collect();
            let prefetch: Vec<u32> = (0..random(4)).map(|_| random(60) as u32).collect();
            frame(&mut loader, &demand, &prefetch, now);
        }
        for read in reads(&mut loader, now) {
            assert!(flying.insert(read.id, read).is_none());
        }
        assert!(flying.values().filter(|read| page_of(read) == 7).count() <= 1);
        let pick = flying.keys().nth(random(flying.len() as u64 + 1) as usize).copied();
        if let Some(read) = pick.and_then(|id| flying.remove(&id)) {
            supply(&mut loader, &read, now);
        }
        let decoded = loader.decoded_cache();
        assert!(decoded.bytes() <= decoded.held_bytes().max(700), "{}", decoded.bytes());
        let bytes = loader.byte_cache();
        assert!(bytes.bytes() <= bytes.held_bytes().max(70), "{}", bytes.bytes());
    }
    assert!(loader.counters.evictions > 100);
    assert!(loader.decoded_cache().contains(&0), "the coarsest stays");
}
