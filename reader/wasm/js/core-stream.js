// A stream beside its reader: it starts the session's reads, decodes between frames, and answers frames.

import { LodpackError } from './errors.js';
import { OVERVIEW, emptyFrame, unpackFrame } from './frame.js';

/** The longest that decoding keeps a frame waiting, give or take one decoding. */
const TURN_MS = 6;

export class CoreStream {
  #core;
  #host;
  #number;
  #options;
  #stream; // The session's number in the reader, once the index is there.
  #flying = new Map();
  #begun; // Once there is a session, or will be none.
  #failure; // Why there will be no session.
  #overview;
  #hasOverview = false; // Whether whoever draws has the overview.
  #isClosed = false;
  #isWorking = false;
  #timer;

  constructor(core, host, number, begin, overview, options) {
    [this.#core, this.#host, this.#number, this.#options, this.#overview] = [core, host, number, options, overview];
    this.#begun = begin().then(
      (stream) => {
        if (this.#isClosed) return;
        this.#stream = stream;
        host.notify(number);
      },
      (error) => {
        this.#failure = error;
        if (!this.#isClosed) host.notify(number);
      },
    );
  }

  /** Draws a frame: what to upload and to drop since the frame before. Never waits. */
  frame(query) {
    const frame = this.#stream === undefined ? this.#frameBefore() : this.#frameOf(query);
    frame.counters.memoryBytes = this.#core.memoryBytes;
    if (frame.shows === 'overview' && !this.#hasOverview) this.#addOverview(frame);
    if (frame.shows === 'picture' && this.#hasOverview) {
      frame.drops.push(OVERVIEW);
      this.#hasOverview = false;
    }
    return frame;
  }

  #frameBefore() {
    if (this.#failure) throw this.#failure;
    this.#overview = typeof this.#overview === 'function' ? this.#overview() : this.#overview;
    return emptyFrame(this.#overview ? 'overview' : 'nothing');
  }

  #frameOf(query) {
    const core = this.#core;
    core.write(query);
    core.call('frame', this.#stream, performance.now());
    const frame = unpackFrame(core.take());
    if (frame.counters.failures > 0) {
      core.call('problems', this.#stream);
      frame.problems = core.text(0).split('\n').filter(Boolean);
    }
    for (const [read, controller] of this.#flying) {
      if (!core.call('is_wanted', this.#stream, read)) controller.abort();
    }
    this.#work();
    return frame;
  }

  #addOverview(frame) {
    this.#overview = typeof this.#overview === 'function' ? this.#overview() : this.#overview;
    if (!this.#overview) return;
    const { positions, triangles, normals } = this.#overview;
    const near = Float32Array.from(positions, (coordinate, k) => coordinate - this.#options.origin[k % 3]);
    frame.uploads.push({ root: OVERVIEW, level: 0, error: this.#options.overviewError, positions: near, triangles: triangles.slice(), normals: normals?.slice(), image: null });
    frame.triangleCount = triangles.length / 3;
    this.#hasOverview = true;
  }

  /** Does jobs for a while, and goes on after whatever waits. */
  #work() {
    if (this.#isWorking || this.#isClosed) return;
    const core = this.#core;
    const end = performance.now() + TURN_MS;
    let hasDecoded = false;
    for (let job; !this.#isWorking && (job = core.call('poll', this.#stream, performance.now())) !== 0;) {
      if (job === 1) this.#read(...core.floats(0, 3));
      else hasDecoded = true;
      if (performance.now() >= end) {
        this.#isWorking = true;
        soon(() => {
          this.#isWorking = false;
          this.#guard(() => this.#work());
        });
      }
    }
    clearTimeout(this.#timer);
    if (!this.#isWorking && core.call('next_due', this.#stream)) {
      const wait = Math.max(core.floats(0, 1)[0] - performance.now(), 1);
      this.#timer = setTimeout(() => this.#guard(() => this.#work()), wait);
    }
    if (hasDecoded) this.#host.notify(this.#number);
  }

  async #read(read, offset, length) {
    const controller = new AbortController();
    this.#flying.set(read, controller);
    let result;
    let reason;
    try {
      result = await this.#host.read(offset, length, controller.signal);
    } catch (error) {
      reason = error;
    }
    this.#flying.delete(read);
    if (this.#isClosed) return;
    this.#guard(() => {
      this.#core.write(reason ? new TextEncoder().encode(reason.message) : result);
      this.#core.call(reason ? 'fail_read' : 'supply_read', this.#stream, read, performance.now());
      this.#work();
      // The next frame may have to say that something was given up.
      if (reason) this.#host.notify(this.#number);
    });
  }

  /** What fails between frames is thrown by the next one. */
  #guard(action) {
    if (this.#isClosed) return;
    try {
      action();
    } catch (error) {
      this.#stream = undefined;
      this.#failure = error instanceof LodpackError ? error : new LodpackError('internal', error.message, { cause: error });
      this.#host.notify(this.#number);
    }
  }

  /** Says what it shows, and waits for the session that it says it to. */
  set(name, ...args) {
    const call = () => {
      if (this.#stream !== undefined) this.#core.call(name, this.#stream, ...args);
    };
    return this.#stream === undefined ? this.#begun.then(call) : call();
  }

  lose() {
    this.#hasOverview = false;
    if (this.#stream !== undefined) this.#core.call('lose', this.#stream);
  }

  close() {
    if (this.#isClosed) return;
    this.#isClosed = true;
    clearTimeout(this.#timer);
    for (const controller of this.#flying.values()) controller.abort();
    if (this.#stream !== undefined) {
      try {
        this.#core.call('close_stream', this.#stream);
      } catch {
      }
    }
  }
}

const waiting = [];
let channel;

/** Calls after the messages that have arrived. A timer would wait four milliseconds. */
function soon(action) {
  if (globalThis.setImmediate) return setImmediate(action);
  if (!channel) {
    channel = new MessageChannel();
    channel.port1.onmessage = () => waiting.shift()?.();
  }
  waiting.push(action);
  channel.port2.postMessage(null);
}
