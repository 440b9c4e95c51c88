// Objects in three.js: a LodpackMesh of which some are hidden, shown alone or highlighted, and that is picked. A module
// of its own, for programs that want it; three-objects.d.ts says what it does.

import { Matrix4, MeshStandardMaterial, Ray, Vector3 } from 'three';
import { objectsOf } from './objects.js';
import { LodpackMesh } from './three.js';

export class LodpackObjects {
  #choice = { only: null, hidden: [], marked: [] };
  #filter = null;
  #highlight = null; // The mesh of what is marked, and its filter.
  #material;
  #turn = Promise.resolve(); // One change after the other.

  /** The objects of a mesh; null if its file has none. */
  static async of(mesh, { material = new MeshStandardMaterial({ color: 0xff8c1a, emissive: 0x662a00 }) } = {}) {
    const objects = await objectsOf(mesh.file);
    return objects && new LodpackObjects(mesh, objects, material);
  }

  /** @private Use of(). */
  constructor(mesh, objects, material) {
    Object.assign(this, { mesh, objects });
    this.#material = material;
    // What is marked lies on what it marks.
    Object.assign(material, { polygonOffset: true, polygonOffsetFactor: -1, polygonOffsetUnits: -1 });
  }

  get choice() {
    return { ...this.#choice };
  }

  /** Changes what is drawn: `only` some nodes, or all; `hidden` ones are not drawn, `marked` ones highlighted. */
  show(choice) {
    return this.#after(() => this.#show({ ...this.#choice, ...choice }));
  }

  #after(action) {
    const turn = this.#turn.then(action);
    this.#turn = turn.catch(() => {});
    return turn;
  }

  async #show(choice) {
    const { objects, mesh } = this;
    const { only, hidden, marked } = choice;
    const filter = only || hidden.length > 0 || marked.length > 0 ? await objects.filter(choice) : null;
    await objects.show(mesh.stream, filter);
    this.#filter?.close();
    [this.#filter, this.#choice] = [filter, choice];
    if (marked.length === 0) return this.#unmark();
    const above = await objects.filter({ ...choice, onlyMarked: true });
    this.#highlight ??= { mesh: await this.#overlay(), filter: null };
    await objects.show(this.#highlight.mesh.stream, above);
    this.#highlight.filter?.close();
    this.#highlight.filter = above;
  }

  /** A second mesh of the same file, which draws what is marked over the first. */
  async #overlay() {
    const { mesh } = this;
    const overlay = await LodpackMesh.of(mesh.file, { material: this.#material, channel: 'none', ground: false });
    Object.defineProperty(overlay, 'pixelTolerance', { get: () => mesh.pixelTolerance });
    Object.assign(overlay, { raycast() {}, onchange: () => mesh.onchange?.(), onproblem: () => {} });
    mesh.add(overlay);
    return overlay;
  }

  /** What a raycaster's ray meets first of what is drawn, with its path from the top down; null if it meets nothing. */
  async pick(raycaster) {
    const { mesh, objects } = this;
    mesh.updateWorldMatrix(true, false);
    const ray = new Ray().copy(raycaster.ray).applyMatrix4(new Matrix4().copy(mesh.matrixWorld).invert());
    const hit = await objects.pick({ origin: ray.origin.toArray(), direction: ray.direction.toArray() }, this.#filter);
    if (!hit) return null;
    const point = new Vector3(...hit.point).applyMatrix4(mesh.matrixWorld);
    const distance = point.distanceTo(raycaster.ray.origin);
    return { ...hit, point, distance, path: await objects.above(hit.number) };
  }

  dispose() {
    this.#unmark();
    this.#filter?.close();
    this.#filter = null;
  }

  #unmark() {
    this.#highlight?.mesh.dispose();
    this.#highlight?.filter?.close();
    this.#highlight = null;
  }
}
