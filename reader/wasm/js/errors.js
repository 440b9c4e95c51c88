// Errors by culprit, like those of the reader: `kind` says who has to act.

/** Why a call failed. `kind` is one of the names in index.d.ts. */
export class LodpackError extends Error {
  constructor(kind, message, options) {
    super(message, options);
    this.name = 'LodpackError';
    this.kind = kind;
  }
}

export class SourceError extends LodpackError {
  constructor(message, { isTransient = false, status, cause } = {}) {
    super('source', message, cause === undefined ? undefined : { cause });
    this.name = 'SourceError';
    this.isTransient = isTransient;
    this.status = status;
  }
}

export class EtagMismatch extends SourceError {
  constructor(what) {
    super(`the file changed while it was read (${what}); open it again`);
    this.name = 'EtagMismatch';
    this.kind = 'changed';
  }
}

/** Refuses another tag of the same kind: ETags have quotes, dates have none. */
export function checkTag(etag, found) {
  if (etag && found && etag !== found && etag.startsWith('"') === found.startsWith('"')) throw new EtagMismatch(`it was ${etag} and is ${found}`);
}

/** What a worker can send: errors lose their class on the way. */
export function packError(error) {
  const { name, message, kind, isTransient, status, what } = error ?? {};
  return { name, message: message ?? String(error), kind, isTransient, status, what };
}

export function unpackError({ name, message, kind, isTransient, status }) {
  if (name === 'AbortError') return new DOMException(message, 'AbortError');
  const error = kind === 'source' ? new SourceError(message, { isTransient, status })
    : kind === 'changed' ? Object.assign(new EtagMismatch(''), { message })
      : new LodpackError(kind ?? 'internal', message);
  return error;
}

export function aborted(signal) {
  return signal?.reason ?? new DOMException('the call was aborted', 'AbortError');
}

/** A promise to be settled by its own functions, or by an abort, which calls `leave` first. */
export function pending(signal, leave) {
  const it = {};
  it.promise = new Promise((resolve, reject) => {
    const abort = () => {
      leave();
      it.reject(aborted(signal));
    };
    const end = (settle) => (value) => {
      signal?.removeEventListener('abort', abort);
      settle(value);
    };
    Object.assign(it, { resolve: end(resolve), reject: end(reject) });
    signal?.addEventListener('abort', abort);
  });
  return it;
}
