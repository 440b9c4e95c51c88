// The reader as the page sees it: in a worker behind messages, or on the same thread.

import { Core } from './core.js';
import { LodpackError, aborted, packError, pending, unpackError } from './errors.js';
import { loadModule } from './wasm.js';

/** A reader in a worker of its own if there are workers, unless `worker` is false. */
export async function startReader(host, { worker = typeof Worker === 'function' && typeof window !== 'undefined', wasm } = {}) {
  const module = await loadModule(wasm);
  return worker ? new WorkerReader(module, host) : new LocalReader(module, host);
}

class LocalReader {
  #core;

  constructor(module, host) {
    this.#core = new Core(module, host);
  }

  async call(name, args, signal) {
    if (signal?.aborted) throw aborted(signal);
    return this.#core[name](args, signal);
  }

  close() {
    this.#core.close();
  }
}

class WorkerReader {
  #worker;
  #host;
  #calls = new Map();
  #callCount = 0;
  #reads = new Map();
  #end;

  constructor(module, host) {
    this.#host = host;
    this.#worker = startWorker();
    this.#worker.onmessage = ({ data }) => this.#take(data);
    this.#worker.onerror = (event) => {
      event.preventDefault?.();
      const what = event.message ?? 'its script cannot be loaded; the page may forbid workers (Content-Security-Policy: worker-src)';
      this.#finish(new LodpackError('internal', `the worker that reads the file stopped: ${what}`));
    };
    this.#worker.postMessage({ module });
  }

  call(name, args, signal) {
    if (this.#end) return Promise.reject(this.#end);
    if (signal?.aborted) return Promise.reject(aborted(signal));
    const call = (this.#callCount += 1);
    const answer = pending(signal, () => {
      this.#worker.postMessage({ abort: call });
      this.#calls.delete(call);
    });
    this.#calls.set(call, answer);
    this.#worker.postMessage({ call, name, args });
    return answer.promise;
  }

  #take(message) {
    if (message.read !== undefined) {
      this.#read(message);
    } else if (message.abortRead !== undefined) {
      this.#reads.get(message.abortRead)?.abort();
    } else if (message.progress !== undefined) {
      this.#host.notify(message.progress);
    } else {
      const { resolve, reject } = this.#calls.get(message.call) ?? {};
      this.#calls.delete(message.call);
      if (message.error) reject?.(unpackError(message.error));
      else resolve?.(message.result);
    }
  }

  async #read({ read, offset, length }) {
    const controller = new AbortController();
    this.#reads.set(read, controller);
    let answer;
    try {
      answer = { read, bytes: await this.#host.read(offset, length, controller.signal) };
    } catch (error) {
      answer = { read, error: packError(error) };
    }
    this.#reads.delete(read);
    // Bytes are copied, because a cache may share them.
    if (!this.#end) this.#worker.postMessage(answer);
  }

  #finish(error) {
    this.#end ??= error;
    this.#worker.terminate();
    for (const controller of this.#reads.values()) controller.abort();
    for (const { reject } of this.#calls.values()) reject(this.#end);
    this.#calls.clear();
  }

  close() {
    this.#finish(new LodpackError('closed', 'the file has been closed'));
  }
}

function startWorker() {
  try {
    // Bundlers look for exactly this expression.
    return new Worker(new URL('./worker.js', import.meta.url), { type: 'module' });
  } catch (error) {
    if (error.name !== 'SecurityError') throw error;
  }
  // A worker's script has to come from the page's own host. One that only imports it may. (In a variable:
  // bundlers would put the script in its place.)
  const name = './worker.js';
  const text = `import ${JSON.stringify(new URL(name, import.meta.url).href)};`;
  const shim = URL.createObjectURL(new Blob([text], { type: 'text/javascript' }));
  const worker = new Worker(shim, { type: 'module' });
  setTimeout(() => URL.revokeObjectURL(shim), 60_000);
  return worker;
}
