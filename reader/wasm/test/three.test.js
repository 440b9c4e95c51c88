// LodpackMesh in Chromium, with WebGL 2 and with WebGPU.

import assert from 'node:assert/strict';
import { readFile } from 'node:fs/promises';
import { describe, test } from 'node:test';
import { launch, mounts, newPage } from './browser.js';
import { serve } from './server.js';
import { checkStrips } from './strips.js';

const skip = !process.env.LODPACK_REFERENCE && 'cargo test -p lodpack-cli runs it';
const SCAN = '/files/valid-scan.lodpack';
const PAINTED = '/files/valid-painted.lodpack';
const DRAWN = '/files/valid-drawn.lodpack';
const LIT = '/files/valid-lit.lodpack';
const TOWN = '/files/valid-town.lodpack';
const TERRAIN = '/files/heights-flat.lodpack';

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
        // Of those that are drawn all have a length; the file stores none.
        const isSmooth = !mesh.material.flatShading && mesh.children.every(({ geometry }) => {
          const { array, itemSize, normalized } = geometry.getAttribute('normal');
          const length = (vertex) => Math.hypot(...array.subarray(itemSize * vertex, itemSize * vertex + 3)) / 32767;
          const drawn = geometry.index.array.subarray(3, geometry.drawRange.count).filter((vertex, k, all) => all[k - (k % 3)] !== all[k - (k % 3) + 1]);
          return normalized && drawn.every((vertex) => Math.abs(length(vertex) - 1) < 1e-3);
        });
        const finest = await mesh.file.select({ view: undefined });
        const children = mesh.children.length;
        const triangles = mesh.triangleCount;
        const whole = edgesOfMesh(await mesh.file.extract(finest), mesh.children[0].position.toArray());
        const drawn = countEdges(full);
        mesh.dispose();
        renderer.render(scene, camera);
        return { hits, drawn, whole, isSmooth, children, triangles, geometries: renderer.info.memory.geometries, isGone: !scene.children.includes(mesh), all: finest.triangleCount };
      });
      assert.equal(result.hits.length, 1);
      const [hit] = result.hits;
      assert.ok(hit.isMesh && hit.distance > 0 && hit.error > 0 && hit.root >= 0, JSON.stringify(hit));
      assert.ok(result.triangles > 0 && result.children > 0);
      if (result.triangles === result.all) assert.deepEqual(result.drawn, result.whole);
      assert.equal(result.geometries, 0);
      assert.ok(result.isGone && result.isSmooth);
    });
  });

  test('a clone streams by itself, with its own children and place', async () => {
    await visit(`/lodpack/examples/three.html?url=${SCAN}`, {}, async (page) => {
      await page.waitForFunction(() => globalThis.mesh?.frame?.isComplete);
      const result = await page.evaluate(async () => {
        const { mesh, camera, scene, renderer } = globalThis;
        const { Group, Object3D } = await import('three');
        const label = new Object3D();
        label.name = 'label';
        mesh.add(label);
        Object.assign(mesh, { name: 'scan', pixelTolerance: 2, onchange: () => {} });
        const group = new Group();
        group.add(mesh);
        const copy = group.clone().children[0];
        const [labels, count] = [copy.children.filter(({ name }) => name === 'label').length, copy.children.length];
        const bare = mesh.clone(false);
        const bareLabels = bare.children.filter(({ name }) => name === 'label').length;
        bare.dispose();
        const same = copy.isLodpackMesh && copy.name === 'scan' && copy.pixelTolerance === 2 && copy.material === mesh.material && copy.onchange === mesh.onchange;
        copy.pixelTolerance = 0.25;
        const before = mesh.triangleCount;
        mesh.dispose();
        scene.add(copy);
        for (let k = 0; k < 400 && !(copy.frame?.isComplete && k > 5); k += 1) {
          renderer.render(scene, camera);
          await new Promise((resolve) => setTimeout(resolve, 20));
        }
        const drawn = copy.triangleCount;
        copy.dispose();
        renderer.render(scene, camera);
        let isClosed = false;
        await copy.file.select({}).catch(({ kind }) => { isClosed = kind === 'closed'; });
        return { labels, count, bareLabels, same, before, drawn, isClosed, geometries: renderer.info.memory.geometries };
      });
      assert.deepEqual([result.labels, result.count, result.bareLabels], [1, 2, 0]);
      assert.ok(result.same && result.isClosed && result.drawn > 0 && result.drawn >= result.before, JSON.stringify(result));
      assert.equal(result.geometries, 0);
    });
  });

  test('streams heights', async () => {
    await visit(`/lodpack/examples/three.html?url=${TERRAIN}`, {}, async (page) => {
      await page.waitForFunction(() => globalThis.mesh?.frame?.isComplete);
      const result = await page.evaluate(async () => {
        const { mesh, camera, scene } = globalThis;
        const { Raycaster, Vector2 } = await import('three');
        const raycaster = new Raycaster();
        raycaster.setFromCamera(new Vector2(0, 0), camera);
        const [hit] = raycaster.intersectObject(scene, true);
        // Normals of samples light it, in the directions of the file.
        // But for the triangle without area that stands for all of it at first.
        const drawn = mesh.children.filter(({ geometry }) => geometry.drawRange.count > 3);
        const areShaded = drawn.length > 0 && drawn.every(({ material }) => material.normalMap?.image.data instanceof Uint16Array && material.normalMapType === 1 && !material.map);
        return { areShaded, kind: mesh.file.kind, triangles: mesh.triangleCount, error: hit?.error, level: hit?.level };
      });
      assert.equal(result.kind, 'heights');
      assert.ok(result.areShaded);
      assert.ok(result.triangles > 100 && result.error >= 0 && result.level >= 0, JSON.stringify(result));
    });
  });

  test('a mesh stands on its ground', async () => {
    await visit(`/lodpack/examples/three.html?url=${TOWN}`, {}, async (page) => {
      await page.waitForFunction(() => globalThis.mesh?.frame?.isComplete && globalThis.mesh.ground?.frame?.isComplete);
      const result = await page.evaluate(async () => {
        const { mesh, camera, scene, renderer } = globalThis;
        const { Raycaster, Vector2 } = await import('three');
        const raycaster = new Raycaster();
        const seen = { mesh: 0, ground: 0 };
        const heights = [];
        for (let y = -0.9; y < 1; y += 0.1) {
          for (let x = -0.9; x < 1; x += 0.1) {
            raycaster.setFromCamera(new Vector2(x, y), camera);
            const [hit] = raycaster.intersectObject(scene, true);
            if (!hit) continue;
            seen[hit.object === mesh ? 'mesh' : hit.object === mesh.ground ? 'ground' : 'other'] += 1;
            if (hit.object === mesh.ground) heights.push(hit.point.y);
          }
        }
        const box = mesh.boundingBox.clone();
        const triangles = [mesh.triangleCount, mesh.ground.triangleCount];
        const isColoured = mesh.ground.children.some(({ material }) => material.map);
        mesh.dispose();
        renderer.render(scene, camera);
        return { seen, heights, triangles, isColoured, size: box.max.toArray().map((most, axis) => most - box.min.getComponent(axis)), geometries: renderer.info.memory.geometries };
      });
      const text = JSON.stringify(result);
      assert.ok(result.seen.mesh > 5 && result.seen.ground > 5 && !result.seen.other, text);
      // In feet above an origin of 40 m.
      assert.ok(result.heights.every((height) => height > -4 / 0.3048 && height < 11 / 0.3048), text);
      assert.ok(result.triangles[0] > result.triangles[1] && result.triangles[1] > 50 && result.isColoured, text);
      assert.ok(result.size[0] > 130 / 0.3048 && result.size[2] > 130 / 0.3048 && result.size[1] < 50 / 0.3048, text);
      assert.equal(result.geometries, 0);
    });
  });

  test('masks are cut out at their cutoff, blended surfaces are scattered, and unlit ones take no light', async () => {
    await visit(`/lodpack/examples/three.html?url=${DRAWN}`, {}, async (page) => {
      await page.waitForFunction(() => globalThis.mesh?.frame?.isComplete);
      const strips = await page.evaluate(async () => {
        const { stripsOf } = await import('/lodpack/test/picture.js');
        const { Raycaster, Vector2 } = await import('three');
        const { mesh, camera, scene, renderer } = globalThis;
        camera.position.set(3, 0.5, 6);
        camera.lookAt(3, 0.5, 0);
        camera.updateMatrixWorld();
        renderer.setAnimationLoop(null);
        renderer.render(scene, camera);
        const gl = renderer.getContext();
        const [width, height] = renderer.getDrawingBufferSize(new Vector2()).toArray();
        const pixels = new Uint8Array(4 * width * height);
        gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
        const raycaster = new Raycaster();
        return stripsOf(pixels, { width, height }, (x, y) => {
          raycaster.setFromCamera(new Vector2((2 * x + 1) / width - 1, (2 * y + 1) / height - 1), camera);
          return raycaster.intersectObject(mesh)[0]?.point.x;
        });
      });
      checkStrips(strips);
    });
  });

  test('shows colours as they are in the file, numbers by a ramp, and gives textures back', async () => {
    await visit(`/lodpack/examples/three.html?url=${PAINTED}`, {}, async (page) => {
      await page.waitForFunction(() => globalThis.mesh?.frame?.isComplete);
      const result = await page.evaluate(async () => {
        const { mesh: lit, camera, scene, renderer } = globalThis;
        const { MeshPhongMaterial, NoColorSpace, Raycaster, Vector2 } = await import('three');
        const { LodpackMesh } = await import('lodpack/three');
        const { paintedColour } = await import('/lodpack/test/picture.js');
        const litName = lit.channel.name;
        const hasMaps = lit.children.every(({ material }) => material.isMeshStandardMaterial && material.map?.colorSpace !== NoColorSpace);
        // What a program changes at the material holds for what draws.
        lit.material.roughness = 0.25;
        renderer.render(scene, camera);
        const follows = lit.children.every(({ material }) => material.roughness === 0.25);
        const [before, slabs] = [renderer.info.memory.textures, lit.children.length];
        lit.dispose();
        renderer.render(scene, camera);
        const after = renderer.info.memory.textures;
        const mesh = await LodpackMesh.load(new URLSearchParams(location.search).get('url'), { lit: false });
        scene.add(mesh);
        const settled = async () => {
          for (let k = 0; k < 400; k += 1) {
            renderer.render(scene, camera);
            if (mesh.frame?.isComplete && k > 2) break;
            await new Promise((resolve) => setTimeout(resolve, 20));
          }
          await new Promise((resolve) => setTimeout(resolve, 50));
          renderer.render(scene, camera);
        };
        const gl = renderer.getContext();
        const [width, height] = renderer.getDrawingBufferSize(new Vector2()).toArray();
        const pixels = new Uint8Array(4 * width * height);
        /** Root mean square of differences to a colour of each point, and the share of pixels that are far off. */
        const errors = () => {
          renderer.render(scene, camera);
          gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
          const raycaster = new Raycaster();
          let [sum, far, count] = [0, 0, 0];
          for (let y = 2; y < height; y += 7) {
            for (let x = 2; x < width; x += 7) {
              raycaster.setFromCamera(new Vector2((2 * x + 1) / width - 1, (2 * y + 1) / height - 1), camera);
              const [hit] = raycaster.intersectObject(mesh);
              if (!hit) continue;
              const off = paintedColour(hit.point.toArray()).map((value, k) => value - pixels[4 * (y * width + x) + k]);
              sum += off.reduce((all, error) => all + error * error, 0) / 3;
              far += off.some((error) => Math.abs(error) > 40) ? 1 : 0;
              count += 1;
            }
          }
          return { error: Math.sqrt(sum / count), far: far / count, count };
        };
        await settled();
        const painted = errors();
        mesh.material = new MeshPhongMaterial({ flatShading: true });
        renderer.render(scene, camera);
        renderer.render(scene, camera);
        const isReplaced = mesh.children.every(({ material }) => material.isMeshPhongMaterial && material.map);
        await mesh.show('height', { range: [-5, 5] });
        await settled();
        const { texels, range, channel } = mesh;
        const used = mesh.children.length;
        mesh.dispose();
        renderer.render(scene, camera);
        const { textures, geometries } = renderer.info.memory;
        return { litName, hasMaps, follows, before, slabs, after, painted, isReplaced, texels, range, channel: channel.name, used, textures, geometries };
      });
      assert.equal(result.litName, 'colour');
      assert.ok(result.hasMaps && result.follows && result.isReplaced, JSON.stringify(result));
      assert.ok(result.painted.count > 100 && result.painted.error < 12 && result.painted.far < 0.02, JSON.stringify(result.painted));
      assert.ok(result.texels.used > 1000 && result.texels.used <= result.texels.allocated);
      assert.deepEqual([result.range, result.channel], [[-5, 5], 'height']);
      // three.js keeps a texture of its own for its lights.
      assert.deepEqual([result.before - result.slabs, result.textures, result.geometries], [result.after, result.after, 0]);
      assert.ok(result.after <= 1);
    });
  });

  test('materials have the normals and maps of the file, as far as they take them', async () => {
    await visit(`/lodpack/examples/three.html?url=${LIT}`, {}, async (page) => {
      await page.waitForFunction(() => globalThis.mesh?.frame?.isComplete);
      const result = await page.evaluate(async () => {
        const { mesh, camera, scene, renderer } = globalThis;
        const { MeshBasicMaterial, MeshPhongMaterial, ObjectSpaceNormalMap } = await import('three');
        const settled = async () => {
          for (let k = 0; k < 400 && !(mesh.frame.isComplete && k > 5); k += 1) {
            renderer.render(scene, camera);
            await new Promise((resolve) => setTimeout(resolve, 20));
          }
          renderer.render(scene, camera);
        };
        /** What draws the roots: not the triangle without area that stands for all of them at first. */
        const maps = () => {
          const { material } = mesh.children.reduce((a, b) => (a.geometry.drawRange.count > b.geometry.drawRange.count ? a : b));
          return ['map', 'normalMap', 'roughnessMap', 'metalnessMap', 'aoMap', 'emissiveMap'].filter((name) => material[name]);
        };
        await settled();
        const standard = maps();
        const { material } = mesh.children.at(-1);
        const factors = [material.normalMapType === ObjectSpaceNormalMap, material.metalness, material.roughness, material.emissive.getHex(), mesh.material.emissive.getHex()];
        mesh.material = new MeshPhongMaterial({ flatShading: true });
        await settled();
        const phong = maps();
        mesh.material = new MeshBasicMaterial();
        await settled();
        const basic = maps();
        mesh.material = new MeshPhongMaterial({ flatShading: true });
        await mesh.show('normal');
        await settled();
        const directions = maps();
        mesh.dispose();
        renderer.render(scene, camera);
        return { standard, factors, phong, basic, directions, textures: renderer.info.memory.textures };
      });
      assert.deepEqual(result.standard, ['map', 'normalMap', 'roughnessMap', 'metalnessMap', 'aoMap', 'emissiveMap']);
      assert.deepEqual(result.factors, [true, 1, 1, 0xffffff, 0]);
      assert.deepEqual(result.phong, ['map', 'normalMap', 'emissiveMap']);
      assert.deepEqual(result.basic, ['map']);
      assert.deepEqual(result.directions, ['normalMap']);
      assert.ok(result.textures <= 1);
    });
  });

  test('draws colours with WebGPURenderer', async () => {
    await visit(`/lodpack/test/webgpu.html?url=${PAINTED}`, { hasWebGpu: true }, async (page) => {
      await page.waitForFunction(() => globalThis.test?.mesh.frame?.isComplete);
      const frames = await page.evaluate(() => globalThis.test.frames);
      await page.waitForFunction((count) => globalThis.test.frames > count + 2, frames);
      const { texels, saturation } = await page.evaluate(async () => {
        const { renderer, mesh } = globalThis.test;
        const canvas = document.createElement('canvas');
        [canvas.width, canvas.height] = [320, 240];
        const context = canvas.getContext('2d');
        await new Promise(requestAnimationFrame);
        context.drawImage(renderer.domElement, 0, 0);
        const { data } = context.getImageData(130, 90, 60, 60);
        let most = 0;
        for (let k = 0; k < data.length; k += 4) most = Math.max(most, Math.max(...data.subarray(k, k + 3)) - Math.min(...data.subarray(k, k + 3)));
        return { texels: mesh.texels, saturation: most };
      });
      assert.ok(texels.used > 1000, JSON.stringify(texels));
      assert.ok(saturation > 60, `the most colourful pixel has ${saturation} of 255`);
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
