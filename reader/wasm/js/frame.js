// What a frame changes, as typed arrays to upload and numbers of roots to drop.

/** The number of the overview among roots. No file has that many. */
export const OVERVIEW = 0xffff_ffff;

// Bits of an upload's flags.
const SHOWS_CHANNEL = 1;
const HAS_PLACES = 2;
const HAS_NORMALS = 4;
const HAS_COLOURS = 8;
/** Bits of what comes with the image of a channel: four bytes a texel each, in this order. */
const BESIDE = { normals: 16, material: 32, emissive: 64 };
const HAS_LIGHT = 128;
const SHOWS = ['nothing', 'overview', 'picture'];
export const LIMITERS = [undefined, 'tolerance', 'finest', 'triangles', 'nodes', 'bytes'];

/** Reads what src/stream.rs packs. The arrays of all uploads share one buffer. */
export function unpackFrame(buffer) {
  const [shows, isComplete, lateRoots, lost, removed, changed, triangleCount, nodeCount, errorPx, limiter, exceeded, wanted, wantedTriangles,
    requests, bytesRead, decoded, failures, lateImages, imageBytes] = new Float64Array(buffer, 0, 19);
  const errors = new Float64Array(buffer, 152, changed);
  let at = 152 + 8 * changed;
  const take = (type, count) => {
    const array = new type(buffer, at, count);
    at += array.byteLength;
    return array;
  };
  const lostRoots = [...take(Uint32Array, lost)];
  const drops = [...take(Uint32Array, removed)];
  const words = take(Uint32Array, 7 * changed);
  const uploads = Array.from({ length: changed }, (_, k) => {
    const [root, level, vertexCount, count, flags, width, height] = words.subarray(7 * k, 7 * k + 7);
    const upload = { root, level, error: errors[k], positions: take(Float32Array, 3 * vertexCount), triangles: take(Uint32Array, 3 * count) };
    if (flags & HAS_LIGHT) upload.normals = take(Int16Array, 2 * vertexCount);
    if (flags & HAS_PLACES) Object.assign(upload, { places: take(Float32Array, 2 * vertexCount), rectangles: take(Uint16Array, 4 * vertexCount) });
    // Without one it keeps the image that it has.
    if (flags & HAS_NORMALS) {
      const data = flags & HAS_COLOURS ? take(Uint8Array, 4 * width * height) : undefined;
      upload.image = { width, height, data, normals: take(Uint16Array, 4 * width * height) };
    } else if (width > 0) {
      upload.image = { width, height, data: take(Uint8Array, 4 * width * height) };
      for (const [name, bit] of Object.entries(BESIDE)) if (flags & bit) upload.image[name] = take(Uint8Array, 4 * width * height);
    } else if (!(flags & SHOWS_CHANNEL)) upload.image = null;
    return upload;
  });
  return {
    shows: SHOWS[shows], isComplete: isComplete === 1, uploads, drops, lateRoots, lostRoots, lateImages, triangleCount, nodeCount,
    wantedNodeCount: wanted, wantedTriangleCount: wantedTriangles, errorPx, limitedBy: LIMITERS[limiter], exceeded: LIMITERS[exceeded],
    counters: { requests, bytesRead, decoded, failures, imageBytes, memoryBytes: 0 }, problems: [],
  };
}

export const emptyFrame = (shows) => ({ ...unpackFrame(new ArrayBuffer(152)), shows, errorPx: Infinity });

export function transferOf({ uploads }) {
  return [...new Set(uploads.map(({ positions }) => positions.buffer))];
}
