// What the surface carries: lists, pages of extracted cuts, images of streams, and the requests that all of this takes.

import assert from 'node:assert/strict';
import { readFile } from 'node:fs/promises';
import { join } from 'node:path';
import { describe, test } from 'node:test';
import { Atlas } from '../js/atlas.js';
import { BytesSource, Pool, SharedPromiseCache, open } from '../js/index.js';
import { edgesOf, edgesOfMesh, nodesOf, outwardsOfTorus, paintedColour, paintedHeight, settle, viewOf } from './picture.js';

const folder = process.env.LODPACK_REFERENCE;
const skip = !folder && 'cargo test -p lodpack-cli makes the file that it needs';
const painted = () => readFile(join(folder, 'valid-painted.lodpack'));
const lit = () => readFile(join(folder, 'valid-lit.lodpack'));
/** A tolerance in pixels at which the file is drawn as several roots. */
const FINE = 0.1;
const bare = () => readFile(join(folder, 'valid-scan.lodpack'));

/** A source that notes what is asked of it. */
function noting(bytes) {
  const inner = new BytesSource(bytes);
  const ranges = [];
  return { ranges, getBytes: (offset, length) => { ranges.push([offset, offset + length]); return inner.getBytes(offset, length); } };
}

/** The colour of a place in an image, between its four nearest texels. */
function texelAt({ width, height, components, data }, [u, v]) {
  const [x, y] = [Math.min(Math.max(u * width - 0.5, 0), width - 1.001), Math.min(Math.max(v * height - 0.5, 0), height - 1.001)];
  const [left, top] = [Math.floor(x), Math.floor(y)];
  return Array.from({ length: components }, (_, k) => {
    const at = (dx, dy) => data[components * ((top + dy) * width + left + dx) + k];
    const across = (dy) => at(0, dy) * (1 - x + left) + at(1, dy) * (x - left);
    return across(0) * (1 - y + top) + across(1) * (y - top);
  });
}

const rootMeanSquare = (differences) => Math.sqrt(differences.reduce((sum, x) => sum + x * x, 0) / differences.length);

describe('channels', { skip }, () => {
  test('a module without them reads the rest, and says what it lacks', async () => {
    const [bytes, wasm] = [await painted(), await readFile(new URL('../lodpack-geometry.wasm', import.meta.url))];
    const [all, bare] = [await open(bytes), await open(bytes, { wasm })];
    const cut = await all.selectLevel(all.levels.length - 1);
    assert.deepEqual(await bare.extract(cut), await all.extract(cut));
    assert.deepEqual(bare.channels, all.channels);
    const stream = await bare.stream();
    await settle(stream, new Pool(), { view: viewOf(bare.bounds, 3) });
    const lacks = { kind: 'unsupported', message: /lodpack\.wasm instead of lodpack-geometry\.wasm/ };
    for (const call of [() => stream.show('colour'), () => bare.channelRange('height'), () => bare.extract(cut, { channels: 'auto' }), () => bare.stream({ channel: 'auto' })]) {
      await assert.rejects(call, lacks);
    }
    await stream.show('none');
    await settle(stream, new Pool(), { view: viewOf(bare.bounds, 2) });
  });

  test('are listed, with the range of numbers', async () => {
    const file = await open(await painted());
    assert.deepEqual(file.channels.map(({ name, kind, components }) => [name, kind, components]), [['colour', 'colour', 3], ['height', 'scalar', 1]]);
    assert.ok(file.channels.every(({ imageBytes, step }) => imageBytes > 1000 && step > 0));
    assert.ok(file.channels.every(({ lossless }) => lossless === false));
    const exact = await open(await readFile(new URL('../../../format-spec/vectors/exact_colours.lodpack', import.meta.url)));
    assert.deepEqual(exact.channels.map(({ lossless }) => lossless), [true, true, true, true]);
    const [low, high] = await file.channelRange('height');
    // The sphere reaches from about -1 to 1, and height is ten times that.
    assert.ok(low < -8 && low > -12 && high > 8 && high < 12, `${low} to ${high}`);
    assert.equal(await file.channelRange('colour'), null);
    assert.deepEqual((await open(await bare())).channels, []);
  });

  test('an extracted cut has the colours and numbers of the input', async () => {
    const file = await open(await painted());
    const cut = await file.selectLevel(file.levels.length - 1);
    const mesh = await file.extract(cut, { channels: ['colour', 'height'] });
    assert.equal(mesh.triangles.length / 3, cut.triangleCount);
    assert.equal(mesh.triangleNodes.length, cut.triangleCount);
    assert.deepEqual(mesh.parts, [{ page: 0, firstIndex: 0, indexCount: mesh.triangles.length }]);
    const [colours, heights] = mesh.channels;
    const [errors, differences] = [[], []];
    for (let k = 0; k < mesh.triangles.length; k += 3) {
      const corners = [...mesh.triangles.subarray(k, k + 3)];
      const middle = [0, 1, 2].map((axis) => corners.reduce((sum, vertex) => sum + mesh.positions[3 * vertex + axis] / 3, 0));
      const uv = [0, 1].map((axis) => corners.reduce((sum, vertex) => sum + mesh.uvs[2 * vertex + axis] / 3, 0));
      const [red, green, blue, alpha] = texelAt(colours.pages[0], uv);
      assert.equal(alpha, 255);
      paintedColour(middle).forEach((x, axis) => errors.push(x - [red, green, blue][axis]));
      differences.push(paintedHeight(middle) - heights.low - heights.step * texelAt(heights.pages[0], uv)[0]);
    }
    assert.ok(rootMeanSquare(errors) < 3, `${rootMeanSquare(errors)} of 255`);
    assert.ok(rootMeanSquare(differences) < 0.2, `${rootMeanSquare(differences)} of 20`);
    // Smaller pages are more of them, and each triangle lies in one.
    const small = await file.extract(cut, { channels: 'auto', pageSize: 256 });
    assert.ok(small.channels[0].pages.length > 1 && small.channels.length === 1);
    assert.equal(small.parts.reduce((sum, { indexCount }) => sum + indexCount, 0), mesh.triangles.length);
    assert.ok(small.uvs.every((x) => x >= 0 && x <= 1));
    const edges = (of) => edgesOfMesh(of, [0, 0, 0]);
    assert.deepEqual(edges(mesh), edges(await file.extract(cut)));
    file.close();
  });

  test('geometry alone asks for no texel, and texels take few requests more', async () => {
    const bytes = await painted();
    const asked = async (options) => {
      const source = noting(bytes);
      const file = await open(source, { cache: new SharedPromiseCache() });
      const cut = await file.selectLevel(1);
      const mesh = await file.extract(cut, options);
      const stream = await file.stream({ channel: Array.isArray(options?.channels) ? 'auto' : 'none' });
      const pool = new Pool({ images: true });
      const frame = await settle(stream, pool, { view: viewOf(file.bounds, 3) });
      file.close();
      return { ranges: source.ranges, mesh, frame, pool };
    };
    const [none, all] = [await asked(), await asked({ channels: ['colour'] })];
    assert.deepEqual((await asked({ channels: 'none' })).ranges, none.ranges);
    assert.equal(none.mesh.channels, undefined);
    assert.deepEqual([none.frame.counters.imageBytes, none.frame.lateImages], [0, 0]);
    const texels = texelsOf(bytes);
    const touches = ([begin, end]) => Math.max(begin, texels[0], HEAD_BYTES) < Math.min(end, texels[1]);
    assert.ok(!none.ranges.some(touches), JSON.stringify([none.ranges, texels]));
    assert.ok(all.ranges.some(touches));
    assert.ok(all.ranges.length <= none.ranges.length + 8, JSON.stringify(all.ranges));
    assert.ok(all.frame.counters.imageBytes > 0);
  });

  test('streams give every root an image, upload none twice, and drop those of roots that are gone', async () => {
    const file = await open(await painted());
    const stream = await file.stream({ channel: 'auto' });
    assert.deepEqual([stream.channel.name, stream.range], ['colour', null]);
    const pool = new Pool({ images: true });
    await settle(stream, pool, { view: viewOf(file.bounds, 3, 0, FINE) });
    const entries = [...pool.roots.values()];
    assert.ok(entries.length > 1 && entries.every(({ tile }) => tile.width > 1));
    assert.equal(pool.texels.used, entries.reduce((sum, { tile: { width, height } }) => sum + width * height, 0));
    assert.deepEqual(edgesOf(pool), edgesOfMesh(await file.extract({ nodes: nodesOf(pool) }), stream.origin));
    // Each vertex has the colour that belongs to it.
    const errors = [];
    for (const { slab, firstVertex, vertexCount } of entries) {
      for (let vertex = firstVertex; vertex < firstVertex + vertexCount; vertex += 1) {
        const { width, height, data } = slab.atlas;
        const texel = texelAt({ width, height, components: 4, data }, [slab.places[2 * vertex] / width, slab.places[2 * vertex + 1] / height]);
        const [left, top, right, bottom] = slab.rectangles.subarray(4 * vertex);
        const [x, y] = slab.places.subarray(2 * vertex);
        assert.ok(x >= left && x <= right && y >= top && y <= bottom);
        const point = [0, 1, 2].map((axis) => slab.positions[3 * vertex + axis] + stream.origin[axis]);
        paintedColour(point).forEach((colour, k) => errors.push(colour - texel[k]));
      }
    }
    assert.ok(rootMeanSquare(errors) < 6, `${rootMeanSquare(errors)} of 255`);
    // Nothing moves, so nothing comes; a lost device gets everything again.
    assert.deepEqual((await stream.frame({ view: viewOf(file.bounds, 3, 0, FINE) })).uploads, []);
    await stream.lose();
    const again = await stream.frame({ view: viewOf(file.bounds, 3, 0, FINE) });
    assert.ok(again.uploads.length === pool.roots.size && again.uploads.every(({ image }) => image?.width > 1));
    // Borders that change come without images: the root has them.
    let kept = 0;
    const { min, max } = file.bounds;
    const part = (from, to) => ({ box: [min, max].map((corner, k) => [corner[0], corner[1], min[2] + [from, to][k] * (max[2] - min[2])]), outside: 'coarsest' });
    const views = [3, 1.5, 20].map((distance) => ({ view: viewOf(file.bounds, distance, 0.3, 0.5) }));
    for (const query of [...views, {}, part(0, 0.2), part(0, 0.4), part(0.5, 0.7), part(0.8, 1)]) {
      for (let k = 0; k < 400; k += 1) {
        const frame = await stream.frame(query);
        kept += frame.uploads.filter(({ image, places }) => image === undefined && places).length;
        pool.update(frame);
        if (frame.isComplete) break;
        await new Promise((resolve) => setTimeout(resolve, 5));
      }
      const used = [...pool.roots.values()].reduce((sum, { tile: { width, height } }) => sum + width * height, 0);
      assert.equal(pool.texels.used, used);
    }
    assert.ok(kept > 0, 'no border changed');
    file.close();
  });

  test('a stream changes channels, with numbers by a ramp', async () => {
    const file = await open(await painted());
    const stream = await file.stream();
    const pool = new Pool({ images: true });
    const query = { view: viewOf(file.bounds, 3, 0, FINE) };
    await settle(stream, pool, query);
    assert.ok([...pool.roots.values()].every(({ tile }) => tile.isWhole));
    let calls = 0;
    stream.onprogress = () => { calls += 1; };
    await stream.show('height');
    assert.ok(calls > 0);
    assert.deepEqual(stream.range, await file.channelRange('height'));
    const brightness = async () => {
      await settle(stream, pool, query);
      const shades = [];
      for (const { slab: { atlas, places, positions }, firstVertex } of pool.roots.values()) {
        const [x, y] = [places[2 * firstVertex], places[2 * firstVertex + 1]].map(Math.floor);
        const at = 4 * (y * atlas.width + x);
        shades.push([positions[3 * firstVertex + 2], atlas.data[at + 1]]);
      }
      return shades.sort(([a], [b]) => a - b);
    };
    // Green grows along the whole ramp, and height with z.
    const shades = await brightness();
    assert.ok(shades.at(-1)[1] > shades[0][1] + 30, JSON.stringify(shades));
    await stream.show('height', { range: [1000, 2000] });
    assert.ok((await brightness()).every(([, green]) => green === 1));
    await stream.show('none');
    await settle(stream, pool, query);
    assert.equal(stream.channel, null);
    assert.ok([...pool.roots.values()].every(({ tile }) => tile.isWhole));
    file.close();
  });

  test('normals and materials come beside colours where they are asked for', async () => {
    const planes = { normals: 'data 1,normals 1', materials: 'data 1,material 1,emissive 1', all: 'data 1,normals 1,material 1,emissive 1' };
    const drawn = async (options) => {
      const source = noting(await lit());
      const file = await open(source, { cache: new SharedPromiseCache() });
      const [stream, pool] = [await file.stream(options), new Pool({ images: true })];
      await settle(stream, pool, { tolerance: 0 });
      const names = [...new Set([...pool.roots.values()].map(({ slab }) => slab.atlas.planes))];
      const bytes = source.ranges.reduce((sum, [begin, end]) => sum + end - begin, 0);
      file.close();
      return { pool, names, bytes, origin: stream.origin, channel: stream.channel.name };
    };
    const bare = await drawn({ channel: 'auto' });
    assert.deepEqual(bare.names, ['data 1']);
    // Numbers by a ramp, and normals, have no material.
    for (const [options, name] of [
      [{ channel: 'auto', normals: true }, planes.normals], [{ channel: 'auto', materials: true }, planes.materials],
      [{ channel: 'auto', normals: true, materials: true }, planes.all], [{ channel: 'normal', normals: true, materials: true }, planes.normals],
      [{ channel: 'roughness', materials: true }, 'data 1'],
    ]) {
      const { names } = await drawn(options);
      assert.deepEqual(names, [name], JSON.stringify(options));
    }
    const { pool, bytes, origin, channel } = await drawn({ channel: 'auto', normals: true, materials: true });
    assert.ok(bytes > 1.5 * bare.bytes, `${bytes} and ${bare.bytes} bytes`);
    assert.equal(channel, 'colour');
    const [angles, wrong] = [[], []];
    for (const { slab, tile, firstVertex, vertexCount } of pool.roots.values()) {
      const image = slab.atlas.read(tile);
      for (let vertex = firstVertex; vertex < firstVertex + vertexCount; vertex += 1) {
        const [x, y] = [slab.places[2 * vertex] - tile.x, slab.places[2 * vertex + 1] - tile.y].map(Math.floor);
        const texel = (plane) => [...image[plane].subarray(4 * (y * image.width + x), 4 * (y * image.width + x) + 4)];
        const point = [0, 1, 2].map((axis) => slab.positions[3 * vertex + axis] + origin[axis]);
        const normal = texel('normals').slice(0, 3).map((byte) => byte / 127.5 - 1);
        const outwards = outwardsOfTorus(point);
        angles.push((180 / Math.PI) * Math.acos(Math.min(normal.reduce((sum, n, axis) => sum + n * outwards[axis], 0) / Math.hypot(...normal), 1)));
        if (Math.abs(point[1]) < 0.1) continue;
        const [material, emissive] = point[1] > 0 ? [[255, 51, 255, 255], [0, 0, 0, 255]] : [[255, 230, 0, 255], [0, 77, 0, 255]];
        const off = [...texel('material').map((n, k) => n - material[k]), ...texel('emissive').map((n, k) => n - emissive[k])];
        wrong.push(Math.max(...off.map(Math.abs)));
      }
    }
    assert.ok(rootMeanSquare(angles) < 3, `normals are ${rootMeanSquare(angles)} degrees off`);
    assert.ok(Math.max(...wrong) < 12, `materials are off by ${Math.max(...wrong)} of 255`);
  });

  test('without colours normals are shown, if light is wanted', async () => {
    const file = await open(await lit());
    file.channels.forEach((channel) => { if (channel.kind === 'colour') channel.kind = 'unknown'; });
    const shown = async (options) => (await file.stream({ channel: 'auto', ...options })).channel?.name;
    assert.deepEqual([await shown({ normals: true }), await shown({})], ['normal', undefined]);
    file.close();
  });

  test('what makes no sense is refused with words', async () => {
    const file = await open(await painted());
    const cut = await file.selectLevel(0);
    const wrong = { name: 'LodpackError', kind: 'query' };
    await assert.rejects(file.extract(cut, { channels: ['color'] }), { ...wrong, message: 'the file has no channel color; it has colour, height' });
    await assert.rejects(file.extract(cut, { channels: 'auto', pageSize: 0 }), wrong);
    await assert.rejects(file.stream({ channel: 'x' }), wrong);
    const stream = await file.stream({ channel: 'height', range: [0, 1] });
    assert.deepEqual(stream.range, [0, 1]);
    await assert.rejects(stream.show('height', { range: [2, 1] }), { ...wrong, message: /lower and a higher/ });
    const other = await open(await bare());
    await assert.rejects(other.extract(await other.selectLevel(0), { channels: ['x'] }), { ...wrong, message: /it has none/ });
    assert.ok(!('uvs' in (await other.extract(await other.selectLevel(0), { channels: 'auto' }))));
  });

  test('damaged texels give errors or surfaces, and never stop the reader', async () => {
    const bytes = await painted();
    const [begin, end] = texelsOf(bytes);
    let failures = 0;
    for (let trial = 0; trial < 12; trial += 1) {
      const changed = Uint8Array.from(bytes);
      changed[begin + Math.floor(((trial + 0.5) / 12) * (end - begin))] ^= 0xff;
      const file = await open(changed, { cache: new SharedPromiseCache() });
      const cut = await file.selectLevel(file.levels.length - 1);
      assert.ok((await file.extract(cut)).triangles.length > 0);
      await file.extract(cut, { channels: ['colour', 'height'] }).catch((error) => {
        assert.equal(error.kind, 'format', error.stack);
        failures += 1;
      });
      const stream = await file.stream({ channel: 'auto' });
      const [pool, problems] = [new Pool({ images: true }), []];
      for (let k = 0; k < 400; k += 1) {
        const frame = await stream.frame({ view: viewOf(file.bounds, 3) });
        pool.update(frame);
        problems.push(...frame.problems);
        if (frame.isComplete) break;
        await new Promise((resolve) => setTimeout(resolve, 5));
      }
      assert.ok(pool.triangleCount > 100);
      assert.ok(problems.every((problem) => /damaged|texel|image|map/.test(problem)), problems.join('\n'));
      file.close();
    }
    assert.ok(failures > 3, `${failures} of 12`);
  });
});

/** What the first request reads anyway. */
const HEAD_BYTES = 8192;
/** The kind of the section. */
const TEXELS = 9;

/** Where the texels of a file lie: SPEC.md, chapter 5, says how sections are found. */
function texelsOf(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  for (let entry = 64; entry < 64 + 32 * view.getUint32(44, true); entry += 32) {
    const [offset, length] = [8, 16].map((at) => Number(view.getBigUint64(entry + at, true)));
    if (view.getUint32(entry, true) === TEXELS) return [offset, offset + length];
  }
  throw new Error('the file has no texels');
}

test('an atlas has room for what was given back, and none lie on each other', () => {
  const atlas = new Atlas(1024, { width: 10, height: 10, data: new Uint8Array(400) });
  const owner = new Map();
  const live = [];
  let seed = 7;
  const dice = (below) => (seed = (Math.imul(seed, 1103515245) + 12345) >>> 0) % below;
  let most = 0;
  for (let step = 0; step < 4000; step += 1) {
    if (live.length > 0 && dice(5) < 2) {
      const [tile] = live.splice(dice(live.length), 1);
      atlas.give(tile);
      continue;
    }
    const [width, height] = [1 + dice(120), 1 + dice(120)];
    const tile = atlas.take(width, height);
    if (!tile) {
      atlas.give(live.splice(dice(live.length), 1)[0]);
      continue;
    }
    assert.ok(tile.x + width <= atlas.width && tile.y + height <= atlas.height);
    const clash = live.find((other) => tile.x < other.x + other.width && other.x < tile.x + width && tile.y < other.y + other.height && other.y < tile.y + height);
    assert.equal(clash, undefined);
    const data = new Uint8Array(4 * width * height).fill(step % 251);
    atlas.write(tile, { width, height, data });
    owner.set(tile, step % 251);
    live.push(tile);
    most = Math.max(most, atlas.usedTexels);
  }
  for (const tile of live) assert.ok(atlas.read(tile).data.every((value) => value === owner.get(tile)));
  assert.ok(most > 0.55 * 1024 * 1024, `at most ${most} texels were in use`);
  live.forEach((tile) => atlas.give(tile));
  assert.equal(atlas.usedTexels, 0);
  assert.ok(atlas.take(1024, 1024));
});
