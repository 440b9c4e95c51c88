// Asks everything of a file that may be hostile. Runs in Node and in pages.

import { viewOf } from './picture.js';

/** How an honest reader may refuse: what the file says, or what its bytes cannot answer. */
const HONEST = new Set(['format', 'unsupported', 'limit', 'query']);
const FRAMES = 4;
/** A hostile file may have many levels, and asking for each says nothing new. */
const MOST_LEVELS = 4;

/**
 * Opens bytes with `open(bytes)` and asks for cuts, meshes, channels and frames. Returns what went well, by name, and
 * throws if anything does worse than to be refused.
 */
export async function ask(open, bytes) {
  const done = new Set();
  const attempt = async (name, call) => {
    try {
      const result = await call();
      done.add(name);
      return result;
    } catch (error) {
      if (error?.name === 'LodpackError' && HONEST.has(error.kind)) return undefined;
      throw new Error(`${name}: ${error?.kind}: ${error?.stack}`, { cause: error });
    }
  };
  const file = await attempt('open', () => open(bytes));
  if (!file) return done;
  const overview = await attempt('overview', () => file.overview());
  if (overview) checkMesh(overview);
  const middle = file.bounds?.max.map((high, axis) => (high + file.bounds.min[axis]) / 2);
  const view = file.bounds && viewOf(file.bounds, 2);
  const queries = [{}, { tolerance: Infinity }, { maxTriangles: 40 }, { maxBytes: 100 }];
  if (file.bounds) queries.push({ box: [file.bounds.min, middle] }, { box: [middle, file.bounds.max], outside: 'coarsest' }, { view });
  const selects = queries.map((query) => () => file.select(query));
  for (let level = 0; level < Math.min(file.levels.length, MOST_LEVELS); level += 1) selects.push(() => file.selectLevel(level));
  for (const select of selects) {
    const cut = await attempt('select', select);
    if (!cut) continue;
    const mesh = await attempt('extract', () => file.extract(cut));
    if (mesh) checkMesh(mesh);
    await attempt('edges', () => file.boundaryEdgeCount(cut));
  }
  const finest = await attempt('select', () => file.selectLevel(file.levels.length - 1));
  const names = file.channels.map(({ name }) => name);
  for (const name of names) await attempt('range', () => file.channelRange(name));
  if (finest && names.length > 0) {
    const mesh = await attempt('textured', () => file.extract(finest, { channels: names, pageSize: 256 }));
    if (mesh) checkMesh(mesh);
  }
  await attempt('stream', () => stream(file, view ?? {}, attempt));
  const ground = await attempt('ground', () => file.ground());
  if (ground) {
    await attempt('stream', () => stream(ground, ground.frame.view(view ?? {}), attempt));
    ground.close();
  }
  // Whatever was refused, the reader still answers.
  const again = await attempt('again', () => file.overview());
  if (done.has('overview') !== done.has('again') || again?.triangles.length !== overview?.triangles.length) throw new Error('it answers differently afterwards');
  file.close();
  return done;
}

async function stream(file, view, attempt) {
  const stream = await file.stream({ byteCache: 1 << 16, decodedCache: 1 << 18, texelCache: 1 << 16 });
  for (const channel of ['none', ...file.channels.map(({ name }) => name)]) {
    await attempt('show', () => stream.show(channel));
    for (let frame = 0; frame < FRAMES; frame += 1) {
      const query = file.bounds ? { view: { ...view, position: view.position.map((x, axis) => x + frame * (file.bounds.min[axis] - x) / 4) } } : {};
      const shown = await attempt('frame', () => stream.frame(query));
      shown?.uploads.forEach(checkMesh);
      if (shown?.isComplete && shown.shows === 'picture') {
        await attempt('picture', () => {});
        break;
      }
      await new Promise((resolve) => setTimeout(resolve, 0));
    }
  }
  stream.close();
}

function checkMesh({ positions, triangles }) {
  const vertexCount = positions.length / 3;
  if (!triangles.every((vertex) => vertex < vertexCount)) throw new Error('a triangle without vertices');
}
