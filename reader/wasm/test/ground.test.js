// A mesh on its ground: heights in the same file, and where they are.

import assert from 'node:assert/strict';
import { readFile } from 'node:fs/promises';
import { test } from 'node:test';
import { BytesSource, Pool, SharedPromiseCache, open } from '../js/index.js';
import { settle, viewOf } from './picture.js';

const vectors = new URL('../../../format-spec/vectors/', import.meta.url);
const vector = (name) => readFile(new URL(`${name}.lodpack`, vectors));
// The vector's mesh has y up, a unit of a quarter of a metre, and this origin; its ground says nothing of its place.
const [UNIT, ORIGIN] = [0.25, [16, -4, 0.5]];
const placed = (point) => {
  const [x, y, z] = point.map((value, axis) => (value - ORIGIN[axis]) / UNIT);
  return [x, z, -y];
};
const isNear = (a, b) => a.forEach((value, k) => assert.ok(Math.abs(value - b[k]) < 1e-9, `${a} is not ${b}`));

test('a ground is an open file of heights with a frame', async () => {
  const file = await open(await vector('ground'));
  const ground = await file.ground();
  assert.deepEqual([file.kind, ground.kind], ['mesh', 'heights']);
  const { frame, bounds } = ground;
  assert.equal(frame.scale, 1 / UNIT);
  for (const point of [bounds.min, bounds.max, [1, 2, 3]]) {
    isNear(frame.point(point), placed(point));
    isNear(frame.pointOfGround(placed(point)), point);
  }
  isNear(frame.offsetOfGround([0, 1, 0]), [0, 0, UNIT]);
  const mesh = await ground.extract(await ground.select({}));
  assert.ok(mesh.triangles.length > 0);
  // What is read of the ground is read of the file; it stays when that is closed.
  assert.ok(file.traffic.bytes >= ground.traffic.bytes && ground.traffic.bytes > 0);
  file.close();
  assert.ok((await ground.extract(await ground.select({ tolerance: 1e9 }))).triangles.length > 0);
  ground.close();
});

test('a file without a ground has none, and neither have heights', async () => {
  for (const name of ['tree', 'heights/hills']) {
    const file = await open(await vector(name));
    assert.equal(await file.ground(), null);
    file.close();
  }
});

test('a view of the mesh shows the ground in the same pixels and at the same depths', async () => {
  const file = await open(await vector('ground'));
  const ground = await file.ground();
  const view = { ...viewOf({ min: [0, 0, 0], max: [300, 60, 10] }, 3), up: [0, 1, 0] };
  const below = ground.frame.view(view);
  assert.deepEqual([below.viewport, below.pixelTolerance], [view.viewport, view.pixelTolerance]);
  const seen = ({ position, forward, up, near }, point) => {
    const dot = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);
    const unit = (a) => a.map((x) => x / Math.hypot(...a));
    const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    const [ahead, right] = [unit(forward), unit(cross(forward, up))];
    const offset = point.map((x, k) => x - position[k]);
    return [right, cross(right, ahead), ahead].map((axis) => dot(axis, offset) / near);
  };
  const point = [30, 40, 12];
  isNear(seen(below, point), seen(view, placed(point)));
  const [stream, pool] = [await ground.stream(), new Pool({ images: true })];
  await settle(stream, pool, { view: below });
  assert.ok(pool.triangleCount > 0);
  ground.close();
  file.close();
});

test('a ground shares the requests of its file', async () => {
  const bytes = await vector('ground');
  const asked = [];
  const inner = new BytesSource(bytes);
  const source = { getBytes: (offset, length) => { asked.push([offset, length]); return inner.getBytes(offset, length); }, getKey: () => 'town' };
  const file = await open(source, { cache: new SharedPromiseCache(), firstReadBytes: 600 });
  const before = asked.length;
  const ground = await file.ground();
  await ground.extract(await ground.select({}));
  assert.ok(asked.length > before && asked.every(([offset, length]) => offset + length <= Math.max(bytes.length, 600)));
  ground.close();
  file.close();
});

test('grounds that are none are refused with words', async () => {
  for (const [name, message] of [['ground_on_a_globe', /globe/], ['ground_of_a_mesh', /no file of heights/], ['ground_elsewhere', /another coordinate reference system/], ['ground_short', /damaged/]]) {
    const refused = async () => {
      const file = await open(await vector(`invalid/${name}`));
      const ground = await file.ground().finally(() => file.close());
      ground?.close();
    };
    await assert.rejects(refused(), { kind: 'format', message }, name);
  }
});
