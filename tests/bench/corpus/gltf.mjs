// What glTF Transform reads of a glTF file's default scene, and what the official validator says of it.
// usage: node gltf.mjs FILE OUT.json OUT.bin [--validate]; packages are looked for in the current folder.
import { createRequire } from "node:module";
import { readFileSync, writeFileSync } from "node:fs";
import { dirname, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const require = createRequire(pathToFileURL(process.cwd() + "/"));
const load = async (name) => import(pathToFileURL(require.resolve(name)));
const [file, head, body, validate] = process.argv.slice(2);
const said = { primitives: [], images: [] };
const chunks = [];
let bytes = 0;
function put(array) {
  const data = Buffer.from(array.buffer, array.byteOffset, array.byteLength);
  const at = bytes;
  chunks.push(data, Buffer.alloc((8 - (data.length % 8)) % 8));
  bytes += data.length + ((8 - (data.length % 8)) % 8);
  return [at, data.length];
}

if (validate) {
  const validator = require("gltf-validator");
  const outside = (uri) => Promise.resolve(new Uint8Array(readFileSync(resolve(dirname(file), decodeURIComponent(uri)))));
  try {
    const report = await validator.validateBytes(new Uint8Array(readFileSync(file)), { uri: file, externalResourceFunction: outside, maxIssues: 20 });
    said.validator = { errors: report.issues.numErrors, first: report.issues.messages.filter((m) => m.severity === 0).map((m) => `${m.code} ${m.pointer}`).slice(0, 3) };
    said.version = report.info?.version;
  } catch (why) {
    said.validator = { errors: 1, first: [String(why)] };
  }
}

try {
  const { NodeIO, Logger } = await load("@gltf-transform/core");
  const { ALL_EXTENSIONS } = await load("@gltf-transform/extensions");
  const draco = require("draco3dgltf");
  const { MeshoptDecoder } = await load("meshoptimizer");
  await MeshoptDecoder.ready;
  const io = new NodeIO().setLogger(new Logger(Logger.Verbosity.SILENT)).registerExtensions(ALL_EXTENSIONS);
  io.registerDependencies({ "draco3d.decoder": await draco.createDecoderModule(), "meshopt.decoder": MeshoptDecoder });
  const root = (await io.read(file)).getRoot();
  said.required = root.listExtensionsRequired().map((e) => e.extensionName);
  const scene = root.getDefaultScene() ?? root.listScenes()[0];
  scene?.traverse((node) => node.getMesh() && add(node, root));
} catch (why) {
  said.error = String(why).split("\n")[0];
}
writeFileSync(head, JSON.stringify(said));
writeFileSync(body, Buffer.concat(chunks));

function add(node, root) {
  const matrices = node.getSkin() ? [[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]] : copies(node);
  for (const primitive of node.getMesh().listPrimitives()) {
    const position = primitive.getAttribute("POSITION");
    if (!position || ![4, 5, 6].includes(primitive.getMode())) continue;
    const count = position.getCount(), index = primitive.getIndices();
    const corners = index ? Array.from(index.getArray()) : [...Array(count).keys()];
    const material = primitive.getMaterial(), texture = material?.getBaseColorTexture();
    const info = material?.getBaseColorTextureInfo(), move = info?.getExtension("KHR_texture_transform");
    const uv = texture && primitive.getAttribute(`TEXCOORD_${move?.getTexCoord() ?? info.getTexCoord()}`);
    const colour = primitive.getAttribute("COLOR_0");
    const entry = { positions: put(elements(position)), corners: put(Uint32Array.from(triangles(corners, primitive.getMode()))), matrices };
    entry.factor = material?.getBaseColorFactor() ?? [1, 1, 1, 1];
    entry.looks = Boolean(material || colour);
    if (colour) entry.colours = [put(elements(colour)), colour.getElementSize()];
    if (texture && uv) {
      entry.uv = put(elements(uv));
      entry.move = move ? [...move.getOffset(), move.getRotation(), ...move.getScale()] : [0, 0, 0, 1, 1];
      entry.wrap = [info.getWrapS(), info.getWrapT()];
      entry.image = root.listTextures().indexOf(texture);
      said.images[entry.image] ??= put(texture.getImage() ?? new Uint8Array());
    }
    said.primitives.push(entry);
  }
}

function elements(accessor) {
  const size = accessor.getElementSize(), all = new Float64Array(accessor.getCount() * size), one = [];
  for (let i = 0; i < accessor.getCount(); i++) all.set(accessor.getElement(i, one), i * size);
  return all;
}

function triangles(corners, mode) {
  if (mode === 4) return corners.slice(0, corners.length - (corners.length % 3));
  const all = [];
  for (let i = 0; i + 2 < corners.length; i++) {
    if (mode === 6) all.push(corners[0], corners[i + 1], corners[i + 2]);
    else all.push(corners[i], corners[i + 1 + (i % 2)], corners[i + 2 - (i % 2)]);
  }
  return all;
}

// The world matrices of a node: one, or one an instance.
function copies(node) {
  const world = node.getWorldMatrix(), many = node.getExtension("EXT_mesh_gpu_instancing");
  if (!many) return [world];
  const [t, r, s] = ["TRANSLATION", "ROTATION", "SCALE"].map((name) => many.getAttribute(name));
  return [...Array((t ?? r ?? s).getCount()).keys()].map((i) => {
    const [x, y, z, w] = r ? r.getElement(i, []) : [0, 0, 0, 1];
    const [a, b, c] = s ? s.getElement(i, []) : [1, 1, 1], move = t ? t.getElement(i, []) : [0, 0, 0];
    const local = [a * (1 - 2 * (y * y + z * z)), a * 2 * (x * y + z * w), a * 2 * (x * z - y * w), 0,
      b * 2 * (x * y - z * w), b * (1 - 2 * (x * x + z * z)), b * 2 * (y * z + x * w), 0,
      c * 2 * (x * z + y * w), c * 2 * (y * z - x * w), c * (1 - 2 * (x * x + y * y)), 0, ...move, 1];
    return local.map((_, k) => [0, 1, 2, 3].reduce((sum, j) => sum + world[(k % 4) + 4 * j] * local[(k - (k % 4)) + j], 0));
  });
}
