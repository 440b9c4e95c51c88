// One instance of the reader, and the loop that fetches what it lacks. Runs in a worker, or where the file was opened.

import { NO_CHANNEL, unpackChannels, unpackTextured } from './channels.js';
import { CoreStream } from './core-stream.js';
import { LodpackError, aborted } from './errors.js';
import { LIMITERS } from './frame.js';

const KINDS = { '-2': 'format', '-3': 'unsupported', '-4': 'query', '-5': 'limit' };
/** The first request: the index of a small file, and all that opening a large one needs, or nearly. */
export const FIRST_READ_BYTES = 8 << 10;
/** Memory of WebAssembly is scarce, so parts may be smaller than other readers allow. */
const PART_BYTES = 1 << 28;

/** Bytes must be read before a call can succeed. */
class Missing extends Error {
  constructor(ranges) {
    super('bytes must be read first');
    this.ranges = ranges;
  }
}

export class Core {
  #exports;
  #dead;
  #closed = new AbortController();
  #streams = new Map();
  #streamCount = 0;
  #channels = [];
  #isOfHeights = false;
  #id = '';
  #host;

  /** `host.read(offset, length, signal)` fetches; `host.notify(stream)` hears that a stream has decoded something. */
  constructor(module, host) {
    this.#host = host;
    this.#exports = new WebAssembly.Instance(module).exports;
  }

  /** Opens the file, whose first bytes have been read. Returns what its index says at once. */
  async open({ data, size, limits }, signal) {
    this.write(data);
    this.call('start', size, limits?.partBytes ?? PART_BYTES);
    await this.#until(() => this.call('finish'), (offset) => this.call('insert', offset), signal);
    this.#isOfHeights = this.call('info') === 1;
    const info = { kind: this.#isOfHeights ? 'heights' : 'mesh', ...this.#info(), heights: this.#isOfHeights ? this.#heights() : null };
    this.#id = info.id;
    const count = this.call('channels');
    this.#channels = unpackChannels(this.floats(0, 7 * count), this.text(56 * count));
    return { ...info, channels: this.#channels };
  }

  /** Where the ground of a mesh lies, and where the mesh is; null without a ground. */
  async ground() {
    if (this.#isOfHeights || !this.call('ground')) return null;
    const [offset, length] = this.floats(0, 2);
    return { offset, length, place: this.take(16) };
  }

  async groundFrame({ place }) {
    this.write(place);
    this.call('ground_frame');
    return this.floats(0, 25);
  }

  async overview() {
    return this.call('overview', 0) ? this.#mesh() : null;
  }

  async select({ query, level }, signal) {
    return this.#ask((question) => {
      if (query) this.write(query);
      const nodeCount = query ? this.call('select', question) : this.call('uniform_cut', level);
      const [error, pixelError, triangleCount, byteCount, limiter] = this.floats(0, 5);
      const nodeErrors = this.floats(40, nodeCount);
      const nodes = this.words(40 + 8 * nodeCount, (this.#isOfHeights ? 4 : 2) * nodeCount);
      const errorEverywhere = nodeErrors.reduce((most, error) => Math.max(most, error), error);
      return { nodes, nodeErrors, error, errorEverywhere, pixelError, triangleCount, byteCount, limitedBy: LIMITERS[limiter], file: this.#id };
    }, signal);
  }

  async extract({ nodes }, signal) {
    return this.#ask((question) => {
      this.write(nodes);
      this.call('extract', question);
      return this.#mesh(this.#isOfHeights);
    }, signal);
  }

  async extractTextured({ nodes, channels, pageSize }, signal) {
    const input = Uint32Array.from([...channels, ...nodes]);
    return this.#ask((question) => {
      this.write(input);
      const pageCount = this.call('extract_textured', question, channels.length, pageSize);
      return unpackTextured(this.take(), pageCount, channels.map((channel) => this.#channels[channel]));
    }, signal);
  }

  async channelRange({ channel }, signal) {
    return this.#ask((question) => (this.call('channel_range', question, channel) ? [...this.floats(0, 2)] : null), signal);
  }

  async boundaryEdgeCount({ nodes }, signal) {
    return this.#ask(() => {
      this.write(nodes);
      this.call('boundary_edge_count');
      return this.floats(0, 1)[0];
    }, signal);
  }

  /** Opens a stream. Its frames show the overview until the whole index is there. */
  async openStream(options) {
    const number = (this.#streamCount += 1);
    const begin = () => this.#ask(() => {
      const { byteCache, decodedCache, texelCache, texelsPerPixel, maxReads, ahead, light, origin, uploadBytes } = options;
      return this.call('open_stream', byteCache, decodedCache, texelCache, texelsPerPixel, maxReads, ahead, light ? 1 : 0, ...origin, uploadBytes);
    });
    const overview = () => (this.call('overview', options.light ? 1 : 0) ? this.#mesh() : null);
    this.#streams.set(number, new CoreStream(this, this.#host, number, begin, overview, options));
    return number;
  }

  async frame({ stream, query }) {
    return this.#stream(stream).frame(query);
  }

  async show({ stream, channel, range, beside }, signal) {
    const isNone = channel === NO_CHANNEL;
    const hasRamp = !isNone && !['colour', 'normal', 'label', 'factor', 'drawing'].includes(this.#channels[channel].kind);
    const values = hasRamp ? range ?? (await this.channelRange({ channel }, signal)) : null;
    this.#stream(stream).set('show', channel, ...(values ?? [0, 1]), beside);
    return values;
  }

  /** Any call: to a stream, or of a question what it says. */
  async ask({ call: [name, input, ...args], stream }, signal) {
    if (stream) return this.#stream(stream).set(name, ...args);
    return this.#ask((question) => {
      if (input) this.write(input);
      return { answer: this.call(name, question, ...args), output: this.take() };
    }, signal);
  }

  async lose({ stream }) {
    this.#stream(stream).lose();
  }

  async closeStream({ stream }) {
    this.#streams.get(stream)?.close();
    this.#streams.delete(stream);
  }

  close() {
    for (const stream of this.#streams.values()) stream.close();
    this.#streams.clear();
    this.#dead ??= new LodpackError('closed', 'the file has been closed');
    this.#closed.abort(this.#dead);
  }

  #stream(number) {
    if (this.#dead) throw this.#dead;
    const stream = this.#streams.get(number);
    if (!stream) throw new LodpackError('closed', 'the stream has been closed');
    return stream;
  }

  call(name, ...args) {
    if (this.#dead) throw this.#dead;
    let answer;
    try {
      answer = this.#exports[`lodpack_${name}`](...args);
    } catch (error) {
      // A trap: memory is short, or there is a mistake in the reader. Either way the instance is lost.
      const what = `the reader stopped (${error.message}); the file may need more memory than there is`;
      this.#dead = new LodpackError('internal', what, { cause: error });
      throw this.#dead;
    }
    if (answer >= 0) return answer;
    if (answer === -1) {
      const numbers = this.floats(0, this.#exports.lodpack_output_length() / 8);
      throw new Missing(Array.from({ length: numbers.length / 2 }, (_, k) => [numbers[2 * k], numbers[2 * k + 1]]));
    }
    throw new LodpackError(KINDS[answer] ?? 'internal', this.text(0));
  }

  write(data) {
    if (this.#dead) throw this.#dead;
    const bytes = ArrayBuffer.isView(data) ? new Uint8Array(data.buffer, data.byteOffset, data.byteLength) : new Uint8Array(data);
    const at = this.#exports.lodpack_input(bytes.length) >>> 0;
    if (at === 0) throw new LodpackError('limit', `there is no memory for ${bytes.length} bytes`);
    new Uint8Array(this.#exports.memory.buffer, at, bytes.length).set(bytes);
  }

  take(from = 0, length = this.#exports.lodpack_output_length() - from) {
    const at = (this.#exports.lodpack_output() >>> 0) + from;
    const buffer = this.#exports.memory.buffer.slice(at, at + length);
    if (length > 1 << 20) this.#exports.lodpack_forget();
    return buffer;
  }

  get memoryBytes() {
    return this.#exports.memory.buffer.byteLength;
  }

  floats(from, count) {
    return new Float64Array(this.#copy(from, 8 * count));
  }

  words(from, count) {
    return new Uint32Array(this.#copy(from, 4 * count));
  }

  text(from) {
    return new TextDecoder().decode(this.#copy(from, this.#exports.lodpack_output_length() - from));
  }

  #copy(from, length) {
    const at = (this.#exports.lodpack_output() >>> 0) + from;
    return this.#exports.memory.buffer.slice(at, at + length);
  }

  #info() {
    const [major, minor, rootCount, topCount, levelCount, first, second, axis] = this.floats(0, 8);
    const numbers = this.floats(64, 16 + 4 * levelCount);
    const known = (number) => (Number.isNaN(number) ? undefined : number);
    const bounds = Number.isNaN(numbers[0]) ? null : { min: [...numbers.subarray(0, 3)], max: [...numbers.subarray(3, 6)] };
    const levels = Array.from({ length: levelCount }, (_, level) => {
      const [tolerance, maxError, triangleCount, pageBytes] = numbers.subarray(16 + 4 * level);
      return { tolerance, maxError, triangleCount, pageBytes };
    });
    const overviewSummary = Number.isNaN(numbers[10]) ? null : { error: numbers[10], triangleCount: numbers[11] };
    const source = known(numbers[12]) === undefined ? null : {
      triangleCount: numbers[12], vertexCount: numbers[13], meanEdgeLength: numbers[14], area: numbers[15],
      generator: this.text(64 + 8 * numbers.length),
    };
    const id = [first, second].map((number) => number.toString(16).padStart(8, '0')).join('');
    return { id, up: [null, 'y', 'z'][axis], version: `${major}.${minor}`, rootCount, topCount, bounds, lattice: { origin: [...numbers.subarray(6, 9)], step: numbers[9] }, levels, overviewSummary, source };
  }

  #heights() {
    this.call('heights');
    const [columns, rows, wraps, isGlobe, depthCount, x, y, dx, dy, step, sampleError, unit, scale] = this.floats(0, 13);
    return {
      columns, rows, wraps: wraps === 1, isGlobe: isGlobe === 1, depthCount, first: [x, y], spacing: [dx, dy], step, sampleError,
      unit: Number.isNaN(unit) ? null : unit, scale, ramp: this.text(104),
    };
  }

  /** A mesh. Of heights also the normal of each vertex and, with a ramp, its colour, as screens show it. */
  #mesh(isOfHeights = false) {
    const [vertexCount, triangleCount] = this.floats(0, 2);
    const buffer = this.take(16);
    let at = 0;
    const part = (type, count) => {
      const array = new type(buffer, at, count);
      at += array.byteLength;
      return array;
    };
    const mesh = {
      positions: part(Float64Array, 3 * vertexCount),
      triangles: part(Uint32Array, 3 * triangleCount),
      triangleNodes: part(Uint32Array, triangleCount),
    };
    if (!isOfHeights) return at < buffer.byteLength ? { ...mesh, normals: part(Int16Array, 2 * vertexCount) } : mesh;
    const normals = part(Float32Array, 3 * vertexCount);
    return { ...mesh, normals, colors: at < buffer.byteLength ? part(Uint8Array, 4 * vertexCount) : null };
  }

  /** Calls until nothing is missing. Bytes fetched for one answer are dropped after it; what the index says stays. */
  async #ask(attempt, signal) {
    const question = this.call('ask');
    try {
      const tell = (offset) => this.call('tell', question, offset);
      return await this.#until(() => attempt(question), tell, signal, () => this.call('supply', question));
    } finally {
      if (!this.#dead) this.call('close_question', question);
    }
  }

  async #until(attempt, insert, signal, afterwards) {
    for (let last = ''; ;) {
      if (signal?.aborted) throw aborted(signal);
      try {
        return attempt();
      } catch (error) {
        if (!(error instanceof Missing)) throw error;
        const wanted = String(error.ranges);
        if (wanted === last) throw new LodpackError('format', 'damaged file: it asks for the same bytes again');
        last = wanted;
        await this.#fetch(error.ranges, insert, signal);
        afterwards?.();
      }
    }
  }

  /** Reads all ranges at once. If one fails, the others are aborted. */
  async #fetch(ranges, insert, signal) {
    const controller = new AbortController();
    const signals = [signal, this.#closed.signal].filter(Boolean);
    const abort = ({ target }) => controller.abort(target.reason);
    for (const each of signals) each.addEventListener('abort', abort);
    try {
      await Promise.all(ranges.map(async ([begin, end]) => {
        const data = await this.#host.read(begin, end - begin, controller.signal);
        this.write(data);
        insert(begin);
      }));
    } catch (error) {
      controller.abort(error);
      throw error;
    } finally {
      for (const each of signals) each.removeEventListener('abort', abort);
    }
  }
}
