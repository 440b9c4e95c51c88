// Normals of vertices in two numbers: the sphere as an octahedron that is unfolded to a square.

/** Numbers of a vertex, in multiples of four bytes: two as streams have them, or a vector of length 32767 and a 0. */
export const NORMAL_SIZES = { octahedral: 2, vectors: 4 };
/** No normal: the least numbers, which no direction has. Vectors are 0 there. */
const NONE = -32768;
const MOST = 32767;

export function putNormals(target, kind, first, count, normals) {
  const [start, end] = [first, first + count].map((vertex) => NORMAL_SIZES[kind] * vertex);
  if (!normals) target.fill(kind === 'vectors' ? 0 : NONE, start, end);
  else if (kind === 'vectors') putVectors(target, start, normals);
  else target.set(normals, start);
}

function putVectors(target, start, normals) {
  for (let k = 0, at = start; k < normals.length; k += 2, at += 4) {
    let [x, y] = [normals[k] / MOST, normals[k + 1] / MOST];
    const z = 1 - Math.abs(x) - Math.abs(y);
    // The half below is folded out.
    if (z < 0) [x, y] = [(1 - Math.abs(y)) * (x < 0 ? -1 : 1), (1 - Math.abs(x)) * (y < 0 ? -1 : 1)];
    const scale = MOST / Math.sqrt(x * x + y * y + z * z);
    target[at] = Math.round(x * scale);
    target[at + 1] = Math.round(y * scale);
    target[at + 2] = Math.round(z * scale);
    target[at + 3] = 0;
  }
}
