// The package as people get it: packed, installed into an empty folder, and its README's first example run.

import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, describe, test } from 'node:test';
import { fileURLToPath } from 'node:url';
import { gzipSync } from 'node:zlib';

const root = fileURLToPath(new URL('..', import.meta.url));
/** A scan on nginx, or on a server of the tests. */
const scan = process.env.LODPACK_SCAN_URL;
const skip = !scan && 'cargo test -p lodpack-cli runs it';

describe('the package', { skip }, () => {
  const folder = mkdtempSync(join(tmpdir(), 'lodpack-package-'));
  after(() => rmSync(folder, { recursive: true }));
  const npm = (...args) => execFileSync('npm', args, { cwd: folder, encoding: 'utf8', stdio: ['ignore', 'pipe', 'pipe'] });

  test('packs, installs into an empty folder, and runs its first example', () => {
    npm('pack', root, '--silent');
    const [tarball] = readdirSync(folder);
    writeFileSync(join(folder, 'package.json'), '{ "private": true, "type": "module" }');
    npm('install', '--offline', '--no-audit', '--no-fund', '--omit=peer', join(folder, tarball));
    const installed = join(folder, 'node_modules/lodpack');
    assert.deepEqual(readdirSync(installed).sort(), ['README.md', 'index.d.ts', 'js', 'lodpack-geometry.wasm', 'lodpack.wasm', 'objects.d.ts', 'package.json', 'three-objects.d.ts', 'three.d.ts']);
    const [, example] = /```js\n([^]*?)```/.exec(readFileSync(join(installed, 'README.md'), 'utf8'));
    const program = example.replace('https://example.org/scan.lodpack', scan);
    assert.notEqual(program, example);
    writeFileSync(join(folder, 'example.js'), program);
    const said = execFileSync('node', ['example.js'], { cwd: folder, encoding: 'utf8' });
    assert.match(said, /^\d+ triangles, at most [\d.e-]+ off the input\n$/);
  });

  test('its types fit its first example', () => {
    const [, example] = /```js\n([^]*?)```/.exec(readFileSync(join(root, 'README.md'), 'utf8'));
    writeFileSync(join(folder, 'example.ts'), `${example}\nexport {};\n`);
    const options = ['--noEmit', '--strict', '--target', 'es2022', '--module', 'nodenext', '--moduleResolution', 'nodenext', '--lib', 'es2022,dom'];
    execFileSync('node', [join(root, 'node_modules/typescript/bin/tsc'), ...options, 'example.ts'], { cwd: folder, encoding: 'utf8' });
    writeFileSync(join(folder, 'wrong.ts'), "import { open } from 'lodpack';\n(await open('x')).select({ tolarance: 1 });\n");
    assert.throws(() => execFileSync('node', [join(root, 'node_modules/typescript/bin/tsc'), ...options, 'wrong.ts'], { cwd: folder, encoding: 'utf8', stdio: 'pipe' }), /tolarance|Command failed/);
  });

  test('the types of objects fit a program', () => {
    const program = `import { open } from 'lodpack';
      import { objectsOf } from 'lodpack/objects';
      const file = await open('x');
      const objects = await objectsOf(file);
      const [first] = (await objects?.find('VALVE')) ?? [];
      const filter = await objects?.filter({ hidden: [first], only: null });
      const stream = await file.stream();
      await objects?.show(stream, filter);
      const name: string | null | undefined = (await objects?.pick({ origin: [0, 0, 9], direction: [0, 0, -1] }, filter))?.name;
      for await (const page of objects?.children() ?? []) console.log(page.map(({ name }) => name), name);
      filter?.close();
      export {};`;
    const options = ['--noEmit', '--strict', '--target', 'es2022', '--module', 'nodenext', '--moduleResolution', 'nodenext', '--lib', 'es2022,dom'];
    const check = (name, text) => {
      writeFileSync(join(folder, name), text);
      return execFileSync('node', [join(root, 'node_modules/typescript/bin/tsc'), ...options, name], { cwd: folder, encoding: 'utf8', stdio: 'pipe' });
    };
    check('objects.ts', program);
    assert.throws(() => check('wrong-objects.ts', program.replace('hidden:', 'hiden:')));
  });

  test('every name of the types is exported, and the reverse', async () => {
    const { default: index } = await import('../js/index.js').then((names) => ({ default: Object.keys(names) }));
    const types = readFileSync(join(root, 'index.d.ts'), 'utf8');
    const declared = [...types.matchAll(/^export (?:class|function|const) (\w+)/gm)].map(([, name]) => name);
    assert.deepEqual(index.sort(), declared.sort());
    // Types of three.js are not there.
    const ofObjects = readFileSync(join(root, 'objects.d.ts'), 'utf8');
    const names = [...ofObjects.matchAll(/^export (?:class|function|const) (\w+)/gm)].map(([, name]) => name);
    assert.deepEqual(Object.keys(await import('../js/objects.js')).sort(), names.sort());
  });

  test('it stays within its size', () => {
    const [wasm, geometry] = ['lodpack.wasm', 'lodpack-geometry.wasm'].map((name) => gzipSync(readFileSync(join(root, name)), { level: 9 }).length);
    // Modules that only programs with objects load have a size of their own.
    const ofObjects = ['objects.js', 'three-objects.js'];
    const sizeOf = (names) => gzipSync(Buffer.concat(names.map((name) => readFileSync(join(root, 'js', name)))), { level: 9 }).length;
    const js = sizeOf(readdirSync(join(root, 'js')).filter((name) => !ofObjects.includes(name)));
    for (const name of readdirSync(join(root, 'js'))) {
      const text = readFileSync(join(root, 'js', name), 'utf8');
      assert.ok(ofObjects.includes(name) || !/from '.*objects\.js'/.test(text), `${name} loads modules of objects`);
    }
    assert.ok(wasm <= 690_000, `lodpack.wasm has ${wasm} bytes gzipped`);
    assert.ok(geometry <= 325_000, `lodpack-geometry.wasm has ${geometry} bytes gzipped`);
    assert.ok(js <= 31_200, `the scripts have ${js} bytes gzipped`);
    assert.ok(sizeOf(ofObjects) <= 4_200, `the scripts for objects have ${sizeOf(ofObjects)} bytes gzipped`);
  });
});
