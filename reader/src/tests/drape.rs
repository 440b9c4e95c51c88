//! Images over heights: windows of them, what is read for these, and damage.

use super::heights_dump::hole;
use super::terrain::{Terrain, texel};
use crate::heights::{Drape, DrapeWindow, Heights, TileId};
use crate::source::Counting;
use crate::{Error, Limits};

fn file() -> Vec<u8> {
    Terrain::plane([20, 12]).with_drape(hole()).file(5.0)
}

fn all_of(drape: &Drape, halvings: u8) -> DrapeWindow {
    DrapeWindow { halvings, first: [0, 0], size: drape.size_at(halvings).map(|size| size as u32) }
}

#[test]
fn texels_are_where_and_what_they_were() {
    let bytes = file();
    let heights = Heights::open(bytes.as_slice(), Limits::default()).unwrap();
    heights.verify().unwrap();
    let drape = *heights.drape().unwrap();
    assert_eq!((drape, heights.index().version()), (hole(), (4, 5)));
    let (mut squares, mut count) = (0.0, 0.0);
    let whole = heights.drape_image(&all_of(&drape, 0)).unwrap();
    for y in 0..90 {
        for x in 0..140 {
            let (found, wanted) = (whole.image.texel(x, y), texel(&drape, 0, [x.into(), y.into()]));
            if wanted[3] > 0 {
                squares += (0..3).map(|k| (f64::from(found[k]) - f64::from(wanted[k])).powi(2)).sum::<f64>();
                count += 3.0;
            }
            assert!(found[3].abs_diff(wanted[3]) < 64, "{x} {y}");
        }
    }
    assert!(squares / count < 25.0, "{}", squares / count);
    // The centre of the first texel.
    let place = whole.place([-0.5, 2.25]);
    assert!(place.iter().all(|x| (x - 0.5).abs() < 1e-12));
}

#[test]
fn windows_are_pieces_of_the_whole_and_transparent_beyond_it() {
    let bytes = file();
    let heights = Heights::open(bytes.as_slice(), Limits::default()).unwrap();
    let drape = hole();
    for halvings in 0..=drape.most_halvings() {
        let whole = heights.drape_image(&all_of(&drape, halvings)).unwrap().image;
        for (columns, rows) in [([0.0, 20.0], [0.0, 12.0]), ([3.0, 9.5], [4.0, 4.0]), ([16.0, 20.0], [11.0, 12.0])] {
            let Some(window) = drape.window(columns, rows, halvings) else { continue };
            let piece = heights.drape_image(&window).unwrap();
            assert_eq!(piece.image.size, window.size);
            for y in 0..window.size[1] {
                for x in 0..window.size[0] {
                    let at = [window.first[0] + i64::from(x), window.first[1] + i64::from(y)];
                    let is_in = (0..2).all(|k| (0..i64::from(whole.size[k])).contains(&at[k]));
                    let wanted = if is_in { whole.texel(at[0] as u32, at[1] as u32) } else { &[0; 4] };
                    assert_eq!(piece.image.texel(x, y), wanted);
                }
            }
        }
    }
    let tile = heights.tile_image(TileId { depth: 0, column: 0, row: 0 }, 30).unwrap().unwrap();
    assert!(tile.image.size.iter().all(|&size| size <= 32));
}

#[test]
fn coarse_images_take_few_bytes_and_few_requests() {
    let drape = Drape { size: [1000, 900], first: [0.0; 2], spacing: [0.02, 0.0125], components: 3, side_log2: 5 };
    let bytes = Terrain::plane([20, 12]).with_drape(drape).file(5.0);
    let read = |halvings: u8| {
        let heights = Heights::open(Counting::new(bytes.as_slice()), Limits::default()).unwrap();
        let before = [heights.source().byte_count(), heights.source().read_count()];
        heights.drape_image(&drape.window([4.0, 9.0], [2.0, 5.0], halvings).unwrap()).unwrap();
        [heights.source().byte_count() - before[0], heights.source().read_count() - before[1]]
    };
    let costs: Vec<[u64; 2]> = (0..7).map(read).collect();
    assert!(costs.is_sorted_by(|finer, coarser| coarser[0] <= finer[0]), "{costs:?}");
    assert!(costs[3][0] < costs[0][0] / 8, "{costs:?}");
    assert!(costs.iter().all(|cost| cost[1] <= 12), "{costs:?}");
}

#[test]
fn every_damaged_byte_of_the_image_is_found() {
    let bytes = file();
    let heights = Heights::open(bytes.as_slice(), Limits::default()).unwrap();
    let range = heights.index().drape_range().unwrap();
    for at in (range.start..range.end).step_by(7) {
        let mut changed = bytes.clone();
        changed[at as usize] ^= 0x10;
        let verified = Heights::open(changed.as_slice(), Limits::default()).and_then(|heights| heights.verify());
        assert!(matches!(verified, Err(Error::Format { .. })), "{at}: {verified:?}");
    }
    let without = Heights::open(Terrain::plane([20, 12]).file(5.0), Limits::default()).unwrap();
    let window = DrapeWindow { halvings: 0, first: [0, 0], size: [1, 1] };
    assert!(matches!(without.drape_image(&window), Err(Error::Query { .. })));
    for window in [
        DrapeWindow { halvings: 70, ..window },
        DrapeWindow { size: [0, 1], ..window },
        DrapeWindow { size: [u32::MAX, u32::MAX], ..window },
        DrapeWindow { first: [i64::MIN, i64::MAX], ..window },
    ] {
        let _ = heights.drape_image(&window);
    }
}
