// Hostile files, with right checksums: an error or a mesh, never a trap, in Node and in the worker of a page.

import assert from 'node:assert/strict';
import { readFile, readdir } from 'node:fs/promises';
import { join } from 'node:path';
import { describe, test } from 'node:test';
import { loadModule, open } from '../js/index.js';
import { launch, mounts, newPage } from './browser.js';
import { ask } from './hostile.js';
import { serve } from './server.js';

/** tests/tests/browser.rs writes it. */
const folder = process.env.LODPACK_CORPUS;
/** Each file in a page starts a worker, so these are fewer. */
const EACH_IN_A_PAGE = 25;

describe('hostile files', { skip: !folder && 'cargo test -p lodpack-cli runs it' }, () => {
  test('are refused or read, and the reader goes on', async () => {
    const wasm = await loadModule();
    const counts = {};
    const names = (await readdir(folder)).sort();
    for (const name of names) {
      const bytes = await readFile(join(folder, name));
      const done = await ask((bytes) => open(bytes, { wasm }), bytes).catch((error) => assert.fail(`${name}: ${error.message}`));
      for (const what of done) counts[what] = (counts[what] ?? 0) + 1;
    }
    console.log(`${names.length} files: ${JSON.stringify(counts)}`);
    // Otherwise the checksums were wrong, and everything was refused at the door.
    assert.ok(names.length > 1000 && counts.open > names.length / 4 && counts.open < names.length * 0.9, `${counts.open} of ${names.length} open`);
    assert.ok(counts.extract > counts.open / 3 && counts.extract < counts.open * 0.97 && counts.picture > counts.open / 3 && counts.textured > 10);
  });

  test('leave the worker of a page alive, and the page', async () => {
    const [browser, server, errors] = [await launch(), await serve({ ...mounts, '/corpus/': folder, '/blank': new TextEncoder().encode('<p>blank</p>') }), []];
    try {
      const page = await newPage(browser, errors);
      await page.goto(`${server.url}/blank`);
      const names = (await readdir(folder)).sort().filter((_, number) => number % EACH_IN_A_PAGE === 0);
      const opened = await page.evaluate(async (names) => {
        const [{ open }, { ask }] = await Promise.all([import('/lodpack/js/index.js'), import('/lodpack/test/hostile.js')]);
        let count = 0;
        for (const name of names) {
          const bytes = await (await fetch(`/corpus/${name}`)).arrayBuffer();
          const done = await ask(open, bytes).catch((error) => { throw new Error(`${name}: ${error.message}`); });
          count += done.has('open') ? 1 : 0;
        }
        return count;
      }, names);
      console.log(`${opened} of ${names.length} files open in a page`);
      assert.ok(opened > names.length / 4);
      assert.deepEqual(errors, []);
    } finally {
      await browser.close();
      await server.close();
    }
  });
});
