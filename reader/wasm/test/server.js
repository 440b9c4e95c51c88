// A web server for tests: folders with ranges, and the faults that servers have.

import { createReadStream } from 'node:fs';
import { readFile, stat } from 'node:fs/promises';
import { createServer } from 'node:http';
import { extname, join, normalize } from 'node:path';
import { gzipSync } from 'node:zlib';

const TYPES = { '.html': 'text/html', '.js': 'text/javascript', '.wasm': 'application/wasm', '.lodpack': 'application/octet-stream', '.css': 'text/css' };

/**
 * Serves `mounts`, from prefixes to folders or bytes. `fault(request)` may return what goes wrong: a status, or the
 * name of a fault below.
 */
export async function serve(mounts, { fault = () => undefined, cors = true, expose = true, hasTags = true } = {}) {
  const log = [];
  const sockets = new Set();
  let [etag, date] = ['"one"', 'Mon, 01 Jan 2024 00:00:00 GMT'];
  const server = createServer(async (request, response) => {
    const path = decodeURIComponent(new URL(request.url, 'http://x').pathname);
    const wrong = fault({ path, range: request.headers.range, method: request.method, count: log.length });
    log.push({ path, range: request.headers.range, method: request.method });
    if (cors) response.setHeader('Access-Control-Allow-Origin', '*');
    if (cors && expose) response.setHeader('Access-Control-Expose-Headers', 'Content-Range, ETag');
    if (wrong === 'cut') return request.socket.destroy();
    if (wrong === 'hang') return undefined;
    if (wrong === 'redirect') return response.writeHead(302, { Location: `http://localhost:${server.address().port}/moved.lodpack` }).end();
    if (typeof wrong === 'number') return response.writeHead(wrong).end('no');
    const prefix = Object.keys(mounts).filter((mount) => path.startsWith(mount)).sort((a, b) => b.length - a.length)[0];
    const found = await load(mounts[prefix], path.slice(prefix?.length ?? 0));
    if (!found) return response.writeHead(404).end('not found');
    response.setHeader('Content-Type', wrong === 'page' ? 'text/html' : TYPES[extname(path) || '.html'] ?? 'application/octet-stream');
    if (path.endsWith('.lodpack')) response.setHeader('Last-Modified', date);
    if (path.endsWith('.lodpack') && hasTags) response.setHeader('ETag', etag);
    if (request.method === 'HEAD') return response.writeHead(200, { 'Content-Length': found.size }).end();
    const [, first, last] = /^bytes=(\d+)-(\d+)$/.exec(request.headers.range ?? '') ?? [];
    if (wrong === 'gzip-whole') {
      return response.writeHead(200, { 'Content-Encoding': 'gzip' }).end(gzipSync(await found.bytes(0, found.size)));
    }
    if (first === undefined || wrong === 'whole') {
      response.writeHead(200, { 'Content-Length': found.size });
      return response.end(await found.bytes(0, found.size));
    }
    if (Number(first) >= found.size) return response.writeHead(416, { 'Content-Range': `bytes */${found.size}` }).end();
    const end = Math.min(Number(last) + 1, found.size);
    let body = await found.bytes(Number(first), end);
    response.setHeader('Content-Range', `bytes ${first}-${end - 1}/${found.size}`);
    if (wrong === 'gzip') {
      body = gzipSync(body);
      response.setHeader('Content-Encoding', 'gzip');
    }
    if (wrong === 'short') body = body.subarray(0, body.length >> 1);
    if (wrong === 'other') response.setHeader('Content-Range', `bytes 7-${end - Number(first) + 6}/${found.size}`);
    response.writeHead(206, { 'Content-Length': body.length });
    if (wrong === 'half') return response.write(body.subarray(0, body.length >> 1), () => setTimeout(() => response.socket.end(), 50));
    for (let part = 0; wrong === 'drip' && part < 7; part += 1) {
      response.write(body.subarray((part * body.length) >> 3, ((part + 1) * body.length) >> 3));
      await new Promise((resolve) => setTimeout(resolve, 120));
    }
    return response.end(wrong === 'drip' ? body.subarray((7 * body.length) >> 3) : body);
  });
  server.on('connection', (socket) => {
    sockets.add(socket);
    socket.on('close', () => sockets.delete(socket));
  });
  await new Promise((resolve) => server.listen(0, '127.0.0.1', resolve));
  return {
    url: `http://127.0.0.1:${server.address().port}`,
    log,
    connectionCount: () => sockets.size,
    /** From now on the files have another ETag and date. */
    change: () => { [etag, date] = ['"two"', 'Tue, 02 Jan 2024 00:00:00 GMT']; },
    close: () => {
      for (const socket of sockets) socket.destroy();
      return new Promise((resolve) => server.close(resolve));
    },
  };
}

async function load(mount, rest) {
  if (mount === undefined) return undefined;
  if (ArrayBuffer.isView(mount)) return { size: mount.length, bytes: async (begin, end) => Buffer.from(mount.subarray(begin, end)) };
  const path = join(mount, normalize(`/${rest || 'index.html'}`));
  const info = await stat(path).catch(() => undefined);
  if (info?.isDirectory()) return load(mount, `${rest.replace(/\/?$/, '/')}index.html`);
  if (!info?.isFile()) return undefined;
  const bytes = async (begin, end) => (end - begin === info.size ? readFile(path) : Buffer.concat(await createReadStream(path, { start: begin, end: end - 1 }).toArray()));
  return { size: info.size, bytes };
}
