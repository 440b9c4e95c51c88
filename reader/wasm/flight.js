// Flies around a file in headless Chromium and prints what it costs: node flight.js FILE [OPTION...]
//
// 1. A flight of --minutes (5) by the clock with an error of --pixels (1), drawn with three.js: after each minute, and
//    a collection of garbage, the JavaScript heap, the reader's memory, the objects on the GPU that three.js counts,
//    and the memory of the page's process.
// 2. Full refinement: everything at the finest level, and a --picture of it.
// 3. Forty times opened, drawn and disposed of: what is left of each.
// 4. 300 frames of a camera that moves, without drawing, with an error of --glide pixels (0.5), of a file that is open
//    in --copies (1): processor time of the page's thread and of the workers' together, for each frame.
//
// Processor times are the kernel's, of single threads, so they hold beside other work. Chromium draws on the processor
// here.

import { readFile, readdir } from 'node:fs/promises';
import { resolve } from 'node:path';
import { parseArgs } from 'node:util';
import { launch, mounts, newPage } from './test/browser.js';
import { serve } from './test/server.js';

const { values, positionals: [path] } = parseArgs({
  allowPositionals: true,
  options: { minutes: { type: 'string', default: '5' }, pixels: { type: 'string', default: '1' }, glide: { type: 'string', default: '0.5' }, copies: { type: 'string', default: '1' }, picture: { type: 'string' } },
});
if (!path) throw new Error('usage: node flight.js FILE [--minutes N] [--pixels P] [--glide P] [--copies N] [--picture OUT.png]');
const CYCLES = 40;
const FRAMES = 300;
const MB = 1e6;

const server = await serve({ ...mounts, '/flown.lodpack': await readFile(resolve(path)) });
const browser = await launch();
const errors = [];
const page = await newPage(browser, errors, { viewport: { width: 800, height: 560 } });
page.setDefaultTimeout(600_000);
await page.goto(`${server.url}/lodpack/test/flight.html?url=/flown.lodpack`);
await page.waitForFunction(() => globalThis.isReady);
const session = await page.context().newCDPSession(page);

/** The process that has the page: the one with the most memory of those that render. */
async function renderer() {
  const found = [];
  for (const pid of (await readdir('/proc')).filter((name) => /^\d+$/.test(name))) {
    const line = await readFile(`/proc/${pid}/cmdline`, 'utf8').catch(() => '');
    if (line.includes('--type=renderer')) found.push({ pid, bytes: await residentBytes(pid) });
  }
  return found.sort((a, b) => b.bytes - a.bytes)[0].pid;
}

async function residentBytes(pid) {
  const status = await readFile(`/proc/${pid}/status`, 'utf8').catch(() => '');
  return 1024 * Number(/VmRSS:\s+(\d+)/.exec(status)?.[1] ?? 0);
}

/** Processor time of a process's threads by their names, in milliseconds. */
async function threadTimes(pid) {
  const times = { page: 0, worker: 0 };
  for (const thread of await readdir(`/proc/${pid}/task`)) {
    const folder = `/proc/${pid}/task/${thread}`;
    const name = (await readFile(`${folder}/comm`, 'utf8').catch(() => '')).trim();
    const [time] = (await readFile(`${folder}/schedstat`, 'utf8').catch(() => '0')).split(' ');
    if (thread === pid) times.page += time / 1e6;
    else if (name.startsWith('DedicatedWorker')) times.worker += time / 1e6;
  }
  return times;
}

async function memory() {
  for (let k = 0; k < 3; k += 1) await session.send('HeapProfiler.collectGarbage');
  const { usedSize } = await session.send('Runtime.getHeapUsage');
  return { heap: usedSize / MB, process: (await residentBytes(await renderer())) / MB };
}

const row = (...cells) => console.log(cells.map((cell, k) => String(typeof cell === 'number' ? Number(cell.toFixed(1)) : cell).padStart([22, 8, 8, 12, 12, 12, 12, 14][k])).join(''));
const minutes = Number(values.minutes);
row('', 'frames', 'nodes', 'triangles', 'heap MB', 'reader MB', 'process MB', 'GPU objects');
const begun = await page.evaluate((pixels) => globalThis.begin(pixels), Number(values.pixels));
const report = async (name, state) => {
  const { heap, process } = await memory();
  row(name, state.count ?? '', state.most ?? state.nodeCount, state.triangleCount, heap, (state.readerBytes ?? 0) / MB, process, `${state.geometries} + ${state.textures}`);
};
await report('begin', begun);
for (let minute = 0; minute < minutes; minute += 1) {
  const state = await page.evaluate(([from, to]) => globalThis.fly(from, to), [60 * minute, 60 * Math.min(minute + 1, minutes)]);
  await report(`minute ${minute + 1}`, state);
  if (state.problems.length > 0) throw new Error(state.problems.join('\n'));
}
const refined = await page.evaluate(() => globalThis.refine());
await report('full refinement', refined);
console.log(`full refinement: ${refined.isComplete ? 'complete' : 'INCOMPLETE'}, limited by ${refined.limitedBy}`);
if (values.picture) await page.screenshot({ path: values.picture });
await page.evaluate(() => globalThis.end());
await report('disposed of', { ...(await page.evaluate(() => globalThis.counts())), nodeCount: 0, triangleCount: 0 });

// The first ones fill caches, and what the browser notes about code.
await page.evaluate((times) => globalThis.repeat(times), CYCLES / 2);
const before = await memory();
const left = await page.evaluate((times) => globalThis.repeat(times), CYCLES);
const after = await memory();
console.log(`${CYCLES} times opened and disposed of: heap ${((after.heap - before.heap) * 1000 / CYCLES).toFixed(1)} kB each, process ${((after.process - before.process) * 1000 / CYCLES).toFixed(0)} kB each; `
  + `${left.geometries} geometries, ${left.textures} textures and ${page.workers().length} workers are left`);

const gliding = page.evaluate((options) => globalThis.glide(...options), [FRAMES, Number(values.glide), Number(values.copies)]);
/** Waits until the page does, notes the times, and lets it go on. */
const lap = async () => {
  await page.waitForFunction(() => globalThis.goOn);
  const times = await threadTimes(await renderer());
  await page.evaluate(() => [globalThis.goOn, globalThis.goOn = undefined][0]());
  return times;
};
const [start, end] = [await lap(), await lap()];
const { nodeCount, uploads } = await gliding;
console.log(`a frame of a moving camera at ${nodeCount.toFixed(0)} nodes, ${uploads.toFixed(1)} of them new: page ${((end.page - start.page) / FRAMES).toFixed(2)} ms, workers ${((end.worker - start.worker) / FRAMES).toFixed(2)} ms`);
if (errors.length > 0) throw new Error(errors.join('\n'));
await browser.close();
await server.close();
