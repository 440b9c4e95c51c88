// The texture of a slab for three.js, and the material that draws with it.

import { DataTexture, LinearFilter, NearestFilter, RGBAFormat, SRGBColorSpace, UnsignedByteType } from 'three';

/** Rows that are uploaded one by one. More are uploaded with all others at once. */
const FEW_ROWS = 256;

export class SlabTexture {
  #atlas;
  #generation;
  #isWhole = true; // Whether all of it waits to be uploaded.
  #material;
  #version; // Of the program's material.

  constructor(atlas, isBlended) {
    this.#atlas = atlas;
    const { data, width, height } = atlas;
    this.texture = new DataTexture(data, width, height, RGBAFormat, UnsignedByteType);
    this.texture.colorSpace = SRGBColorSpace;
    this.texture.onUpdate = () => { this.#isWhole = false; };
    this.blend(isBlended);
    this.#fit();
  }

  #uploadAll() {
    this.texture.clearUpdateRanges?.();
    this.texture.needsUpdate = this.#isWhole = true;
  }

  /** Whether something lies between two texels. */
  blend(isBlended) {
    this.texture.minFilter = this.texture.magFilter = isBlended ? LinearFilter : NearestFilter;
    this.#uploadAll();
  }

  /** Coordinates are texels, so a texture that grows changes none of them. */
  #fit() {
    const { data, width, height, generation, dirtyTiles } = this.#atlas;
    if (this.#generation !== undefined) this.texture.dispose(); // Its size changes.
    this.texture.image = { data, width, height };
    this.texture.repeat.set(1 / width, 1 / height);
    this.#uploadAll();
    this.#generation = generation;
    dirtyTiles.length = 0;
  }

  /** Hands new images to three.js. */
  upload() {
    const { dirtyTiles, width, generation } = this.#atlas;
    if (generation !== this.#generation) return this.#fit();
    if (dirtyTiles.length === 0) return undefined;
    const { texture } = this;
    const rows = dirtyTiles.reduce((sum, tile) => sum + tile.height, texture.updateRanges?.length ?? 0);
    // three.js knows ranges of rows since release 166, and only for WebGL.
    if (rows > FEW_ROWS || this.#isWhole || !texture.addUpdateRange) {
      this.#uploadAll();
    } else {
      for (const tile of dirtyTiles) {
        for (let row = tile.y; row < tile.y + tile.height; row += 1) texture.addUpdateRange(4 * (row * width + tile.x), 4 * tile.width);
      }
      texture.needsUpdate = true;
    }
    dirtyTiles.length = 0;
    return undefined;
  }

  /** A program's material with this texture; its own one, where it has no use for it. */
  materialLike(material) {
    if (!('map' in material)) return material;
    if (this.#material?.constructor !== material.constructor) {
      this.#material?.dispose();
      this.#material = material.clone();
    } else {
      // Whatever the program has changed.
      this.#material.copy(material);
    }
    const { onBeforeCompile, customProgramCacheKey, version } = material;
    if (version !== this.#version) this.#material.needsUpdate = true;
    this.#version = version;
    return Object.assign(this.#material, { map: this.texture, onBeforeCompile, customProgramCacheKey });
  }

  dispose() {
    this.texture.dispose();
    this.#material?.dispose();
  }
}
