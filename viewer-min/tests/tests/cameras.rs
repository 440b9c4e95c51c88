//! Cameras and paths.

use glam::DVec3;
use lodpack_view::camera::{circling, pair, parse, path_from_json, path_to_json};

#[test]
fn paths_survive_a_round_trip_and_nonsense_is_refused() {
    let bounds = [[-1.0, -2.0, -3.0], [1.0, 2.0, 5e6]];
    let path = circling(bounds, [0.0, 1.0, 0.0], 7);
    let back = path_from_json(&path_to_json(&path), &path[0]).unwrap();
    for (a, b) in path.iter().zip(&back) {
        let [before, after] = [a, b].map(|view| DVec3::from(view.forward).normalize());
        assert!(a.position == b.position && (before - after).length() < 1e-8);
    }
    for text in ["", "1,2,3", "1,2,3:1,2,3", "1,2:0,0,0", "1,2,nan:0,0,0", "1,2,3:0,0,0:0,1,0:200"] {
        assert!(parse(text, &path[0]).is_err(), "{text}");
    }
    assert!(path_from_json("{}", &path[0]).is_err() && path_from_json("[]", &path[0]).is_err());
}

#[test]
fn pairs_keep_a_millimetre_at_five_million() {
    for x in [5e6 + 0.001, -5e6 + 1e-6, 1.0 / 3.0, 123_456_789.123_456] {
        let p = pair([x, 0.0, 0.0]);
        assert!((f64::from(p[0]) + f64::from(p[3]) - x).abs() < x.abs() * 1e-14);
    }
}
