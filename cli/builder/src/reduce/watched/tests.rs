//! Roofs whose vertices are moved.

use super::*;
use crate::reduce::cells::Sampled;

/// A roof with its ridge at `x`, of two slopes eight wide.
fn roof(x: f64, height: f64) -> (Vec<DVec3>, [[u32; 3]; 4]) {
    let along = |x: f64, z: f64| [0.0, 8.0].map(|y| DVec3::new(x, y, z));
    ([along(0.0, 0.0), along(x, height), along(8.0, 0.0)].concat(), [[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]])
}

/// One whose colours change from place to place.
fn sampled() -> Sampled {
    let (positions, triangles) = roof(3.0, 2.0);
    let colour = |triangle: usize, [a, b, _]: [f64; 3]| {
        let bright = 50.0 * triangle as f64;
        Some([bright + 90.0 * (40.0 * a).sin().abs(), 100.0 * b, 7.0])
    };
    Sampled::new(triangles.iter().map(|t| t.map(|v| positions[v as usize])).collect(), 900.0, 0.0, colour)
}

#[test]
fn what_comes_of_moves_is_what_is_found_afresh() {
    let sampled = sampled();
    let points = Grouped::new(&sampled);
    let (positions, triangles) = roof(4.0, 1.0);
    let mut watched = Watched::new(&points, positions, triangles.to_vec()).expect("it shows something");
    let seen = |watched: &Watched<'_>| {
        let seen = sampled.seen(watched.positions().to_vec(), &triangles);
        seen.mean().expect("something is seen") * seen.distance()
    };
    let first = watched.value();
    for (vertex, offset) in
        [(2, [-0.5, 0.0, 0.5]), (3, [-0.25, -1.0, 0.25]), (0, [0.0, 0.5, 0.0]), (3, [0.0, 0.5, 0.5])]
    {
        let moved =
            watched.moved(vertex, watched.positions()[vertex] + DVec3::from(offset)).expect("no triangle turns");
        let value = moved.value;
        watched.take(moved);
        let afresh =
            Watched::new(&points, watched.positions().to_vec(), triangles.to_vec()).expect("as before").value();
        assert!((value / afresh - 1.0).abs() < 1e-3 && value == watched.value(), "{value} {afresh}");
        // Points on an edge belong to one of two triangles; and here cells are others, and its own points more.
        assert!((value / seen(&watched) - 1.0).abs() < 0.1, "{value} {}", seen(&watched));
    }
    assert!(watched.value() < first);
}

#[test]
fn triangles_do_not_turn_over() {
    let sampled = sampled();
    let points = Grouped::new(&sampled);
    let (positions, triangles) = roof(4.0, 1.0);
    let watched = Watched::new(&points, positions, triangles.to_vec()).expect("it shows something");
    assert!(watched.moved(2, DVec3::new(20.0, 0.0, 1.0)).is_none());
    assert!(watched.moved(2, DVec3::new(4.0, 0.0, 1.5)).is_some());
    assert_eq!(watched.shortest_edge(0), 17_f64.sqrt());
}

#[test]
fn what_shows_nothing_is_not_watched() {
    let (positions, triangles) = roof(4.0, 1.0);
    let corners = triangles.iter().map(|t| t.map(|v| positions[v as usize])).collect();
    let (nothing, sampled) = (Sampled::new(corners, 900.0, 0.0, |_, _| None), sampled());
    let is_watched =
        |of: &Sampled, positions: Vec<DVec3>| Watched::new(&Grouped::new(of), positions, triangles.to_vec()).is_some();
    assert!(is_watched(&sampled, positions.clone()));
    assert!(!is_watched(&nothing, positions.clone()));
    assert!(!is_watched(&sampled, vec![DVec3::ONE; positions.len()]));
    // Larger than what it shows, by little and by far.
    for (size, wanted) in [(1.4, true), (4.0, false), (1e6, false)] {
        assert_eq!(is_watched(&sampled, positions.iter().map(|point| point * size).collect()), wanted, "{size}");
    }
}

#[test]
fn edges_are_split_where_most_is_wrong() {
    let sampled = sampled();
    let points = Grouped::new(&sampled);
    let (positions, triangles) = roof(4.0, 1.0);
    let watched = Watched::new(&points, positions, triangles.to_vec()).expect("it shows something");
    assert_eq!(watched.worst_edges(4).len(), 9);
    let worst = watched.worst_edges(1);
    assert!(worst.len() == 3 && worst.iter().all(|&edge| (1..=2).contains(&watched.triangles_at(edge).len())));
    let (split, parts_of) = watched.split([2, 3]).expect("the ridge");
    assert_eq!((split.positions()[6], &parts_of[..]), (DVec3::new(4.0, 4.0, 1.0), &[0, 1, 2, 3, 1, 2][..]));
    let area = |watched: &Watched<'_>| {
        let corners = |t: &[u32; 3]| t.map(|v| watched.positions()[v as usize]);
        watched.triangles().iter().map(|t| doubled_area(corners(t)).z).sum::<f64>()
    };
    assert!((area(&split) - area(&watched)).abs() < 1e-9 && area(&watched) > 100.0);
    // It is the same surface, and only cells are others.
    assert!((split.value() / watched.value() - 1.0).abs() < 0.2, "{} {}", split.value(), watched.value());
}
