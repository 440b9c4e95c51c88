// Files and streams: queries, frames without cracks, failures, and bytes from hostile places.

import assert from 'node:assert/strict';
import { readFile, readdir } from 'node:fs/promises';
import { join } from 'node:path';
import { describe, test } from 'node:test';
import { BytesSource, LodpackError, OVERVIEW, Pool, SharedPromiseCache, loadModule, open } from '../js/index.js';
import { edgesOf, edgesOfMesh, nodesOf, settle, viewOf } from './picture.js';

const vectors = new URL('../../../format-spec/vectors/', import.meta.url);
const vector = (name) => readFile(new URL(`${name}.lodpack`, vectors));
const folder = process.env.LODPACK_REFERENCE;
const needsScan = { skip: !folder && 'cargo test -p lodpack-cli makes the file that it needs' };
const scan = () => readFile(join(folder, 'valid-scan.lodpack'));

test('what the index says', async () => {
  const file = await open(await vector('torus'));
  assert.equal(file.levels.length, 3);
  assert.deepEqual(file.levels.map(({ triangleCount }) => triangleCount), [30, 120, 480]);
  assert.ok(file.bounds.min.every((low, axis) => low < file.bounds.max[axis]));
  assert.match(file.version, /^\d+\.\d+$/);
  assert.equal(file.lattice.step, 2 ** -7);
  assert.equal(file.byteLength, (await vector('torus')).length);
  const empty = await open(await vector('nothing'));
  assert.equal(empty.bounds, null);
  assert.equal((await empty.select({})).nodes.length, 0);
});

test('cuts keep tolerances and budgets', async () => {
  const file = await open(await vector('torus'));
  const coarse = await file.select({ tolerance: 1 });
  assert.deepEqual([coarse.triangleCount, coarse.limitedBy], [30, 'tolerance']);
  const budget = await file.select({ maxTriangles: 200 });
  assert.ok(budget.triangleCount <= 200 && budget.limitedBy === 'triangles');
  const seen = await file.select({ view: viewOf(file.bounds, 3) });
  assert.ok(seen.pixelError > 0 && seen.nodes.length > 0);
  const outside = await file.select({ sphere: { centre: [100, 100, 100], radius: 1 } });
  assert.equal(outside.nodes.length, 0);
  const kept = await file.select({ box: [[100, 100, 100], [101, 101, 101]], outside: 'coarsest' });
  assert.equal(kept.triangleCount, 30);
  const planes = Array.from({ length: 6 }, () => ({ normal: [1, 0, 0], offset: 1000 }));
  assert.equal((await file.select({ frustum: planes })).triangleCount, 480);
});

test('queries that make no sense are refused with words', async () => {
  const file = await open(await vector('torus'));
  const stream = await file.stream();
  const bad = [
    [{ tolerance: NaN }, /tolerance has to consist of numbers/],
    [{ tolerance: -1 }, /zero or more/],
    [{ tolerance: '1' }, /has to consist of numbers/],
    [{ maxTriangles: -5 }, /maxTriangles must be zero or more/],
    [{ maxTriangles: 3 }, /needs at least 30 triangles/],
    [{ tolarance: 1 }, /a query has no tolarance; it has tolerance/],
    [{ box: [1, 2, 3] }, /box has 6 numbers, not 3/],
    [{ box: [[1, 1, 1], [0, 0, 0]] }, /smallest corner/],
    [{ box: [0, 0, 0, 1, 1, 1], sphere: { centre: [0, 0, 0], radius: 1 } }, /one volume/],
    [{ sphere: { centre: [0, 0, 0], radius: -1 } }, /radius/],
    [{ view: { position: [NaN, 0, 0] } }, /numbers, not of NaN/],
    [{ view: { position: [Infinity, 0, 0] } }, /view/],
    [{ view: { forward: [0, 0, 0] } }, /view/],
    [{ view: { fov: 1 } }, /a view has no fov/],
    [{ view: {}, tolerance: 1 }, /in pixels/],
    [{ outside: 'later' }, /outside/],
  ];
  for (const [query, message] of bad) {
    await assert.rejects(file.select(query), (error) => error instanceof LodpackError && error.kind === 'query' && message.test(error.message), JSON.stringify(query));
  }
  await assert.rejects(file.selectLevel(1.5), { kind: 'query' });
  await assert.rejects(file.selectLevel(99), { kind: 'query' });
  await assert.rejects(file.extract({ nodes: Uint32Array.of(0, 0, 0, 0) }), /sorted by root/);
  await assert.rejects(file.extract({ nodes: Uint32Array.of(7e6, 0) }), { kind: 'query' });
  await assert.rejects(file.extract([]), { kind: 'query' });
  for (const position of [[NaN, 0, 0], [Infinity, 0, 0]]) await assert.rejects(stream.frame({ view: { position } }), { kind: 'query' });
  // The stream lives on.
  await settle(stream, new Pool(), { view: viewOf(file.bounds, 3) });
});

test('calls can be aborted, and end when the file is closed', async () => {
  const bytes = await vector('torus');
  const held = [];
  let isHeld = false;
  const inner = new BytesSource(bytes);
  const source = {
    getBytes: (offset, length, signal) => (isHeld
      ? new Promise((_, reject) => { held.push(offset); signal.addEventListener('abort', () => reject(signal.reason)); })
      : inner.getBytes(offset, length)),
  };
  isHeld = true;
  const controller = new AbortController();
  const opening = open(source, { signal: controller.signal, cache: new SharedPromiseCache() });
  setTimeout(() => controller.abort(), 20);
  await assert.rejects(opening, { name: 'AbortError' });
  assert.ok(held.length > 0);
  isHeld = false;
  const file = await open(source, { cache: new SharedPromiseCache() });
  const gone = new AbortController();
  gone.abort();
  await assert.rejects(file.select({}, { signal: gone.signal }), { name: 'AbortError' });
  const stream = await file.stream();
  stream.close();
  await assert.rejects(stream.frame({}), { kind: 'closed' });
  file.close();
  await assert.rejects(file.select({}), { kind: 'closed' });
});

test('WebAssembly may come as bytes', async () => {
  const wasm = await readFile(new URL('../lodpack.wasm', import.meta.url));
  for (const given of [wasm, await loadModule(wasm)]) {
    const file = await open(await vector('torus'), { wasm: given });
    assert.equal(file.rootCount, 1);
  }
});

describe('streams', needsScan, () => {
  test('every frame is a complete surface without cracks, at any levels', async () => {
    for (const bytes of [await scan(), await vector('tree'), await vector('closed_torus'), await vector('many_clusters')]) {
      const file = await open(bytes);
      const stream = await file.stream();
      const pool = new Pool();
      let checked = 0;
      let mixed = 0;
      let clean = 0;
      const check = async ({ triangleCount }) => {
        // The native reader proves that what it extracts has no cracks.
        const cut = { nodes: nodesOf(pool) };
        const drawn = edgesOf(pool);
        assert.deepEqual(drawn, edgesOfMesh(await file.extract(cut), stream.origin));
        // A scan has vertices that share a position, and then edges that count otherwise.
        if (drawn.wrong + drawn.degenerate === 0) {
          assert.equal(drawn.boundary, await file.boundaryEdgeCount(cut));
          clean += 1;
        }
        assert.equal(pool.triangleCount, triangleCount);
        checked += 1;
        mixed += new Set([...pool.roots.values()].map(({ level }) => level)).size > 1 ? 1 : 0;
      };
      for (let step = 0; step < 40; step += 1) {
        const view = viewOf(file.bounds, 4 - 3.6 * Math.sin((step / 40) * Math.PI), step / 6, 2 ** (step % 5));
        const frame = await stream.frame({ view, outside: 'coarsest' });
        pool.update(frame);
        if (frame.shows === 'picture' && (frame.uploads.length > 0 || step % 8 === 0)) await check(frame);
        await new Promise((resolve) => setTimeout(resolve, 2));
      }
      // How many frames had different levels until here depends on how fast the machine is. Here parts are nearer than
      // others.
      await check(await settle(stream, pool, { view: viewOf(file.bounds, 0.4, 20 / 6, 64), outside: 'coarsest' }));
      assert.ok(checked > 3 && (clean > 0 || file.rootCount > 8), `${checked} frames were checked, ${clean} without such vertices`);
      if (file.rootCount > 8) assert.ok(mixed > 0, 'no frame had different levels');
      file.close();
    }
  });

  test('what a stream shows in the end is what extract returns', async () => {
    const file = await open(await scan());
    const stream = await file.stream();
    const pool = new Pool();
    const view = viewOf(file.bounds, 2);
    await settle(stream, pool, { view });
    const mesh = await file.extract({ nodes: nodesOf(pool) });
    assert.equal(mesh.triangles.length / 3, pool.triangleCount);
    const sorted = (positions) => [...new Set(Array.from({ length: positions.length / 3 }, (_, k) => positions.subarray(3 * k, 3 * k + 3).join()))].sort();
    const near = Float32Array.from(mesh.positions, (x, k) => x - stream.origin[k % 3]);
    const drawn = [...pool.roots.values()].flatMap(({ slab, firstVertex, vertexCount }) => [...slab.positions.subarray(3 * firstVertex, 3 * (firstVertex + vertexCount))]);
    assert.deepEqual(sorted(Float32Array.from(drawn)), sorted(near));
    file.close();
  });

  test('a device that was lost gets everything again', async () => {
    const file = await open(await scan());
    const stream = await file.stream();
    const pool = new Pool();
    const query = { view: viewOf(file.bounds, 2) };
    await settle(stream, pool, query);
    assert.deepEqual((await stream.frame(query)).uploads.length, 0);
    await stream.lose();
    const again = new Pool();
    again.update(await stream.frame(query));
    assert.deepEqual(edgesOf(again), edgesOf(pool));
    assert.equal(again.triangleCount, pool.triangleCount);
    file.close();
  });

  test('reads that fail are tried again, given up with words, and may be had later', async () => {
    const inner = new BytesSource(await scan());
    let works = true;
    let count = 0;
    const source = {
      async getBytes(offset, length) {
        count += 1;
        if (works === true || (works === 'sometimes' && count % 2)) return inner.getBytes(offset, length);
        throw new Error('the line is dead');
      },
    };
    const flaky = await open(source, { cache: new SharedPromiseCache() });
    works = 'sometimes';
    const query = { view: viewOf(flaky.bounds, 2) };
    let frame;
    for (let attempt = 0; attempt < 5; attempt += 1) {
      // The index may need attempts of its own: a stream that could not begin says so.
      const stream = await flaky.stream();
      const pool = new Pool();
      frame = await settle(stream, pool, query).catch((error) => ({ error }));
      if (!frame.error) break;
    }
    assert.ok(frame.isComplete, frame.error?.message);
    flaky.close();

    works = true;
    const file = await open(source, { cache: new SharedPromiseCache() });
    const stream = await file.stream();
    const pool = new Pool();
    for (let k = 0; k < 100; k += 1) {
      frame = await stream.frame({ view: viewOf(file.bounds, 60, 0, 100) });
      pool.update(frame);
      if (frame.shows === 'picture') break;
      await new Promise((resolve) => setTimeout(resolve, 5));
    }
    assert.equal(frame.shows, 'picture');
    works = false;
    const problems = [];
    for (let k = 0; k < 2000 && problems.length === 0; k += 1) {
      frame = await stream.frame(query);
      pool.update(frame);
      problems.push(...frame.problems);
      await new Promise((resolve) => setTimeout(resolve, 5));
    }
    assert.match(problems.join('\n'), /the line is dead/);
    works = true;
    // What was there is still drawn, and whole.
    assert.ok(pool.triangleCount > 0);
    assert.deepEqual(edgesOf(pool), edgesOfMesh(await file.extract({ nodes: nodesOf(pool) }), stream.origin));
    await stream.retry();
    assert.ok((await settle(stream, pool, query)).triangleCount > 0);
    assert.deepEqual(edgesOf(pool), edgesOfMesh(await file.extract({ nodes: nodesOf(pool) }), stream.origin));
    file.close();
  });

  test('the overview stands in until the coarsest level is there', async () => {
    const file = await open(await scan());
    const stream = await file.stream();
    const pool = new Pool();
    const shows = new Set();
    for (let k = 0; k < 200; k += 1) {
      const frame = await stream.frame({ view: viewOf(file.bounds, 3) });
      pool.update(frame);
      shows.add(frame.shows);
      assert.equal(pool.roots.has(OVERVIEW), frame.shows === 'overview');
      if (frame.isComplete) break;
      await new Promise((resolve) => setTimeout(resolve, 2));
    }
    assert.equal(shows.has('overview'), file.overviewSummary !== null);
    file.close();
  });

  test('changed bytes give errors or surfaces, and never stop the reader', async () => {
    const bytes = await scan();
    let seed = 12345;
    const dice = (below) => (seed = (Math.imul(seed, 1103515245) + 12345) >>> 0) % below;
    for (let trial = 0; trial < 60; trial += 1) {
      const changed = Uint8Array.from(bytes);
      for (let k = dice(4); k >= 0; k -= 1) changed[dice(trial % 2 ? 4096 : bytes.length)] ^= 1 << dice(8);
      await tryAll(trial % 5 === 0 ? changed.subarray(0, dice(changed.length)) : changed);
    }
  });
});

/** Opens and draws bytes. Errors must be errors of the file. */
async function tryAll(bytes) {
  let file;
  const check = (error) => assert.ok(['format', 'unsupported', 'limit', 'query'].includes(error.kind), `${error.kind}: ${error.stack}`);
  try {
    file = await open(bytes, { cache: new SharedPromiseCache() });
    const pool = new Pool();
    const stream = await file.stream();
    for (let k = 0; k < 30; k += 1) {
      const frame = await stream.frame({ view: viewOf(file.bounds ?? { min: [0, 0, 0], max: [1, 1, 1] }, 2) });
      pool.update(frame);
      if (frame.isComplete || frame.problems.length > 0) break;
      await new Promise((resolve) => setTimeout(resolve, 1));
    }
    const mesh = await file.extract(await file.select({}));
    assert.ok(mesh.triangles.every((vertex) => vertex < mesh.positions.length / 3));
  } catch (error) {
    check(error);
  } finally {
    file?.close();
  }
}

test('invalid vectors are refused or drawn, and never stop the reader', async () => {
  const invalid = new URL('invalid/', vectors);
  const names = (await readdir(invalid)).filter((name) => name.endsWith('.lodpack'));
  assert.ok(names.length > 100);
  for (const name of names) await tryAll(await readFile(new URL(name, invalid)));
});

test('a file of a newer version says so', async () => {
  await assert.rejects(open(await readFile(new URL('invalid/newer_version.lodpack', vectors))), (error) => {
    assert.equal(error.kind, 'unsupported');
    assert.match(error.message, /newer lodpack/);
    return true;
  });
});
