// An open file, and its streams. index.d.ts says what they do.

import { SharedPromiseCache } from './cache.js';
import { channelNumber, channelNumbers, checkedRange } from './channels.js';
import { FIRST_READ_BYTES } from './core.js';
import { EtagMismatch, LodpackError, SourceError, checkTag } from './errors.js';
import { GroundFrame } from './ground.js';
import { packQuery } from './query.js';
import { startReader } from './remote.js';
import { sourceOf } from './source.js';

const sharedCache = new SharedPromiseCache();

export async function open(from, options = {}) {
  const source = sourceOf(from);
  const cache = options.cache ?? sharedCache;
  try {
    return await LodpackFile.open(source, cache, options);
  } catch (error) {
    if (!(error instanceof EtagMismatch)) throw error;
    // The cache had the beginning of an older file.
    cache.invalidate(source);
    return LodpackFile.open(source, cache, options);
  }
}

export class LodpackFile {
  #reader;
  #streams = new Map();
  #reading;
  #options;

  /** @private Use open(). */
  static async open(source, cache, options) {
    const { signal, limits, firstReadBytes = FIRST_READ_BYTES } = options;
    if (!(firstReadBytes > 0)) throw new LodpackError('query', 'firstReadBytes has to be more than zero');
    const reading = { source, cache, etag: undefined, head: undefined, size: 0, failure: undefined, requests: 0, bytes: 0 };
    const file = new LodpackFile(reading);
    // The first bytes come while the module is compiled.
    const begin = read(reading, 0, firstReadBytes, signal);
    begin.catch(() => {}); // Reported below.
    file.#reader = await startReader({
      read: (offset, length, signal) => readRest(reading, offset, length, signal),
      notify: (stream) => file.#streams.get(stream)?.notify(),
    }, options);
    try {
      const { data, size = data.byteLength < firstReadBytes ? data.byteLength : await source.getSize?.(signal), etag } = await begin;
      if (size === undefined) throw new SourceError('the source does not say how large the file is: getBytes() has to return size');
      [reading.etag, reading.head, reading.size] = [etag, new Uint8Array(data), size];
      file.byteLength = size;
      Object.assign(file, await file.#reader.call('open', { data, size, limits }, signal));
      file.#options = options;
      return file;
    } catch (error) {
      file.close();
      throw error;
    }
  }

  constructor(reading) {
    this.#reading = reading;
  }

  get traffic() {
    const { requests, bytes } = this.#reading;
    return { requests, bytes };
  }

  get failure() {
    return this.#reading.failure;
  }

  async ground({ signal } = {}) {
    const part = await this.#reader.call('ground', {}, signal);
    if (!part) return null;
    // It is read as a part of this file, whose cache is enough.
    const getBytes = async (at, length, signal) => (
      { size: part.length, data: await readRest(this.#reading, part.offset + at, Math.min(length, part.length - at), signal) });
    const ground = await LodpackFile.open({ getBytes }, new SharedPromiseCache({ maxBytes: 0 }), { ...this.#options, signal });
    try {
      ground.frame = new GroundFrame(await ground.#reader.call('groundFrame', part, signal));
      return ground;
    } catch (error) {
      ground.close();
      throw error;
    }
  }

  overview() {
    return this.#reader.call('overview');
  }

  async select(query, { signal } = {}) {
    return this.#reader.call('select', { query: packQuery(query) }, signal);
  }

  async selectLevel(level, { signal } = {}) {
    if (!Number.isInteger(level) || level < 0) throw new LodpackError('query', 'a level is a whole number from 0');
    return this.#reader.call('select', { level }, signal);
  }

  async extract(cut, { signal, channels = 'none', pageSize = 4096 } = {}) {
    const [nodes, numbers] = [this.#nodesOf(cut), channelNumbers(this.channels, channels)];
    // Meshes of heights have the colours of a ramp anyway.
    if (numbers.length === 0 || this.kind === 'heights') return this.#reader.call('extract', { nodes }, signal);
    if (!(pageSize >= 1 && pageSize <= 65536)) throw new LodpackError('query', 'pageSize is a number of texels, up to 65536');
    return this.#reader.call('extractTextured', { nodes, channels: numbers, pageSize: Math.floor(pageSize) }, signal);
  }

  async channelRange(name, { signal } = {}) {
    const [channel] = channelNumbers(this.channels, [name]);
    return channel === undefined ? null : this.#reader.call('channelRange', { channel }, signal);
  }

  async boundaryEdgeCount(cut, { signal } = {}) {
    return this.#reader.call('boundaryEdgeCount', { nodes: this.#nodesOf(cut) }, signal);
  }

  /** The nodes of a cut of this file. Those that were put together by hand may leave out which file they are for. */
  #nodesOf(cut) {
    if (!(cut?.nodes instanceof Uint32Array)) {
      throw new LodpackError('query', 'a cut comes from select() or selectLevel(): its nodes are a Uint32Array');
    }
    if (cut.file !== undefined && cut.file !== this.id) {
      throw new LodpackError('query', 'this cut is one of another file; select it in this one');
    }
    return cut.nodes;
  }

  /** @private */
  ask(call, signal, stream) {
    return this.#reader.call('ask', { call, stream }, signal);
  }

  get storesNormals() {
    return this.kind === 'heights' || this.channels.some(({ kind }) => kind === 'normal');
  }

  async stream(options = {}) {
    const stream = this.streamLater(options);
    await stream.ready;
    return stream;
  }

  /** @private A stream whose calls wait until it is open. */
  streamLater(options) {
    const middle = this.bounds ? this.bounds.min.map((low, axis) => (low + this.bounds.max[axis]) / 2) : [0, 0, 0];
    const { origin = middle, byteCache = 64 << 20, decodedCache = 256 << 20, texelCache = 128 << 20, texelsPerPixel = 1, maxReads = 6, ahead = 300, uploadBytes = Infinity } = options;
    const { channel = 'none', range, normals, materials } = options;
    const light = Boolean(options.light) && !this.storesNormals;
    channelNumber(this.channels, channel); // Before anything is started.
    const overviewError = this.overviewSummary?.error ?? Infinity;
    const number = this.#reader.call('openStream', { origin, byteCache, decodedCache, texelCache, texelsPerPixel, maxReads, ahead, light, uploadBytes, overviewError });
    const stream = new Stream(this.#reader, this.#reading, number, origin, this.channels, (number) => this.#streams.delete(number));
    stream.ready = number.then((number) => {
      this.#streams.set(number, stream);
      if (channel !== 'none' && channel !== null) return stream.show(channel, { range, normals, materials });
    });
    return stream;
  }

  close() {
    this.#reader?.close();
    this.#streams.clear();
  }
}

export class Stream {
  #reader;
  #reading;
  #channels;
  #closed;

  /** @private Use file.stream(). */
  constructor(reader, reading, number, origin, channels, closed) {
    [this.#reader, this.#reading, this.number, this.#channels, this.#closed] = [reader, reading, number, channels, closed];
    this.origin = origin;
    this.channel = null;
    this.range = null;
    this.onprogress = undefined;
  }

  async frame(query) {
    const { failure } = this.#reading;
    const frame = await this.#reader.call('frame', { stream: await this.number, query: packQuery(query) });
    if (failure) frame.problems.push(failure.message);
    return frame;
  }

  async show(channel, { range, normals = false, materials = false, signal } = {}) {
    const number = channelNumber(this.#channels, channel, normals ? 'normal' : undefined);
    const beside = (normals ? 1 : 0) + (materials && this.#channels[number]?.kind === 'colour' ? 2 : 0);
    const values = await this.#reader.call('show', { stream: await this.number, channel: number, range: checkedRange(range), beside }, signal);
    [this.channel, this.range] = [this.#channels[number] ?? null, values];
    this.notify();
  }

  async lose() {
    return this.#reader.call('lose', { stream: await this.number });
  }

  async retry() {
    return this.#reader.call('ask', { stream: await this.number, call: ['retry'] });
  }

  notify() {
    this.onprogress?.();
  }

  close() {
    this.number.then((stream) => {
      this.#closed(stream);
      return this.#reader.call('closeStream', { stream });
    }).catch(() => {}); // The file may be closed already.
  }
}

async function read(reading, offset, length, signal) {
  if (reading.failure) throw reading.failure;
  const { source, cache, etag } = reading;
  reading.requests += 1;
  reading.bytes += length;
  try {
    const answer = await cache.getBytes(source, offset, length, signal, etag);
    checkTag(etag, answer.etag);
    return answer;
  } catch (error) {
    if (error instanceof EtagMismatch) {
      reading.failure = error;
      cache.invalidate(source);
    }
    throw error;
  }
}

/** Reads all of a range, without what came with opening: Chrome's cache asks the server about overlaps first. */
async function readRest(reading, offset, length, signal) {
  const begin = Math.min(offset + length, Math.max(offset, reading.head.length));
  const known = reading.head.slice(offset, begin);
  const rest = offset + length - begin;
  if (offset + length > reading.size) {
    throw new LodpackError('format', `damaged file: the file is truncated (${length} bytes at offset ${offset})`);
  }
  if (rest === 0) return known.buffer;
  const { data } = await read(reading, begin, rest, signal);
  if (data.byteLength !== rest) throw new SourceError(`the source returned ${data.byteLength} of ${rest} bytes`, { isTransient: true });
  if (known.length === 0) return data;
  const all = new Uint8Array(length);
  all.set(known);
  all.set(new Uint8Array(data), known.length);
  return all.buffer;
}
