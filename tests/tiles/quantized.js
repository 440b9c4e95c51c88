// Checks a folder of quantized-mesh tiles with a decoder that lodpack has no part in: node quantized.js FOLDER. Prints
// what it found as JSON; exit status 1 if anything is wrong.

import { readFile, readdir } from 'node:fs/promises';
import { join } from 'node:path';
import decoder from '@here/quantized-mesh-decoder';

const decode = decoder.default ?? decoder;

const folder = process.argv[2];
const problems = [];
const say = (where, what) => problems.push(`${where}: ${what}`);
const LAST = 32767;
const RADII = [6378137, 6378137, 6356752.314245179];

const layer = JSON.parse(await readFile(join(folder, 'layer.json'), 'utf8'));
if (layer.format !== 'quantized-mesh-1.0' || layer.scheme !== 'tms' || layer.projection !== 'EPSG:4326') say('layer.json', 'is of another kind');
if (layer.available.length !== layer.maxzoom + 1) say('layer.json', 'does not say what is available at each level');
const isAvailable = (z, x, y) =>
  layer.available[z]?.some(({ startX, startY, endX, endY }) => startX <= x && x <= endX && startY <= y && y <= endY) ?? false;
for (const x of [0, 1]) if (!isAvailable(0, x, 0)) say('layer.json', `lacks the tile 0/${x}/0, without which Cesium shows nothing`);

/** Longitude, latitude and height to metres from the middle of the earth. */
function place(longitude, latitude, height) {
  const [l, b] = [longitude, latitude].map((angle) => (angle * Math.PI) / 180);
  const e2 = 1 - (RADII[2] / RADII[0]) ** 2;
  const n = RADII[0] / Math.sqrt(1 - e2 * Math.sin(b) ** 2);
  return [(n + height) * Math.cos(b) * Math.cos(l), (n + height) * Math.cos(b) * Math.sin(l), (n * (1 - e2) + height) * Math.sin(b)];
}

function normalOf(x, y) {
  const [a, b] = [x, y].map((byte) => (byte / 255) * 2 - 1);
  const c = 1 - Math.abs(a) - Math.abs(b);
  const n = c < 0 ? [(1 - Math.abs(b)) * Math.sign(a || 1), (1 - Math.abs(a)) * Math.sign(b || 1), c] : [a, b, c];
  const length = Math.hypot(...n);
  return n.map((value) => value / length);
}

const dot = (a, b) => a.reduce((sum, value, k) => sum + value * b[k], 0);

const tiles = new Map();
const found = { tiles: 0, triangles: 0, levels: layer.maxzoom + 1, vertices: [], neighbours: 0, largest: 0 };
for (const path of (await readdir(folder, { recursive: true })).filter((path) => path.endsWith('.terrain'))) {
  const [z, x, y] = path.replace('.terrain', '').split(/[\\/]/).map(Number);
  if (!isAvailable(z, x, y)) say(path, 'is not among those that are available');
  const bytes = await readFile(join(folder, path));
  const { header, vertexData, triangleIndices, westIndices, southIndices, eastIndices, northIndices, extensions } = decode(
    bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength),
  );
  const count = vertexData.length / 3;
  const [u, v, h] = [0, 1, 2].map((k) => vertexData.subarray(k * count, (k + 1) * count));
  if (vertexData.some((value) => value > LAST)) say(path, 'has a vertex outside');
  const { minHeight, maxHeight } = header;
  const side = 180 / 2 ** z;
  const heights = Array.from(h, (value) => minHeight + (value / LAST) * (maxHeight - minHeight));
  const degrees = Array.from(u, (_, k) => [-180 + side * (x + u[k] / LAST), -90 + side * (y + v[k] / LAST)]);
  // All of the square is covered once, by triangles that are seen from above.
  let area = 0;
  for (let k = 0; k < triangleIndices.length; k += 3) {
    const [a, b, c] = triangleIndices.subarray(k, k + 3);
    if (Math.max(a, b, c) >= count) say(path, 'has a triangle without a vertex');
    const own = (u[b] - u[a]) * (v[c] - v[a]) - (u[c] - u[a]) * (v[b] - v[a]);
    if (own <= 0) say(path, 'has a triangle that is turned over');
    area += own;
  }
  if (area !== 2 * LAST * LAST) say(path, `covers ${area / (2 * LAST * LAST)} of its square`);
  // Edges have all vertices that lie on them.
  const edges = { west: [u, 0, westIndices], south: [v, 0, southIndices], east: [u, LAST, eastIndices], north: [v, LAST, northIndices] };
  const along = {};
  for (const [name, [axis, line, indices]] of Object.entries(edges)) {
    const on = Array.from(axis, (_, k) => k).filter((k) => axis[k] === line);
    if ([...indices].sort((a, b) => a - b).join() !== on.join()) say(path, `does not list its vertices in the ${name}`);
    const other = axis === u ? v : u;
    along[name] = on.map((k) => [other[k], heights[k]]).sort((a, b) => a[0] - b[0]);
  }
  // The ball around it, the middle, and normals that point up.
  const centre = [header.boundingSphereCenterX, header.boundingSphereCenterY, header.boundingSphereCenterZ];
  const positions = degrees.map(([longitude, latitude], k) => place(longitude, latitude, heights[k]));
  for (const position of positions) {
    if (Math.hypot(...position.map((value, k) => value - centre[k])) > header.boundingSphereRadius) say(path, 'reaches out of its ball');
  }
  const occluder = [header.horizonOcclusionPointX, header.horizonOcclusionPointY, header.horizonOcclusionPointZ];
  if (!occluder.every(Number.isFinite) || Math.hypot(...occluder) < 1 - 1e-9) say(path, 'has a point of occlusion in the earth');
  const normals = extensions.vertexNormals;
  if (normals?.length !== 2 * count) say(path, 'does not have a normal for each vertex');
  positions.forEach((position, k) => {
    if (dot(normalOf(normals[2 * k], normals[2 * k + 1]), position) <= 0) say(path, 'has a normal that points down');
  });
  tiles.set(`${z}/${x}/${y}`, { along, step: (maxHeight - minHeight) / LAST });
  found.tiles += 1;
  found.triangles += triangleIndices.length / 3;
  found.largest = Math.max(found.largest, bytes.length);
  if (z === layer.maxzoom) degrees.forEach(([longitude, latitude], k) => found.vertices.push([longitude, latitude, heights[k]]));
}

// Neighbours of a level have the same vertices on their border, across the date line, too.
for (const [name, { along, step }] of tiles) {
  const [z, x, y] = name.split('/').map(Number);
  for (const [mine, theirs, other] of [['east', 'west', `${z}/${(x + 1) % 2 ** (z + 1)}/${y}`], ['north', 'south', `${z}/${x}/${y + 1}`]]) {
    const there = tiles.get(other);
    if (!there) continue;
    found.neighbours += 1;
    const [a, b] = [along[mine], there.along[theirs]];
    if (a.map(([at]) => at).join() !== b.map(([at]) => at).join()) {
      say(name, `has other vertices than ${other}`);
      continue;
    }
    const off = Math.max(...a.map(([, height], k) => Math.abs(height - b[k][1])));
    if (off > step + there.step + 1e-2) say(name, `is ${off} m from ${other}`);
  }
}
let wanted = 0;
for (const ranges of layer.available) for (const { startX, startY, endX, endY } of ranges) wanted += (endX - startX + 1) * (endY - startY + 1);
if (wanted !== tiles.size) say('layer.json', `says that ${wanted} tiles are available, and ${tiles.size} are there`);

console.log(JSON.stringify(found));
problems.slice(0, 20).forEach((problem) => console.error(problem));
// Not process.exit: it would cut off what a pipe has not taken yet.
process.exitCode = problems.length > 0 ? 1 : 0;
