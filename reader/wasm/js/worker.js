// The worker: one reader behind messages. remote.js is the other end.

import { Core } from './core.js';
import { aborted, packError, pending, unpackError } from './errors.js';
import { transferOf } from './frame.js';

let core;
let readCount = 0;
const reads = new Map();
const calls = new Map();

const host = {
  /** The page fetches, so sources may be any objects of it. */
  read(offset, length, signal) {
    if (signal?.aborted) return Promise.reject(aborted(signal));
    const read = (readCount += 1);
    const answer = pending(signal, () => {
      postMessage({ abortRead: read });
      reads.delete(read);
    });
    reads.set(read, answer);
    postMessage({ read, offset, length });
    return answer.promise;
  },
  notify: (stream) => postMessage({ progress: stream }),
};

onmessage = ({ data: message }) => {
  if (message.module) {
    core = new Core(message.module, host);
  } else if (message.read !== undefined) {
    const { resolve, reject } = reads.get(message.read) ?? {};
    reads.delete(message.read);
    if (message.error) reject?.(unpackError(message.error));
    else resolve?.(message.bytes);
  } else if (message.abort !== undefined) {
    calls.get(message.abort)?.abort();
  } else {
    answer(message);
  }
};

async function answer({ call, name, args }) {
  const controller = new AbortController();
  calls.set(call, controller);
  try {
    const result = await core[name](args, controller.signal);
    const arrays = Object.values(result ?? {}).filter(ArrayBuffer.isView);
    const transfer = name === 'frame' ? transferOf(result) : [...new Set(arrays.map((array) => array.buffer))];
    postMessage({ call, result }, transfer);
  } catch (error) {
    postMessage({ call, error: packError(error) });
  } finally {
    calls.delete(call);
  }
}
