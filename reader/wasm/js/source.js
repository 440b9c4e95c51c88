// Where the bytes are. A source is any object with getBytes(offset, length, signal, etag), after PMTiles' Source.

import { EtagMismatch, LodpackError, SourceError, aborted, checkTag, pending } from './errors.js';
import { isNode, nodeModule } from './wasm.js';

const ADVICE = {
  401: ': it requires a login; use an address that needs none, such as a signed one',
  403: ': it does not let you read this; check your rights, or whether a signed address has expired',
  404: ': the file does not exist; check the address',
  410: ': the file does not exist; check the address',
  408: ': it is overloaded; try again later',
  429: ': it is overloaded; try again later',
};
const advice = (status) => ADVICE[status] ?? (status >= 500 ? ': it failed; try again later, or ask whoever runs it' : '');

/** An attempt that brings as many bytes is no failure: the next one asks for the rest. */
const PROGRESS = 1 << 14;

export class FetchSource {
  #whole; // The file, if the server sends only whole files and it is small enough.
  #size;

  constructor(url, { headers, credentials, cache = 'no-store', timeout = 30_000, attempts = 4, pause = 200, maxWholeBytes = 32 << 20, otherHosts = false } = {}) {
    // Relative addresses are those of the page.
    this.url = new URL(url, globalThis.document?.baseURI ?? globalThis.location?.href).href;
    Object.assign(this, { headers, credentials, cache, timeout, attempts, pause, maxWholeBytes, otherHosts });
  }

  getKey() {
    return this.url;
  }

  async getBytes(offset, length, signal, etag) {
    const begin = () => ({ offset, length, etag, parts: [], bytes: 0 });
    let [cache, failures, got] = [this.cache, 0, begin()];
    for (;;) {
      const before = got.bytes;
      try {
        return await this.#fetch(got, signal, cache);
      } catch (error) {
        if (signal?.aborted) throw aborted(signal);
        if (error instanceof EtagMismatch && cache !== 'reload') {
          // A cache on the way may hold parts of an older file.
          [cache, got] = ['reload', begin()];
          continue;
        }
        failures = got.bytes - before >= PROGRESS ? 1 : failures + 1;
        if (!error.isTransient || failures >= this.attempts) throw error;
      }
      await pauseFor(this.pause * 2 ** (failures - 1), signal);
    }
  }

  /** Asks for what a range lacks. */
  async #fetch(got, signal, cache) {
    const { offset, length, bytes } = got;
    if (this.#whole) return cutOut(this.#whole, offset, length);
    const headers = new Headers(this.headers);
    headers.set('Range', `bytes=${offset + bytes}-${offset + length - 1}`);
    return this.#request({ headers, cache }, signal, async (response, wake) => {
      const { status } = response;
      const size = status === 416 && /^bytes \*\/(\d+)$/.exec(response.headers.get('Content-Range'))?.[1];
      if (status === 206 || status === 200 || size || (status === 416 && offset === 0)) {
        const found = response.headers.get('ETag');
        // A weak tag says nothing about bytes.
        const tag = (found?.startsWith('W/') ? undefined : found) ?? response.headers.get('Last-Modified') ?? undefined;
        checkTag(got.etag, tag);
        got.etag ??= tag;
        if (status === 416) return { data: new ArrayBuffer(0), etag: tag, size: Number(size ?? 0) };
        return status === 206 ? this.#partial(response, got, signal, wake) : this.#entire(response, got, wake);
      }
      const isTransient = [408, 429, 500, 502, 503, 504].includes(status);
      throw new SourceError(`the server answered with status ${status}${advice(status)}`, { status, isTransient });
    });
  }

  async #partial(response, got, signal, wake) {
    const { offset, length } = got;
    const said = response.headers.get('Content-Range');
    const range = /^bytes (\d+)-(\d+)\/(\d+|\*)$/.exec(said ?? '');
    if (said !== null && (!range || Number(range[1]) !== offset + got.bytes || Number(range[2]) >= offset + length)) {
      throw new SourceError(`the server sent a different range than requested: content range ${said}`);
    }
    const encoding = response.headers.get('Content-Encoding');
    if (encoding && encoding !== 'identity') {
      throw new SourceError(`the server compresses ranges (${encoding}), which count other bytes; turn compression off for this file`);
    }
    if (range && range[3] !== '*') {
      const [was, size] = [this.#size, Number(range[3])];
      this.#size = size;
      if (offset > 0 && was !== undefined && was !== size) throw new EtagMismatch(`it had ${was} bytes and has ${size}`);
    }
    await collect(response, got, wake);
    // Pages on other hosts see no Content-Range unless the server exposes it. Content-Length they see.
    this.#size ??= await this.#askSize(signal);
    const expected = Math.min(length, Math.max(this.#size - offset, 0));
    if (got.bytes !== expected) {
      throw new SourceError(
        `the server ended its answer after ${got.bytes} of ${expected} bytes; if it compresses, turn that off for this file`,
        { isTransient: true },
      );
    }
    return { data: joined(got), etag: got.etag, size: this.#size };
  }

  async #askSize(signal) {
    const ask = (response) => Number(response.headers.get('Content-Length') ?? NaN);
    const size = await this.#request({ method: 'HEAD', headers: new Headers(this.headers) }, signal, ask);
    if (Number.isSafeInteger(size)) return size;
    throw new SourceError('the server does not say how large the file is; let it send Access-Control-Expose-Headers: Content-Range, ETag');
  }

  /** The server ignores ranges. A small file is taken whole. */
  async #entire(response, { offset, length, etag }, wake) {
    const kind = response.headers.get('Content-Type') ?? '';
    if (kind.startsWith('text/html')) {
      response.body?.cancel();
      throw new SourceError(
        `the server answered with a web page (${kind}) instead of a file; check the address, and whether it requires a login`,
      );
    }
    const all = { length: this.maxWholeBytes, parts: [], bytes: 0 };
    await collect(response, all, wake).catch((error) => {
      throw error.isTooLong ? new SourceError('the server ignores range requests; copy the file, or serve it from a server that supports them') : error;
    });
    this.#whole = { data: joined(all), etag, size: all.bytes };
    return cutOut(this.#whole, offset, length);
  }

  /** Sends a request. The time limit begins anew with whatever arrives. */
  async #request(options, signal, read) {
    if (signal?.aborted) throw aborted(signal);
    const controller = new AbortController();
    const abort = () => controller.abort();
    signal?.addEventListener('abort', abort);
    let timer;
    const wake = () => {
      clearTimeout(timer);
      timer = setTimeout(abort, this.timeout);
    };
    wake();
    try {
      const response = await fetch(this.url, { ...options, credentials: this.credentials, signal: controller.signal });
      wake();
      if (!this.otherHosts && response.redirected && new URL(response.url).host !== new URL(this.url).host) {
        abort();
        throw new SourceError(`the server redirects to another host; open ${response.url} instead, or set otherHosts`);
      }
      return await read(response, wake);
    } catch (error) {
      if (error instanceof LodpackError) throw error;
      if (signal?.aborted) throw aborted(signal);
      if (controller.signal.aborted) throw new SourceError('the server did not answer in time', { isTransient: true });
      const what = error.cause?.message ?? error.message;
      throw new SourceError(
        `cannot read ${this.url}: the server cannot be reached, closed the connection, compresses ranges, or does not allow this page to read it (CORS): ${what}`,
        { isTransient: true, cause: error },
      );
    } finally {
      clearTimeout(timer);
      signal?.removeEventListener('abort', abort);
    }
  }
}

export class FileSource {
  static #count = 0;
  #key = `blob ${FileSource.#count += 1}`;

  constructor(file) {
    this.file = file;
  }

  getKey() {
    return this.#key;
  }

  async getBytes(offset, length, signal) {
    try {
      const data = await this.file.slice(offset, offset + length).arrayBuffer();
      if (signal?.aborted) throw aborted(signal);
      return { data, size: this.file.size };
    } catch (error) {
      if (signal?.aborted) throw aborted(signal);
      // The file system says so when a file was changed after it had been chosen.
      if (error.name === 'NotReadableError') throw new EtagMismatch('the file on disk is not the one that was chosen');
      throw new SourceError(`cannot read ${this.file.name ?? 'the file'}: ${error.message}`, { cause: error });
    }
  }
}

class PathSource {
  constructor(path) {
    this.path = path;
    this.getKey = () => `path ${path}`;
  }

  async getBytes(offset, length, _signal, etag) {
    let file;
    try {
      file = await (await nodeModule('node:fs/promises')).open(this.path);
      const { size, mtimeMs } = await file.stat();
      const tag = `${size} bytes of ${mtimeMs}`;
      checkTag(etag, tag);
      const data = new Uint8Array(Math.max(Math.min(length, size - offset), 0));
      const { bytesRead } = await file.read(data, 0, data.length, offset);
      return { data: data.buffer.slice(0, bytesRead), etag: tag, size };
    } catch (error) {
      throw error instanceof LodpackError ? error : new SourceError(`cannot read ${this.path}: ${error.message}`, { cause: error });
    } finally {
      await file?.close();
    }
  }
}

export class BytesSource {
  static #count = 0;
  #key = `bytes ${BytesSource.#count += 1}`;

  constructor(bytes) {
    this.bytes = ArrayBuffer.isView(bytes) ? new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength) : new Uint8Array(bytes);
  }

  getKey() {
    return this.#key;
  }

  async getBytes(offset, length) {
    return { data: this.bytes.slice(offset, offset + length).buffer, size: this.bytes.byteLength };
  }
}

/** The source that an argument of open() stands for. */
export function sourceOf(from) {
  if (typeof from === 'string' || from instanceof URL) {
    // One letter is a drive.
    const scheme = /^([a-z][a-z\d+.-]+):/i.exec(from)?.[1];
    if (!isNode || (scheme && scheme !== 'file')) return new FetchSource(from);
    return new PathSource(scheme ? new URL(from) : from);
  }
  if (typeof Blob !== 'undefined' && from instanceof Blob) return new FileSource(from);
  if (from instanceof ArrayBuffer || ArrayBuffer.isView(from)) return new BytesSource(from);
  if (typeof from?.getBytes === 'function') return from;
  throw new LodpackError('query', 'open() takes an address, a path in Node, a File or Blob, bytes, or a source with getBytes()');
}

function cutOut({ data, etag, size }, offset, length) {
  return { data: data.slice(offset, offset + length), etag, size };
}

/** A pause that ends with the call. */
function pauseFor(ms, signal) {
  const end = pending(signal, () => clearTimeout(timer));
  const timer = setTimeout(end.resolve, ms);
  return end.promise;
}

/** Adds an answer's body to what is there, and refuses one that is too long. */
async function collect(response, got, wake) {
  const reader = response.body?.getReader();
  for (let part; reader && !(part = await reader.read()).done; wake()) {
    if (got.bytes + part.value.byteLength > got.length) {
      reader.cancel().catch(() => {});
      throw Object.assign(new SourceError(`the server sent more than the ${got.length} bytes that were asked for`), { isTooLong: true });
    }
    got.parts.push(part.value);
    got.bytes += part.value.byteLength;
  }
}

function joined({ parts, bytes }) {
  const all = new Uint8Array(bytes);
  let at = 0;
  for (const part of parts) {
    all.set(part, at);
    at += part.byteLength;
  }
  return all.buffer;
}
