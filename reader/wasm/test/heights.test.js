// Files of heights: what they say, cuts and meshes, frames of a moving camera, and bytes that are not as they should
// be.

import assert from 'node:assert/strict';
import { readFile } from 'node:fs/promises';
import { join } from 'node:path';
import { describe, test } from 'node:test';
import { BytesSource, Pool, SharedPromiseCache, open } from '../js/index.js';
import { edgesOf, edgesOfMesh, settle, viewOf } from './picture.js';

const vectors = new URL('../../../format-spec/vectors/heights/', import.meta.url);
const vector = (name) => readFile(new URL(`${name}.lodpack`, vectors));
const NAMES = ['cell', 'hills', 'ridge', 'islands', 'globe'];

/** The number of a half float from 0 to 1. */
const ofHalf = (bits) => (bits < 1024 ? bits / 2 ** 24 : (1 + (bits & 1023) / 1024) * 2 ** ((bits >> 10) - 15));

/** Corners of all triangles of a pool, or of a mesh seen from the origin of a stream. */
const trianglesOf = (parts) => parts.flatMap(({ positions, indices }) => Array.from({ length: indices.length / 3 }, (_, k) => {
  const corners = [0, 1, 2].map((corner) => [0, 1, 2].map((axis) => positions[3 * indices[3 * k + corner] + axis] + 0).join());
  // Beginning with the first of them.
  const first = corners.indexOf([...corners].sort()[0]);
  return [0, 1, 2].map((corner) => corners[(first + corner) % 3]).join(' ');
})).sort();
const ofPool = (pool) => trianglesOf([...pool.roots.values()].map(({ slab: { positions, indices }, firstIndex, indexCount }) => (
  { positions, indices: indices.subarray(firstIndex, firstIndex + indexCount) })));
const ofMesh = ({ positions, triangles }, origin) => trianglesOf([
  { positions: Float32Array.from(positions, (x, k) => x - origin[k % 3]), indices: triangles }]);

test('what a file says', async () => {
  for (const name of NAMES) {
    const file = await open(await vector(name));
    assert.equal(file.kind, 'heights');
    assert.ok(file.heights.columns > 1 && file.heights.rows > 1 && file.heights.depthCount > 0);
    assert.equal(file.heights.isGlobe, name === 'globe');
    assert.ok(file.bounds.min.every((low, axis) => low <= file.bounds.max[axis]));
    assert.deepEqual([file.levels, file.channels, file.overviewSummary], [[], [], null]);
    assert.equal(await file.overview(), null);
    file.close();
  }
  const mesh = await open(await readFile(new URL('../torus.lodpack', vectors)));
  assert.deepEqual([mesh.kind, mesh.heights], ['mesh', null]);
});

test('cuts keep tolerances, budgets and boxes, and have no cracks', async () => {
  for (const name of NAMES) {
    const file = await open(await vector(name));
    const finest = await file.select({});
    const coarse = await file.select({ tolerance: 1e9 });
    assert.ok(coarse.triangleCount <= finest.triangleCount && coarse.error >= finest.error);
    const middle = await file.select({ tolerance: (coarse.error + finest.error) / 2 });
    assert.ok(middle.limitedBy === 'finest' || middle.error <= (coarse.error + finest.error) / 2);
    assert.equal(middle.nodes.length, 4 * middle.nodeErrors.length);
    const budget = await file.select({ maxTriangles: Math.max(coarse.triangleCount, 300) });
    assert.ok(budget.triangleCount <= Math.max(coarse.triangleCount, 300));
    for (const cut of [finest, coarse, middle, budget]) {
      const mesh = await file.extract(cut);
      assert.equal(mesh.triangleNodes.length, mesh.triangles.length / 3);
      const { boundary, wrong, degenerate } = edgesOfMesh(mesh, [0, 0, 0]);
      assert.deepEqual([wrong, degenerate], [0, 0], name);
      if (name === 'globe') assert.equal(boundary, 0);
    }
    const { first: [x, y], spacing: [dx, dy] } = file.heights;
    const part = await file.select({ box: [[x, y + dy, -1e9], [x + dx, y, 1e9]] });
    assert.ok(part.nodes.length <= finest.nodes.length && part.nodes.length > 0);
    file.close();
  }
});

test('what heights do not have is refused with words', async () => {
  const file = await open(await vector('hills'));
  for (const query of [{ view: {} }, { maxNodes: 3 }, { sphere: { centre: [0, 0, 0], radius: 1 } }]) {
    await assert.rejects(file.select(query), { kind: 'query', message: /cuts of heights take box/ });
  }
  await assert.rejects(file.select({ tolerance: -1 }), { kind: 'query' });
  await assert.rejects(file.selectLevel(0), { kind: 'query', message: /neither levels nor channels/ });
  await assert.rejects(file.extract({ nodes: Uint32Array.of(0, 0) }), { kind: 'query' });
  await assert.rejects(file.extract({ nodes: Uint32Array.of(0, 7, 7, 0) }), { kind: 'query', message: /does not exist/ });
  await assert.rejects(file.stream({ channel: 'paint' }), { kind: 'query' });
  const stream = await file.stream();
  await assert.rejects(stream.frame({ maxBytes: 1 }), { kind: 'query' });
  await assert.rejects(stream.frame({ view: { forward: [0, 0, 0] } }), { kind: 'query' });
});

describe('streams of heights', () => {
  test('what a stream shows of everything is what extract returns', async () => {
    for (const name of NAMES) {
      const file = await open(await vector(name));
      const stream = await file.stream();
      const pool = new Pool();
      const finest = await file.select({});
      for (const tolerance of [1e9, 30, 3, 0]) {
        await settle(stream, pool, { tolerance });
        const mesh = await file.extract(await file.select({ tolerance }));
        assert.deepEqual(ofPool(pool), ofMesh(mesh, stream.origin), `${name} ${tolerance}`);
      }
      assert.equal(pool.triangleCount > 0, finest.triangleCount > 0);
      file.close();
    }
  });

  test('tiles have normals of length 1, a texel a sample, and send them once', async () => {
    for (const name of NAMES) {
      const file = await open(await vector(name));
      const stream = await file.stream();
      const pool = new Pool({ images: true });
      await settle(stream, pool, { tolerance: 0 });
      for (const { slab: { atlas, places, rectangles }, tile, firstVertex, vertexCount } of pool.roots.values()) {
        // A texel more on each side than there are samples.
        assert.deepEqual([tile.width, tile.height, atlas.data], [67, 67, undefined]);
        const texels = atlas.read(tile).normals;
        for (let k = 0; k < texels.length; k += 4) {
          const [x, y, z, one] = texels.subarray(k, k + 4);
          assert.ok(Math.abs(Math.hypot(...[x, y, z].map((bits) => 2 * ofHalf(bits) - 1)) - 1) < 2e-3 && one === 0x3c00, `${name} ${k}`);
        }
        for (let vertex = firstVertex; vertex < firstVertex + vertexCount; vertex += 1) {
          const [left, top, right, bottom] = rectangles.subarray(4 * vertex, 4 * vertex + 4);
          const [x, y] = places.subarray(2 * vertex, 2 * vertex + 2);
          assert.deepEqual([left, top, right, bottom], [tile.x + 1, tile.y + 1, tile.x + 66, tile.y + 66]);
          assert.ok(x >= left + 0.5 && x <= right - 0.5 && y >= top + 0.5 && y <= bottom - 0.5);
        }
      }
      // The border changes, and with it the triangles; the image only where another tile lies beside it.
      const { uploads } = await stream.frame({ tolerance: 1e9 });
      assert.ok(uploads.every(({ places }) => places));
      const mesh = await file.extract(await file.select({}));
      assert.deepEqual([mesh.normals.length, mesh.colors], [mesh.positions.length, null]);
      file.close();
    }
  });

  test('a ramp is a channel that colours tiles and meshes', async () => {
    const file = await open(await vector('painted'));
    assert.deepEqual(file.channels.map(({ name, kind }) => [name, kind]), [['colour', 'colour']]);
    assert.equal(file.heights.ramp, 'hills');
    const mesh = await file.extract(await file.select({}), { channels: 'auto' });
    // The stops of the vector, at heights from 10 to 60.
    const stops = [[10, [0, 40, 160]], [20.5, [250, 240, 200]], [20.5, [30, 120, 40]], [60, [255, 255, 255]]];
    const colour = (height) => {
      const above = stops.findIndex(([stop]) => stop > height);
      if (above <= 0) return above < 0 ? stops.at(-1)[1] : stops[0][1];
      const [[low, from], [high, to]] = [stops[above - 1], stops[above]];
      return from.map((x, k) => Math.round(x + ((height - low) / (high - low)) * (to[k] - x)));
    };
    for (let k = 0; k < mesh.colors.length / 4; k += 1) {
      assert.deepEqual([...mesh.colors.subarray(4 * k, 4 * k + 4)], [...colour(mesh.positions[3 * k + 2]), 255]);
    }
    const stream = await file.stream({ channel: 'auto' });
    const pool = new Pool({ images: true });
    await settle(stream, pool, { tolerance: 0 });
    const [{ slab, tile, firstVertex, vertexCount }] = pool.roots.values();
    const texels = slab.atlas.read(tile).data;
    for (let vertex = firstVertex; vertex < firstVertex + vertexCount; vertex += 1) {
      const [x, y] = [slab.places[2 * vertex] - tile.x, slab.places[2 * vertex + 1] - tile.y].map(Math.floor);
      const height = slab.positions[3 * vertex + 2] + stream.origin[2];
      assert.deepEqual([...texels.subarray(4 * (67 * y + x), 4 * (67 * y + x) + 3)], colour(Math.round(height * 4) / 4));
    }
    await stream.show('none');
    pool.update(await stream.frame({ tolerance: 0 }));
    const [{ slab: bare, tile: there }] = pool.roots.values();
    assert.deepEqual([bare.atlas.read(there).data, bare.atlas.planes], [undefined, 'normals 2']);
    file.close();
  });

  test('every frame has a surface without cracks, from the first one on', async () => {
    for (const name of ['hills', 'ridge', 'globe']) {
      const file = await open(await vector(name));
      const stream = await file.stream();
      const pool = new Pool();
      const counts = new Set();
      for (let step = 0; step < 40; step += 1) {
        const view = viewOf(file.bounds, 4 - 3.2 * Math.sin((step / 40) * Math.PI), step / 6, 2 ** ((step % 9) - 6));
        const frame = await stream.frame({ view });
        pool.update(frame);
        assert.equal(frame.shows, 'picture');
        assert.ok(pool.triangleCount > 0 && pool.triangleCount === frame.triangleCount, `${name} ${step}`);
        const { wrong, degenerate } = edgesOf(pool);
        assert.deepEqual([wrong, degenerate], [0, 0], `${name} ${step}`);
        counts.add(pool.triangleCount);
        await new Promise((resolve) => setTimeout(resolve, 2));
      }
      assert.ok(counts.size > 1, `${name}: ${[...counts]}`);
      const frame = await settle(stream, pool, { view: viewOf(file.bounds, 2) });
      assert.ok(frame.errorPx <= 1 || frame.limitedBy === 'finest');
      file.close();
    }
  });

  test('a device that was lost gets everything again', async () => {
    const file = await open(await vector('hills'));
    const stream = await file.stream();
    const pool = new Pool();
    const query = { view: viewOf(file.bounds, 2) };
    await settle(stream, pool, query);
    assert.equal((await stream.frame(query)).uploads.length, 0);
    await stream.lose();
    const again = new Pool();
    again.update(await stream.frame(query));
    assert.deepEqual(ofPool(again), ofPool(pool));
    file.close();
  });
});

// Larger than the first request, and the native reader's answers.
const folder = process.env.LODPACK_REFERENCE;
const needsFiles = { skip: !folder && 'cargo test -p lodpack-cli makes the files that it needs' };

describe('larger files of heights', needsFiles, () => {
  for (const name of ['heights-flat', 'heights-globe']) {
    test(`${name}: meshes are those of the native reader`, async () => {
      const file = await open(await readFile(join(folder, `${name}.lodpack`)));
      for (const tolerance of [100, 10]) {
        const { positions, triangles } = await file.extract(await file.select({ tolerance }));
        const bytes = Buffer.concat([positions, triangles].map(({ buffer, byteOffset, byteLength }) => Buffer.from(buffer, byteOffset, byteLength)));
        assert.ok(bytes.equals(await readFile(join(folder, `${name}.${tolerance}.bin`))), `${tolerance}`);
      }
      file.close();
    });

    test(`${name}: a moving camera gets what it needs in few requests, and never a crack`, async () => {
      const inner = new BytesSource(await readFile(join(folder, `${name}.lodpack`)));
      let requests = 0;
      const source = {
        async getBytes(offset, length) {
          requests += 1;
          await new Promise((resolve) => setTimeout(resolve, 3));
          return inner.getBytes(offset, length);
        },
      };
      const file = await open(source, { cache: new SharedPromiseCache() });
      assert.ok(requests <= 2, `${requests} to open`);
      const stream = await file.stream();
      const pool = new Pool();
      for (let step = 0; step < 30; step += 1) {
        const frame = await stream.frame({ view: viewOf(file.bounds, 3 - step / 12, step / 9) });
        pool.update(frame);
        const { wrong } = edgesOf(pool);
        assert.ok(wrong === 0 && pool.triangleCount > 0, `${step}: ${wrong}`);
        await new Promise((resolve) => setTimeout(resolve, 4));
      }
      const frame = await settle(stream, pool, { view: viewOf(file.bounds, 0.8, 3) });
      assert.ok(frame.errorPx <= 1 || frame.limitedBy === 'finest');
      assert.ok(requests < frame.counters.decoded, `${requests} requests, ${frame.counters.decoded} tiles`);
      file.close();
    });
  }
});

test('damaged files are refused, or drawn without what is damaged', async () => {
  const good = await vector('hills');
  for (let at = 0; at < good.length; at += 61) {
    const bad = Uint8Array.from(good);
    bad[at] ^= 0x40;
    const file = await open(new BytesSource(bad), { cache: new SharedPromiseCache() }).catch((error) => error);
    if (file instanceof Error) {
      assert.ok(['format', 'unsupported', 'limit'].includes(file.kind), `${at}: ${file}`);
      continue;
    }
    const answer = await file.select({}).then((cut) => file.extract(cut)).catch((error) => error);
    assert.ok(answer.kind === 'format' || answer.kind === 'limit' || answer.triangles, `${at}: ${answer}`);
    const stream = await file.stream().catch((error) => error);
    if (!(stream instanceof Error)) {
      const pool = new Pool();
      pool.update(await stream.frame({ view: viewOf(file.bounds, 2) }));
      assert.ok(pool.triangleCount > 0);
    }
    file.close();
  }
});
