// Draws a pool with WebGL 2. The shading is that of the native viewer's shader.wgsl.

import { VERTICAL_FOV, sub } from './camera.js';

const VERTEX = `#version 300 es
uniform vec3 camera, right, up, forward;
uniform vec4 projection; // Clip units per tangent in x and y; near plane.
layout(location = 0) in vec3 position;
layout(location = 1) in vec2 info; // Level and error.
layout(location = 2) in vec2 place; // In the slab's texture, in texels.
layout(location = 3) in vec4 rectangle; // Of the piece of the surface there: left, top, right, bottom.
layout(location = 4) in vec2 folded; // The normal, as a place in the unfolded octahedron; the least numbers for none.
uniform float hasNormals;
out vec3 smoothed;
out vec3 view;
flat out vec2 about;
centroid out vec2 at;
flat out vec4 bounds;
invariant gl_Position;
void main() {
  vec3 offset = position - camera;
  view = vec3(dot(right, offset), dot(up, offset), dot(forward, offset));
  about = info;
  // Without length where there is none.
  smoothed = vec3(0.0);
  if (hasNormals == 1.0 && folded.x >= -32767.0) {
    vec2 flat_place = folded / 32767.0;
    vec3 normal = vec3(flat_place, 1.0 - abs(flat_place.x) - abs(flat_place.y));
    if (normal.z < 0.0) normal.xy = (1.0 - abs(normal.yx)) * vec2(normal.x < 0.0 ? -1.0 : 1.0, normal.y < 0.0 ? -1.0 : 1.0);
    smoothed = vec3(dot(right, normal), dot(up, normal), dot(forward, normal)) / length(normal);
  }
  at = place;
  // Interpolation reads no texel of another piece.
  bounds = rectangle + vec4(0.5, 0.5, -0.5, -0.5);
  // The depth is that of an infinite projection.
  gl_Position = vec4(view.x * projection.x, view.y * projection.y, view.z - 2.0 * projection.z, view.z);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
uniform vec4 projection; // And pixels per tangent.
uniform vec4 mode; // Meaning of colours; number of levels; tolerance in pixels; 1 for lines.
uniform vec3 channel; // 1 if there are images, 2 if they show classes, 3 directions; 1 without light; 1 with normals of heights, 2 with others.
uniform sampler2D texels;
uniform sampler2D normals; // Components from 0 to 1, with 1 in the fourth one; 0 where there are none.
uniform mat3 axes; // From directions of the file to those of the view.
in vec3 view;
in vec3 smoothed;
flat in vec2 about;
centroid in vec2 at;
flat in vec4 bounds;
out vec4 result;
vec3 hue(float h) {
  return clamp(abs(fract(vec3(h) + vec3(1.0, 2.0 / 3.0, 1.0 / 3.0)) * 6.0 - 3.0) - 1.0, 0.0, 1.0);
}
// What screens show (sRGB) of linear light.
vec3 shown_of(vec3 light) {
  vec3 high = 1.055 * pow(max(light, vec3(0.0)), vec3(1.0 / 2.4)) - 0.055;
  return clamp(mix(high, 12.92 * light, lessThanEqual(light, vec3(0.0031308))), 0.0, 1.0);
}
// The mean over the pixel: of one place where texels are larger than pixels, of up to 16 where they are smaller.
vec4 mean_at(sampler2D image) {
  vec2 along_x = dFdx(at), along_y = dFdy(at), size = vec2(textureSize(image, 0));
  float count = clamp(ceil(max(length(along_x), length(along_y))), 1.0, 4.0);
  vec4 sum = vec4(0.0);
  for (float y = 0.5; y < count; y += 1.0) {
    for (float x = 0.5; x < count; x += 1.0) {
      vec2 there = at + along_x * (x / count - 0.5) + along_y * (y / count - 0.5);
      sum += textureLod(image, clamp(there, bounds.xy, bounds.zw) / size, 0.0);
    }
  }
  return sum / (count * count);
}
// A number from 0 to 1 for a pixel, so that those of neighbours are spread evenly (Jimenez 2014, interleaved gradient
// noise).
float scattered(vec2 pixel) {
  return fract(52.9829189 * fract(dot(floor(pixel), vec2(0.06711056, 0.00583715))));
}
void main() {
  if (mode.w == 1.0) { result = vec4(0.05, 0.1, 0.2, 0.55); return; }
  vec3 along_x = dFdx(view), along_y = dFdy(view);
  vec3 normal = cross(along_x, along_y);
  // Rounding may leave a sliver without a normal; light it from the front.
  bool is_lost = dot(normal, normal) <= 1e-12 * dot(along_x, along_x) * dot(along_y, along_y);
  normal = normalize(is_lost ? -view : normal);
  if (dot(normal, view) > 0.0) normal = -normal;
  bool is_front = gl_FrontFacing;
  if (dot(smoothed, smoothed) > 0.0) {
    // A sliver that is folded over is seen from behind, but looks this way with all around it.
    is_front = is_front || dot(smoothed, view) < 0.0;
    normal = normalize(is_front ? smoothed : -smoothed);
  }
  vec4 stored = channel.z > 0.0 ? mean_at(normals) : vec4(0.0);
  if (stored.w > 0.5) {
    vec3 direction = normalize(axes * (2.0 * stored.xyz - stored.w));
    // Of slopes behind a ridge, a sample of a pixel may be seen.
    is_front = is_front || channel.z == 1.0 && dot(direction, normalize(view)) < 0.3;
    normal = is_front ? direction : -direction;
  }
  float key = max(dot(normal, normalize(vec3(-0.45, 0.6, -0.66))), 0.0);
  float fill = max(dot(normal, normalize(vec3(0.8, 0.0, -0.6))), 0.0);
  float light = 0.16 + 0.92 * key + 0.18 * fill + 0.08 * normal.y;
  vec3 base = is_front ? vec3(0.86, 0.83, 0.78) : vec3(0.75, 0.32, 0.26);
  if (mode.x == 1.0) base = mix(vec3(1.0), hue(0.7 - 0.7 * about.x / max(mode.y - 1.0, 1.0)), 0.5);
  if (mode.x == 2.0) {
    // Green: far below the tolerance; yellow: at it; red: twice the tolerance.
    float pixels = about.y * projection.w / view.z;
    base = mix(vec3(1.0), hue(clamp(0.333 - 0.167 * pixels / mode.z, 0.0, 0.333)), 0.6);
  }
  if (mode.x == 3.0) base = vec3(1.0, 0.6, 0.15);
  vec3 colour = sqrt(clamp(base * base * light, 0.0, 1.0));
  vec4 nearest = channel.x > 0.0 ? texelFetch(texels, ivec2(clamp(at, bounds.xy, bounds.zw)), 0) : vec4(0.0);
  vec4 texel = channel.x == 2.0 || channel.x == 0.0 ? nearest : mean_at(texels);
  // The lowest bits of a texel's coverage say how it is meant: they are not interpolated.
  int bits = channel.x == 1.0 ? int(nearest.a * 255.0 + 0.5) : 3;
  // Without opacity there is no image yet, nor a mean.
  // Light shows directions better than colours do.
  if (channel.x == 3.0 && channel.y == 0.0) texel.a = 0.0;
  if (texel.a > 0.002 && mode.x == 0.0) {
    colour = shown_of(texel.rgb * (channel.y == 1.0 || (bits & 2) == 0 ? 1.0 : light));
    // What stops a share of the light is there in this share of the pixels: in none for 4, in all for 252.
    float least = (bits & 1) == 1 ? 127.5 : float(bits & 3) + 4.5 + 247.0 * scattered(gl_FragCoord.xy);
    if (channel.x == 1.0 && texel.a * 255.0 < least) discard;
  }
  result = vec4(colour, 1.0);
}`;

const COLOURS = { shading: 0, level: 1, error: 2 };
const IMAGES = { colours: 1, classes: 2, directions: 3 };
/** By the bytes of their numbers: those of heights are half floats. */
const NORMALS = { 1: 2, 2: 1 };

export class Renderer {
  constructor(canvas) {
    this.canvas = canvas;
    const gl = canvas.getContext('webgl2', { antialias: true, alpha: false, powerPreference: 'high-performance' });
    if (!gl) throw new Error('This browser cannot draw in three dimensions (WebGL 2 is off or missing). Another browser may.');
    this.gl = gl;
    this.isLost = false;
    canvas.addEventListener('webglcontextlost', (event) => {
      event.preventDefault(); // Asks for another one.
      this.isLost = true;
    });
    canvas.addEventListener('webglcontextrestored', () => {
      this.isLost = false;
      this.#start();
      this.onrestored?.();
    });
    this.#start();
  }

  #start() {
    const { gl } = this;
    this.generation = (this.generation ?? 0) + 1;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
      throw new Error(`The graphics driver refuses a shader: ${gl.getProgramInfoLog(program)}`);
    }
    const names = ['camera', 'right', 'up', 'forward', 'projection', 'mode', 'channel', 'normals', 'hasNormals', 'axes'];
    this.places = Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(program, name)]));
    gl.useProgram(program);
    gl.uniform1i(this.places.normals, 1);
    /** The longest side of a texture. */
    this.maxTextureSize = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    gl.enable(gl.DEPTH_TEST);
    gl.clearColor(0.91, 0.925, 0.957, 1);
  }

  /** Fits the picture to the window. Returns its size in pixels. */
  resize() {
    const ratio = Math.min(globalThis.devicePixelRatio || 1, 2);
    const size = [this.canvas.clientWidth, this.canvas.clientHeight].map((length) => Math.max(Math.round(length * ratio), 1));
    if (this.canvas.width !== size[0] || this.canvas.height !== size[1]) [this.canvas.width, this.canvas.height] = size;
    return size;
  }

  /**
   * Draws surfaces into one picture, each as a camera in its own space sees it. `image` says what the images of one
   * show: 'colours', 'classes', 'directions', or nothing.
   */
  draw(surfaces, { colour, tolerance, wireframe, isUnlit }) {
    const { gl, places } = this;
    if (this.isLost || gl.isContextLost()) return;
    const [width, height] = this.resize();
    gl.viewport(0, 0, width, height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const perTangent = 1 / Math.tan(VERTICAL_FOV / 2);
    const drawOne = ({ pool, camera, origin, levelCount, image, isMarked }, isLines) => {
      const [right, up, forward] = camera.axes;
      gl.uniform3fv(places.camera, sub(camera.position, origin));
      gl.uniform3fv(places.right, right);
      gl.uniform3fv(places.up, up);
      gl.uniform3fv(places.forward, forward);
      gl.uniform4f(places.projection, (perTangent * height) / width, perTangent, camera.near, (perTangent * height) / 2);
      gl.uniformMatrix3fv(places.axes, true, [...right, ...up, ...forward]);
      gl.uniform4f(places.mode, isMarked ? 3 : COLOURS[colour] ?? 0, levelCount, tolerance, isLines ? 1 : 0);
      for (const slab of pool.slabs) {
        const { array, count } = isLines ? this.#lines(slab) : this.#upload(slab);
        gl.bindVertexArray(array);
        gl.uniform1f(places.hasNormals, slab.normals ? 1 : 0);
        gl.uniform3f(places.channel, IMAGES[image] ?? 0, isUnlit ? 1 : 0, slab.drawn?.normals ? NORMALS[slab.atlas.normals.BYTES_PER_ELEMENT] : 0);
        gl.activeTexture(gl.TEXTURE1);
        gl.bindTexture(gl.TEXTURE_2D, slab.drawn?.normals ?? null);
        gl.activeTexture(gl.TEXTURE0);
        gl.bindTexture(gl.TEXTURE_2D, slab.drawn?.texture ?? null);
        gl.drawElements(isLines ? gl.LINES : gl.TRIANGLES, count, gl.UNSIGNED_INT, 0);
      }
    };
    const draw = (isLines) => surfaces.forEach((surface) => {
      if (surface.isMarked && isLines) return;
      // What is selected lies on what it is.
      const offset = (wireframe ? 1 : 0) - (surface.isMarked ? 1 : 0);
      gl.polygonOffset(isLines ? 0 : offset, isLines ? 0 : offset);
      gl.depthFunc(isLines || surface.isMarked ? gl.LEQUAL : gl.LESS);
      drawOne(surface, isLines);
    });
    gl.enable(gl.POLYGON_OFFSET_FILL);
    draw(false);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    if (wireframe) {
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
      draw(true);
      gl.disable(gl.BLEND);
    }
    gl.bindVertexArray(null);
  }

  /** Uploads what has changed in a slab; everything, if the device has lost it. */
  #upload(slab) {
    const { gl } = this;
    if (slab.drawn?.generation !== this.generation) this.#create(slab);
    const { array, positions, info, indices } = slab.drawn;
    gl.bindVertexArray(array);
    if (slab.dirtyVertices.length + slab.dirtyIndices.length > 0) slab.drawn.areLinesStale = true;
    const parts = (buffer, target, source, ranges, size) => {
      if (ranges.length === 0) return;
      gl.bindBuffer(target, buffer);
      for (const [first, count] of joined(ranges)) gl.bufferSubData(target, size * first * source.BYTES_PER_ELEMENT, source, size * first, size * count);
    };
    parts(positions, gl.ARRAY_BUFFER, slab.positions, slab.dirtyVertices, 3);
    parts(info, gl.ARRAY_BUFFER, slab.info, slab.dirtyVertices, 2);
    if (slab.normals) parts(slab.drawn.folded, gl.ARRAY_BUFFER, slab.normals, slab.dirtyVertices, 2);
    parts(indices, gl.ELEMENT_ARRAY_BUFFER, slab.indices, slab.dirtyIndices, 1);
    if (slab.atlas) {
      parts(slab.drawn.places, gl.ARRAY_BUFFER, slab.places, slab.dirtyVertices, 2);
      parts(slab.drawn.rectangles, gl.ARRAY_BUFFER, slab.rectangles, slab.dirtyVertices, 4);
      this.#uploadImages(slab);
    }
    slab.dirtyVertices.length = 0;
    slab.dirtyIndices.length = 0;
    return { array, count: slab.indexCount };
  }

  #create(slab) {
    const { gl } = this;
    const buffer = (target, data) => {
      const made = gl.createBuffer();
      gl.bindBuffer(target, made);
      gl.bufferData(target, data, gl.DYNAMIC_DRAW);
      return made;
    };
    const arrays = () => {
      const array = gl.createVertexArray();
      gl.bindVertexArray(array);
      return array;
    };
    const array = arrays();
    const positions = buffer(gl.ARRAY_BUFFER, slab.positions);
    this.#attribute(0, 3);
    const info = buffer(gl.ARRAY_BUFFER, slab.info);
    this.#attribute(1, 2);
    const indices = buffer(gl.ELEMENT_ARRAY_BUFFER, slab.indices);
    slab.drawn = { generation: this.generation, array, positions, info, indices, areLinesStale: true };
    if (slab.normals) {
      slab.drawn.folded = buffer(gl.ARRAY_BUFFER, slab.normals);
      this.#attribute(4, 2, gl.SHORT);
    }
    if (slab.atlas) {
      slab.drawn.places = buffer(gl.ARRAY_BUFFER, slab.places);
      this.#attribute(2, 2);
      slab.drawn.rectangles = buffer(gl.ARRAY_BUFFER, slab.rectangles);
      this.#attribute(3, 4, gl.UNSIGNED_SHORT);
    }
    slab.dirtyVertices.length = 0;
    slab.dirtyIndices.length = 0;
  }

  /** Uploads the images that are new, or all of textures that have grown. */
  #uploadImages({ atlas, drawn }) {
    const { gl } = this;
    const isGrown = drawn.textureGeneration !== atlas.generation;
    // Colours are interpolated in linear light.
    if (atlas.data) drawn.texture = this.#uploadPlane(atlas, atlas.data, isGrown ? null : drawn.texture, drawn.texture, [gl.SRGB8_ALPHA8, gl.UNSIGNED_BYTE]);
    if (atlas.normals) drawn.normals = this.#uploadPlane(atlas, atlas.normals, isGrown ? null : drawn.normals, drawn.normals, atlas.normals.BYTES_PER_ELEMENT === 2 ? [gl.RGBA16F, gl.HALF_FLOAT] : [gl.RGBA8, gl.UNSIGNED_BYTE]);
    drawn.textureGeneration = atlas.generation;
    atlas.dirtyTiles.length = 0;
  }

  /** Uploads new images into a texture; if there is none, all of them into a new one, in place of the one before. */
  #uploadPlane(atlas, texels, texture, before, [format, type]) {
    const { gl } = this;
    if (texture) {
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.pixelStorei(gl.UNPACK_ROW_LENGTH, atlas.width);
      for (const { x, y, width, height } of atlas.dirtyTiles) {
        gl.texSubImage2D(gl.TEXTURE_2D, 0, x, y, width, height, gl.RGBA, type, texels, 4 * (y * atlas.width + x));
      }
      gl.pixelStorei(gl.UNPACK_ROW_LENGTH, 0);
      return texture;
    }
    gl.deleteTexture(before ?? null);
    const made = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, made);
    gl.texStorage2D(gl.TEXTURE_2D, 1, format, atlas.width, atlas.height);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, atlas.width, atlas.height, gl.RGBA, type, texels);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    return made;
  }

  #attribute(place, size, type = this.gl.FLOAT) {
    this.gl.enableVertexAttribArray(place);
    this.gl.vertexAttribPointer(place, size, type, false, 0, 0);
  }

  /** The edges of a slab's triangles. Each is there twice, which does not show. */
  #lines(slab) {
    const { gl } = this;
    const { drawn } = slab;
    if (!drawn.lines) {
      drawn.lines = { array: gl.createVertexArray(), buffer: gl.createBuffer(), count: 0 };
      gl.bindVertexArray(drawn.lines.array);
      gl.bindBuffer(gl.ARRAY_BUFFER, drawn.positions);
      this.#attribute(0, 3);
      gl.bindBuffer(gl.ARRAY_BUFFER, drawn.info);
      this.#attribute(1, 2);
    }
    if (drawn.areLinesStale) {
      const count = slab.indexCount;
      const lines = new Uint32Array(2 * count);
      for (let k = 0; k < count; k += 3) {
        const [a, b, c] = [slab.indices[k], slab.indices[k + 1], slab.indices[k + 2]];
        lines.set([a, b, b, c, c, a], 2 * k);
      }
      gl.bindVertexArray(drawn.lines.array);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, drawn.lines.buffer);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, lines, gl.DYNAMIC_DRAW);
      drawn.lines.count = lines.length;
      drawn.areLinesStale = false;
    }
    return { array: drawn.lines.array, count: drawn.lines.count };
  }

  /** Gives a slab's buffers back. */
  forget({ drawn }) {
    const { gl } = this;
    // A device that was lost has taken them.
    if (drawn?.generation !== this.generation) return;
    const { positions, info, indices, folded, places, rectangles, lines } = drawn;
    for (const buffer of [positions, info, indices, folded, places, rectangles, lines?.buffer]) gl.deleteBuffer(buffer ?? null);
    for (const texture of [drawn.texture, drawn.normals]) gl.deleteTexture(texture ?? null);
    for (const array of [drawn.array, drawn.lines?.array]) gl.deleteVertexArray(array ?? null);
  }
}

/** Ranges that overlap or touch, joined. */
function joined(ranges) {
  const sorted = [...ranges].sort(([a], [b]) => a - b);
  const result = [];
  for (const [first, count] of sorted) {
    const last = result.at(-1);
    if (last && first <= last[0] + last[1]) last[1] = Math.max(last[1], first + count - last[0]);
    else result.push([first, count]);
  }
  return result;
}
