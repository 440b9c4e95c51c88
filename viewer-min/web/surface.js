// A surface in the picture: a mesh, heights, or the heights that a mesh stands on, which have a space of their own.

import { Pool } from 'lodpack';
import { add, unit } from './camera.js';

const IMAGES = { label: 'classes', drawing: 'classes', normal: 'directions' };
/** Caches of a mesh and of its ground: together they take what a file alone takes. */
const HALF = { byteCache: 32 << 20, decodedCache: 128 << 20, texelCache: 64 << 20 };

export class Surface {
  /** The surfaces of an open file: one, or a mesh and its ground. */
  static async allOf(file, renderer, signal) {
    const ground = await file.ground({ signal });
    try {
      const files = ground ? [file, ground] : [file];
      return await Promise.all(files.map(async (file) => new Surface(file, await file.stream({ light: true, ...(ground ? HALF : {}) }), renderer)));
    } catch (error) {
      ground?.close();
      throw error;
    }
  }

  constructor(file, stream, renderer) {
    const { maxTextureSize } = renderer;
    Object.assign(this, { file, stream, renderer });
    this.pool = new Pool({ infoSize: 2, infoOf: ({ level, error }) => [level, error], normals: file.storesNormals ? undefined : 'octahedral', images: file.channels.length > 0 || file.kind === 'heights', maxTextureSize });
    this.pool.onremove = (slab) => renderer.forget(slab);
  }

  close() {
    this.pool.slabs.forEach((slab) => this.renderer.forget(slab));
    this.file.close();
  }

  /** A second one of the same file, in one colour, for what is selected in it. Ends without the file. */
  async above() {
    const stream = await this.file.stream({ light: true, byteCache: 8 << 20, decodedCache: 32 << 20 });
    return Object.assign(new Surface(this.file, stream, this.renderer), { isMarked: true });
  }

  end() {
    this.pool.slabs.forEach((slab) => this.renderer.forget(slab));
    this.stream.close();
  }

  /** The box around it in the space of the picture, or null. */
  get bounds() {
    const { file: { bounds, frame } } = this;
    if (!bounds || !frame) return bounds;
    const ends = [frame.point(bounds.min), frame.point(bounds.max)];
    const by = (of) => [0, 1, 2].map((axis) => of(ends[0][axis], ends[1][axis]));
    return { min: by(Math.min), max: by(Math.max) };
  }

  /** Asks for what a view of the picture needs, of so many triangles at most. */
  ask(view, maxTriangles) {
    return this.stream.frame({ view: this.file.frame?.view(view) ?? view, ...(maxTriangles === undefined ? {} : { maxTriangles }) });
  }

  /** Shows a channel if it has one of this name; another surface has, if not. */
  show(name, range) {
    const isOwn = name === 'none' || this.file.channels.some((channel) => channel.name === name);
    return this.stream.show(isOwn ? name : 'auto', { range: isOwn ? range : undefined, normals: true });
  }

  /** What the renderer draws. */
  drawn(camera) {
    const { file: { frame, heights, levels }, stream: { channel, origin }, pool } = this;
    const own = frame ? {
      position: frame.pointOfGround(camera.position), axes: camera.axes.map((axis) => unit(frame.offsetOfGround(axis))), near: camera.near / frame.scale,
    } : camera;
    return { pool, origin, camera: own, levelCount: heights?.depthCount ?? levels.length, isMarked: this.isMarked, image: channel ? IMAGES[channel.kind] ?? 'colours' : undefined };
  }

  /**
   * The nearest point that a ray meets, or null. Distances are counted in lengths of the direction, and so are the same
   * in both spaces.
   */
  pick(from, direction) {
    const { file: { frame }, stream: { origin }, pool } = this;
    const [start, along] = frame ? [frame.pointOfGround(from), frame.offsetOfGround(direction)] : [from, direction];
    const hit = pool.raycast(start.map((value, axis) => value - origin[axis]), along);
    return hit && { ...hit, surface: this };
  }

  /** Where a hit is in the space of the picture, and how far the surface there can be from the input. */
  place({ point, entry }) {
    const { file: { frame }, stream: { origin } } = this;
    // What is drawn is nowhere farther from the input than the certified error. Rounding the vertices adds half a unit
    // in the last place on each axis, and finding the point no more than that.
    const rounding = Math.hypot(...entry.min.map((low, axis) => Math.max(Math.abs(low), Math.abs(entry.max[axis])) * 2 ** -23));
    const there = add(point, origin);
    return { point: frame?.point(there) ?? there, error: (entry.error + rounding) * (frame?.scale ?? 1) };
  }
}

/** What the frames of all surfaces say together. */
export function joinedFrames(frames) {
  const [first] = frames;
  const sum = (of) => frames.reduce((all, frame) => all + of(frame), 0);
  return {
    ...first,
    shows: frames.every(({ shows }) => shows === 'picture') ? 'picture' : first.shows,
    isComplete: frames.every(({ isComplete }) => isComplete),
    errorPx: Math.max(...frames.map(({ errorPx }) => errorPx)),
    lateRoots: sum(({ lateRoots }) => lateRoots),
    lateImages: sum(({ lateImages }) => lateImages),
    hasChanges: frames.some(({ uploads, drops }) => uploads.length + drops.length > 0),
    problems: frames.flatMap(({ problems }) => problems),
  };
}
