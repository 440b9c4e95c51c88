// Prints how fast the reader decodes and joins whole files at their finest level: node bench.js FILE...
// The numbers compare with the last column of `cargo run --release -p lodpack --example decode_bench -- FILE...`.

import { readFile } from 'node:fs/promises';
import { open } from './js/index.js';

const LEAST_SECONDS = 2;
/** Processor seconds of all threads: the compiler's as well, which is why measuring begins when it has finished. */
const now = () => {
  const { user, system } = process.cpuUsage();
  return (user + system) / 1e6;
};

console.log('samples  triangles  first call, ms  joined (million samples per second)  file');
for (const path of process.argv.slice(2)) {
  const wasm = process.env.LODPACK_WASM ? await readFile(process.env.LODPACK_WASM) : undefined;
  const file = await open(await readFile(path), { wasm });
  const cut = await file.selectLevel(file.levels.length - 1);
  const begun = performance.now();
  const { positions, triangles } = await file.extract(cut);
  const first = performance.now() - begun;
  for (const warm = now(); now() - warm < 1;) await file.extract(cut);
  let count = 0;
  const start = now();
  for (; now() - start < LEAST_SECONDS; count += 1) await file.extract(cut);
  const samples = positions.length / 3;
  const speed = (samples * count) / (now() - start) / 1e6;
  console.log([samples, triangles.length / 3, first.toFixed(0), speed.toFixed(2), path].map((x, k) => String(x).padStart([7, 10, 15, 36, 0][k])).join('  '));
  file.close();
}
