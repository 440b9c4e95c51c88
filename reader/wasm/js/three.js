// An object for three.js that streams by itself: LodpackMesh. three.d.ts says what it does.

import {
  Box3, BufferAttribute, BufferGeometry, DoubleSide, DynamicDrawUsage, Frustum, Matrix4, Mesh, MeshBasicMaterial, MeshStandardMaterial, Object3D, Ray,
  Sphere, Vector2, Vector3,
} from 'three';
import { open } from './file.js';
import { Pool } from './pool.js';
import { SlabTexture, cover } from './three-texture.js';

const nothing = () => {};
const takesLight = ({ material, lit = true }) => (material ? 'normalMap' in material : lit);

/** A material without light needs colours alone. */
const besideOf = (options) => (takesLight(options) ? { normals: true, materials: true } : {});
const streamOptions = ({ channel, range, stream, ...options }) => ({ channel, range, light: takesLight(options), ...besideOf(options), ...stream });

/** A ground shows its own colours, or none where the mesh on it shows none. */
const groundChannel = (channel) => (channel === 'none' ? 'none' : 'auto');

/** Draws a file as finely as the camera needs, in a few buffers with one material. */
export class LodpackMesh extends Object3D {
  #stream;
  #pool;
  #meshes = new Map(); // By slab.
  #textures = new Map(); // By slab, where they have images.
  #owners; // How many close the file together, if any.
  #options;
  #ownsMaterial;
  #isCovered; // Whether texels of colours have a coverage.
  #beside; // What the stream shows beside a channel.
  #query; // What was asked for last, as text.
  #isAsking = false;
  #hasMore = true; // Whether the same question has another answer by now.
  #isDisposed = false;

  static async load(from, options = {}) {
    const file = await open(from, options);
    try {
      const mesh = await LodpackMesh.of(file, options);
      mesh.#owners = { count: 1 };
      return mesh;
    } catch (error) {
      file.close();
      throw error;
    }
  }

  static async of(file, options = {}) {
    // Colours of roots and those of the file exclude each other.
    const { channel = options.colorOf ? 'none' : 'auto' } = options;
    const mesh = new LodpackMesh(file, await file.stream(streamOptions({ ...options, channel })), options);
    let ground;
    try {
      ground = options.ground === false ? null : await file.ground();
      if (ground) mesh.#stand(await LodpackMesh.of(ground, { ...options, channel: groundChannel(channel), range: undefined }));
      return mesh;
    } catch (error) {
      ground?.close();
      mesh.dispose();
      throw error;
    }
  }

  /** @private Use load() or of(). */
  constructor(file, stream, options = {}) {
    const { material, pixelTolerance = 1, colorOf, lit = true } = options;
    super();
    this.#options = options;
    this.type = 'LodpackMesh';
    this.isLodpackMesh = true;
    Object.assign(this, { file, pixelTolerance });
    const hasNormals = takesLight(options) && options.stream?.light !== false && !file.storesNormals;
    /** Normals of the file, and of heights, come as a texture; until it is there, surfaces are flat. */
    this.material = material ?? (lit
      ? new MeshStandardMaterial({ flatShading: !hasNormals, vertexColors: Boolean(colorOf) })
      : new MeshBasicMaterial({ vertexColors: Boolean(colorOf) }));
    this.#ownsMaterial = !material;
    // Texels have a coverage where the file says how it is drawn.
    this.#isCovered = options.isCovered ?? (this.#ownsMaterial && file.channels.some(({ kind }) => kind === 'drawing'));
    if (this.#isCovered && this.#ownsMaterial) Object.assign(this.material, { side: DoubleSide, onBeforeCompile: cover });
    this.#beside = besideOf(options);
    this.frame = this.ground = null;
    this.onchange = undefined;
    this.onproblem = (problem) => console.warn('lodpack:', problem);
    const { min, max } = file.bounds ?? { min: [0, 0, 0], max: [0, 0, 0] };
    this.boundingBox = new Box3(new Vector3(...min), new Vector3(...max));
    this.boundingSphere = this.boundingBox.getBoundingSphere(new Sphere());
    this.#pool = new Pool({ normals: hasNormals ? 'vectors' : undefined, images: file.channels.length > 0 || file.kind === 'heights', ...(colorOf ? { infoSize: 3, infoOf: colorOf } : {}) });
    this.#pool.onremove = (slab) => this.#remove(slab);
    this.#stream = this.stream = stream;
    stream.onprogress = () => {
      this.#hasMore = true;
      this.onchange?.();
    };
    // Something has to be drawn from the beginning for the camera to be seen: a triangle without area.
    this.#pool.update({ drops: [], uploads: [{ root: -1, level: 0, error: 0, positions: new Float32Array(9), triangles: new Uint32Array(3) }] });
    this.#upload();
  }

  /** Takes the ground, whose coordinates are others, as a part. */
  #stand(ground) {
    const matrix = new Matrix4().set(...ground.file.frame.meshFromGround, 0, 0, 0, 1);
    matrix.decompose(ground.position, ground.quaternion, ground.scale);
    ground.#owners ??= { count: 1 };
    ground.onchange = () => this.onchange?.();
    ground.onproblem = (problem) => this.onproblem?.(problem);
    this.boundingBox.union(ground.boundingBox.clone().applyMatrix4(matrix)).getBoundingSphere(this.boundingSphere);
    this.ground = ground;
    this.add(ground);
  }

  clone(recursive) {
    const { file, material, range, ground, onchange, onproblem } = this;
    const options = { ...this.#options, material, isCovered: this.#isCovered, channel: this.channel?.name ?? 'none', range };
    const stream = file.streamLater(streamOptions(options));
    const copy = Object.assign(new LodpackMesh(file, stream, options), { onchange, onproblem });
    stream.ready.catch((error) => { if (!copy.#isDisposed) copy.onproblem?.(error); });
    copy.#owners = this.#owners;
    if (copy.#owners) copy.#owners.count += 1;
    if (ground) copy.#stand(ground.clone());
    return copy.copy(this, recursive);
  }

  copy(source, recursive = true) {
    super.copy(source, false);
    this.pixelTolerance = source.pixelTolerance;
    const own = [...source.#meshes.values(), source.ground];
    if (recursive) source.children.forEach((child) => own.includes(child) || this.add(child.clone()));
    return this;
  }

  get channel() {
    return this.#stream.channel;
  }

  get range() {
    return this.#stream.range;
  }

  async show(channel, options = {}) {
    await this.#stream.show(channel, { ...this.#beside, ...options });
    for (const texture of this.#textures.values()) texture.look(this.#look);
    await this.ground?.show(groundChannel(channel), { ...options, range: undefined });
    this.#hasMore = true;
    this.onchange?.();
  }

  get #look() {
    // Between classes there is nothing.
    const isCovered = this.#isCovered && this.channel?.kind === 'colour';
    return { isCovered, isBlended: !['label', 'drawing'].includes(this.channel?.kind), hasDirections: this.channel?.kind === 'normal' };
  }

  get texels() {
    return this.#pool.texels;
  }

  get triangleCount() {
    return this.#pool.triangleCount - 1 + (this.ground?.triangleCount ?? 0);
  }

  update(camera, renderer) {
    if (this.ground) {
      this.ground.pixelTolerance = this.pixelTolerance;
      this.ground.update(camera, renderer);
    }
    for (const [slab, mesh] of this.#meshes) {
      // What a program sets at the object holds for all of it.
      const { castShadow, receiveShadow, renderOrder } = this;
      const material = this.#textures.get(slab)?.materialLike(this.material) ?? this.material;
      Object.assign(mesh, { castShadow, receiveShadow, material, renderOrder });
    }
    if (this.#isAsking || this.#isDisposed) return;
    const query = this.#queryOf(camera, renderer);
    const text = JSON.stringify(query);
    if (text === this.#query && !this.#hasMore) return;
    [this.#query, this.#hasMore, this.#isAsking] = [text, false, true];
    this.#stream.frame(query).then(
      (frame) => {
        if (this.#isDisposed) return;
        this.frame = frame;
        if (frame.uploads.length + frame.drops.length > 0) {
          this.#pool.update(frame);
          this.#upload();
          this.onchange?.();
        }
        frame.problems.forEach((problem) => this.onproblem?.(problem));
      },
      (error) => { if (!this.#isDisposed) this.onproblem?.(error); },
    ).finally(() => { this.#isAsking = false; });
  }

  async retry() {
    await this.ground?.retry();
    await this.#stream.retry();
    this.#hasMore = true;
  }

  #queryOf(camera, renderer) {
    this.updateWorldMatrix(true, false);
    const [width, height] = renderer.getDrawingBufferSize(new Vector2()).toArray();
    const local = new Matrix4().copy(this.matrixWorld).invert().multiply(camera.matrixWorld);
    const scale = local.getMaxScaleOnAxis() || 1;
    if (!camera.isPerspectiveCamera) {
      // Without perspective a pixel is equally large everywhere.
      const pixel = ((camera.top - camera.bottom) / camera.zoom / Math.max(height, 1)) * scale;
      const planes = new Frustum().setFromProjectionMatrix(new Matrix4().copy(local).invert().premultiply(camera.projectionMatrix)).planes;
      return { frustum: planes.map(({ normal, constant }) => ({ normal: normal.toArray(), offset: constant })), tolerance: this.pixelTolerance * pixel };
    }
    const [, y, z] = [new Vector3(), new Vector3(), new Vector3()].map((axis, k) => axis.setFromMatrixColumn(local, k).normalize());
    const view = {
      position: new Vector3().setFromMatrixPosition(local).toArray(), forward: z.negate().toArray(), up: y.toArray(),
      viewport: [Math.max(width, 1), Math.max(height, 1)], verticalFov: (camera.getEffectiveFOV() * Math.PI) / 180,
      near: camera.near * scale, pixelTolerance: this.pixelTolerance,
    };
    return { view };
  }

  #upload() {
    for (const slab of this.#pool.slabs) {
      const { geometry } = this.#meshes.get(slab) ?? this.#add(slab);
      const mark = (attribute, ranges) => {
        if (!attribute) return;
        for (const [first, count] of ranges) attribute.addUpdateRange(first * attribute.itemSize, count * attribute.itemSize);
        if (ranges.length > 0) attribute.needsUpdate = true;
      };
      mark(geometry.getAttribute('position'), slab.dirtyVertices);
      mark(geometry.getAttribute('normal'), slab.dirtyVertices);
      mark(geometry.getAttribute('color'), slab.dirtyVertices);
      mark(geometry.getAttribute('uv'), slab.dirtyVertices);
      this.#textures.get(slab)?.upload();
      mark(geometry.index, slab.dirtyIndices);
      slab.dirtyVertices.length = 0;
      slab.dirtyIndices.length = 0;
      geometry.setDrawRange(0, slab.indexCount);
    }
  }

  #add(slab) {
    const geometry = new BufferGeometry();
    const attribute = (array, size, isNormalized) => new BufferAttribute(array, size, isNormalized).setUsage(DynamicDrawUsage);
    geometry.setAttribute('position', attribute(slab.positions, 3));
    if (slab.normals) geometry.setAttribute('normal', attribute(slab.normals, 4, true));
    if (slab.info) geometry.setAttribute('color', attribute(slab.info, 3));
    if (slab.atlas) {
      geometry.setAttribute('uv', attribute(slab.places, 2));
      this.#textures.set(slab, new SlabTexture(slab.atlas, this.#look));
    }
    geometry.setIndex(attribute(slab.indices, 1));
    const origin = new Vector3(...this.#stream.origin);
    geometry.boundingSphere = new Sphere(this.boundingSphere.center.clone().sub(origin), this.boundingSphere.radius);
    geometry.boundingBox = this.boundingBox.clone().translate(origin.negate());
    slab.dirtyVertices.length = 0;
    slab.dirtyIndices.length = 0;
    const mesh = new Mesh(geometry, this.#textures.get(slab)?.materialLike(this.material) ?? this.material);
    mesh.position.fromArray(this.#stream.origin);
    mesh.frustumCulled = false; // The stream leaves out what is not seen.
    mesh.raycast = nothing;
    mesh.layers = this.layers;
    mesh.onBeforeRender = (renderer, _scene, camera) => this.update(camera, renderer);
    this.add(mesh);
    this.#meshes.set(slab, mesh);
    return mesh;
  }

  #remove(slab) {
    const mesh = this.#meshes.get(slab);
    if (!mesh) return;
    this.#meshes.delete(slab);
    this.remove(mesh);
    mesh.geometry.dispose();
    this.#textures.get(slab)?.dispose();
    this.#textures.delete(slab);
  }

  raycast(raycaster, intersects) {
    if (!raycaster.ray.intersectsSphere(this.boundingSphere.clone().applyMatrix4(this.matrixWorld))) return;
    const ray = new Ray().copy(raycaster.ray).applyMatrix4(new Matrix4().copy(this.matrixWorld).invert());
    const origin = ray.origin.clone().sub(new Vector3(...this.#stream.origin));
    const hit = this.#pool.raycast(origin.toArray(), ray.direction.toArray());
    if (!hit) return;
    const { entry: { slab: { positions }, root, level, error }, triangle: [a, b, c] } = hit;
    const corner = (k) => new Vector3().fromArray(positions, 3 * k);
    const normal = corner(c).sub(corner(b)).cross(corner(a).sub(corner(b))).normalize();
    const point = ray.at(hit.distance, new Vector3()).applyMatrix4(this.matrixWorld);
    const distance = point.distanceTo(raycaster.ray.origin);
    if (distance < raycaster.near || distance > raycaster.far) return;
    intersects.push({ distance, point, object: this, face: { a, b, c, normal, materialIndex: 0 }, root, level, error });
  }

  dispose() {
    if (this.#isDisposed) return;
    this.#isDisposed = true;
    this.ground?.dispose();
    this.#stream.close();
    for (const slab of [...this.#meshes.keys()]) this.#remove(slab);
    if (this.#ownsMaterial) this.material.dispose();
    if (this.#owners && (this.#owners.count -= 1) === 0) this.file.close();
    this.removeFromParent();
  }
}
