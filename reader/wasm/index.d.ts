/** Three numbers: x, y, z in world units. */
export type Point = readonly [number, number, number] | readonly number[];

/** Why a call failed, by who has to act. */
export type ErrorKind = 'format' | 'unsupported' | 'query' | 'limit' | 'source' | 'changed' | 'closed' | 'internal';

/**
 * `format`: the file is damaged. `unsupported`: it needs a newer reader. `query`: the caller asked for something
 * impossible.
 */
export class LodpackError extends Error {
  kind: ErrorKind;
}

/** The bytes could not be read. */
export class SourceError extends LodpackError {
  /** Whether another attempt may succeed. */
  isTransient: boolean;
  /** The HTTP status, if there was one. */
  status?: number;
  constructor(message: string, options?: { isTransient?: boolean; status?: number; cause?: unknown });
}

/** The file is no longer the one that was opened: open it again. */
export class EtagMismatch extends SourceError {
  constructor(what: string);
}

/** What a source returns. */
export interface RangeResponse {
  /** Fewer bytes than asked for only where the file ends. They are shared: do not write to them. */
  data: ArrayBuffer;
  /** Identifies this state of the file. */
  etag?: string;
  /** Bytes of the file; needed with the first answer unless the source has getSize(). */
  size?: number;
}

/** Where the bytes are. Shaped after PMTiles' Source. */
export interface Source {
  getBytes(offset: number, length: number, signal?: AbortSignal, etag?: string): Promise<RangeResponse>;
  /** Names the file for caches. */
  getKey?(): string;
  getSize?(signal?: AbortSignal): Promise<number>;
}

export interface FetchOptions {
  headers?: HeadersInit;
  credentials?: RequestCredentials;
  /**
   * Whether the browser keeps parts of the file beyond this page; 'no-store'. 'default' is for servers that know
   * If-Range: behind others Chrome joins parts of different files, and shows the old ETag for both.
   */
  cache?: RequestCache;
  /** Milliseconds without a byte after which a request counts as failed; 30,000. */
  timeout?: number;
  /** Attempts in a row that bring less than 16 KiB; 4. What has arrived is kept, and the next one asks for the rest. */
  attempts?: number;
  /** Milliseconds before the second attempt, which double; 200. */
  pause?: number;
  /** The largest file to read whole from a server that ignores ranges, bytes; 32 MiB. */
  maxWholeBytes?: number;
  /** Whether the server may redirect to other hosts; false. */
  otherHosts?: boolean;
}

/** A file on a web server that supports range requests. */
export class FetchSource implements Source {
  constructor(url: string | URL, options?: FetchOptions);
  readonly url: string;
  getKey(): string;
  getBytes(offset: number, length: number, signal?: AbortSignal, etag?: string): Promise<RangeResponse>;
}

/** A file that somebody chose or dropped, or any other Blob. */
export class FileSource implements Source {
  constructor(file: Blob);
  getKey(): string;
  getBytes(offset: number, length: number, signal?: AbortSignal): Promise<RangeResponse>;
}

/** Bytes in memory. */
export class BytesSource implements Source {
  constructor(bytes: ArrayBuffer | ArrayBufferView);
  getKey(): string;
  getBytes(offset: number, length: number): Promise<RangeResponse>;
}

/** Shares answers and running requests between all files that are opened with it. */
export class SharedPromiseCache {
  /** `maxBytes`: what it keeps at most; 16 MiB. */
  constructor(options?: { maxBytes?: number });
  getBytes(source: Source, offset: number, length: number, signal?: AbortSignal, etag?: string): Promise<RangeResponse>;
  /** Forgets everything of a source. */
  invalidate(source: Source): void;
}

export interface OpenOptions {
  signal?: AbortSignal;
  /** Whether to read in a worker; by default in browsers, and not in Node. */
  worker?: boolean;
  /** The module, if not the file beside this package's scripts: its address, its bytes, or compiled. */
  wasm?: string | URL | ArrayBuffer | ArrayBufferView | WebAssembly.Module;
  /** By default one that all files share. */
  cache?: SharedPromiseCache;
  /** Bytes of the first request; 8,192. */
  firstReadBytes?: number;
  /** What a file may ask of the machine: bytes of one part, 2^28. */
  limits?: { partBytes?: number };
}

/** Opens a file: one request for a small one, two for others. In Node a text without a scheme is a path. */
export function open(from: string | URL | Blob | ArrayBuffer | ArrayBufferView | Source, options?: OpenOptions): Promise<LodpackFile>;

/** Compiles the module, to share it or to do so early. Without an argument the result is shared by all files. */
export function loadModule(wasm?: OpenOptions['wasm']): Promise<WebAssembly.Module>;

/** A perspective view of the surface. */
export interface View {
  /** The camera's position; the origin. */
  position?: Point;
  /** The direction in which it looks, of any length but zero; 0, 0, -1. */
  forward?: Point;
  /** Up in the picture; 0, 1, 0. */
  up?: Point;
  /** Width and height, pixels; 1920, 1080. */
  viewport?: readonly number[];
  /** Angle between the picture's upper and lower border, radians; a third of pi. */
  verticalFov?: number;
  /** Depth of the near plane, world units; 0.001. */
  near?: number;
  /** The error to reach on the screen, pixels; 1. */
  pixelTolerance?: number;
  /** The part of the viewport that is drawn: left, lower, right and upper border, 0 to 1; all. */
  window?: readonly number[];
}

/** What to draw, and how finely. An empty query asks for everything at the finest level. */
export interface Query {
  /** Smallest and largest coordinates. */
  box?: readonly [Point, Point] | readonly number[];
  sphere?: { centre: Point; radius: number };
  /** Six planes; normal . x + offset >= 0 inside. */
  frustum?: readonly { normal: Point; offset: number }[];
  /** What it does not show is outside, and its pixel tolerance replaces `tolerance`. */
  view?: View;
  /** What becomes of what is outside; 'drop'. */
  outside?: 'drop' | 'coarsest';
  /** The error to reach, world units. */
  tolerance?: number;
  maxTriangles?: number;
  maxNodes?: number;
  maxBytes?: number;
}

/** Why a cut is not finer. */
export type Limiter = 'tolerance' | 'finest' | 'triangles' | 'nodes' | 'bytes';

/** A level for each root that is drawn; of heights, a resolution for each tile. */
export interface Cut {
  /**
   * Pairs of root and level, by root. Of heights four numbers for each tile: depth, column, row, and which of its
   * resolutions.
   */
  nodes: Uint32Array;
  /** Certified bound of each node's error, world units. */
  nodeErrors: Float64Array;
  /** The largest of these inside the query's volume and view. */
  error: number;
  /** The largest of all: it bounds everything that is drawn. */
  errorEverywhere: number;
  /** The largest error in the view, pixels; 0 without a view. */
  pixelError: number;
  triangleCount: number;
  /** Bytes of pages that it needs; 0 unless the query had `maxBytes`. */
  byteCount: number;
  limitedBy?: Limiter;
  /**
   * The `id` of the file that it was selected in, which others refuse. Cuts that are put together by hand may omit it.
   */
  file?: string;
}

/** Triangles, watertight where the surface is. */
export interface Mesh {
  /** World positions: x, y, z of each vertex. */
  positions: Float64Array;
  /** Three vertices for each triangle, counter-clockwise seen from outside. */
  triangles: Uint32Array;
  /** For each triangle the number of its node in the cut. */
  triangleNodes: Uint32Array;
  /** Of heights: x, y and z of each vertex's normal. */
  normals?: Float32Array;
  /**
   * Of heights: red, green, blue and opacity of each vertex, as screens show them (sRGB); null if the file has no ramp.
   */
  colors?: Uint8Array | null;
}

/**
 * What the values of a channel mean: sRGB colours, measured numbers, directions of the surface's normal, numbers of
 * classes.
 */
export type ChannelKind = 'colour' | 'scalar' | 'normal' | 'label' | 'factor' | 'drawing' | 'unknown';

/** Something that the surface carries besides positions. */
export interface Channel {
  name: string;
  kind: ChannelKind;
  /** Numbers of a value, 1 to 4. */
  components: number;
  /** A stored number n stands for the value low + n * step. */
  low: number;
  step: number;
  /** Stated bound on the error of a texel, in units of the value; 0 where none is stated. */
  bound: number;
  /** Bytes of all its images in the file. */
  imageBytes: number;
  /** Whether colours, normals or factors are stored without loss; false for other kinds. */
  lossless: boolean;
}

/** Images of one size: four bytes a texel, row after row, the first one at v = 0. */
export interface Image {
  width: number;
  height: number;
  /** Red, green, blue and opacity, as screens show them (sRGB). */
  data: Uint8Array;
  /**
   * With `normals`, where the root has some: components from -1 to 1 are bytes from 0 to 255, and 255 follows. In the
   * file's coordinates.
   */
  normals?: Uint8Array;
  /** With `materials`, where the file has any of these: occlusion, roughness and metalness from 0 to 255, and 255. */
  material?: Uint8Array;
  /** With `materials`, where the file has it: emitted light, as screens show it, and 255. */
  emissive?: Uint8Array;
}

/** An image that many roots share. */
export interface Page {
  width: number;
  height: number;
  /** Numbers of a texel: 4 of colours (red, green, blue, opacity), those of the channel otherwise. */
  components: number;
  /** Of colours bytes; of other channels stored numbers. Row after row, the first one at v = 0. */
  data: Uint8Array | Uint16Array;
}

/**
 * Triangles whose vertices have places in pages. Where triangles do not agree about the place of a vertex, it is there
 * several times.
 */
export interface TexturedMesh extends Mesh {
  /** u and v of each vertex, of the page's width and height: 0 to 1. */
  uvs: Float32Array;
  /** Which triangles lie in which page; null is none. */
  parts: { page: number | null; firstIndex: number; indexCount: number }[];
  /** The channels that were asked for. All have the same layout of pages. */
  channels: (Channel & { pages: Page[] })[];
}

/** Which channels to extract: the first one of colours, none, or those of these names. */
export type Channels = 'auto' | 'none' | readonly string[];

/** What a file of heights says about its grid. */
export interface HeightGrid {
  /** Columns and rows of samples. */
  columns: number;
  rows: number;
  /** Whether the last column of cells ends at the first column of samples. */
  wraps: boolean;
  /** Whether it stands on an ellipsoid: then coordinates are degrees, and positions are geocentric. */
  isGlobe: boolean;
  /** How many depths the tree of tiles has. */
  depthCount: number;
  /** Coordinates of the first column and the first row, from the north-west, and what each column and row adds. */
  first: [number, number];
  spacing: [number, number];
  /**
   * The difference of two neighbouring stored heights, and how far a stored one may be from its input, in units of
   * heights.
   */
  step: number;
  sampleError: number;
  /** Metres in a unit of heights, if the file says so; and coordinates in one. */
  unit: number | null;
  scale: number;
  /** The name of its colours by height, or nothing. With them, the file has one channel, *colour*. */
  ramp: string;
}

/** Takes coordinates of a ground to those of the mesh on it, and back. */
export interface GroundFrame {
  /** Units of the mesh in a unit of the ground: errors grow by it. */
  readonly scale: number;
  /** Three rows of four numbers; the fourth one of a row is what is added. */
  readonly meshFromGround: Float64Array;
  readonly groundFromMesh: Float64Array;
  /** A point of the ground in the space of the mesh. */
  point(point: Point): [number, number, number];
  pointOfGround(point: Point): [number, number, number];
  /**
   * What lies between two points of the mesh's space, in that of the ground: a direction that keeps its length in the
   * world.
   */
  offsetOfGround(offset: Point): [number, number, number];
  /**
   * The view that shows the ground in the same pixels, and with the same depths in a depth buffer, as this one shows
   * the mesh.
   */
  view(view: View): View;
}

/** An open file. Close it, or its worker stays. */
export class LodpackFile {
  private constructor();
  /**
   * Whether it holds a mesh or a grid of heights. The latter's roots are tiles and its levels depths in frames;
   * `levels` is empty, and `channels`, too, unless it has colours by height.
   */
  readonly kind: 'mesh' | 'heights';
  /**
   * Whether it has normals: a channel of them, or those of heights. Streams find some for files without, if asked to
   * (`light`).
   */
  readonly storesNormals: boolean;
  /** The grid of a file of heights; null for a mesh. */
  readonly heights: HeightGrid | null;
  /** What tells this file from others: files of the same bytes have the same one. */
  readonly id: string;
  /** The axis that points up, if the file says so. */
  readonly up: 'y' | 'z' | null;
  /** Version of the format. */
  readonly version: string;
  readonly byteLength: number;
  readonly rootCount: number;
  /** Roots that are nobody's children. */
  readonly topCount: number;
  /** Box around everything, world units; null if there is nothing. */
  readonly bounds: { min: [number, number, number]; max: [number, number, number] } | null;
  /** World position of lattice point 0, 0, 0, and the lattice's step. */
  readonly lattice: { origin: [number, number, number]; step: number };
  /** Coarse to fine: the tolerance that a level was built for, the certified error of everything at it, its size. */
  readonly levels: { tolerance: number; maxError: number; triangleCount: number; pageBytes: number }[];
  readonly overviewSummary: { error: number; triangleCount: number } | null;
  /** What the file was made from, if it says so. */
  readonly source: { triangleCount: number; vertexCount: number; meanEdgeLength: number; area: number; generator: string } | null;
  /** What the surface carries besides positions. */
  readonly channels: Channel[];
  /** Requests sent for this file, and bytes that they asked for. */
  readonly traffic: { requests: number; bytes: number };
  /** Why nothing can be read any more. */
  readonly failure?: EtagMismatch;
  /** Of a ground that `ground()` has opened: where it is in the space of the mesh. */
  readonly frame?: GroundFrame;
  /**
   * The heights that the mesh stands on, as a file of heights in coordinates of its own; null if there are none. It has
   * a worker of its own, stays open when this file is closed, and is read through it: `traffic` of this file counts
   * both.
   */
  ground(options?: { signal?: AbortSignal }): Promise<LodpackFile | null>;
  /** One small mesh of the whole surface, if the file has one. It came with opening. */
  overview(): Promise<Mesh | null>;
  /**
   * The cut for a query. Of heights by `box` (x and y, or degrees on a globe; z does not count), `tolerance` and
   * `maxTriangles`.
   */
  select(query: Query, options?: { signal?: AbortSignal }): Promise<Cut>;
  /** The cut that draws everything at a level; 0 is the coarsest. */
  selectLevel(level: number, options?: { signal?: AbortSignal }): Promise<Cut>;
  extract(cut: Pick<Cut, 'nodes'>, options?: { signal?: AbortSignal; channels?: 'none' }): Promise<Mesh>;
  /**
   * With images of channels, packed into pages of at most `pageSize` texels along each side (4096), unless one image is
   * larger.
   */
  extract(cut: Pick<Cut, 'nodes'>, options: { signal?: AbortSignal; channels: readonly [string, ...string[]]; pageSize?: number }): Promise<TexturedMesh>;
  /** Without `channels` in the result where the file has none that was meant. */
  extract(cut: Pick<Cut, 'nodes'>, options: { signal?: AbortSignal; channels: Channels; pageSize?: number }): Promise<Mesh & Partial<TexturedMesh>>;
  /**
   * The smallest and the largest value of a channel at the coarsest level, which it reads; null for colours, normals
   * and labels.
   */
  channelRange(name: string, options?: { signal?: AbortSignal }): Promise<[number, number] | null>;
  boundaryEdgeCount(cut: Pick<Cut, 'nodes'>, options?: { signal?: AbortSignal }): Promise<number>;
  stream(options?: StreamOptions): Promise<Stream>;
  /** Ends the worker, and all calls and requests that run. */
  close(): void;
}

export interface StreamOptions {
  /** The point that positions are relative to, so that single precision suffices; the middle of `bounds`. */
  origin?: Point;
  /** Bound of the cache of pages, bytes; 64 MiB. */
  byteCache?: number;
  /** Bound of the cache of decoded surfaces, bytes; 256 MiB. */
  decodedCache?: number;
  /** Bound of the cache of decoded images, bytes; 128 MiB. They are drawn smaller where they would not fit. */
  texelCache?: number;
  /** About how many texels images have along each side of a pixel, as near as halving allows; above 0; 1. */
  texelsPerPixel?: number;
  /** The channel to show: 'auto' (the first one of colours), 'none' or a name; 'none'. */
  channel?: 'auto' | 'none' | (string & {});
  /** The values that get the first and the last colour of the ramp, for numbers; those of the coarsest level. */
  range?: readonly [number, number];
  /**
   * Whether images have the file's normals beside the channel, for light; false. 'auto' then takes normals where there
   * are no colours.
   */
  normals?: boolean;
  /** Whether images have what else materials have beside the channel, if that is one of colours; false. */
  materials?: boolean;
  /**
   * Whether vertices get normals for smooth light where the file stores none (`storesNormals`), alike on both sides of
   * every border (SPEC.md, 14.5); false.
   */
  light?: boolean;
  /** Most reads at once; 6. */
  maxReads?: number;
  /** How far the camera's motion is predicted, milliseconds; 300. 0 turns prefetching off. */
  ahead?: number;
  /**
   * Most bytes of surfaces that a frame draws newly; Infinity. What does not fit waits, and what was drawn stays. One
   * root or group always goes, and so does what nothing was drawn in place of. Heights have no bound.
   */
  uploadBytes?: number;
}

/** The image of a tile of heights: a texel a sample, and one more on each side, which repeats the border. */
export interface TileImage {
  width: number;
  height: number;
  /** Red, green, blue and opacity, as screens show them (sRGB), if the stream shows colours. */
  data?: Uint8Array;
  /** Normals as half floats: components from -1 to 1 are numbers from 0 to 1, and a 1 follows. */
  normals: Uint16Array;
}

/** A root to upload, in place of what it was before. */
export interface Upload {
  /** Its number; OVERVIEW for the small mesh that stands in until the coarsest level is there. */
  root: number;
  level: number;
  /** Certified bound of its error, world units. */
  error: number;
  /** Relative to the stream's origin. Roots that meet have the same positions there, to the bit. */
  positions: Float32Array;
  triangles: Uint32Array;
  /**
   * In a stream with light the normal of each vertex, two numbers x and y of 32767 each: the point (x, y, 1 - |x| -
   * |y|) of an octahedron, where x and y give way to (1 - |y|) sign x and (1 - |x|) sign y if the third number is
   * negative. A Pool can make vectors of them. Vertices on creases are there once for each side.
   */
  normals?: Int16Array;
  /**
   * Colours of the channel that the stream shows. Undefined: the root keeps the image that it has. Null: the stream
   * shows none.
   */
  image?: Image | TileImage | null;
  /**
   * x and y of each vertex in the image, in texels: the first one lies between 0 and 1. Without places the image has
   * one texel, for all of the root.
   */
  places?: Float32Array;
  /**
   * Left, top, right and bottom of the part of the image around each vertex. Interpolation within a triangle must not
   * read beyond it.
   */
  rectangles?: Uint16Array;
}

/** What a frame changes, and what it shows then. */
export interface Frame {
  shows: 'nothing' | 'overview' | 'picture';
  /** Whether everything is drawn as wanted, except for what has been given up. */
  isComplete: boolean;
  uploads: Upload[];
  /** Roots that are no longer drawn. Drop them together with the uploads, or cracks show. */
  drops: number[];
  /** Roots that are coarser than wanted because their bytes are not there yet. */
  lateRoots: number;
  /**
   * Roots whose image is not there yet, or coarser than wanted. Without one a single texel stands for it: the mean of
   * one that is near.
   */
  lateImages: number;
  /** Roots that cannot be drawn at all, because what they need was given up. */
  lostRoots: number[];
  triangleCount: number;
  nodeCount: number;
  wantedNodeCount: number;
  /** Triangles that it would have if everything were there. */
  wantedTriangleCount: number;
  /** The largest error in the view, pixels; 0 without a view. */
  errorPx: number;
  limitedBy?: Limiter;
  /** The budget that even the coarsest cut exceeds. */
  exceeded?: Limiter;
  /**
   * `imageBytes` are those of decoded images in memory, `memoryBytes` the whole memory of the file's reader, which
   * never shrinks.
   */
  counters: { requests: number; bytesRead: number; decoded: number; failures: number; imageBytes: number; memoryBytes: number };
  /** What has been given up since the frame before, in words. */
  problems: string[];
}

/**
 * Has several streams that are drawn into one picture, such as a mesh, its ground and another mesh, keep one budget of
 * triangles, with about the same error for all after a few frames. In each frame ask for the limits, put them into the
 * queries, and record the frames.
 */
export class SharedBudget {
  /**
   * What each of `count` streams may take in the next frame: a tolerance for all of them, at least the one that is
   * worth having (pixels), and triangles for each, which together are the whole budget.
   */
  limits(maxTriangles: number, pixelTolerance: number, count: number): { pixelTolerance: number; maxTriangles: number[] };
  /** The frames of all streams, in the order of their shares. */
  record(frames: readonly Pick<Frame, 'wantedTriangleCount' | 'limitedBy'>[]): void;
}

/** Draws a file for a moving camera while it is being loaded. */
export class Stream {
  private constructor();
  readonly origin: Point;
  /** Called when something has been loaded, so that another frame would show more. */
  onprogress?: () => void;
  /** Never waits for bytes. Send one at a time. */
  frame(query: Query): Promise<Frame>;
  /** The channel that is shown. */
  readonly channel: Channel | null;
  /** The values of the ends of its ramp, where it has numbers. */
  readonly range: [number, number] | null;
  /** Shows another channel from the next frame on, which uploads everything. */
  show(channel: 'auto' | 'none' | (string & {}), options?: { range?: readonly [number, number]; normals?: boolean; materials?: boolean; signal?: AbortSignal }): Promise<void>;
  /** The next frame uploads everything that is drawn: for a GPU that has lost it. */
  lose(): Promise<void>;
  /** Tries again what has been given up. */
  retry(): Promise<void>;
  close(): void;
}

/** The number of the overview among roots. */
export const OVERVIEW: number;

/** Buffers that hold some roots. */
export interface Slab {
  readonly positions: Float32Array;
  /**
   * With `normals: 'octahedral'` two numbers a vertex, as uploads have them, and -32768 where there is no normal; with
   * 'vectors' x, y, z in 1/32767 and a 0.
   */
  readonly normals?: Int16Array;
  readonly info?: Float32Array;
  readonly indices: Uint32Array;
  /** With images: x and y of each vertex in the atlas, in texels. */
  readonly places?: Float32Array;
  /** With images: left, top, right and bottom of the part of the atlas around each vertex. */
  readonly rectangles?: Uint16Array;
  readonly atlas?: Atlas;
  /** How many indices have to be drawn. Unused ones among them draw nothing. */
  readonly indexCount: number;
  /** First and count of what has changed. Empty these lists after uploading. */
  dirtyVertices: [number, number][];
  dirtyIndices: [number, number][];
  /** Whatever the program keeps with it. */
  drawn: unknown;
}

/**
 * Textures of one size that hold the images of a slab's roots, which all have the same ones of these: see Image and
 * TileImage.
 */
export interface Atlas {
  readonly width: number;
  readonly height: number;
  /** Roots without any image have white without opacity. */
  readonly data?: Uint8Array;
  readonly normals?: Uint8Array | Uint16Array;
  readonly material?: Uint8Array;
  readonly emissive?: Uint8Array;
  /** Grows when height and data change, so that the texture has to be made anew. */
  readonly generation: number;
  /** What has changed. Empty this list after uploading. */
  dirtyTiles: { x: number; y: number; width: number; height: number }[];
}

/** A root in a slab. */
export interface PoolEntry {
  root: number;
  level: number;
  error: number;
  slab: Slab;
  firstVertex: number;
  vertexCount: number;
  firstIndex: number;
  indexCount: number;
  min: number[];
  max: number[];
}

/** Everything that frames draw, in few buffers. */
export class Pool {
  /**
   * `normals` says how slabs have those of a stream with light; without it they have none. `infoOf` returns `infoSize`
   * numbers for each vertex of a root. With `images` slabs have an atlas each, no side longer than `maxTextureSize`
   * (4096).
   */
  constructor(options?: {
    infoSize?: number;
    normals?: 'octahedral' | 'vectors';
    infoOf?: (entry: Pick<PoolEntry, 'root' | 'level' | 'error'>) => ArrayLike<number>;
    images?: boolean;
    maxTextureSize?: number;
  });
  readonly slabs: Slab[];
  readonly roots: Map<number, PoolEntry>;
  readonly triangleCount: number;
  /** Texels that roots use, and texels that atlases have. */
  readonly texels: { used: number; allocated: number };
  /** Called with a slab that is no longer drawn. */
  onremove?: (slab: Slab) => void;
  /** An image that is too large becomes its mean, and `problems` gets a line that says so. */
  update(frame: Pick<Frame, 'uploads' | 'drops'> & Partial<Pick<Frame, 'problems'>>): void;
  /** Asks `infoOf` again. */
  refresh(): void;
  /** The nearest point that a ray meets; relative to the stream's origin, like `origin`. */
  raycast(origin: number[], direction: number[]): { distance: number; point: number[]; entry: PoolEntry; triangle: number[] } | null;
}
