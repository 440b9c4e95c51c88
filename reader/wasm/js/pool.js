// Geometry of many roots in a few buffers: what three.js and WebGL draw with one call each.

import { LodpackError } from './errors.js';

const SLAB_VERTICES = 1 << 16;
const SLAB_INDICES = 3 << 17;

/** Free ranges of a buffer, ascending, none beginning where another ends. */
class FreeRanges {
  constructor(length) {
    this.ranges = [[0, length]];
  }

  /** The first place that is large enough, or -1. */
  take(count) {
    const { ranges } = this;
    const k = ranges.findIndex(([begin, end]) => end - begin >= count);
    if (k < 0) return -1;
    const [begin, end] = ranges[k];
    if (end - begin === count) ranges.splice(k, 1);
    else ranges[k] = [begin + count, end];
    return begin;
  }

  give(begin, count) {
    if (count === 0) return;
    const { ranges } = this;
    let k = ranges.findIndex(([next]) => next > begin);
    if (k < 0) k = ranges.length;
    ranges.splice(k, 0, [begin, begin + count]);
    if (ranges[k + 1]?.[0] === ranges[k][1]) ranges.splice(k, 2, [begin, ranges[k + 1][1]]);
    if (k > 0 && ranges[k - 1][1] === begin) ranges.splice(k - 1, 2, [ranges[k - 1][0], ranges[k][1]]);
  }

  /** Where the last range that is in use ends. */
  usedEnd(length) {
    const last = this.ranges.at(-1);
    return last?.[1] === length ? last[0] : length;
  }
}

/** Buffers that hold some roots. What no root uses draws nothing: its triangles are points. */
export class Slab {
  constructor(vertexCapacity, indexCapacity, { infoSize, infoType }) {
    this.positions = new Float32Array(3 * vertexCapacity);
    this.info = infoSize ? new infoType(infoSize * vertexCapacity) : undefined;
    this.indices = new Uint32Array(indexCapacity);
    this.freeVertices = new FreeRanges(vertexCapacity);
    this.freeIndices = new FreeRanges(indexCapacity);
    this.rootCount = 0;
    /** Ranges of vertices and indices that changed since whoever draws has emptied these lists: first, count. */
    this.dirtyVertices = [];
    this.dirtyIndices = [];
    /** Kept by whoever draws. */
    this.drawn = undefined;
  }

  /** How many indices have to be drawn. */
  get indexCount() {
    return this.freeIndices.usedEnd(this.indices.length);
  }
}

/** All roots that are drawn, in slabs. */
export class Pool {
  constructor({ infoSize = 0, infoType = Float32Array, infoOf = () => [] } = {}) {
    /** Numbers of each vertex beside its position: what `infoOf` returns for its root. */
    Object.assign(this, { infoSize, infoType, infoOf });
    this.slabs = [];
    this.roots = new Map();
    this.triangleCount = 0;
    /** Called with a slab that is no longer drawn, to give its GPU memory back. */
    this.onremove = undefined;
  }

  /** Takes what a frame changes. */
  update({ uploads, drops }) {
    for (const root of drops) this.delete(root);
    // All old ones go first, so that new ones find their room.
    for (const { root } of uploads) this.delete(root);
    for (const upload of uploads) this.#add(upload);
    this.#removeEmpty();
  }

  /** One empty slab stays for what comes next. */
  #removeEmpty() {
    const empty = this.slabs.filter((slab) => slab.rootCount === 0).slice(1);
    if (empty.length === 0) return;
    this.slabs = this.slabs.filter((slab) => !empty.includes(slab));
    empty.forEach((slab) => this.onremove?.(slab));
  }

  delete(root) {
    const entry = this.roots.get(root);
    if (!entry) return;
    const { slab, firstVertex, vertexCount, firstIndex, indexCount } = entry;
    slab.indices.fill(0, firstIndex, firstIndex + indexCount);
    slab.dirtyIndices.push([firstIndex, indexCount]);
    slab.freeVertices.give(firstVertex, vertexCount);
    slab.freeIndices.give(firstIndex, indexCount);
    slab.rootCount -= 1;
    this.roots.delete(root);
    this.triangleCount -= indexCount / 3;
  }

  #add({ root, level, error, positions, triangles }) {
    const [vertexCount, indexCount] = [positions.length / 3, triangles.length];
    const { slab, firstVertex, firstIndex } = this.#room(vertexCount, indexCount);
    slab.positions.set(positions, 3 * firstVertex);
    for (let k = 0; k < indexCount; k += 1) slab.indices[firstIndex + k] = triangles[k] + firstVertex;
    slab.dirtyVertices.push([firstVertex, vertexCount]);
    slab.dirtyIndices.push([firstIndex, indexCount]);
    slab.rootCount += 1;
    const entry = { root, level, error, slab, firstVertex, vertexCount, firstIndex, indexCount, ...boundsOf(positions) };
    this.roots.set(root, entry);
    this.triangleCount += indexCount / 3;
    if (slab.info) this.#inform(entry);
  }

  #inform(entry) {
    const { slab, firstVertex, vertexCount } = entry;
    const values = this.infoOf(entry);
    for (let k = 0; k < vertexCount; k += 1) slab.info.set(values, this.infoSize * (firstVertex + k));
  }

  /** Asks `infoOf` again for all roots. */
  refresh() {
    for (const entry of this.roots.values()) {
      this.#inform(entry);
      entry.slab.dirtyVertices.push([entry.firstVertex, entry.vertexCount]);
    }
  }

  #room(vertexCount, indexCount) {
    for (const slab of this.slabs) {
      const firstVertex = slab.freeVertices.take(vertexCount);
      if (firstVertex < 0) continue;
      const firstIndex = slab.freeIndices.take(indexCount);
      if (firstIndex >= 0) return { slab, firstVertex, firstIndex };
      slab.freeVertices.give(firstVertex, vertexCount);
    }
    const slab = new Slab(Math.max(SLAB_VERTICES, vertexCount), Math.max(SLAB_INDICES, indexCount), this);
    this.slabs.push(slab);
    return { slab, firstVertex: slab.freeVertices.take(vertexCount), firstIndex: slab.freeIndices.take(indexCount) };
  }

  /** The nearest point that a ray meets, or null. `direction` has any length; `distance` counts its lengths. */
  raycast(origin, direction) {
    if (![...origin, ...direction].every(Number.isFinite)) throw new LodpackError('query', 'a ray has to be finite');
    let nearest = null;
    for (const entry of this.roots.values()) {
      if (!meetsBox(origin, direction, entry.min, entry.max, nearest?.distance ?? Infinity)) continue;
      const { slab: { positions, indices }, firstIndex, indexCount } = entry;
      for (let k = firstIndex; k < firstIndex + indexCount; k += 3) {
        const distance = meetTriangle(origin, direction, positions, indices[k], indices[k + 1], indices[k + 2]);
        if (distance < (nearest?.distance ?? Infinity)) nearest = { distance, entry, triangle: [indices[k], indices[k + 1], indices[k + 2]] };
      }
    }
    if (!nearest) return null;
    const point = origin.map((x, axis) => x + nearest.distance * direction[axis]);
    return { ...nearest, point };
  }
}

function boundsOf(positions) {
  const [min, max] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  for (let k = 0; k < positions.length; k += 3) {
    for (let axis = 0; axis < 3; axis += 1) {
      const x = positions[k + axis];
      if (x < min[axis]) min[axis] = x;
      if (x > max[axis]) max[axis] = x;
    }
  }
  return { min, max };
}

function meetsBox(origin, direction, min, max, most) {
  let [enter, leave] = [0, most];
  for (let axis = 0; axis < 3; axis += 1) {
    if (direction[axis] === 0) {
      if (origin[axis] < min[axis] || origin[axis] > max[axis]) return false;
      continue;
    }
    const a = (min[axis] - origin[axis]) / direction[axis];
    const b = (max[axis] - origin[axis]) / direction[axis];
    enter = Math.max(enter, Math.min(a, b));
    leave = Math.min(leave, Math.max(a, b));
  }
  return enter <= leave;
}

/** Moeller and Trumbore 1997, both sides. Infinity if the ray misses. */
function meetTriangle(o, d, p, i, j, k) {
  const [ax, ay, az] = [p[3 * i], p[3 * i + 1], p[3 * i + 2]];
  const [ux, uy, uz] = [p[3 * j] - ax, p[3 * j + 1] - ay, p[3 * j + 2] - az];
  const [vx, vy, vz] = [p[3 * k] - ax, p[3 * k + 1] - ay, p[3 * k + 2] - az];
  const [hx, hy, hz] = [d[1] * vz - d[2] * vy, d[2] * vx - d[0] * vz, d[0] * vy - d[1] * vx];
  const determinant = ux * hx + uy * hy + uz * hz;
  if (determinant === 0) return Infinity;
  const [sx, sy, sz] = [o[0] - ax, o[1] - ay, o[2] - az];
  const u = (sx * hx + sy * hy + sz * hz) / determinant;
  if (u < 0 || u > 1) return Infinity;
  const [qx, qy, qz] = [sy * uz - sz * uy, sz * ux - sx * uz, sx * uy - sy * ux];
  const v = (d[0] * qx + d[1] * qy + d[2] * qz) / determinant;
  if (v < 0 || u + v > 1) return Infinity;
  const distance = (vx * qx + vy * qy + vz * qz) / determinant;
  return distance > 0 ? distance : Infinity;
}
