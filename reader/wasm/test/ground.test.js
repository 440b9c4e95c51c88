// A mesh on its ground: heights in the same file, and where they are.

import assert from 'node:assert/strict';
import { readFile } from 'node:fs/promises';
import { test } from 'node:test';
import { BytesSource, Pool, SharedBudget, SharedPromiseCache, open } from '../js/index.js';
import { settle, viewOf } from './picture.js';

const vectors = new URL('../../../format-spec/vectors/', import.meta.url);
const vector = (name) => readFile(new URL(`${name}.lodpack`, vectors));
// The vector's mesh has y up, a unit of a quarter of a metre, and this origin; its ground says nothing of its place.
const [UNIT, ORIGIN] = [0.25, [16, -4, 0.5]];
const placed = (point) => {
  const [x, y, z] = point.map((value, axis) => (value - ORIGIN[axis]) / UNIT);
  return [x, z, -y];
};
// A budget and what three surfaces took, negative where they lacked triangles; and the limits before it. The reader's
// test has the same.
const RUN = [
  [1000, -330, -200, 300], [1000, -500, -250, 240], [1000, -600, -150, 200], [1000, 300, 400, 200], [1000, 100, 50, 0],
  [400, 300, 200, 100], [400, 200, -150, 20], [400, 150, -230, 18], [400, 150, 200, 18],
];
const SHARED = [
  [0.5, 333, 333, 334], [0.525, 432, 261, 307], [0.578813, 506, 253, 241], [0.70355, 639, 159, 202], [0.677689, 333, 444, 223], [0.5, 254,
  127, 19], [0.5, 200, 133, 67], [0.525, 202, 177, 21], [0.578813, 150, 231, 19],
];
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

test('a mesh, its ground and another mesh keep one budget of triangles', async () => {
  const file = await open(await vector('ground'));
  const files = [file, await file.ground(), await open(await vector('ground'))];
  const streams = await Promise.all(files.map((file) => file.stream()));
  const view = { ...viewOf(file.bounds, 3), up: [0, 1, 0] };
  const views = [view, files[1].frame.view(view), view];
  const ask = (limits) => Promise.all(streams.map((stream, k) => stream.frame(
    { view: { ...views[k], pixelTolerance: limits.pixelTolerance }, maxTriangles: limits.maxTriangles[k] },
  )));
  const sum = (frames) => frames.reduce((all, { wantedTriangleCount }) => all + wantedTriangleCount, 0);
  const all = { maxTriangles: [1e9, 1e9, 1e9] };
  let [coarsest, finest] = [0, 0];
  for (let k = 0; k < 30; k += 1) {
    coarsest = sum(await ask({ ...all, pixelTolerance: 1e9 }));
    finest = sum(await ask({ ...all, pixelTolerance: 1e-6 }));
    await new Promise((resolve) => { setTimeout(resolve, 10); });
  }
  assert.ok(finest > 2 * coarsest && coarsest > 0, `${coarsest} ${finest}`);
  const budget = new SharedBudget();
  const whole = Math.floor((coarsest + finest) / 2);
  let frames;
  for (let k = 0; k < 40; k += 1) {
    const limits = budget.limits(whole, 1e-6, 3);
    assert.equal(limits.maxTriangles.reduce((a, b) => a + b), whole);
    frames = await ask(limits);
    assert.ok(sum(frames) <= whole + coarsest);
    budget.record(frames);
  }
  assert.ok(sum(frames) <= whole && sum(frames) > whole / 2, `${sum(frames)} of ${whole}`);
  assert.equal(frames[0].wantedTriangleCount, frames[2].wantedTriangleCount);
  files.forEach((file) => file.close());
});

test('budgets are shared out as the reader shares them', () => {
  const budget = new SharedBudget();
  const steps = RUN.map(([most, ...taken]) => {
    const { pixelTolerance, maxTriangles } = budget.limits(most, 0.5, 3);
    budget.record(taken.map((triangles) => ({ wantedTriangleCount: Math.abs(triangles), limitedBy: triangles < 0 ? 'triangles' : 'tolerance' })));
    return [Number(pixelTolerance.toFixed(6)), ...maxTriangles];
  });
  assert.deepEqual(steps, SHARED);
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
