// A file that `lodpack serve` serves, with the page, in Chromium.

import assert from 'node:assert/strict';
import { after, before, describe, test } from 'node:test';
import { launch, newPage } from './browser.js';
import { serve } from './server.js';

const host = process.env.LODPACK_SERVED;
const skip = !host && 'cargo test -p lodpack-cli runs it';

describe('lodpack serve', { skip }, () => {
  let browser;
  const errors = [];

  before(async () => {
    browser = await launch();
  });
  after(() => browser.close());

  // The front page, and the address of the file itself, which somebody may paste.
  for (const path of ['/', '/a%20b.lodpack']) {
    test(`${path} shows the file`, async () => {
      const page = await newPage(browser, errors);
      await page.goto(`http://${host}${path}`);
      await page.waitForFunction(() => globalThis.lodpackViewer?.last?.isComplete);
      assert.ok(await page.evaluate(() => globalThis.lodpackViewer.shown.pool.triangleCount) > 100);
      assert.match(await page.title(), /lodpack/);
      assert.deepEqual(errors, []);
      await page.close();
    });
  }

  test('a page of another host reads it in ranges', async () => {
    // Another port is another host.
    const elsewhere = await serve({ '/': new TextEncoder().encode('<p>elsewhere</p>') });
    const page = await newPage(browser, errors);
    await page.goto(`${elsewhere.url}/index.html`);
    const seen = await page.evaluate(async (url) => {
      const answer = await fetch(url, { headers: { Range: 'bytes=0-15' } });
      return [answer.status, (await answer.arrayBuffer()).byteLength, answer.headers.get('Content-Range'), answer.headers.get('ETag')];
    }, `http://${host}/a%20b.lodpack`);
    assert.deepEqual(seen.slice(0, 2), [206, 16]);
    assert.match(seen[2], /^bytes 0-15\//);
    assert.match(seen[3], /^"/);
    await page.close();
    await elsewhere.close();
  });
});
