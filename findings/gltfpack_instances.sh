#!/usr/bin/env bash
# What one would guess: `gltfpack -mi` (EXT_mesh_gpu_instancing) only changes how instances are stored, and skips nodes
# whose matrix is no translation, rotation and scale.
# What is so (gltfpack 1.3.0): a turned node below one that is scaled in one direction is sheared, and the shear is
# dropped: a triangle of area 1 gets one of 1.25, without a word. A flat node (scale 1 1 0) gets a rotation of length
# .87 where glTF asks for 1. With -kn ("keep named nodes") no instances are written, even if no node has a name.
# Consequence: lodpack normalises rotations of instances.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
echo '{"private": true}' > package.json
npm install --silent --no-audit --no-fund gltfpack@1.3.0
cat > run.mjs <<'JS'
import { execFileSync } from "node:child_process";
import { readFileSync, writeFileSync } from "node:fs";
const corners = Buffer.from(new Float32Array([0, 0, 0, 1, 0, 0, 0, 1, 0]).buffer);
const binary = Buffer.concat([corners, Buffer.from([0, 0, 1, 0, 2, 0])]);
/** What gltfpack makes of nodes that draw the triangle (0 0 0, 1 0 0, 0 1 0): the document and its instances. */
function pack(nodes, roots, ...flags) {
  const document = {
    asset: { version: "2.0" }, scene: 0, scenes: [{ nodes: roots }], nodes,
    meshes: [{ primitives: [{ attributes: { POSITION: 0 }, indices: 1 }] }],
    buffers: [{ byteLength: 42, uri: "data:application/octet-stream;base64," + binary.toString("base64") }],
    bufferViews: [{ buffer: 0, byteLength: 36 }, { buffer: 0, byteOffset: 36, byteLength: 6 }],
    accessors: [{ bufferView: 0, componentType: 5126, count: 3, type: "VEC3", min: [0, 0, 0], max: [1, 1, 0] },
      { bufferView: 1, componentType: 5123, count: 3, type: "SCALAR" }],
  };
  writeFileSync("in.gltf", JSON.stringify(document));
  execFileSync("node", ["node_modules/gltfpack/cli.js", "-i", "in.gltf", "-o", "out.glb", "-noq", "-mi", ...flags]);
  const bytes = readFileSync("out.glb");
  const json = bytes.readUInt32LE(12), rest = bytes.subarray(28 + json);
  const packed = JSON.parse(bytes.subarray(20, 20 + json));
  const found = packed.nodes.map((node) => node.extensions?.EXT_mesh_gpu_instancing?.attributes).find((found) => found);
  const row = (name, k, width) => {
    const accessor = packed.accessors[found[name]], view = packed.bufferViews[accessor.bufferView];
    const size = accessor.componentType === 5126 ? 4 : 2;
    const at = (view.byteOffset ?? 0) + (accessor.byteOffset ?? 0) + k * (view.byteStride ?? width * size);
    const number = (place) => (size === 4 ? rest.readFloatLE(place) : rest.readInt16LE(place) / 32767);
    return Array.from({ length: width }, (_, c) => number(at + size * c));
  };
  return { instances: found && [0, 1].map((k) => ({ rotation: row("ROTATION", k, 4), scale: row("SCALE", k, 3) })) };
}
const close = (a, b) => { if (Math.abs(a - b) > 0.001) throw new Error(`${a} and not ${b}: this has changed`); };
const eighth = { rotation: [0, 0, Math.sin(Math.PI / 8), Math.cos(Math.PI / 8)] };
const sheared = pack([{ scale: [2, 1, 1], children: [1, 2] }, { mesh: 0, ...eighth }, { mesh: 0 }], [0]).instances[0];
const area = sheared.scale[0] * sheared.scale[1] / 2;
console.log("sheared: scale", sheared.scale, "so an area of", area, "where it is 1");
close(area, 1.25);
const flat = pack([{ mesh: 0, scale: [1, 1, 0] }, { mesh: 0, translation: [5, 0, 0] }], [0, 1]).instances[0];
console.log("flat: rotation", flat.rotation, "of length", Math.hypot(...flat.rotation));
close(Math.hypot(...flat.rotation), 0.866);
const nameless = [{ mesh: 0 }, { mesh: 0, translation: [5, 0, 0] }];
const [without, kept] = [pack(nameless, [0, 1]), pack(nameless, [0, 1], "-kn")];
console.log("nameless nodes: instances", Boolean(without.instances), "and with -kn", Boolean(kept.instances));
if (!without.instances || kept.instances) throw new Error("this has changed");
JS
node run.mjs
