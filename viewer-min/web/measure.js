// A distance between two points of the surface, with a bound of what it can be off.

import { dot, norm, sub } from './camera.js';

export class Measure {
  #ends = [];

  constructor(svg) {
    this.svg = svg;
  }

  /** Adds a point, and how far it can be from the input; the third one begins anew. */
  add({ point, error }) {
    if (this.#ends.length === 2) this.#ends = [];
    this.#ends.push({ point, error });
  }

  clear() {
    this.#ends = [];
  }

  /**
   * Distance and bound, or null. The points of the input that the ends stand for are as far apart, give or take the
   * bound.
   */
  get result() {
    if (this.#ends.length < 2) return null;
    const [a, b] = this.#ends;
    return { distance: norm(sub(a.point, b.point)), uncertainty: a.error + b.error };
  }

  /** `12.34 ± 0.05`: no more digits than the bound allows. */
  get text() {
    const { result } = this;
    if (!result) return '';
    const digits = Math.min(Math.max(1 - Math.floor(Math.log10(result.uncertainty || 1e-12)), 0), 12);
    // The bound is rounded up.
    const bound = Math.ceil(result.uncertainty * 10 ** digits) / 10 ** digits;
    return `${result.distance.toFixed(digits)} ± ${bound.toFixed(digits)}`;
  }

  draw(camera, [width, height], verticalFov) {
    const [right, up, forward] = camera.axes;
    const perTangent = height / 2 / Math.tan(verticalFov / 2);
    const places = this.#ends.map(({ point }) => {
      const offset = sub(point, camera.position);
      const depth = dot(forward, offset);
      if (depth < camera.near) return null;
      return [width / 2 + (perTangent * dot(right, offset)) / depth, height / 2 - (perTangent * dot(up, offset)) / depth].map(Math.round);
    });
    const shown = places.filter(Boolean);
    const parts = shown.map(([x, y]) => `<circle cx="${x}" cy="${y}" r="4"/>`);
    if (shown.length === 2) {
      const [[a, b], [c, d]] = shown;
      parts.unshift(`<line x1="${a}" y1="${b}" x2="${c}" y2="${d}"/>`);
      parts.push(`<text x="${(a + c) / 2 + 8}" y="${(b + d) / 2 - 8}">${this.text}</text>`);
    }
    const all = parts.join('');
    if (this.svg.innerHTML !== all) this.svg.innerHTML = all;
  }
}
