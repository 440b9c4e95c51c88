//! What an engine draws from its buffers is the picture.

use std::collections::{BTreeMap, BTreeSet};

use super::{model, random_cut};
use crate::{
    stream::{Mode, Options, Pool, PoolOptions, PoolUpload, StreamerOptions, VERTEX_BYTES},
    tests::synthetic::Random,
};

/// Buffers as an engine has them.
#[derive(Default)]
struct Engine(BTreeMap<u64, [Vec<u8>; 2]>);

impl Engine {
    fn copy(&mut self, pool: &Pool, uploads: Vec<PoolUpload>) {
        let ids: BTreeSet<u64> = pool.buffers().map(|buffer| buffer.id).collect();
        self.0.retain(|id, _| ids.contains(id));
        for buffer in pool.buffers() {
            let new =
                || [vec![0; buffer.vertex_count as usize * VERTEX_BYTES], vec![0; buffer.index_count as usize * 4]];
            self.0.entry(buffer.id).or_insert_with(new);
        }
        for PoolUpload { place, vertices, indices, .. } in uploads {
            let [of_vertices, of_indices] = self.0.get_mut(&place.buffer).expect("the pool has it");
            let (at, first) = (place.first_vertex as usize * VERTEX_BYTES, place.first_index as usize * 4);
            of_vertices[at..at + vertices.len()].copy_from_slice(&vertices);
            of_indices[first..first + indices.len()].copy_from_slice(&indices);
        }
    }

    /// Corners of all triangles that the calls draw, in bits.
    fn drawn(&self, pool: &Pool) -> Vec<[[u32; 3]; 3]> {
        let mut all = Vec::new();
        for (_, place) in pool.places() {
            let [count, instances, first, base, _] = place.indirect(7).map(|n| n as usize);
            assert_eq!(instances, 1);
            let [vertices, indices] = &self.0[&place.buffer];
            let word = |bytes: &[u8], at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
            let corner = |k: usize| {
                let vertex = word(indices, 4 * (first + k)) as usize + base;
                [0, 1, 2].map(|axis| word(vertices, vertex * VERTEX_BYTES + 4 * axis))
            };
            all.extend((0..count / 3).map(|k| [0, 1, 2].map(|side| corner(3 * k + side))));
        }
        all.sort_unstable();
        all
    }
}

#[test]
fn engines_draw_the_picture_whatever_changes() {
    let (file, mut random) = (model(4), Random::new(3));
    for light in [false, true] {
        let session = Options { mode: Mode::Synchronous, light, ..Options::default() };
        let mut streamer = file.streamer(StreamerOptions { session, ..StreamerOptions::default() }).unwrap();
        let origin = file.bounds().unwrap()[0];
        let small = PoolOptions { vertex_count: 2000, index_count: 9000 };
        let (mut pool, mut engine) = (Pool::new(origin, small), Engine::default());
        let mut most = 0;
        for number in 0..24 {
            let nodes = match number % 4 {
                0 => file.uniform_cut(number as u8 / 4 % 4).unwrap().nodes,
                1 => random_cut(&file, &mut random)[..40].to_vec(),
                _ => random_cut(&file, &mut random),
            };
            let streamed = streamer.show(&nodes).unwrap();
            let uploads = pool.update(streamer.picture(), &streamed.frame.changes);
            engine.copy(&pool, uploads);
            let mut wanted = Vec::new();
            for drawn in streamer.picture().roots() {
                let lit = drawn.lit().map(|lit| (lit.positions, lit.triangles));
                assert_eq!(lit.is_some(), light);
                let (positions, triangles) = lit.unwrap_or_else(|| drawn.joined());
                let bits =
                    |vertex: u32| [0, 1, 2].map(|k| ((positions[vertex as usize][k] - origin[k]) as f32).to_bits());
                wanted.extend(triangles.iter().map(|triangle| triangle.map(bits)));
            }
            wanted.sort_unstable();
            assert!(engine.drawn(&pool) == wanted, "{number}, light {light}");
            most = most.max(pool.buffers().len());
        }
        assert!(most > 1, "one buffer has room for all");
        // A device that was lost.
        let (mut again, mut other) = (Pool::new(origin, PoolOptions::default()), Engine::default());
        let uploads = again.fill(streamer.picture());
        other.copy(&again, uploads);
        assert!(other.drawn(&again) == engine.drawn(&pool) && again.buffers().len() == 1);
    }
}
