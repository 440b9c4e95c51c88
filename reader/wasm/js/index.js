// lodpack: streams and draws any part of a huge triangle mesh, at any certified error.

export { SharedPromiseCache } from './cache.js';
export { EtagMismatch, LodpackError, SourceError } from './errors.js';
export { LodpackFile, Stream, open } from './file.js';
export { OVERVIEW } from './frame.js';
export { Pool } from './pool.js';
export { SharedBudget } from './shared-budget.js';
export { BytesSource, FetchSource, FileSource } from './source.js';
export { loadModule } from './wasm.js';
