// Validates a folder of 3D Tiles: node check.js FOLDER. Prints a summary as JSON; exit status 1 if anything is wrong.
//
// Every tile goes through Khronos' glTF validator. The files of JSON are checked here, and also by the schemas of the
// 3D Tiles specification where LODPACK_TILES_SCHEMA names a copy of its folder specification/schema.

import { readFile, readdir } from 'node:fs/promises';
import { dirname, join, normalize, relative } from 'node:path';
import Ajv from 'ajv';
import validator from 'gltf-validator';

const folder = process.argv[2];
const problems = [];
const seen = { tilesets: 0, tiles: 0, errors: 0, warnings: 0, infos: {} };
const used = new Set();
const say = (where, what) => problems.push(`${where}: ${what}`);

/** The official schemas, if they are there. */
async function schemas() {
  const from = process.env.LODPACK_TILES_SCHEMA;
  if (!from) return undefined;
  const ajv = new Ajv({ strict: false, allErrors: true, validateFormats: false });
  for (const path of await readdir(from, { recursive: true })) {
    if (!path.endsWith('.schema.json')) continue;
    const schema = JSON.parse(await readFile(join(from, path), 'utf8'));
    delete schema.$schema;
    // References are relative to the file.
    schema.$id = `http://schema/${path}`;
    ajv.addSchema(schema);
  }
  return ajv.getSchema('http://schema/tileset.schema.json');
}
const schema = await schemas();

const isNumber = (value) => typeof value === 'number' && Number.isFinite(value);
/** Whether box `a` holds box `b`, both along the axes. */
const holds = (a, b) => [0, 1, 2].every((k) => {
  const [half, other] = [a[3 + 4 * k], b[3 + 4 * k]];
  return Math.abs(a[k] - b[k]) + other <= half * (1 + 1e-12) + 1e-12;
});

function checkTile(where, tile, above) {
  const box = tile.boundingVolume?.box;
  if (box?.length !== 12 || !box.every(isNumber)) return say(where, 'no box');
  if (!isNumber(tile.geometricError) || tile.geometricError < 0) say(where, 'no geometric error');
  if (above && tile.geometricError > above.geometricError) say(where, 'a tile is worse than what it replaces');
  if (above && !holds(above.boundingVolume.box, box)) say(where, 'a tile leaves the box above it');
  if (tile.children && tile.children.length === 0) say(where, 'an empty list of children');
  for (const child of tile.children ?? []) checkTile(where, child, tile);
  return undefined;
}

async function tileset(path, above) {
  seen.tilesets += 1;
  const where = relative(folder, path);
  const document = JSON.parse(await readFile(path, 'utf8'));
  if (schema && !schema(document)) schema.errors.slice(0, 5).forEach((error) => say(where, `schema: ${error.instancePath} ${error.message}`));
  if (document.asset?.version !== '1.1') say(where, 'no version 1.1');
  if (!isNumber(document.geometricError)) say(where, 'no geometric error');
  if (!['REPLACE', 'ADD'].includes(document.root?.refine)) say(where, 'the root does not say how it is refined');
  checkTile(where, document.root, above);
  const contents = [];
  (function collect(tile) {
    if (tile.content) contents.push([tile.content.uri, tile]);
    (tile.children ?? []).forEach(collect);
  })(document.root);
  for (const [uri, tile] of contents) {
    const target = normalize(join(dirname(path), uri));
    if (relative(folder, target).startsWith('..')) say(where, `${uri} leaves the folder`);
    if (used.has(target)) say(where, `${uri} is used twice`);
    used.add(target);
    if (uri.endsWith('.json')) await tileset(target, tile);
    else await glb(target);
  }
}

async function glb(path) {
  seen.tiles += 1;
  const bytes = new Uint8Array(await readFile(path));
  const report = await validator.validateBytes(bytes, { maxIssues: 100, ignoredIssues: [] });
  seen.errors += report.issues.numErrors;
  seen.warnings += report.issues.numWarnings;
  for (const { severity, code, message, pointer } of report.issues.messages) {
    if (severity < 2) say(relative(folder, path), `${code} ${pointer}: ${message}`);
    else seen.infos[code] = (seen.infos[code] ?? 0) + 1;
  }
}

await tileset(join(folder, 'tileset.json'), undefined);
for (const path of await readdir(folder, { recursive: true })) {
  if (/\.(json|glb)$/.test(path) && path !== 'tileset.json' && !used.has(join(folder, path))) say(path, 'nothing leads to it');
}
console.log(JSON.stringify({ ...seen, hasSchema: Boolean(schema), problems: problems.slice(0, 50) }));
process.exit(problems.length > 0 ? 1 : 0);
