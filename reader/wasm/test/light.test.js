// Streams with light: normals at vertices where a file stores none.

import assert from 'node:assert/strict';
import { readFile } from 'node:fs/promises';
import { test } from 'node:test';
import { Pool, open } from '../js/index.js';
import { settle, viewOf } from './picture.js';

const vector = (name) => readFile(new URL(`../../../format-spec/vectors/${name}.lodpack`, import.meta.url));

/** Draws views from all sides into pools of both kinds, and checks what these hold after each. */
async function look(file, check) {
  const stream = await file.stream({ light: true });
  const pools = ['octahedral', 'vectors'].map((normals) => new Pool({ normals }));
  for (const distance of [1, 3, 0.3, 2]) {
    await settle(stream, { update: (frame) => pools.forEach((pool) => pool.update(frame)) }, { view: viewOf(file.bounds, distance) });
    check(...pools);
  }
  stream.close();
}

test('normals have a length, and mostly one value where roots meet', async () => {
  const file = await open(await vector('tree'));
  assert.equal(file.storesNormals, false);
  let [same, all] = [0, 0];
  await look(file, (octahedral, vectors) => {
    const places = new Map();
    for (const [root, { slab, firstVertex, vertexCount }] of vectors.roots) {
      const other = octahedral.roots.get(root);
      for (let k = 0; k < vertexCount; k += 1) {
        const [x, y, z, none] = slab.normals.subarray(4 * (firstVertex + k), 4 * (firstVertex + k) + 4);
        assert.ok(Math.abs(Math.hypot(x, y, z) - 32767) < 2 && none === 0);
        const folded = other.slab.normals.subarray(2 * (other.firstVertex + k), 2 * (other.firstVertex + k) + 2);
        // The outer half of the square is the half of the sphere below.
        assert.equal(Math.abs(folded[0]) + Math.abs(folded[1]) > 32768, z < -1);
        const place = slab.positions.slice(3 * (firstVertex + k), 3 * (firstVertex + k) + 3).join();
        if (!places.has(place)) places.set(place, new Map());
        const roots = places.get(place);
        roots.set(root, [...(roots.get(root) ?? []), [x, y, z].join()]);
      }
    }
    for (const roots of places.values()) {
      if (roots.size < 2) continue;
      const [first, ...others] = [...roots.values()];
      all += 1;
      if (others.every((normals) => normals.some((normal) => first.includes(normal)))) same += 1;
    }
  });
  assert.ok(all > 100 && same > 0.5 * all, `${same} of ${all}`);
  file.close();
});

const dark = { update: ({ uploads }) => assert.ok(uploads.every(({ normals }) => normals === undefined)) };

test('a stream without light, and files that store normals, have none', async () => {
  const file = await open(await vector('tree'));
  const stream = await file.stream();
  await settle(stream, dark, { view: viewOf(file.bounds, 1) });
  file.close();
  const heights = await open(await vector('heights/hills'));
  assert.equal(heights.storesNormals, true);
  const lit = await heights.stream({ light: true });
  await settle(lit, dark, { view: viewOf(heights.bounds, 1) });
  heights.close();
});
