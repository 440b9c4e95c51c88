// Draws a folder of 3D Tiles in headless Chromium with 3d-tiles-renderer: node draw.js FOLDER [ERROR_IN_PIXELS
// [PICTURE.png | picks]]. Prints what was drawn and what it took as JSON; with `picks` also the objects that are seen.

import { fileURLToPath } from 'node:url';
import { chromium } from 'playwright-core';
import { serve } from '../../reader/wasm/test/server.js';

const [folder, error = '8', picture] = process.argv.slice(2);
const path = (from) => fileURLToPath(new URL(from, import.meta.url));
const server = await serve({ '/': path('.'), '/modules/': path('node_modules'), '/tiles/': folder });
const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
  args: ['--no-sandbox', '--disable-background-networking', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'],
});
const page = await browser.newPage({ viewport: { width: 512, height: 384 } });
const problems = [];
page.on('pageerror', (thrown) => problems.push(thrown.stack));
page.on('console', (message) => message.type() === 'error' && problems.push(message.text()));
let bytes = 0;
page.on('response', async (response) => {
  if (new URL(response.url()).pathname.startsWith('/tiles/')) bytes += Number(response.headers()['content-length'] ?? 0);
});
let state = { problems: [] };
try {
  const picks = picture === 'picks' ? '&picks' : '';
  await page.goto(`${server.url}/page.html?error=${error}${picks}`);
  await page.waitForFunction(() => globalThis.lodpackTiles?.isDone, undefined, { timeout: 120_000 });
  state = await page.evaluate(() => globalThis.lodpackTiles);
  if (picture && !picks) await page.screenshot({ path: picture });
} catch (thrown) {
  problems.push(String(thrown));
}
const requests = server.log.filter((request) => request.path.startsWith('/tiles/')).length;
problems.push(...state.problems);
console.log(JSON.stringify({ ...state, requests, bytes, problems }));
await browser.close();
await server.close();
process.exit(problems.length > 0 ? 1 : 0);
