// Objects: what the input of a file named, with the tree that it gave. A module of its own: `import { objectsOf } from
// 'lodpack/objects'`. It needs lodpack.wasm; lodpack-geometry.wasm knows no objects.

import type { LodpackFile, Mesh, Query, Stream } from 'lodpack';

/** What the input named: an object, which has a surface, or an assembly, which only holds others. */
export interface ObjectNode {
  readonly number: number;
  /** May repeat. */
  readonly name: string | null;
  /** What other programs know it by; may repeat. */
  readonly id: string | null;
  readonly parent: number | null;
  readonly isObject: boolean;
}

/** What is drawn of objects. Numbers and nodes stand for themselves and everything below them. */
export interface ObjectChoice {
  /** Nothing but these; null, the default, for everything. */
  only?: Iterable<number | ObjectNode> | null;
  /** Without these, even if they are in `only`. */
  hidden?: Iterable<number | ObjectNode>;
  /** A selection: with `onlyMarked` a filter shows what of it is drawn, alone, to draw it over the rest. */
  marked?: Iterable<number | ObjectNode>;
  onlyMarked?: boolean;
}

/** What a ray meets. */
export interface ObjectHit extends ObjectNode {
  readonly root: number;
  /** From the ray's origin, in units of the file. */
  readonly distance: number;
  /** Bound of the distance between the surface that was met and the input. */
  readonly error: number;
  readonly point: number[];
}

interface Cancel {
  signal?: AbortSignal;
}

/** The objects of an open file; null if it has none. */
export function objectsOf(file: LodpackFile, options?: Cancel): Promise<Objects | null>;

export class Objects {
  private constructor();
  /** Objects have the numbers from 0; assemblies follow. */
  readonly count: number;
  readonly nodeCount: number;
  node(number: number, options?: Cancel): Promise<ObjectNode>;
  /** Many at once, in this order. */
  nodes(numbers: Iterable<number | ObjectNode>, options?: Cancel): Promise<ObjectNode[]>;
  /** The numbers of what has exactly this name or, if nothing has, this id. */
  find(text: string, options?: Cancel): Promise<number[]>;
  /** What a node consists of, or without one what is a part of nothing: page by page, each read when asked for. */
  children(parent?: number | ObjectNode | null, options?: Cancel): AsyncGenerator<ObjectNode[]>;
  /** What a node is a part of, from the top down. */
  above(number: number | ObjectNode, options?: Cancel): Promise<ObjectNode[]>;
  /** A box around nodes with everything below them. */
  bounds(nodes: Iterable<number | ObjectNode>, options?: Cancel): Promise<{ min: [number, number, number]; max: [number, number, number] } | null>;
  /** A filter, which is found once; giving it to a stream reads nothing. */
  filter(choice: ObjectChoice, options?: Cancel): Promise<ObjectFilter>;
  /** Draws what a filter shows, or everything, in a stream from the next frame on. */
  show(stream: Stream, filter?: ObjectFilter | null): Promise<void>;
  /** The mesh of a query, of what a filter shows. */
  extract(query: Query, filter?: ObjectFilter | null, options?: Cancel): Promise<Mesh>;
  /** What a ray meets first of the finest surface, past what a filter hides. */
  pick(ray: { origin: ArrayLike<number> & Iterable<number>; direction: ArrayLike<number> & Iterable<number> }, filter?: ObjectFilter | null, options?: Cancel): Promise<ObjectHit | null>;
}

export class ObjectFilter {
  private constructor();
  readonly number: number;
  /** Gives it back. Streams that show it keep it. */
  close(): void;
}
