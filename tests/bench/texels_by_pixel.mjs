// What a textured file takes in the reader of browsers: the opening view, and a flight.
//
//     node tests/bench/texels_by_pixel.mjs FILE.lodpack [FILE ...]
//
// A window of 1,280 x 800 at 1 pixel of error, from 2 radii away, where a read takes 30 ms. Per file: bytes that were
// read until every root in it shows an image of its own, and until the picture is complete; texels of the images of
// all drawn roots then, for each pixel of the window; those that whole images would have. Then 240 frames of a flight
// from there to the surface and around it: the most bytes of images in any frame, of the stream's texelCache, and the
// memory of the reader. Needs reader/wasm/build to have run.

import { readFile } from 'node:fs/promises';
import { BytesSource, open } from '../../reader/wasm/js/index.js';

const WINDOW = [1280, 800];
const FRAMES = 240;

/** A file from afar: each read takes 30 ms. */
class Far {
  constructor(bytes) { this.inner = new BytesSource(bytes); }

  async getBytes(offset, length) {
    await new Promise((resolve) => setTimeout(resolve, 30));
    return this.inner.getBytes(offset, length);
  }
}

/** A view of the box from so many radii away. */
function viewOf({ min, max }, distance, angle) {
  const middle = min.map((low, k) => (low + max[k]) / 2);
  const radius = Math.hypot(...min.map((low, k) => max[k] - low)) / 2;
  const forward = [-Math.sin(angle), 0, -Math.cos(angle)];
  return { position: middle.map((x, k) => x - distance * radius * forward[k]), forward, viewport: WINDOW, near: radius / 1000, pixelTolerance: 1 };
}

class Drawn {
  images = new Map();

  take({ uploads, drops }) {
    drops.forEach((root) => this.images.delete(root));
    for (const { root, image } of uploads) {
      if (image) this.images.set(root, image.width * image.height);
      else if (image === null) this.images.delete(root);
    }
  }

  get texels() {
    return [...this.images.values()].reduce((sum, texels) => sum + texels, 0);
  }
}

async function complete(stream, drawn, view, each = () => {}) {
  for (;;) {
    const loaded = new Promise((resolve) => { stream.onprogress = resolve; });
    const frame = await stream.frame({ view });
    drawn.take(frame);
    each(frame);
    if (frame.isComplete && frame.shows === 'picture') return frame;
    await Promise.race([loaded, new Promise((resolve) => setTimeout(resolve, 50))]);
  }
}

async function measured(path, options, flies) {
  const file = await open(new Far(await readFile(path)));
  const stream = await file.stream({ channel: 'auto', ...options });
  const drawn = new Drawn();
  let first = null;
  const own = ({ counters, shows, lateRoots }) => {
    // One texel is a mean that stands for an image.
    if (first === null && shows === 'picture' && lateRoots === 0 && [...drawn.images.values()].every((texels) => texels > 1)) first = counters.bytesRead;
  };
  const start = performance.now();
  const { counters } = await complete(stream, drawn, viewOf(file.bounds, 2, 0), own);
  const opening = { first, bytes: counters.bytesRead, texels: drawn.texels, seconds: (performance.now() - start) / 1000 };
  let [most, memory] = [0, 0];
  for (let frame = 0; flies && frame < FRAMES; frame += 1) {
    const t = frame / FRAMES;
    const result = await stream.frame({ view: viewOf(file.bounds, 2 - 1.4 * Math.sin(Math.PI * t), 6.3 * t) });
    drawn.take(result);
    most = Math.max(most, result.counters.imageBytes);
    memory = result.counters.memoryBytes;
    await new Promise((resolve) => setTimeout(resolve, 16));
  }
  file.close();
  return { ...opening, most, memory };
}

console.log('| file | own images, bytes | complete, bytes | seconds | texels a pixel | whole images | images in a flight, MiB | memory, MiB |\n|---|---:|---:|---:|---:|---:|---:|---:|');
const CACHE = 128 << 20;
for (const path of process.argv.slice(2)) {
  const { first, bytes, texels, seconds, most, memory } = await measured(path, { texelCache: CACHE }, true);
  const whole = await measured(path, { texelCache: 2 ** 31, texelsPerPixel: 1e9 }, false).then(({ texels }) => texels, () => NaN);
  const pixels = WINDOW[0] * WINDOW[1];
  const mib = (count) => (count / (1 << 20)).toFixed(0);
  const name = path.split('/').pop();
  console.log(`| ${name} | ${first} | ${bytes} | ${seconds.toFixed(1)} | ${(texels / pixels).toFixed(2)} | ${(whole / pixels).toFixed(0)} | ${mib(most)} of ${mib(CACHE)} | ${mib(memory)} |`);
}
