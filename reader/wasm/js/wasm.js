// The WebAssembly module: fetched and compiled once, and shared with all workers.

import { LodpackError } from './errors.js';

let shared;

export const isNode = Boolean(globalThis.process?.versions?.node) && !globalThis.document;
/** A module of Node. Bundlers for browsers would look for a name that is written where it is imported. */
export const nodeModule = (name) => import(/* @vite-ignore */ name);

/**
 * The compiled module. `wasm` may be its address, its bytes, or a module; without it the file beside this one is used.
 */
export function loadModule(wasm) {
  if (wasm instanceof WebAssembly.Module) return Promise.resolve(wasm);
  if (wasm instanceof ArrayBuffer || ArrayBuffer.isView(wasm)) return WebAssembly.compile(wasm);
  if (wasm) return compile(new URL(wasm, globalThis.document?.baseURI ?? globalThis.location?.href));
  shared ??= compile(new URL('../lodpack.wasm', import.meta.url)).catch((error) => {
    shared = undefined; // The next call may have more luck.
    throw error;
  });
  return shared;
}

async function compile(url) {
  if (url.protocol === 'file:') {
    const { readFile } = await nodeModule('node:fs/promises');
    return WebAssembly.compile(await readFile(url));
  }
  let response;
  try {
    response = await fetch(url);
  } catch (error) {
    throw new LodpackError('source', `cannot load ${url}: ${error.message}`, { cause: error });
  }
  if (!response.ok) throw new LodpackError('source', `cannot load ${url}: the server answered with status ${response.status}`);
  const type = response.headers.get('Content-Type') ?? '';
  // Other types cannot be compiled while they arrive.
  if (WebAssembly.compileStreaming && type.startsWith('application/wasm')) return WebAssembly.compileStreaming(response);
  return WebAssembly.compile(await response.arrayBuffer());
}
