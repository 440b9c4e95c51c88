// Objects of a LodpackMesh: `import { LodpackObjects } from 'lodpack/three-objects'`.

import type { Material, Raycaster, Vector3 } from 'three';
import type { LodpackMesh } from 'lodpack/three';
import type { ObjectChoice, ObjectHit, ObjectNode, Objects } from 'lodpack/objects';

export class LodpackObjects {
  private constructor();
  /** The objects of a mesh; null if its file has none. `material` is that of what is marked: orange without one. */
  static of(mesh: LodpackMesh, options?: { material?: Material }): Promise<LodpackObjects | null>;
  readonly mesh: LodpackMesh;
  readonly objects: Objects;
  /** What is drawn: a copy. */
  readonly choice: ObjectChoice;
  /**
   * Changes what is drawn: what the change does not name stays as it is. What is marked is drawn over the mesh, by a
   * child of it with a stream of its own.
   */
  show(change: Omit<ObjectChoice, 'onlyMarked'>): Promise<void>;
  /** What a raycaster's ray meets first of what is drawn: its object, in world coordinates, with all that it is in. */
  pick(raycaster: Raycaster): Promise<(Omit<ObjectHit, 'point'> & { point: Vector3; path: ObjectNode[] }) | null>;
  /** Ends what it has drawn over the mesh. */
  dispose(): void;
}
