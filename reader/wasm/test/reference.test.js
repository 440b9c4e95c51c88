// What the native reader says about each file, the reader in WebAssembly says too: to the bit, and to the letter.

import assert from 'node:assert/strict';
import { readFile, readdir } from 'node:fs/promises';
import { join } from 'node:path';
import test from 'node:test';
import { open } from '../js/index.js';

/** tests/tests/browser.rs writes the answers. */
const folder = process.env.LODPACK_REFERENCE;

function bytesOf({ positions, triangles }) {
  return Buffer.concat([positions, triangles].map((array) => Buffer.from(array.buffer, array.byteOffset, array.byteLength)));
}

/** What a call gives: bytes, or an error in words. */
async function answer(call) {
  try {
    return { bin: bytesOf(await call()) };
  } catch (error) {
    assert.equal(error.name, 'LodpackError', error.stack);
    return { error: `${error.kind}: ${error.message}` };
  }
}

test('every level of every file is the same to the bit, and every error to the letter', { skip: !folder && 'cargo test -p lodpack-cli runs it' }, async () => {
  // heights.test.js compares the others.
  const names = (await readdir(folder)).filter((name) => !name.startsWith('heights-'));
  const files = names.filter((name) => name.endsWith('.lodpack')).map((name) => name.slice(0, -8));
  const expected = new Map();
  for (const name of names.filter((name) => !name.endsWith('.lodpack'))) expected.set(name, await readFile(join(folder, name)));
  const compare = (name, { bin, error }) => {
    const text = expected.get(`${name}.error`)?.toString();
    assert.equal(error, text, name);
    if (bin) assert.ok(bin.equals(expected.get(`${name}.bin`)), `${name} has other bytes`);
    expected.delete(`${name}.error`);
    expected.delete(`${name}.bin`);
  };
  for (const name of files) {
    const bytes = await readFile(join(folder, `${name}.lodpack`));
    let file;
    const opened = await answer(async () => {
      file = await open(bytes);
      return { positions: new Float64Array(0), triangles: new Uint32Array(0) };
    });
    if (!file) {
      compare(`${name}.open`, opened);
      continue;
    }
    let overview;
    const shown = await answer(async () => (overview = await file.overview()) ?? { positions: new Float64Array(0), triangles: new Uint32Array(0) });
    if (overview || shown.error) compare(`${name}.overview`, shown);
    for (let level = 0; level < file.levels.length; level += 1) {
      compare(`${name}.level${level}`, await answer(async () => file.extract(await file.selectLevel(level))));
    }
    compare(`${name}.mixed`, await answer(async () => {
      const cut = await file.selectLevel(file.levels.length - 1);
      for (let k = 0; k < cut.nodes.length; k += 2) {
        if (cut.nodes[k] % 3 === 0) cut.nodes[k + 1] = Math.max(cut.nodes[k + 1] - 1, 0);
      }
      return file.extract(cut);
    }));
    file.close();
  }
  assert.ok(files.length > 100);
  assert.deepEqual([...expected.keys()], [], 'the native reader has answers that were not compared');
});
