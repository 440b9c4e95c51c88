// Errors by culprit, like those of the reader: `kind` says who has to act.

/** Why a call failed. `kind` is one of the names in index.d.ts. */
export class LodpackError extends Error {
  constructor(kind, message, options) {
    super(message, options);
    this.name = 'LodpackError';
    this.kind = kind;
  }
}

/** The bytes could not be read. */
export class SourceError extends LodpackError {
  constructor(message, { isTransient = false, status, cause } = {}) {
    super('source', message, cause === undefined ? undefined : { cause });
    this.name = 'SourceError';
    this.isTransient = isTransient;
    this.status = status;
  }
}

/** The file at this address is no longer the one that was opened. */
export class EtagMismatch extends SourceError {
  constructor(what) {
    super(`the file changed while it was read (${what}); open it again`);
    this.name = 'EtagMismatch';
    this.kind = 'changed';
  }
}

/** What a worker can send: errors lose their class on the way. */
export function packError(error) {
  const { name, message, kind, isTransient, status, what } = error ?? {};
  return { name, message: message ?? String(error), kind, isTransient, status, what };
}

/** The error that was packed. */
export function unpackError({ name, message, kind, isTransient, status }) {
  if (name === 'AbortError') return new DOMException(message, 'AbortError');
  const error = kind === 'source' ? new SourceError(message, { isTransient, status })
    : kind === 'changed' ? Object.assign(new EtagMismatch(''), { message })
      : new LodpackError(kind ?? 'internal', message);
  return error;
}

/** What a call that was aborted rejects with. */
export function aborted(signal) {
  return signal?.reason ?? new DOMException('the call was aborted', 'AbortError');
}
