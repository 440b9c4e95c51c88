// What a frame changes, as typed arrays to upload and numbers of roots to drop.

/** The number of the overview among roots. No file has so many. */
export const OVERVIEW = 0xffff_ffff;

const SHOWS = ['nothing', 'overview', 'picture'];
const LIMITERS = [undefined, 'tolerance', 'finest', 'triangles', 'nodes', 'bytes'];

/** Reads what src/stream.rs packs. The arrays of all uploads share one buffer. */
export function unpackFrame(buffer) {
  const [shows, isComplete, lateRoots, lost, removed, changed, triangleCount, nodeCount, errorPx, limiter, exceeded, wanted,
    requests, bytesRead, decoded, failures] = new Float64Array(buffer, 0, 16);
  const errors = new Float64Array(buffer, 128, changed);
  let at = 128 + 8 * changed;
  const words = (count) => {
    const array = new Uint32Array(buffer, at, count);
    at += 4 * count;
    return array;
  };
  const lostRoots = [...words(lost)];
  const drops = [...words(removed)];
  const sizes = words(4 * changed);
  const uploads = Array.from({ length: changed }, (_, k) => {
    const [root, level, vertexCount, count] = sizes.subarray(4 * k, 4 * k + 4);
    const positions = new Float32Array(buffer, at, 3 * vertexCount);
    at += positions.byteLength;
    return { root, level, error: errors[k], positions, triangles: words(3 * count) };
  });
  return {
    shows: SHOWS[shows], isComplete: isComplete === 1, uploads, drops, lateRoots, lostRoots, triangleCount, nodeCount,
    wantedNodeCount: wanted, errorPx, limitedBy: LIMITERS[limiter], exceeded: LIMITERS[exceeded],
    counters: { requests, bytesRead, decoded, failures }, problems: [],
  };
}

/** A frame without changes. */
export function emptyFrame(shows) {
  return {
    shows, isComplete: false, uploads: [], drops: [], lateRoots: 0, lostRoots: [], triangleCount: 0, nodeCount: 0,
    wantedNodeCount: 0, errorPx: Infinity, limitedBy: undefined, exceeded: undefined,
    counters: { requests: 0, bytesRead: 0, decoded: 0, failures: 0 }, problems: [],
  };
}

/** The arrays of a frame whose memory may move to another thread. */
export function transferOf({ uploads }) {
  return [...new Set(uploads.map(({ positions }) => positions.buffer))];
}
