// LodpackMesh in Chromium, with WebGL 2 and with WebGPU.

import assert from 'node:assert/strict';
import { readFile } from 'node:fs/promises';
import { describe, test } from 'node:test';
import { launch, mounts, newPage } from './browser.js';
import { serve } from './server.js';

const skip = !process.env.LODPACK_REFERENCE && 'cargo test --release -p lodpack-cli runs it';
const SCAN = '/files/valid-scan.lodpack';

async function visit(address, options, action) {
  const [browser, server, errors] = [await launch(options), await serve(mounts), []];
  try {
    const page = await newPage(browser, errors, { viewport: { width: 320, height: 240 } });
    await page.goto(server.url + address);
    await action(page);
    assert.deepEqual(errors, []);
  } finally {
    await browser.close();
    await server.close();
  }
}

describe('LodpackMesh', { skip }, () => {
  test('the example has at most 40 lines, streams, picks, has no cracks, and gives everything back', async () => {
    assert.ok((await readFile(new URL('../examples/three.html', import.meta.url), 'utf8')).split('\n').length <= 41);
    await visit(`/lodpack/examples/three.html?url=${SCAN}`, {}, async (page) => {
      await page.waitForFunction(() => globalThis.mesh?.frame?.isComplete);
      const result = await page.evaluate(async () => {
        const { mesh, camera, scene, renderer } = globalThis;
        const { Raycaster, Vector2 } = await import('three');
        const { countEdges, edgesOfMesh } = await import('/lodpack/test/picture.js');
        const raycaster = new Raycaster();
        raycaster.setFromCamera(new Vector2(0, 0), camera);
        const hits = raycaster.intersectObject(scene, true).map(({ distance, root, level, error, object }) => ({ distance, root, level, error, isMesh: object === mesh }));
        const parts = mesh.children.map(({ geometry }) => ({
          positions: geometry.getAttribute('position').array, indices: geometry.index.array.subarray(0, geometry.drawRange.count),
        }));
        // Triangles that draw nothing.
        const full = parts.map(({ positions, indices }) => ({ positions, indices: indices.filter((_, k) => indices[k - (k % 3)] !== indices[k - (k % 3) + 1]) }));
        const finest = await mesh.file.select({ view: undefined });
        const children = mesh.children.length;
        const triangles = mesh.triangleCount;
        const whole = edgesOfMesh(await mesh.file.extract(finest), mesh.children[0].position.toArray());
        const drawn = countEdges(full);
        mesh.dispose();
        renderer.render(scene, camera);
        return { hits, drawn, whole, children, triangles, geometries: renderer.info.memory.geometries, isGone: !scene.children.includes(mesh), all: finest.triangleCount };
      });
      assert.equal(result.hits.length, 1);
      const [hit] = result.hits;
      assert.ok(hit.isMesh && hit.distance > 0 && hit.error > 0 && hit.root >= 0, JSON.stringify(hit));
      assert.ok(result.triangles > 0 && result.children > 0);
      if (result.triangles === result.all) assert.deepEqual(result.drawn, result.whole);
      assert.equal(result.geometries, 0);
      assert.ok(result.isGone);
    });
  });

  test('draws with WebGPURenderer', async () => {
    await visit(`/lodpack/test/webgpu.html?url=${SCAN}`, { hasWebGpu: true }, async (page) => {
      await page.waitForFunction(() => globalThis.test?.mesh.frame?.isComplete);
      const frames = await page.evaluate(() => globalThis.test.frames);
      await page.waitForFunction((count) => globalThis.test.frames > count + 2, frames);
      const { isWebGpu, triangles, drawn } = await page.evaluate(() => {
        const { renderer, mesh } = globalThis.test;
        return { isWebGpu: renderer.backend.isWebGPUBackend === true, triangles: mesh.triangleCount, drawn: renderer.info.render.triangles };
      });
      assert.ok(isWebGpu, 'three.js fell back to WebGL');
      assert.ok(drawn >= triangles && triangles > 100);
    });
  });
});
