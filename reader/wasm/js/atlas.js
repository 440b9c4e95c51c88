// Images of many roots in one texture. index.d.ts has more.

import { FreeRanges } from './free-ranges.js';

/** Texels in a row, and the most rows. */
const SIDE = 2048;
/** An image of more texels gets a texture of its own, of just its size. */
const OWN_TEXELS = 1 << 18;
/** Rows at first; they double as they are needed. */
const FIRST_HEIGHT = 256;
/** Rows of shelves are multiples of it, so that images of similar heights share them. */
const STEP = 16;

export function isLarge({ width, height }) {
  return width * height > OWN_TEXELS;
}

/**
 * What an image may have beside its size, four numbers a texel each: colours as screens show them (RGBA); normals,
 * whose components from -1 to 1 are bytes or half floats from 0 to 1, with a 1; occlusion, roughness and metalness; and
 * emitted light.
 */
export const PLANES = ['data', 'normals', 'material', 'emissive'];

/** What images have that go into one atlas, as text. */
export const planesOf = (image) => PLANES.filter((name) => image[name]).map((name) => `${name} ${image[name].BYTES_PER_ELEMENT}`).join();

/** Images in shelves: rows of the texture, each as high as its first image. */
export class Atlas {
  #shelves = []; // From the top: { y, height, free, tiles }.

  /** A texture for an image, and for more with the same planes. */
  constructor(maxSize, image) {
    const { width, height } = image;
    const isOwn = isLarge(image) || Math.max(width, height) > SIDE;
    [this.width, this.maxHeight] = isOwn ? [width, height] : [Math.min(SIDE, maxSize), Math.min(SIDE, maxSize)];
    this.height = isOwn ? height : Math.min(FIRST_HEIGHT, this.maxHeight);
    this.planes = planesOf(image);
    for (const name of PLANES) this[name] = image[name] && new image[name].constructor(4 * this.width * this.height);
    this.generation = 0;
    this.dirtyTiles = [];
    this.usedTexels = 0;
  }

  take(width, height) {
    if (width > this.width || height > this.maxHeight) return null;
    const rows = Math.min(Math.ceil(height / STEP) * STEP, this.maxHeight);
    // The lowest shelf that fits, but none that wastes more than half of its rows on it.
    const fitting = this.#shelves.filter((shelf) => shelf.height >= height && (shelf.height <= 2 * rows || shelf.tiles === 0));
    fitting.sort((a, b) => a.height - b.height);
    for (const shelf of fitting) {
      const x = shelf.free.take(width);
      if (x >= 0) return this.#tile(this.#cut(shelf, rows), x, width, height);
    }
    const y = this.#end();
    if (y + rows > this.maxHeight) return null;
    const shelf = { y, height: rows, free: new FreeRanges(this.width), tiles: 0 };
    this.#shelves.push(shelf);
    this.#grow(y + rows);
    return this.#tile(shelf, shelf.free.take(width), width, height);
  }

  /** An empty shelf that is higher than needed becomes two. */
  #cut(shelf, rows) {
    if (shelf.tiles === 0 && shelf.height > rows) {
      const rest = { y: shelf.y + rows, height: shelf.height - rows, free: new FreeRanges(this.width), tiles: 0 };
      this.#shelves.splice(this.#shelves.indexOf(shelf) + 1, 0, rest);
      shelf.height = rows;
    }
    return shelf;
  }

  #tile(shelf, x, width, height) {
    shelf.tiles += 1;
    this.usedTexels += width * height;
    return { shelf, x, y: shelf.y, width, height };
  }

  #end() {
    const last = this.#shelves.at(-1);
    return last ? last.y + last.height : 0;
  }

  #grow(rows) {
    if (rows <= this.height) return;
    while (this.height < rows) this.height = Math.min(2 * this.height, this.maxHeight);
    for (const name of PLANES.filter((name) => this[name])) {
      const all = new this[name].constructor(4 * this.width * this.height);
      all.set(this[name]);
      this[name] = all;
    }
    this.generation += 1;
    this.dirtyTiles.length = 0;
  }

  give({ shelf, x, width, height }) {
    shelf.free.give(x, width);
    shelf.tiles -= 1;
    this.usedTexels -= width * height;
    // Empty shelves side by side are one, and the last ones are none.
    for (let k = this.#shelves.length - 2; k >= 0; k -= 1) {
      const [above, below] = [this.#shelves[k], this.#shelves[k + 1]];
      if (above.tiles > 0 || below.tiles > 0) continue;
      above.height += below.height;
      this.#shelves.splice(k + 1, 1);
    }
    if (this.#shelves.at(-1)?.tiles === 0) this.#shelves.pop();
  }

  write(tile, image) {
    for (const name of PLANES.filter((name) => this[name])) {
      this.#rows(tile, (begin, length, row) => this[name].set(image[name].subarray(row * length, (row + 1) * length), begin));
    }
    this.dirtyTiles.push(tile);
  }

  read(tile) {
    const image = { width: tile.width, height: tile.height };
    for (const name of PLANES.filter((name) => this[name])) {
      const data = new this[name].constructor(4 * tile.width * tile.height);
      this.#rows(tile, (begin, length, row) => data.set(this[name].subarray(begin, begin + length), row * length));
      image[name] = data;
    }
    return image;
  }

  #rows({ x, y, width, height }, visit) {
    for (let row = 0; row < height; row += 1) visit(4 * ((y + row) * this.width + x), 4 * width, row);
  }
}
