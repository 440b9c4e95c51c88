// The table of queries that every language answers alike: tests/data/queries.txt. reader/src/tests/queries.rs says what
// its lines mean.

import assert from 'node:assert/strict';
import { readFile } from 'node:fs/promises';
import { test } from 'node:test';
import { open } from '../js/index.js';

const root = new URL('../../../', import.meta.url);
const vector = async (name) => open(await readFile(new URL(`format-spec/vectors/${name}.lodpack`, root)));
const number = (text) => ({ inf: Infinity, '-inf': -Infinity, nan: NaN })[text] ?? Number(text);

/** FNV-1a of 64 bits. */
function hash(...arrays) {
  let value = 0xcbf29ce484222325n;
  for (const array of arrays) {
    for (const byte of new Uint8Array(array.buffer, array.byteOffset, array.byteLength)) {
      value = BigInt.asUintN(64, (value ^ BigInt(byte)) * 0x100000001b3n);
    }
  }
  return value.toString(16).padStart(16, '0');
}

async function answer(asked) {
  const [name, ...words] = asked.split(' ');
  const [file, query] = [await vector(name), {}];
  let [drawer, channel] = [file, undefined];
  for (const word of words) {
    const [part, value] = word.split('=');
    if (part === 'box') query.box = value.split(',').map(number);
    else if (part === 'context') query.outside = 'coarsest';
    else if (part === 'channel') channel = value;
    else if (part === 'drawn-by') drawer = await vector(value);
    else query[{ tolerance: 'tolerance', triangles: 'maxTriangles', nodes: 'maxNodes', bytes: 'maxBytes' }[part]] = number(value);
  }
  try {
    const cut = await file.select(query);
    const mesh = await drawer.extract(cut);
    const { channels = [] } = channel === undefined ? {} : await file.extract(cut, { channels: [channel] });
    const carried = channels.map(({ name, kind }) => `${name}:${kind}`);
    const count = cut.nodeErrors.length;
    return [count, mesh.triangles.length / 3, mesh.positions.length / 3, cut.error, cut.errorEverywhere, cut.limitedBy, hash(mesh.positions, mesh.triangles), ...carried];
  } catch (error) {
    if (!error.kind) throw error;
    return [error.kind];
  }
}

test('queries are answered as in every other language', async () => {
  const lines = (await readFile(new URL('tests/data/queries.txt', root), 'utf8')).trim().split('\n');
  assert.ok(lines.length >= 40);
  for (const line of lines) {
    const [asked, expected] = line.split(' = ');
    const wanted = expected.split(' ').map((word, at) => (at < 5 && expected.includes(' ') ? Number(word) : word));
    assert.deepEqual(await answer(asked), wanted, asked);
  }
});
