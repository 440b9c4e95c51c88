// What the input named: found, picked, hidden, shown alone. A module of its own, for programs that want it;
// objects.d.ts says what it does.

import { LodpackError } from './errors.js';
import { packQuery } from './query.js';

const NONE = 0xffff_ffff;

/** The objects of an open file; null if it has none. */
export async function objectsOf(file, { signal } = {}) {
  if (file.kind === 'heights') return null;
  const { answer, output } = await file.ask(['objects'], signal);
  return answer ? new Objects(file, ...new Uint32Array(output)) : null;
}

const numbersOf = (nodes, what) => Uint32Array.from(nodes, (node) => {
  const number = node?.number ?? node;
  if (!Number.isInteger(number) || number < 0 || number >= NONE) throw new LodpackError('query', `${what} is a list of objects or their numbers, not of ${node}`);
  return number;
});

export class Objects {
  #file;

  /** @private Use objectsOf(). */
  constructor(file, count, nodeCount) {
    this.#file = file;
    [this.count, this.nodeCount] = [count, nodeCount];
  }

  async #numbers(call, signal) {
    return [...new Uint32Array((await this.#file.ask(call, signal)).output)];
  }

  /** Name, id and parent of some objects and assemblies, in this order. */
  async nodes(numbers, { signal } = {}) {
    const wanted = numbersOf(numbers, 'nodes');
    const { output } = await this.#file.ask(['object_nodes', wanted], signal);
    const words = new Uint32Array(output, 0, 3 * wanted.length);
    let at = words.byteLength;
    const text = (length) => {
      if (length === NONE) return null;
      at += length;
      return new TextDecoder().decode(new Uint8Array(output, at - length, length));
    };
    return Array.from(wanted, (number, k) => {
      const [parent, name, id] = words.subarray(3 * k, 3 * k + 3);
      return { number, name: text(name), id: text(id), parent: parent === NONE ? null : parent, isObject: number < this.count };
    });
  }

  async node(number, options) {
    return (await this.nodes([number], options))[0];
  }

  /** The numbers of what has this name or, if nothing has, this id. */
  async find(text, { signal } = {}) {
    return this.#numbers(['find_objects', new TextEncoder().encode(text)], signal);
  }

  /** What a node consists of, or what is a part of nothing: page by page, as somebody asks. */
  async *children(parent = null, { signal } = {}) {
    const of = parent?.number ?? parent ?? NONE;
    for (const page of await this.#numbers(['object_child_pages', null, of], signal)) {
      yield await this.nodes(await this.#numbers(['object_children', null, of, page], signal), { signal });
    }
  }

  /** What a node is a part of, from the top down. */
  async above(number, { signal } = {}) {
    return this.nodes((await this.#numbers(['objects_above', null, number?.number ?? number], signal)).reverse(), { signal });
  }

  /** A box around nodes and everything below them; null if nothing of them is there. */
  async bounds(nodes, { signal } = {}) {
    const { answer, output } = await this.#file.ask(['object_bounds', numbersOf(nodes, 'nodes')], signal);
    const [a, b, c, d, e, f] = new Float64Array(output);
    return answer ? { min: [a, b, c], max: [d, e, f] } : null;
  }

  /**
   * What is drawn: only some nodes, or all; without hidden ones. Marked ones are drawn as the others are, or alone with
   * `onlyMarked`.
   */
  async filter({ only = null, hidden = [], marked = [], onlyMarked = false, ...more } = {}, { signal } = {}) {
    const extra = Object.keys(more)[0];
    if (extra) throw new LodpackError('query', `a choice of objects has no ${extra}; it has only, hidden, marked, onlyMarked`);
    const list = (nodes, what) => (nodes === null ? [NONE] : [[...nodes].length, ...numbersOf(nodes, what)]);
    const input = Uint32Array.from([onlyMarked ? 1 : 0, ...list(only, 'only'), ...list(hidden, 'hidden'), ...list(marked, 'marked')]);
    const { answer } = await this.#file.ask(['filter_objects', input], signal);
    return new ObjectFilter(this.#file, answer);
  }

  /** Draws this in a stream from the next frame on: a filter, or everything. */
  async show(stream, filter = null) {
    await this.#file.ask(['show_objects', null, numberOf(filter)], undefined, await stream.number);
    stream.notify();
  }

  /** The mesh of a query, of the objects that a filter shows. */
  async extract(query, filter = null, { signal } = {}) {
    const { output } = await this.#file.ask(['extract_objects', packQuery(query), numberOf(filter)], signal);
    const [vertexCount, triangleCount] = new Float64Array(output, 0, 2);
    const triangles = 16 + 24 * vertexCount;
    return {
      positions: new Float64Array(output, 16, 3 * vertexCount),
      triangles: new Uint32Array(output, triangles, 3 * triangleCount),
      triangleNodes: new Uint32Array(output, triangles + 12 * triangleCount, triangleCount),
    };
  }

  /** What a ray meets first of the finest surface, past what a filter hides; null if it meets nothing. */
  async pick({ origin, direction }, filter = null, { signal } = {}) {
    const ray = Float64Array.from([...origin, ...direction]);
    const { answer, output } = await this.#file.ask(['pick', ray, numberOf(filter)], signal);
    if (!answer) return null;
    const [object, root, distance, error, ...point] = new Float64Array(output);
    return { ...await this.node(object, { signal }), root, distance, error, point };
  }
}

/** What is drawn of the objects of a file. Give it back with close(), once no call takes it any more. */
export class ObjectFilter {
  #file;

  /** @private Use objects.filter(). */
  constructor(file, number) {
    this.#file = file;
    this.number = number;
  }

  close() {
    this.#file.ask(['close_filter', null, this.number]).catch(() => {}); // The file may be closed already.
  }
}

const numberOf = (filter) => (filter ? filter.number : NONE);
