// Sources, servers that fail, and the cache.

import assert from 'node:assert/strict';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join, relative } from 'node:path';
import { describe, test } from 'node:test';
import { pathToFileURL } from 'node:url';
import { EtagMismatch, FetchSource, FileSource, SharedPromiseCache, SourceError, open } from '../js/index.js';
import { serve } from './server.js';

const folder = process.env.LODPACK_REFERENCE;
const skip = !folder && 'cargo test -p lodpack-cli makes the file that it needs';
/** Larger than the first request. */
const scan = folder ? readFileSync(join(folder, 'valid-scan.lodpack')) : undefined;
const quick = { pause: 1, timeout: 400 };

const bytesAt = (offset, length) => scan.buffer.slice(scan.byteOffset + offset, scan.byteOffset + offset + length);

/** Opens the file over HTTP and extracts everything, with a cache of its own. */
async function readAll(url, options = {}, cache = new SharedPromiseCache()) {
  const file = await open(new FetchSource(`${url}/t.lodpack`, { ...quick, ...options }), { cache });
  try {
    const mesh = await file.extract(await file.select({}));
    return { triangles: mesh.triangles.length / 3, traffic: file.traffic };
  } finally {
    file.close();
  }
}

async function withServer(options, action) {
  const server = await serve({ '/': scan, '/t.lodpack': scan }, options);
  try {
    return await action(server);
  } finally {
    await server.close();
  }
}

const refuses = (options, pattern, source = {}) => withServer(options, (server) => assert.rejects(
  readAll(server.url, source),
  (error) => {
    assert.ok(error instanceof SourceError, error.stack);
    assert.match(error.message, pattern);
    return true;
  },
));

describe('sources', { skip }, () => {
let everything;
test('a file over HTTP is what it is in memory', async () => {
  const file = await open(scan);
  everything = (await file.extract(await file.select({}))).triangles.length / 3;
  await withServer({}, async ({ url, log }) => {
    const { triangles, traffic } = await readAll(url);
    assert.equal(triangles, everything);
    assert.equal(log.length, traffic.requests);
    assert.equal(log[0].range, 'bytes=0-8191');
    assert.ok(traffic.requests > 1 && traffic.bytes <= scan.length);
  });
});

test('a server that hides Content-Range and ETag costs one request more', async () => {
  // Node shows all headers; this server sends none of them.
  const { Response } = globalThis;
  const plain = globalThis.fetch;
  globalThis.fetch = async (...args) => {
    const response = await plain(...args);
    const headers = new Headers(response.headers);
    for (const name of ['Content-Range', 'ETag']) headers.delete(name);
    return new Response(response.body, { status: response.status, headers });
  };
  try {
    await withServer({}, async ({ url, log }) => {
      assert.equal((await readAll(url)).triangles, everything);
      assert.equal(log.filter(({ method }) => method === 'HEAD').length, 1);
    });
  } finally {
    globalThis.fetch = plain;
  }
});

test('a server that sends only whole files is used if the file is small', async () => {
  for (const wrong of ['whole', 'gzip-whole']) {
    await withServer({ fault: () => wrong }, async ({ url, log }) => {
      assert.equal((await readAll(url)).triangles, everything);
      assert.equal(log.length, 1);
    });
    await refuses({ fault: () => wrong }, /ignores range requests/, { maxWholeBytes: 10_000 });
  }
});

test('a server that is wrong about ranges is refused, and the message says what to do', async () => {
  await refuses({ fault: () => 'gzip' }, /compresses ranges \(gzip\).*turn compression off/);
  await refuses({ fault: () => 'short' }, /ended its answer after/);
  await refuses({ fault: () => 'other' }, /different range than requested/);
});

test('a web page, a wrong address and a missing login are told apart', async () => {
  await refuses({ fault: () => 404 }, /status 404: the file does not exist/);
  await refuses({ fault: () => 401 }, /requires a login/);
  await refuses({ fault: () => 403 }, /does not let you read this/);
  const page = await serve({ '/': new TextEncoder().encode('<!doctype html><p>Please log in') }, { fault: () => 'whole' });
  const cache = new SharedPromiseCache();
  await assert.rejects(open(new FetchSource(`${page.url}/t.html`, quick), { cache }), /web page \(text\/html\)/);
  await page.close();
});

test('failures that may pass are tried again, and others are not', async () => {
  for (const wrong of [503, 'cut', 'hang', 429]) {
    const fault = ({ count }) => (count % 2 === 0 ? wrong : undefined);
    await withServer({ fault }, async ({ url }) => assert.equal((await readAll(url)).triangles, everything));
  }
  await withServer({ fault: () => 404 }, async ({ url, log }) => {
    await assert.rejects(readAll(url));
    assert.equal(log.length, 1);
  });
  await refuses({ fault: () => 'hang' }, /did not answer in time/, { attempts: 2, timeout: 100 });
  await refuses({ fault: () => 'cut' }, /cannot be reached, closed the connection/, { attempts: 2 });
});

/** Larger than any part that counts as progress. */
const big = Uint8Array.from({ length: 100_000 }, (_, k) => (k * k) >> 3);
const bigAt = (offset, length) => big.buffer.slice(offset, offset + length);
const withBig = async (options, action) => {
  const server = await serve({ '/t.lodpack': big }, options);
  try {
    return await action(server);
  } finally {
    await server.close();
  }
};

test('a slow answer is awaited as long as something arrives', async () => {
  // It takes twice as long as the limit.
  await withBig({ fault: () => 'drip' }, async ({ url, log }) => {
    const source = new FetchSource(`${url}/t.lodpack`, quick);
    const { data } = await source.getBytes(1000, 64_000);
    assert.deepEqual(new Uint8Array(data), new Uint8Array(bigAt(1000, 64_000)));
    assert.equal(log.length, 1);
  });
});

test('what has arrived is kept when a connection breaks', async () => {
  await withBig({ fault: () => 'half' }, async ({ url, log }) => {
    const source = new FetchSource(`${url}/t.lodpack`, { ...quick, attempts: 2 });
    const length = 1 << 16;
    await assert.rejects(source.getBytes(1000, length), SourceError);
    // Half of the rest each, until an attempt brought too little to count.
    let [from, rest] = [1000, length];
    for (const { range } of log) {
      assert.equal(range, `bytes=${from}-${999 + length}`);
      [from, rest] = [from + (rest >> 1), rest - (rest >> 1)];
    }
    assert.equal(log.length, 3);
  });
  await withBig({ fault: ({ count }) => (count % 2 === 0 ? 'half' : undefined) }, async ({ url }) => {
    const source = new FetchSource(`${url}/t.lodpack`, { ...quick, attempts: 2 });
    assert.deepEqual(new Uint8Array((await source.getBytes(77, 50_001)).data), new Uint8Array(bigAt(77, 50_001)));
  });
  // Not if the file is another one by then.
  const server = await serve({ '/t.lodpack': big }, { fault: ({ count }) => (count < 2 ? 'half' : undefined) });
  const source = new FetchSource(`${server.url}/t.lodpack`, { ...quick, pause: 300 });
  const read = source.getBytes(0, 50_000);
  while (server.log.length === 0) await new Promise((resolve) => setTimeout(resolve, 5));
  server.change();
  assert.deepEqual(new Uint8Array((await read).data), new Uint8Array(bigAt(0, 50_000)));
  assert.equal(server.log.at(-1).range, 'bytes=0-49999', 'all of the new file');
  await assert.rejects(source.getBytes(50_000, 100, undefined, '"one"'), EtagMismatch);
  await server.close();
});

test('closing a file ends what runs', async () => {
  for (const wrong of ['hang', 503]) {
    await withServer({ fault: ({ count }) => (count > 0 ? wrong : undefined) }, async ({ url, log }) => {
      const file = await open(new FetchSource(`${url}/t.lodpack`, { timeout: 1e9, pause: 1e8 }), { cache: new SharedPromiseCache() });
      const answer = file.select({}).then((cut) => file.extract(cut));
      while (log.length < 2) await new Promise((resolve) => setTimeout(resolve, 5));
      file.close();
      await assert.rejects(answer, { kind: 'closed' });
    });
  }
});

test('other hosts are read only if that is asked for', async () => {
  const fault = ({ path }) => (path === '/t.lodpack' ? 'redirect' : undefined);
  const server = await serve({ '/': scan, '/moved.lodpack': scan }, { fault });
  await assert.rejects(readAll(server.url), /redirects to another host; open http:\/\/localhost:\d+\/moved.lodpack/);
  assert.equal((await readAll(server.url, { otherHosts: true })).triangles, everything);
  await server.close();
});

test('a path is a file in Node', async () => {
  const path = join(folder, 'valid-scan.lodpack');
  for (const from of [path, relative('.', path), pathToFileURL(path), pathToFileURL(path).href]) {
    const file = await open(from, { cache: new SharedPromiseCache() });
    assert.equal((await file.extract(await file.select({}))).triangles.length / 3, everything);
    file.close();
  }
  await assert.rejects(open(join(folder, 'nowhere.lodpack')), (error) => error instanceof SourceError && /nowhere\.lodpack.*no such file/.test(error.message));
  await assert.rejects(open(folder), SourceError);
  const own = mkdtempSync(join(tmpdir(), 'lodpack-path-'));
  const copy = join(own, 'copy.lodpack');
  writeFileSync(copy, scan);
  const file = await open(copy, { cache: new SharedPromiseCache() });
  writeFileSync(copy, scan.subarray(0, scan.length - 1));
  await assert.rejects(async () => file.extract(await file.select({})), EtagMismatch);
  file.close();
  rmSync(own, { recursive: true });
});

test('a file without a tag that changes is known by its date', async () => {
  await withServer({ hasTags: false }, async (server) => {
    const file = await open(new FetchSource(`${server.url}/t.lodpack`, quick), { cache: new SharedPromiseCache() });
    server.change();
    await assert.rejects(async () => file.extract(await file.select({})), EtagMismatch);
    file.close();
  });
});

test('a file that changes is not mixed with the old one', async () => {
  await withServer({}, async (server) => {
    const cache = new SharedPromiseCache();
    const file = await open(new FetchSource(`${server.url}/t.lodpack`, quick), { cache });
    server.change();
    await assert.rejects(async () => file.extract(await file.select({})), EtagMismatch);
    // It stays so, and sends no more requests.
    const count = server.log.length;
    await assert.rejects(async () => file.extract(await file.select({})), /open it again/);
    assert.equal(server.log.length, count);
    assert.ok(file.failure instanceof EtagMismatch);
    file.close();
    // Opening it again forgets what the cache had.
    assert.equal((await readAll(server.url, {}, cache)).triangles, everything);
  });
});

test('a cached beginning of an older file is noticed while the file opens', async () => {
    let etag = 'one';
  let count = 0;
  const source = {
    getKey: () => 'mine',
    async getBytes(offset, length, _signal, known) {
      count += 1;
      if (known && known !== etag) throw new EtagMismatch('test');
      return { data: bytesAt(offset, length), etag, size: scan.length };
    },
  };
  const cache = new SharedPromiseCache();
  const first = await open(source, { cache });
  first.close();
  const before = count;
  const again = await open(source, { cache });
  assert.equal(count, before, 'opening again asks the cache');
  etag = 'two';
  await assert.rejects(async () => again.extract(await again.select({})), EtagMismatch);
  const fresh = await open(source, { cache });
  assert.equal((await fresh.extract(await fresh.select({}))).triangles.length / 3, everything);
});

test('two readers of one file share requests, and a request ends when nobody waits for it', async () => {
  let resolvers = [];
  let aborted = 0;
  const source = {
    getBytes: (_offset, length, signal) => new Promise((resolve, reject) => {
      resolvers.push(() => resolve({ data: new ArrayBuffer(length), size: 99 }));
      signal.addEventListener('abort', () => { aborted += 1; reject(signal.reason); });
    }),
  };
  const cache = new SharedPromiseCache({ maxBytes: 25 });
  const [first, second] = [new AbortController(), new AbortController()];
  const answers = [first, second].map(({ signal }) => cache.getBytes(source, 0, 10, signal));
  assert.equal(resolvers.length, 1);
  first.abort();
  await assert.rejects(answers[0], { name: 'AbortError' });
  assert.equal(aborted, 0);
  resolvers[0]();
  assert.equal((await answers[1]).data.byteLength, 10);
  const third = new AbortController();
  const lonely = cache.getBytes(source, 10, 10, third.signal);
  third.abort();
  await assert.rejects(lonely, { name: 'AbortError' });
  assert.equal(aborted, 1);
  // The least recently used answers go first.
  resolvers = [];
  for (const offset of [20, 40, 60]) {
    const answer = cache.getBytes(source, offset, 10);
    resolvers.at(-1)();
    await answer;
  }
  assert.equal(resolvers.length, 3);
  await cache.getBytes(source, 60, 10);
  assert.equal(resolvers.length, 3);
  const gone = cache.getBytes(source, 20, 10);
  assert.equal(resolvers.length, 4);
  resolvers[3]();
  await gone;
});

test('files from the disk are read in parts', async () => {
  const blob = new Blob([scan]);
  const file = await open(blob, { cache: new SharedPromiseCache() });
  assert.equal((await file.extract(await file.select({}))).triangles.length / 3, everything);
  file.close();
  const unreadable = new FileSource({ name: 'gone.lodpack', slice: () => ({ arrayBuffer: async () => { throw new DOMException('x', 'NotReadableError'); } }) });
  await assert.rejects(open(unreadable, { cache: new SharedPromiseCache() }), EtagMismatch);
});

test('sources that break their promise are refused', async () => {
  const options = () => ({ cache: new SharedPromiseCache() });
  const bad = (answer) => open({ getBytes: async () => answer }, options());
  await assert.rejects(bad({ data: bytesAt(0, 8192) }), /does not say how large the file is/);
  await assert.rejects(bad({ data: new ArrayBuffer(5), size: 3 }), { kind: 'format' });
  await assert.rejects(open(7), { kind: 'query' });
  // Long files whose source sends less than was asked for.
  const short = { getBytes: async (offset, length) => ({ data: bytesAt(offset, offset ? length - 1 : length), size: scan.length }) };
  await assert.rejects(async () => {
    const file = await open(short, options());
    return file.extract(await file.select({}));
  }, /returned \d+ of \d+ bytes/);
});
});
