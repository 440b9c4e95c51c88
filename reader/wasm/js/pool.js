// Geometry and images of many roots in a few buffers, which one call each draws. index.d.ts has more.

import { Atlas, isLarge, planesOf } from './atlas.js';
import { LodpackError } from './errors.js';
import { FreeRanges } from './free-ranges.js';
import { NORMAL_SIZES, putNormals } from './octahedral.js';

const SLAB_VERTICES = 1 << 16;
const SLAB_INDICES = 3 << 17;
/** What roots without an image have: white without opacity. */
const NO_IMAGE = { width: 1, height: 1, data: new Uint8Array([255, 255, 255, 0]), isWhole: true };

/** Buffers that hold some roots. What no root uses draws nothing: its triangles are points. */
export class Slab {
  constructor(vertexCapacity, indexCapacity, { infoSize, infoType, normals, maxTextureSize }, image) {
    this.positions = new Float32Array(3 * vertexCapacity);
    this.normals = normals ? new Int16Array(NORMAL_SIZES[normals] * vertexCapacity) : undefined;
    this.info = infoSize ? new infoType(infoSize * vertexCapacity) : undefined;
    this.indices = new Uint32Array(indexCapacity);
    this.places = image ? new Float32Array(2 * vertexCapacity) : undefined;
    this.rectangles = image ? new Uint16Array(4 * vertexCapacity) : undefined;
    this.atlas = image ? new Atlas(maxTextureSize, image) : undefined;
    this.freeVertices = new FreeRanges(vertexCapacity);
    this.freeIndices = new FreeRanges(indexCapacity);
    this.rootCount = 0;
    this.dirtyVertices = [];
    this.dirtyIndices = [];
    this.drawn = undefined;
  }

  get indexCount() {
    return this.freeIndices.usedEnd(this.indices.length);
  }
}

export class Pool {
  constructor({ infoSize = 0, infoType = Float32Array, infoOf = () => [], normals = undefined, images = false, maxTextureSize = 4096 } = {}) {
    Object.assign(this, { infoSize, infoType, infoOf });
    this.normals = normals;
    Object.assign(this, { images, maxTextureSize });
    this.slabs = [];
    this.roots = new Map();
    this.triangleCount = 0;
    this.onremove = undefined;
  }

  update({ uploads, drops, problems }) {
    for (const root of drops) this.delete(root);
    // All old ones go first, so that new ones find their room.
    const images = uploads.map(({ root, image }) => this.#release(root, image));
    uploads.forEach((upload, k) => this.#add(upload, this.#fitting(upload.root, images[k], problems)));
    this.#removeEmpty();
  }

  get texels() {
    const atlases = this.slabs.map(({ atlas }) => atlas).filter(Boolean);
    const sum = (of) => atlases.reduce((all, atlas) => all + of(atlas), 0);
    return { used: sum(({ usedTexels }) => usedTexels), allocated: sum(({ width, height }) => width * height) };
  }

  /** One empty slab stays for what comes next. */
  #removeEmpty() {
    const empty = this.slabs.filter((slab) => slab.rootCount === 0).slice(this.images ? 0 : 1);
    if (empty.length === 0) return;
    this.slabs = this.slabs.filter((slab) => !empty.includes(slab));
    empty.forEach((slab) => this.onremove?.(slab));
  }

  delete(root) {
    this.#release(root, null);
  }

  /** Takes a root out. Returns its next image: the one it had, if no other is given. */
  #release(root, image) {
    const entry = this.roots.get(root);
    if (!entry) return image;
    const { slab, firstVertex, vertexCount, firstIndex, indexCount, tile } = entry;
    slab.indices.fill(0, firstIndex, firstIndex + indexCount);
    slab.dirtyIndices.push([firstIndex, indexCount]);
    slab.freeVertices.give(firstVertex, vertexCount);
    slab.freeIndices.give(firstIndex, indexCount);
    slab.rootCount -= 1;
    this.roots.delete(root);
    this.triangleCount -= indexCount / 3;
    if (!tile) return image;
    if (image === undefined) return { ...tile, slab };
    slab.atlas.give(tile);
    return image;
  }

  /** An image that no texture has room for becomes a single texel, its mean; those that have a place do fit. */
  #fitting(root, image, problems) {
    if (!this.images) return undefined;
    const { width, height, data, slab } = image ?? NO_IMAGE;
    if (slab || Math.max(width, height) <= this.maxTextureSize) return image ?? NO_IMAGE;
    problems?.push(`root ${root} has an image of ${width}x${height} texels; this device draws ${this.maxTextureSize}x${this.maxTextureSize}`);
    const sums = [0, 0, 0, 0];
    data.forEach((value, k) => { sums[k % 4] += value; });
    return { width: 1, height: 1, data: Uint8Array.from(sums, (sum) => (4 * sum) / data.length), isWhole: true };
  }

  #add({ root, level, error, positions, triangles, normals, places, rectangles }, image) {
    const [vertexCount, indexCount] = [positions.length / 3, triangles.length];
    const { slab, firstVertex, firstIndex, tile } = this.#room(vertexCount, indexCount, image);
    slab.positions.set(positions, 3 * firstVertex);
    if (slab.normals) putNormals(slab.normals, this.normals, firstVertex, vertexCount, normals);
    for (let k = 0; k < indexCount; k += 1) slab.indices[firstIndex + k] = triangles[k] + firstVertex;
    slab.dirtyVertices.push([firstVertex, vertexCount]);
    slab.dirtyIndices.push([firstIndex, indexCount]);
    slab.rootCount += 1;
    const entry = { root, level, error, slab, firstVertex, vertexCount, firstIndex, indexCount, tile, ...boundsOf(positions) };
    this.roots.set(root, entry);
    this.triangleCount += indexCount / 3;
    if (slab.info) this.#inform(entry);
    if (tile) this.#place(entry, tile.isWhole ? undefined : places, rectangles);
  }

  /** Says where the vertices of a root lie in the atlas: those of one without places in the middle of its texel. */
  #place({ slab, firstVertex, vertexCount, tile: { x, y } }, places, rectangles) {
    for (let k = 0; k < vertexCount; k += 1) {
      const vertex = firstVertex + k;
      slab.places[2 * vertex] = x + (places ? places[2 * k] : 0.5);
      slab.places[2 * vertex + 1] = y + (places ? places[2 * k + 1] : 0.5);
      for (let side = 0; side < 4; side += 1) {
        slab.rectangles[4 * vertex + side] = (side % 2 ? y : x) + (places ? rectangles[4 * k + side] : side >> 1);
      }
    }
  }

  #inform(entry) {
    const { slab, firstVertex, vertexCount } = entry;
    const values = this.infoOf(entry);
    for (let k = 0; k < vertexCount; k += 1) slab.info.set(values, this.infoSize * (firstVertex + k));
  }

  refresh() {
    for (const entry of this.roots.values()) {
      this.#inform(entry);
      entry.slab.dirtyVertices.push([entry.firstVertex, entry.vertexCount]);
    }
  }

  /** Room for a root and its image: where the image is already, if there is some. */
  #room(vertexCount, indexCount, image) {
    const slabs = image?.slab ? [image.slab, ...this.slabs.filter((slab) => slab !== image.slab)] : this.slabs;
    for (const slab of slabs) {
      const room = this.#roomIn(slab, vertexCount, indexCount, image);
      if (room) return room;
    }
    // A large image is drawn alone, with some room for the border to change.
    const [vertices, indices] = image && isLarge(image) ? [2 * vertexCount, 2 * indexCount] : [SLAB_VERTICES, SLAB_INDICES];
    const slab = new Slab(Math.max(vertices, vertexCount), Math.max(indices, indexCount), this, image?.slab ? image.slab.atlas.read(image) : image);
    this.slabs.push(slab);
    return this.#roomIn(slab, vertexCount, indexCount, image);
  }

  #roomIn(slab, vertexCount, indexCount, image) {
    // Roots with normals and roots without have materials of their own.
    if (image && slab.atlas.planes !== (image.slab?.atlas.planes ?? planesOf(image))) return null;
    const firstVertex = slab.freeVertices.take(vertexCount);
    const firstIndex = firstVertex < 0 ? -1 : slab.freeIndices.take(indexCount);
    const tile = firstIndex < 0 || !image ? undefined : this.#tileIn(slab, image);
    if (firstIndex >= 0 && tile !== null) return { slab, firstVertex, firstIndex, tile };
    if (firstIndex >= 0) slab.freeIndices.give(firstIndex, indexCount);
    if (firstVertex >= 0) slab.freeVertices.give(firstVertex, vertexCount);
    return null;
  }

  /** The place of an image in a slab: the one it has, or a new one; null if there is no room. */
  #tileIn(slab, image) {
    if (image.slab === slab) return image;
    const tile = slab.atlas.take(image.width, image.height);
    if (!tile) return null;
    slab.atlas.write(tile, image.slab ? image.slab.atlas.read(image) : image);
    image.slab?.atlas.give(image);
    return Object.assign(tile, { isWhole: image.isWhole });
  }

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
