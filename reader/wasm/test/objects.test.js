// Objects in JavaScript: found, picked, hidden and shown alone; in three.js and in the viewer page.

import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { describe, test } from 'node:test';
import { CoreStream } from '../js/core-stream.js';
import { BytesSource, Pool, open } from '../js/index.js';
import { objectsOf } from '../js/objects.js';
import { launch, mounts, newPage } from './browser.js';
import { serve } from './server.js';

const skip = !process.env.LODPACK_REFERENCE && 'cargo test -p lodpack-cli runs it';
const vector = (name) => new BytesSource(readFileSync(new URL(`../../../format-spec/vectors/${name}.lodpack`, import.meta.url)));

/** A file with its objects, and all of its nodes. */
async function opened(name) {
  const file = await open(vector(name), { worker: false });
  const objects = await objectsOf(file);
  return { file, objects, nodes: await objects.nodes(Array.from({ length: objects.nodeCount }, (_, number) => number)) };
}

/** Triangles as texts, in an order of their own. */
function triangles({ positions, triangles }, origin = [0, 0, 0], by = (x) => Math.fround(x)) {
  const point = (vertex) => [0, 1, 2].map((k) => by(positions[3 * vertex + k] - origin[k])).join();
  const all = [];
  for (let k = 0; k < triangles.length; k += 3) {
    const [a, b, c] = triangles.subarray(k, k + 3);
    if (a !== b) all.push([[a, b, c], [b, c, a], [c, a, b]].map((corners) => corners.map(point).join(' ')).sort()[0]);
  }
  return all.sort();
}

/** What a stream draws once everything is there. */
async function drawn(stream, query = {}) {
  const pool = new Pool();
  await stream.lose();
  for (let frame; !frame?.isComplete;) {
    frame = await stream.frame(query);
    pool.update(frame);
    await new Promise((resolve) => setTimeout(resolve, 5));
  }
  return pool.slabs.flatMap((slab) => triangles({ positions: slab.positions, triangles: slab.indices }, undefined, (x) => x)).sort();
}

describe('objects', { skip }, () => {
  test('nodes are found by name and id, and below their parents page by page', async () => {
    const { file, objects, nodes } = await opened('objects');
    assert.equal(nodes.filter(({ isObject }) => isObject).length, objects.count);
    assert.ok(objects.count > 10 && objects.nodeCount > objects.count);
    for (const node of nodes.filter((_, k) => k % 7 === 0)) {
      assert.deepEqual(await objects.node(node.number), node);
      const numbers = (is) => nodes.filter(is).map(({ number }) => number);
      if (node.name !== null) assert.deepEqual(await objects.find(node.name), numbers(({ name }) => name === node.name));
      else if (node.id !== null && !nodes.some(({ name }) => name === node.id)) assert.deepEqual(await objects.find(node.id), numbers(({ id }) => id === node.id));
      const path = [];
      for (let above = node.parent; above !== null; above = nodes[above].parent) path.unshift(nodes[above]);
      assert.deepEqual(await objects.above(node), path);
    }
    for (const parent of [null, ...nodes.filter((_, k) => k % 5 === 0)]) {
      const below = [];
      for await (const page of objects.children(parent)) below.push(...page);
      assert.deepEqual(below, nodes.filter((node) => node.parent === (parent?.number ?? null)));
    }
    assert.deepEqual(await objects.find('no such thing'), []);
    await assert.rejects(objects.node(objects.nodeCount), { kind: 'query' });
    await assert.rejects(objects.filter({ hide: [1] }), /has no hide/);
    await assert.rejects(objects.filter({ hidden: ['one'] }), /not of one/);
    file.close();
  });

  test('what is hidden, and what is left, are the whole; streams draw what is extracted', async () => {
    const { file, objects } = await opened('objects');
    const stream = await file.stream({ origin: [0, 0, 0] });
    const whole = triangles(await objects.extract({}));
    for (const some of [[0], [3, 5, objects.nodeCount - 1], Array.from({ length: objects.count >> 1 }, (_, k) => 2 * k)]) {
      const [hidden, only] = [await objects.filter({ hidden: some }), await objects.filter({ only: some })];
      const parts = [];
      for (const filter of [hidden, only]) {
        const mesh = triangles(await objects.extract({}, filter));
        parts.push(...mesh);
        await objects.show(stream, filter);
        assert.deepEqual(await drawn(stream), mesh);
        filter.close();
        // A stream keeps what it shows.
        assert.deepEqual(await drawn(stream), mesh);
      }
      assert.deepEqual(parts.sort(), whole);
      // What is marked alone is the same as what is shown alone.
      const marked = await objects.filter({ marked: some, onlyMarked: true });
      assert.deepEqual(triangles(await objects.extract({}, marked)), triangles(await objects.extract({}, await objects.filter({ only: some }))));
    }
    await objects.show(stream, null);
    assert.deepEqual(await drawn(stream), whole);
    const none = await objects.filter({ only: [] });
    assert.equal((await objects.extract({}, none)).triangles.length, 0);
    file.close();
  });

  test('a stream says what it shows once it has a session, and whoever asks may close it after that', async () => {
    const [calls, failed] = [[], []];
    const core = { call: (...call) => calls.push(call) };
    for (const [session, expected] of [[7, [['show_objects', 7, 1], ['show_objects', 7, 2]]], [undefined, []]]) {
      let begin;
      const begun = new Promise((resolve, reject) => { begin = () => (session ? resolve(session) : reject(new Error('no session'))); });
      const stream = new CoreStream(core, { notify: (number) => failed.push(number) }, 3, () => begun, null, {});
      const shown = ['show_objects', 'show_objects'].map((name, k) => Promise.resolve(stream.set(name, k + 1)).then(() => calls.push(['close', k + 1])));
      await new Promise((resolve) => { setTimeout(resolve, 5); });
      assert.deepEqual(calls, [], 'nothing is closed before it is shown');
      begin();
      await Promise.all(shown);
      assert.deepEqual(calls.splice(0).filter(([name]) => name !== 'close'), expected);
      assert.ok(failed.splice(0).includes(3));
    }
  });

  test('picks name an object, and go past those that are hidden', async () => {
    const { file, objects } = await opened('objects');
    const origin = file.bounds.max.map((x) => x + 1);
    let hits = 0;
    for (let number = 0; number < objects.count; number += 9) {
      const aim = await objects.bounds([number]);
      const ray = { origin, direction: aim.min.map((low, axis) => (low + aim.max[axis]) / 2 - origin[axis]) };
      const hit = await objects.pick(ray);
      if (!hit) continue;
      hits += 1;
      assert.ok(hit.isObject && hit.distance > 0 && hit.error >= 0);
      const box = await objects.bounds([hit]);
      hit.point.forEach((x, axis) => assert.ok(x >= box.min[axis] - 1e-9 && x <= box.max[axis] + 1e-9));
      const filter = await objects.filter({ hidden: [hit] });
      const next = await objects.pick(ray, filter);
      assert.ok(next === null || (next.number !== hit.number && next.distance >= hit.distance));
      filter.close();
    }
    assert.ok(hits > 5, `${hits}`);
    file.close();
  });

  test('files without objects have none', async () => {
    for (const name of ['torus', 'nothing', 'heights/cell']) {
      const file = await open(vector(name), { worker: false });
      assert.equal(await objectsOf(file), null);
      file.close();
    }
  });

  test('in the viewer page objects are listed, picked, hidden, shown alone and shown again', async () => {
    const [browser, server, errors] = [await launch(), await serve(mounts), []];
    try {
      const page = await newPage(browser, errors, { viewport: { width: 1000, height: 700 } });
      await page.goto(`${server.url}/?url=/vectors/objects.lodpack`);
      await page.waitForSelector('#objects:not([hidden]) li');
      const state = () => page.evaluate(() => {
        const { objects, shown } = globalThis.lodpackViewer;
        return { ...objects.choice, selected: objects.selected?.number ?? null, triangles: shown.pool.triangleCount, marked: objects.marked?.pool.triangleCount ?? 0 };
      });
      const until = (what, argument) => page.waitForFunction(what, argument);
      await until(() => globalThis.lodpackViewer.last?.isComplete && globalThis.lodpackViewer.shown.pool.triangleCount > 0);
      const before = await state();
      // Where an object is in the picture.
      const at = await page.evaluate(() => {
        const { camera, pick } = globalThis.lodpackViewer;
        for (let y = -0.9; y < 0.9; y += 0.05) {
          for (let x = -0.4; x < 0.9; x += 0.05) if (pick(x, y)) return [((x + 1) / 2) * innerWidth, ((1 - y) / 2) * innerHeight];
        }
        return camera && null;
      });
      await page.mouse.click(...at);
      await page.waitForSelector('#name:not([hidden])');
      await until(() => globalThis.lodpackViewer.objects.marked?.pool.triangleCount > 0);
      const picked = await state();
      assert.ok(picked.selected !== null && picked.marked > 0);
      await page.keyboard.press('h');
      await until((most) => globalThis.lodpackViewer.shown.pool.triangleCount !== most && !globalThis.lodpackViewer.objects.marked, picked.triangles);
      assert.deepEqual((await state()).hidden, [picked.selected]);
      await page.keyboard.press('j');
      await until(() => globalThis.lodpackViewer.objects.choice.hidden.length === 0);
      // What is asked for while names are still on their way is of what was asked for before.
      const quick = await page.evaluate(async () => {
        const { objects } = globalThis.lodpackViewer;
        const acts = [0, 1].flatMap((number) => [objects.select(number), objects.act('hide')]);
        await Promise.all([...acts, objects.select(2)]);
        const { hidden } = objects.choice;
        const selected = objects.selected.number;
        await objects.select(null);
        await objects.act('all');
        return { hidden, selected };
      });
      assert.deepEqual(quick, { hidden: [0, 1], selected: 2 });
      // Found by its name, and alone.
      const name = await page.evaluate(async (number) => {
        const { objects } = globalThis.lodpackViewer;
        await objects.select(number);
        const { name, id } = objects.selected;
        await objects.select(null);
        return name || id;
      }, picked.selected);
      if (name) {
        await page.fill('#objects input', name);
        await page.press('#objects input', 'Enter');
        await page.waitForSelector('#objects li.selected');
        assert.ok((await page.textContent('#name')).includes(name));
      } else {
        await page.evaluate((number) => globalThis.lodpackViewer.objects.select(number), picked.selected);
      }
      await page.click('#objects button[data-do=isolate]');
      await until((most) => globalThis.lodpackViewer.shown.pool.triangleCount < most, before.triangles);
      await page.click('#objects button[data-do=go]');
      await page.click('#objects button[data-do=all]');
      await until((most) => globalThis.lodpackViewer.objects.choice.only === null && globalThis.lodpackViewer.last.isComplete, 0);
      await page.keyboard.press('Escape');
      // The tree is read as it is opened.
      await page.fill('#objects input', '');
      await page.press('#objects input', 'Enter');
      await page.waitForFunction(() => document.querySelectorAll('#objects > ul > li').length > 0);
      await page.locator('#objects .toggle:not(.faint)').first().click();
      await page.waitForSelector('#objects ul ul li');
      assert.ok(await page.isHidden('#error'), await page.textContent('#error'));
      assert.deepEqual(errors, []);
    } finally {
      await browser.close();
      await server.close();
    }
  });

  test('the page of a file without objects lists none', async () => {
    const [browser, server, errors] = [await launch(), await serve(mounts), []];
    try {
      const page = await newPage(browser, errors);
      await page.goto(`${server.url}/?url=/vectors/torus.lodpack`);
      await page.waitForFunction(() => globalThis.lodpackViewer?.last?.isComplete);
      assert.ok(await page.isHidden('#objects'));
      await page.mouse.click(240, 180);
      await page.keyboard.press('h');
      await page.keyboard.press('i');
      assert.ok(await page.isHidden('#error') && await page.isHidden('#name'));
      assert.deepEqual(errors, []);
    } finally {
      await browser.close();
      await server.close();
    }
  });

  test('in three.js a mesh hides, isolates, highlights and picks', async () => {
    const [browser, server, errors] = [await launch(), await serve(mounts), []];
    try {
      const page = await newPage(browser, errors, { viewport: { width: 320, height: 240 } });
      await page.goto(`${server.url}/lodpack/examples/three.html?url=/vectors/objects.lodpack`);
      await page.waitForFunction(() => globalThis.mesh?.frame?.isComplete);
      const result = await page.evaluate(async () => {
        const { mesh, camera, scene, renderer } = globalThis;
        const { Raycaster, Vector2 } = await import('three');
        const { LodpackObjects } = await import('/lodpack/js/three-objects.js');
        const objects = await LodpackObjects.of(mesh);
        const settle = async () => {
          for (let k = 0; k < 40; k += 1) {
            renderer.render(scene, camera);
            await new Promise((resolve) => setTimeout(resolve, 25));
          }
        };
        await settle();
        const all = mesh.triangleCount;
        const raycaster = new Raycaster();
        let hit = null;
        for (let y = -0.9; y < 0.9 && !hit; y += 0.1) {
          for (let x = -0.9; x < 0.9 && !hit; x += 0.1) {
            raycaster.setFromCamera(new Vector2(x, y), camera);
            hit = await objects.pick(raycaster);
          }
        }
        const seen = raycaster.intersectObject(mesh)[0];
        await objects.show({ hidden: [hit.number] });
        await settle();
        const hidden = mesh.triangleCount;
        const next = await objects.pick(raycaster);
        await objects.show({ hidden: [], only: [hit.number], marked: [hit.number] });
        await settle();
        const alone = mesh.triangleCount;
        const overlay = mesh.children.find((child) => child.isLodpackMesh);
        const marked = overlay?.triangleCount;
        await objects.show({ only: null, marked: [] });
        await settle();
        const again = mesh.triangleCount;
        objects.dispose();
        mesh.dispose();
        renderer.render(scene, camera);
        return { hit: { ...hit, point: hit.point.toArray() }, seen: seen?.distance, all, hidden, alone, marked, again, next: next?.number ?? null, isGone: mesh.children.every((child) => !child.isLodpackMesh), geometries: renderer.info.memory.geometries };
      });
      const { hit } = result;
      assert.ok(hit.isObject && Array.isArray(hit.path) && hit.distance > 0 && hit.error >= 0, JSON.stringify(hit));
      assert.notEqual(result.next, hit.number);
      assert.ok(result.alone > 0 && result.alone < result.all && result.alone === result.marked, JSON.stringify(result));
      assert.notEqual(result.hidden, result.all);
      assert.equal(result.again, result.all);
      assert.ok(result.isGone);
      assert.equal(result.geometries, 0);
      assert.deepEqual(errors, []);
    } finally {
      await browser.close();
      await server.close();
    }
  });
});
