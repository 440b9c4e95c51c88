// The texture of a slab for three.js, and the material that draws with it.

import {
  DataTexture, HalfFloatType, LinearFilter, NearestFilter, NoColorSpace, ObjectSpaceNormalMap, RGBAFormat, SRGBColorSpace, UnsignedByteType,
} from 'three';
import { PLANES } from './atlas.js';

/** Rows that are uploaded one by one. More are uploaded with all others at once. */
const FEW_ROWS = 256;

/** What three.js has for the planes of an atlas: properties of materials, and what these need. */
const USES = {
  data: { maps: ['map'], colorSpace: SRGBColorSpace },
  normals: { maps: ['normalMap'], colorSpace: NoColorSpace, fit: (material) => { material.normalMapType = ObjectSpaceNormalMap; } },
  // Each takes its own component, and is multiplied.
  material: { maps: ['roughnessMap', 'metalnessMap', 'aoMap'], colorSpace: NoColorSpace, fit: (material) => { material.roughness = material.metalness = 1; } },
  emissive: { maps: ['emissiveMap'], colorSpace: SRGBColorSpace, fit: (material) => { material.emissive.setRGB(1, 1, 1); } },
};

/**
 * Has a shader of WebGL take the fourth component of colours as their coverage (`Drawing::coverage`). Its lowest bits,
 * which are not interpolated, say whether it is compared with one half or the share of pixels that show the surface,
 * and whether light falls on it. Elsewhere it is compared.
 */
export function cover(shader) {
  shader.fragmentShader = shader.fragmentShader.replace('#include <alphatest_fragment>', `
    bool isUnlit = false;
    #if defined(USE_MAP) && defined(USE_ALPHATEST)
      int bits = int(texelFetch(map, ivec2(vMapUv * vec2(textureSize(map, 0))), 0).a * 255.0 + 0.5);
      // Jimenez 2014, interleaved gradient noise.
      float scattered = fract(52.9829189 * fract(dot(floor(gl_FragCoord.xy), vec2(0.06711056, 0.00583715))));
      isUnlit = bits > 0 && (bits & 2) == 0;
      // Where it is 0 nothing is known yet. The least coverage, 4, shows no pixel, and the most, 252, all.
      float least = (bits & 1) == 1 ? alphaTest : (float(bits & 3) + 4.5 + 247.0 * scattered) / 255.0;
      if (bits > 0 && diffuseColor.a < least) discard;
    #endif`).replace('#include <opaque_fragment>', `if (isUnlit) outgoingLight = diffuseColor.rgb;
    #include <opaque_fragment>`);
}

/** The textures of a slab: one for each plane of its atlas. */
export class SlabTexture {
  #atlas;
  #planes;
  #material;
  #version; // Of the program's material.

  constructor(atlas, look) {
    this.#atlas = atlas;
    this.#planes = PLANES.filter((name) => atlas[name]).map((name) => new Plane(atlas, name));
    this.look(look);
  }

  /**
   * Whether something lies between two texels of colours, and whether these are the directions of normals, which light
   * shows better; and whether opacity is how much of a texel is there.
   */
  look({ isBlended, hasDirections, isCovered }) {
    Object.assign(this, { hasDirections, isCovered });
    if (this.#material) this.#material.needsUpdate = true;
    for (const plane of this.#planes) plane.blend(isBlended || plane.name !== 'data');
  }

  upload() {
    for (const plane of this.#planes) plane.upload();
    this.#atlas.dirtyTiles.length = 0;
  }

  /** A program's material with these textures; its own one, where it has no use for them. */
  materialLike(material) {
    const isShown = ({ name, maps }) => maps[0] in material && !(name === 'data' && this.hasDirections && 'normalMap' in material);
    const planes = this.#planes.filter(isShown);
    if (planes.length === 0) return material;
    if (this.#material?.constructor !== material.constructor) {
      this.#material?.dispose();
      this.#material = material.clone();
    } else {
      this.#material.copy(material);
    }
    const { onBeforeCompile, customProgramCacheKey, version } = material;
    if (version !== this.#version) this.#material.needsUpdate = true;
    this.#version = version;
    for (const { maps, fit, texture } of planes) {
      for (const map of maps) this.#material[map] = texture;
      fit?.(this.#material);
    }
    if (this.isCovered) this.#material.alphaTest = 0.5;
    return Object.assign(this.#material, { onBeforeCompile, customProgramCacheKey });
  }

  dispose() {
    for (const plane of this.#planes) plane.texture.dispose();
    this.#material?.dispose();
  }
}

class Plane {
  #atlas;
  #generation;
  #isWhole = true; // Whether all of it waits to be uploaded.

  constructor(atlas, name) {
    this.#atlas = atlas;
    Object.assign(this, USES[name], { name });
    const type = atlas[name] instanceof Uint16Array ? HalfFloatType : UnsignedByteType;
    this.texture = new DataTexture(atlas[name], atlas.width, atlas.height, RGBAFormat, type);
    this.texture.colorSpace = this.colorSpace;
    this.texture.onUpdate = () => { this.#isWhole = false; };
    this.#fit();
  }

  #uploadAll() {
    this.texture.clearUpdateRanges?.();
    this.texture.needsUpdate = this.#isWhole = true;
  }

  blend(isBlended) {
    this.texture.minFilter = this.texture.magFilter = isBlended ? LinearFilter : NearestFilter;
    this.#uploadAll();
  }

  /** Coordinates are texels, so a texture that grows changes none of them. */
  #fit() {
    const { width, height, generation } = this.#atlas;
    if (this.#generation !== undefined) this.texture.dispose(); // Its size changes.
    this.texture.image = { data: this.#atlas[this.name], width, height };
    this.texture.repeat.set(1 / width, 1 / height);
    this.#uploadAll();
    this.#generation = generation;
  }

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
