import type { Box3, Camera, Material, Object3D, Raycaster, Sphere } from 'three';
import type { Channel, Frame, LodpackFile, OpenOptions, StreamOptions, open } from './index.js';

export interface LodpackMeshOptions {
  /**
   * By default a MeshStandardMaterial. Where the file stores no normals, and the material takes light, vertices have
   * some (`normal`, SPEC.md, 14.5); elsewhere, and with `stream: { light: false }`, it has to be flat-shaded. Where a
   * channel is shown, copies of it have textures: `map`, and where the file has them and the material takes them
   * `normalMap`, `roughnessMap`, `metalnessMap`, `aoMap` and `emissiveMap`.
   */
  material?: Material;
  /** False for a MeshBasicMaterial instead, which shows colours as they are in the file. */
  lit?: boolean;
  /**
   * The channel to show: 'auto' (the first one of colours, or normals), 'none' or a name; 'auto'. Normals are seen by
   * their light.
   */
  channel?: StreamOptions['channel'];
  /** The values that get the first and the last colour of the ramp, for numbers; those of the coarsest level. */
  range?: readonly [number, number];
  /** The error to reach on the screen, pixels; 1. */
  pixelTolerance?: number;
  /** A colour for each root, red, green and blue from 0 to 1, for materials with vertexColors. */
  colorOf?: (root: { root: number; level: number; error: number }) => ArrayLike<number>;
  stream?: StreamOptions;
  /** False leaves out the ground that the mesh stands on. */
  ground?: boolean;
}

/**
 * Draws a file as finely as the camera needs. Scale it by one factor for all axes, or errors on the screen are not what
 * they should be.
 */
export class LodpackMesh extends Object3D {
  private constructor();
  /** Opens a file and streams it. */
  static load(from: Parameters<typeof open>[0], options?: LodpackMeshOptions & OpenOptions): Promise<LodpackMesh>;
  /** Streams a file that is open. dispose() leaves it open. */
  static of(file: LodpackFile, options?: LodpackMeshOptions): Promise<LodpackMesh>;
  readonly isLodpackMesh: true;
  readonly file: LodpackFile;
  material: Material;
  pixelTolerance: number;
  /** Of everything, in the object's own coordinates. */
  readonly boundingBox: Box3;
  readonly boundingSphere: Sphere;
  /** With those of the ground. */
  readonly triangleCount: number;
  /**
   * The ground that the mesh stands on: a child, which `dispose()` ends, too. Its file, frame and materials are its
   * own.
   */
  readonly ground: LodpackMesh | null;
  /** The channel that is shown. */
  readonly channel: Channel | null;
  /** The values of the ends of its ramp, where it has numbers. */
  readonly range: [number, number] | null;
  /** Texels that roots use, and texels that textures have. */
  readonly texels: { used: number; allocated: number };
  /** Shows another channel. */
  show(channel: 'auto' | 'none' | (string & {}), options?: { range?: readonly [number, number] }): Promise<void>;
  /** The last frame, with its counters. */
  readonly frame: Frame | null;
  /** Called when drawing again would show something new. */
  onchange?: () => void;
  /** Called with what could not be loaded. */
  onproblem?: (problem: Error | string) => void;
  /** Drawing calls it; call it to prepare for another camera. */
  update(camera: Camera, renderer: object): void;
  retry(): Promise<void>;
  /** Hits have `root`, `level` and the certified `error` of what was hit. */
  raycast(raycaster: Raycaster, intersects: object[]): void;
  /**
   * Another one of the same file, with a stream of its own; with its own children unless `recursive` is false. It
   * shares the material, and a file that load() has opened, which the last one closes.
   */
  clone(recursive?: boolean): this;
  dispose(): void;
}
