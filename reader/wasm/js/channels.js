// What the surface carries: which channels there are, and which ones a program means.

import { LodpackError } from './errors.js';

const KINDS = ['unknown', 'colour', 'scalar', 'normal', 'label', 'factor', 'drawing'];
/** Whether texels of a kind come as red, green, blue and opacity. */
export const isOfBytes = (kind) => ['colour', 'normal', 'factor'].includes(kind);
export const NO_CHANNEL = 0xffff_ffff;

/** Reads what src/channels.rs packs: seven numbers for each channel, and their names. */
export function unpackChannels(numbers, names) {
  const lines = names.split('\n');
  return Array.from({ length: numbers.length / 7 }, (_, k) => {
    const [kind, components, low, step, bound, imageBytes, lossless] = numbers.subarray(7 * k);
    return { name: lines[k], kind: KINDS[kind] ?? 'unknown', components, low, step, bound, imageBytes, lossless: lossless === 1 };
  });
}

/**
 * The number of the channel that is meant: 'auto' is the first one of colours, else one of a kind that will do as
 * well; NO_CHANNEL is none.
 */
export function channelNumber(channels, wanted = 'none', alsoKind = undefined) {
  if (wanted === null || wanted === 'none') return NO_CHANNEL;
  const first = (is) => channels.findIndex(({ kind }) => kind === is);
  const automatic = first('colour') >= 0 ? first('colour') : first(alsoKind);
  const number = wanted === 'auto' ? automatic : channels.findIndex(({ name }) => name === wanted);
  if (number >= 0) return number;
  if (wanted === 'auto') return NO_CHANNEL;
  const names = channels.map(({ name }) => name).join(', ');
  throw new LodpackError('query', names ? `the file has no channel ${wanted}; it has ${names}` : `the file has no channel ${wanted}: it has none`);
}

export function channelNumbers(channels, wanted) {
  const list = Array.isArray(wanted) ? wanted : [wanted];
  return [...new Set(list.map((name) => channelNumber(channels, name)))].filter((number) => number !== NO_CHANNEL);
}

export function checkedRange(range) {
  if (range == null) return undefined;
  const [low, high] = range;
  if (Number.isFinite(low) && Number.isFinite(high) && low < high) return [low, high];
  throw new LodpackError('query', `a range has a lower and a higher value, not ${JSON.stringify(range)}`);
}

/** Reads what `extract_textured` packs: a mesh whose vertices have places in pages, and the pages of each channel. */
export function unpackTextured(buffer, pageCount, infos) {
  const [vertexCount, triangleCount] = new Float64Array(buffer, 0, 2);
  let at = 16;
  const take = (type, count) => {
    const array = new type(buffer, at, count);
    at += Math.ceil(array.byteLength / 4) * 4;
    return array;
  };
  const positions = take(Float64Array, 3 * vertexCount);
  const uvs = take(Float32Array, 2 * vertexCount);
  const triangles = take(Uint32Array, 3 * triangleCount);
  const triangleNodes = take(Uint32Array, triangleCount);
  const counts = take(Uint32Array, pageCount + 1);
  const sizes = take(Uint32Array, 2 * pageCount);
  const parts = [];
  let firstIndex = 0;
  counts.forEach((count, page) => {
    if (count > 0) parts.push({ page: page < pageCount ? page : null, firstIndex, indexCount: 3 * count });
    firstIndex += 3 * count;
  });
  const channels = infos.map((info) => {
    const [pageComponents] = take(Uint32Array, 1);
    const type = isOfBytes(info.kind) ? Uint8Array : Uint16Array;
    const pages = Array.from({ length: pageCount }, (_, page) => {
      const [width, height] = sizes.subarray(2 * page);
      return { width, height, components: pageComponents, data: take(type, pageComponents * width * height) };
    });
    return { ...info, pages };
  });
  return { positions, triangles, triangleNodes, uvs, parts, channels };
}
