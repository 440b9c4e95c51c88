// The package as people get it: packed, installed into an empty folder, and its README's first example run.

import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, describe, test } from 'node:test';
import { fileURLToPath } from 'node:url';
import { gzipSync } from 'node:zlib';
import { serve } from './server.js';

const root = fileURLToPath(new URL('..', import.meta.url));
const reference = process.env.LODPACK_REFERENCE;
const skip = !reference && 'cargo test --release -p lodpack-cli runs it';

describe('the package', { skip }, () => {
  const folder = mkdtempSync(join(tmpdir(), 'lodpack-package-'));
  after(() => rmSync(folder, { recursive: true }));
  const npm = (...args) => execFileSync('npm', args, { cwd: folder, encoding: 'utf8', stdio: ['ignore', 'pipe', 'pipe'] });

  test('packs, installs into an empty folder, and runs its first example', async () => {
    npm('pack', root, '--silent');
    const [tarball] = readdirSync(folder);
    writeFileSync(join(folder, 'package.json'), '{ "private": true, "type": "module" }');
    npm('install', '--offline', '--no-audit', '--no-fund', '--omit=peer', join(folder, tarball));
    const installed = join(folder, 'node_modules/lodpack');
    assert.deepEqual(readdirSync(installed).sort(), ['README.md', 'index.d.ts', 'js', 'lodpack.wasm', 'package.json', 'three.d.ts']);
    const [, example] = /```js\n([^]*?)```/.exec(readFileSync(join(installed, 'README.md'), 'utf8'));
    const server = await serve({ '/files/': reference });
    const program = example.replace('https://example.org/scan.lodpack', `${server.url}/files/valid-scan.lodpack`);
    assert.notEqual(program, example);
    writeFileSync(join(folder, 'example.js'), program);
    const { execFile } = await import('node:child_process');
    const said = await new Promise((resolve, reject) => {
      execFile('node', ['example.js'], { cwd: folder }, (error, stdout, stderr) => (error ? reject(new Error(stderr)) : resolve(stdout)));
    });
    await server.close();
    assert.match(said, /^\d+ triangles, at most [\d.e-]+ off the input\n$/);
    assert.ok(server.log.every(({ range }) => range), 'it reads ranges');
  });

  test('its types fit its first example', () => {
    const [, example] = /```js\n([^]*?)```/.exec(readFileSync(join(root, 'README.md'), 'utf8'));
    writeFileSync(join(folder, 'example.ts'), `${example}\nexport {};\n`);
    const options = ['--noEmit', '--strict', '--target', 'es2022', '--module', 'nodenext', '--moduleResolution', 'nodenext', '--lib', 'es2022,dom'];
    execFileSync('node', [join(root, 'node_modules/typescript/bin/tsc'), ...options, 'example.ts'], { cwd: folder, encoding: 'utf8' });
    writeFileSync(join(folder, 'wrong.ts'), "import { open } from 'lodpack';\n(await open('x')).select({ tolarance: 1 });\n");
    assert.throws(() => execFileSync('node', [join(root, 'node_modules/typescript/bin/tsc'), ...options, 'wrong.ts'], { cwd: folder, encoding: 'utf8', stdio: 'pipe' }), /tolarance|Command failed/);
  });

  test('every name of the types is exported, and the reverse', async () => {
    const { default: index } = await import('../js/index.js').then((names) => ({ default: Object.keys(names) }));
    const types = readFileSync(join(root, 'index.d.ts'), 'utf8');
    const declared = [...types.matchAll(/^export (?:class|function|const) (\w+)/gm)].map(([, name]) => name);
    assert.deepEqual(index.sort(), declared.sort());
  });

  test('it stays within its size', () => {
    const wasm = gzipSync(readFileSync(join(root, 'lodpack.wasm')), { level: 9 }).length;
    const scripts = readdirSync(join(root, 'js')).map((name) => readFileSync(join(root, 'js', name)));
    const js = gzipSync(Buffer.concat(scripts), { level: 9 }).length;
    assert.ok(wasm <= 490_000, `lodpack.wasm has ${wasm} bytes gzipped`);
    assert.ok(js <= 27_000, `the scripts have ${js} bytes gzipped`);
  });
});
