// The page and the native viewer show the same colours. viewer-min/tests/tests/channels.rs draws the pictures.

import assert from 'node:assert/strict';
import { describe, test } from 'node:test';
import { launch, mounts, newPage } from './browser.js';
import { serve } from './server.js';

const folder = process.env.LODPACK_PICTURES;
const skip = !folder && 'cargo test -p lodpack-view runs it';
const SIDE = 300;
const CAMERA = '1.2,1.1,2.9:0,0,0:0,1,0';

describe('beside the native viewer', { skip }, () => {
  for (const [name, settings] of [['lit', ''], ['unlit', '&unlit=1'], ['height', '&channel=height&unlit=1'], ['band', '&channel=height&range=15:25']]) {
    test(`the picture ${name}`, async () => {
      const [browser, server, errors] = [await launch(), await serve({ ...mounts, '/pictures/': folder }), []];
      try {
        const page = await newPage(browser, errors, { viewport: { width: SIDE, height: SIDE } });
        await page.goto(`${server.url}/?url=/pictures/coloured.lodpack#camera=${CAMERA}${settings}`);
        await page.waitForFunction(() => globalThis.lodpackViewer?.last?.isComplete && globalThis.lodpackViewer.shown.stream.channel);
        await page.waitForTimeout(300);
        await page.waitForFunction(() => globalThis.lodpackViewer.last.isComplete);
        const { psnr, count } = await page.evaluate(async ([address, isUnlit]) => {
          const { renderer, shown, camera } = globalThis.lodpackViewer;
          const { gl, canvas: { width, height } } = renderer;
          const bitmap = await createImageBitmap(await (await fetch(address)).blob());
          const canvas = new OffscreenCanvas(width, height);
          const context = canvas.getContext('2d');
          context.drawImage(bitmap, 0, 0);
          const { data: native } = context.getImageData(0, 0, width, height);
          renderer.draw(shown.surfaces.map((surface) => ({ ...surface.drawn(camera), image: 'colours' })), { colour: 'shading', tolerance: 1, wireframe: false, isUnlit });
          const own = new Uint8Array(4 * width * height);
          gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, own);
          const isSurface = (pixels, at) => Math.abs(pixels[at] - 232) + Math.abs(pixels[at + 1] - 236) + Math.abs(pixels[at + 2] - 244) > 6;
          let [sum, count] = [0, 0];
          for (let y = 0; y < height; y += 1) {
            for (let x = 0; x < width; x += 1) {
              // WebGL counts rows from below.
              const [a, b] = [4 * ((height - 1 - y) * width + x), 4 * (y * width + x)];
              if (!isSurface(own, a) || !isSurface(native, b)) continue;
              for (let k = 0; k < 3; k += 1) sum += (own[a + k] - native[b + k]) ** 2;
              count += 1;
            }
          }
          return { psnr: 10 * Math.log10(255 ** 2 / (sum / (3 * count))), count };
        }, [`/pictures/${name}.png`, settings.includes('unlit')]);
        console.log(`${name}: ${psnr.toFixed(1)} dB over ${count} pixels`);
        // Edges differ: the page has several samples for each of their pixels.
        assert.ok(count > 10_000 && psnr > 30, `${psnr} dB over ${count} pixels`);
        assert.deepEqual(errors, []);
      } finally {
        await browser.close();
        await server.close();
      }
    });
  }
});
