// Bytes that several readers want are fetched once, as PMTiles' SharedPromiseCache does. index.d.ts has more.

import { aborted, pending } from './errors.js';

export class SharedPromiseCache {
  #entries = new Map(); // By source, ETag and range; the least recently used first.
  #bytes = 0;

  constructor({ maxBytes = 16 << 20 } = {}) {
    this.maxBytes = maxBytes;
  }

  getBytes(source, offset, length, signal, etag) {
    if (signal?.aborted) return Promise.reject(aborted(signal));
    const key = JSON.stringify([source.getKey?.() ?? keyOf(source), etag ?? null, offset, length]);
    let entry = this.#entries.get(key);
    if (entry) {
      this.#entries.delete(key);
    } else {
      entry = this.#fetch(key, source, offset, length, etag);
    }
    this.#entries.set(key, entry);
    return entry.wait(signal);
  }

  invalidate(source) {
    const prefix = JSON.stringify([source.getKey?.() ?? keyOf(source)]).slice(0, -1);
    for (const key of [...this.#entries.keys()]) {
      if (key.startsWith(`${prefix},`)) this.#remove(key, this.#entries.get(key));
    }
  }

  #fetch(key, source, offset, length, etag) {
    const controller = new AbortController();
    const entry = { bytes: 0, waiting: 0, isDone: false };
    const promise = Promise.resolve(source.getBytes(offset, length, controller.signal, etag)).then(
      (answer) => {
        entry.isDone = true;
        if (this.#entries.get(key) === entry) {
          entry.bytes = answer.data.byteLength;
          this.#bytes += entry.bytes;
          this.#shrink();
        }
        return answer;
      },
      (error) => {
        this.#remove(key, entry);
        throw error;
      },
    );
    promise.catch(() => {}); // Whoever waits hears of it.
    entry.wait = (signal) => {
      entry.waiting += 1;
      const answer = pending(signal, () => {
        entry.waiting -= 1;
        if (entry.waiting > 0 || entry.isDone) return;
        this.#remove(key, entry);
        controller.abort();
      });
      promise.then(answer.resolve, answer.reject);
      return answer.promise;
    };
    return entry;
  }

  #remove(key, entry) {
    if (this.#entries.get(key) !== entry) return;
    this.#entries.delete(key);
    this.#bytes -= entry.bytes;
  }

  #shrink() {
    for (const [key, entry] of this.#entries) {
      if (this.#bytes <= this.maxBytes) return;
      if (entry.isDone) this.#remove(key, entry);
    }
  }
}

const keys = new WeakMap();
let keyCount = 0;

function keyOf(source) {
  if (!keys.has(source)) keys.set(source, `source ${(keyCount += 1)}`);
  return keys.get(source);
}
