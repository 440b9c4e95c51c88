// Where the bytes are. A source is any object with getBytes(offset, length, signal, etag), after PMTiles' Source.

import { EtagMismatch, LodpackError, SourceError, aborted } from './errors.js';

const ADVICE = {
  401: ': it requires a login; use an address that needs none, such as a signed one',
  403: ': it does not let you read this; check your rights, or whether a signed address has expired',
  404: ': the file does not exist; check the address',
  410: ': the file does not exist; check the address',
  408: ': it is overloaded; try again later',
  429: ': it is overloaded; try again later',
};
const advice = (status) => ADVICE[status] ?? (status >= 500 ? ': it failed; try again later, or ask whoever runs it' : '');

/** A file on a web server that supports range requests. */
export class FetchSource {
  #whole; // The file, if the server sends only whole files and it is small enough.
  #size;

  constructor(url, { headers, credentials, cache = 'no-store', timeout = 30_000, attempts = 4, pause = 200, maxWholeBytes = 32 << 20 } = {}) {
    // Relative addresses are those of the page.
    this.url = new URL(url, globalThis.document?.baseURI ?? globalThis.location?.href).href;
    Object.assign(this, { headers, credentials, cache, timeout, attempts, pause, maxWholeBytes });
  }

  getKey() {
    return this.url;
  }

  /** Returns these bytes, fewer where the file ends, with the file's ETag and size as far as the server says them. */
  async getBytes(offset, length, signal, etag) {
    let pause = this.pause;
    for (let attempt = 1; ; attempt += 1) {
      try {
        return await this.#fetch(offset, length, signal, etag, false);
      } catch (error) {
        if (signal?.aborted) throw aborted(signal);
        if (error instanceof EtagMismatch && attempt === 1) {
          // A cache on the way may hold parts of an older file.
          return await this.#fetch(offset, length, signal, etag, true);
        }
        if (!error.isTransient || attempt >= this.attempts) throw error;
      }
      await new Promise((resolve) => setTimeout(resolve, pause));
      pause *= 2;
    }
  }

  async #fetch(offset, length, signal, etag, isReload) {
    if (this.#whole) return cutOut(this.#whole, offset, length);
    const headers = new Headers(this.headers);
    headers.set('Range', `bytes=${offset}-${offset + length - 1}`);
    return this.#request({ headers, cache: isReload ? 'reload' : this.cache }, signal, async (response) => {
      const found = response.headers.get('ETag') ?? undefined;
      // A weak tag says nothing about bytes.
      const tag = found?.startsWith('W/') ? undefined : found;
      if (etag && tag && etag !== tag) throw new EtagMismatch(`its ETag was ${etag} and is ${tag}`);
      switch (response.status) {
        case 206: return this.#partial(response, offset, length, tag, signal);
        case 200: return this.#entire(response, offset, length, tag);
        case 416: {
          const size = /^bytes \*\/(\d+)$/.exec(response.headers.get('Content-Range') ?? '')?.[1];
          if (size !== undefined || offset === 0) return { data: new ArrayBuffer(0), etag: tag, size: Number(size ?? 0) };
        }
      }
      const { status } = response;
      const isTransient = [408, 429, 500, 502, 503, 504].includes(status);
      throw new SourceError(`the server answered with status ${status}${advice(status)}`, { status, isTransient });
    });
  }

  async #partial(response, offset, length, etag, signal) {
    const said = response.headers.get('Content-Range');
    const range = /^bytes (\d+)-(\d+)\/(\d+|\*)$/.exec(said ?? '');
    if (said !== null && (!range || Number(range[1]) !== offset || Number(range[2]) >= offset + length)) {
      throw new SourceError(`the server sent a different range than requested: content range ${said}`);
    }
    const encoding = response.headers.get('Content-Encoding');
    if (encoding && encoding !== 'identity') {
      throw new SourceError(`the server compresses ranges (${encoding}), which count other bytes; turn compression off for this file`);
    }
    const data = await body(response, length);
    const expected = range ? Number(range[2]) + 1 - offset : length;
    if (range && range[3] !== '*') this.#size = Number(range[3]);
    // Pages on other hosts see no Content-Range unless the server exposes it. Content-Length they see.
    this.#size ??= await this.#askSize(signal);
    if (data.byteLength !== Math.min(expected, Math.max(this.#size - offset, 0))) {
      throw new SourceError(
        `the server ended its answer after ${data.byteLength} of ${expected} bytes; if it compresses, turn that off for this file`,
        { isTransient: true },
      );
    }
    return { data, etag, size: this.#size };
  }

  async #askSize(signal) {
    const ask = (response) => Number(response.headers.get('Content-Length') ?? NaN);
    const size = await this.#request({ method: 'HEAD', headers: new Headers(this.headers) }, signal, ask);
    if (Number.isSafeInteger(size)) return size;
    throw new SourceError('the server does not say how large the file is; let it send Access-Control-Expose-Headers: Content-Range, ETag');
  }

  /** The server ignores ranges. A small file is taken whole. */
  async #entire(response, offset, length, etag) {
    const kind = response.headers.get('Content-Type') ?? '';
    if (kind.startsWith('text/html')) {
      response.body?.cancel();
      throw new SourceError(
        `the server answered with a web page (${kind}) instead of a file; check the address, and whether it requires a login`,
      );
    }
    const whole = await body(response, this.maxWholeBytes).catch((error) => {
      throw error.isTooLong ? new SourceError('the server ignores range requests; copy the file, or serve it from a server that supports them') : error;
    });
    this.#whole = { data: whole, etag, size: whole.byteLength };
    return cutOut(this.#whole, offset, length);
  }

  /** Sends a request. The time limit includes reading the answer. */
  async #request(options, signal, read) {
    if (signal?.aborted) throw aborted(signal);
    const controller = new AbortController();
    const abort = () => controller.abort();
    signal?.addEventListener('abort', abort);
    const timer = setTimeout(abort, this.timeout);
    try {
      const response = await fetch(this.url, { ...options, credentials: this.credentials, signal: controller.signal });
      return await read(response);
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

/** A file that somebody chose or dropped, or any other Blob. */
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

/** Bytes in memory. */
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
  if (typeof from === 'string' || from instanceof URL) return new FetchSource(from);
  if (typeof Blob !== 'undefined' && from instanceof Blob) return new FileSource(from);
  if (from instanceof ArrayBuffer || ArrayBuffer.isView(from)) return new BytesSource(from);
  if (typeof from?.getBytes === 'function') return from;
  throw new LodpackError('query', 'open() takes an address, a File or Blob, bytes, or a source with getBytes()');
}

function cutOut({ data, etag, size }, offset, length) {
  return { data: data.slice(offset, offset + length), etag, size };
}

/** An answer's body, refused if it is longer than this. */
async function body(response, most) {
  const parts = [];
  let length = 0;
  const reader = response.body?.getReader();
  for (let part; reader && !(part = await reader.read()).done;) {
    length += part.value.byteLength;
    if (length > most) {
      reader.cancel().catch(() => {});
      throw Object.assign(new SourceError(`the server sent more than the ${most} bytes that were asked for`), { isTooLong: true });
    }
    parts.push(part.value);
  }
  const all = new Uint8Array(length);
  let at = 0;
  for (const part of parts) {
    all.set(part, at);
    at += part.byteLength;
  }
  return all.buffer;
}
