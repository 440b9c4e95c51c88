// The texture of a slab for three.js, and the material that draws with it.

import {
  DataTexture, HalfFloatType, LinearFilter, NearestFilter, NoColorSpace, ObjectSpaceNormalMap, RGBAFormat, SRGBColorSpace, UnsignedByteType,
} from 'three';

/** Rows that are uploaded one by one. More are uploaded with all others at once. */
const FEW_ROWS = 256;

/** The properties of an atlas that textures show, and those of materials that show them. */
const PLANES = [
  { texels: 'data', map: 'map', type: UnsignedByteType, colorSpace: SRGBColorSpace },
  { texels: 'normals', map: 'normalMap', type: HalfFloatType, colorSpace: NoColorSpace },
];

/** The textures of a slab: of colours, of normals, or of both. */
export class SlabTexture {
  #atlas;
  #planes;
  #material;
  #version; // Of the program's material.

  constructor(atlas, isBlended) {
    this.#atlas = atlas;
    this.#planes = PLANES.filter(({ texels }) => atlas[texels]).map((plane) => new Plane(atlas, plane));
    this.blend(isBlended);
  }

  /** Whether something lies between two texels of colours. */
  blend(isBlended) {
    for (const plane of this.#planes) plane.blend(isBlended || plane.map !== 'map');
  }

  /** Hands new images to three.js. */
  upload() {
    for (const plane of this.#planes) plane.upload();
    this.#atlas.dirtyTiles.length = 0;
  }

  /** A program's material with these textures; its own one, where it has no use for them. */
  materialLike(material) {
    const planes = this.#planes.filter(({ map }) => map in material);
    if (planes.length === 0) return material;
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
    for (const { map, texture } of planes) {
      this.#material[map] = texture;
      if (map === 'normalMap') this.#material.normalMapType = ObjectSpaceNormalMap;
    }
    return Object.assign(this.#material, { onBeforeCompile, customProgramCacheKey });
  }

  dispose() {
    for (const plane of this.#planes) plane.texture.dispose();
    this.#material?.dispose();
  }
}

/** One texture of a slab. */
class Plane {
  #atlas;
  #texels;
  #generation;
  #isWhole = true; // Whether all of it waits to be uploaded.

  constructor(atlas, { texels, map, type, colorSpace }) {
    [this.#atlas, this.#texels, this.map] = [atlas, texels, map];
    this.texture = new DataTexture(atlas[texels], atlas.width, atlas.height, RGBAFormat, type);
    this.texture.colorSpace = colorSpace;
    this.texture.onUpdate = () => { this.#isWhole = false; };
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
    const { width, height, generation } = this.#atlas;
    if (this.#generation !== undefined) this.texture.dispose(); // Its size changes.
    this.texture.image = { data: this.#atlas[this.#texels], width, height };
    this.texture.repeat.set(1 / width, 1 / height);
    this.#uploadAll();
    this.#generation = generation;
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
    return undefined;
  }
}
