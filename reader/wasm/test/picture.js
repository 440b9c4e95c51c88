// What is drawn, as one mesh: for checks of its edges.

/**
 * How many edges have one triangle, how many have another number than one or two in opposite directions, and how many
 * triangles are degenerate; vertices at one position are one vertex. `parts` are pairs of positions and indices.
 */
export function countEdges(parts) {
  const vertices = new Map();
  const edges = new Map();
  let degenerate = 0;
  for (const { positions, indices } of parts) {
    const weld = (vertex) => {
      // The bits of the positions as they are drawn.
      const key = `${positions[3 * vertex]} ${positions[3 * vertex + 1]} ${positions[3 * vertex + 2]}`;
      if (!vertices.has(key)) vertices.set(key, vertices.size);
      return vertices.get(key);
    };
    for (let k = 0; k < indices.length; k += 3) {
      const corners = [weld(indices[k]), weld(indices[k + 1]), weld(indices[k + 2])];
      if (new Set(corners).size < 3) degenerate += 1;
      for (let corner = 0; corner < 3; corner += 1) {
        const [from, to] = [corners[corner], corners[(corner + 1) % 3]];
        // A neighbour has the edge the other way round.
        const key = from < to ? `${from} ${to}` : `${to} ${from}`;
        edges.set(key, (edges.get(key) ?? 0) + (from < to ? 1 : 1_000_000));
      }
    }
  }
  const uses = [...edges.values()];
  return {
    boundary: uses.filter((use) => use === 1 || use === 1_000_000).length,
    wrong: uses.filter((use) => ![1, 1_000_000, 1_000_001].includes(use)).length,
    degenerate,
  };
}

/** The edges of what a pool draws. */
export function edgesOf(pool) {
  const parts = ({ slab: { positions, indices }, firstIndex, indexCount }) => ({ positions, indices: indices.subarray(firstIndex, firstIndex + indexCount) });
  return countEdges([...pool.roots.values()].map(parts));
}

/** The edges of a mesh that was extracted, seen from the origin of a stream. */
export function edgesOfMesh({ positions, triangles }, origin) {
  return countEdges([{ positions: Float32Array.from(positions, (x, k) => x - origin[k % 3]), indices: triangles }]);
}

/** The cut that a pool shows. */
export function nodesOf(pool) {
  const pairs = [...pool.roots.values()].map(({ root, level }) => [root, level]).sort(([a], [b]) => a - b);
  return Uint32Array.from(pairs.flat());
}

/** A view of everything, from `distance` radii away. */
export function viewOf({ min, max }, distance, angle = 0, pixelTolerance = 1) {
  const middle = min.map((low, k) => (low + max[k]) / 2);
  const radius = Math.max(Math.hypot(...min.map((low, k) => max[k] - low)) / 2, 1e-9);
  const forward = [-Math.sin(angle), 0, -Math.cos(angle)];
  return { position: middle.map((x, k) => x - distance * radius * forward[k]), forward, viewport: [800, 600], near: radius / 1000, pixelTolerance };
}

/** Sends frames until one is complete. */
export async function settle(stream, pool, query, most = 2000) {
  for (let k = 0; k < most; k += 1) {
    const frame = await stream.frame(query);
    pool.update(frame);
    if (frame.isComplete) return frame;
    await new Promise((resolve) => setTimeout(resolve, 5));
  }
  throw new Error('the stream does not become complete');
}

/** The colour that the painted file has at a point: tests/tests/channels.rs says so. */
export function paintedColour([x, y, z]) {
  return [2 * x + y, 3 * y, 4 * z].map((angle) => 127.5 + 100 * Math.sin(angle));
}

/** The number that it has there. */
export function paintedHeight([, , z]) {
  return 10 * z;
}

/** The normal of the file *valid-lit*: a torus around z, of radius 1. */
export function outwardsOfTorus([x, y, z]) {
  const radius = Math.hypot(x, y);
  const outwards = [x - x / radius, y - y / radius, z];
  return outwards.map((value) => value / Math.hypot(...outwards));
}

/** The pixels of what the viewer page shows now, with these images, lit or not. */
export function pixelsOf({ renderer, shown, camera }, image, isUnlit) {
  const { gl, canvas } = renderer;
  renderer.draw(shown.surfaces.map((surface) => ({ ...surface.drawn(camera), image })), { colour: 'shading', tolerance: 1, wireframe: false, isUnlit });
  const pixels = new Uint8Array(4 * canvas.width * canvas.height);
  gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  return pixels;
}

/**
 * What the strips of `valid-drawn` show, which lie side by side along x: of each the share of its pixels that show it
 * and not the background, and among these the share whose red is that of the file. `place` gives the x of what a pixel
 * shows.
 */
export function stripsOf(pixels, { width, height }, place) {
  const strips = Array.from({ length: 6 }, () => ({ all: 0, shown: 0, plain: 0 }));
  for (let y = 0; y < height; y += 1) {
    for (let x = 0; x < width; x += 1) {
      const at = place(x, y);
      const strip = strips[Math.floor(at)];
      // Not near the border of two.
      if (!strip || Math.abs(at - Math.floor(at) - 0.5) > 0.45) continue;
      const [red, green, blue] = pixels.subarray(4 * (y * width + x));
      strip.all += 1;
      if (Math.hypot(red - 232, green - 236, blue - 244) < 6) continue;
      strip.shown += 1;
      strip.plain += Math.abs(red - 200) < 12 ? 1 : 0;
    }
  }
  return strips.map(({ all, shown, plain }) => ({ all, shown: shown / all, plain: plain / shown }));
}
