// The camera: position, what it looks at, and which way is up; orbiting and flying; as text for the page's address.

export const VERTICAL_FOV = Math.PI / 4;

export const add = (a, b) => a.map((x, k) => x + b[k]);
export const sub = (a, b) => a.map((x, k) => x - b[k]);
export const scale = (a, t) => a.map((x) => x * t);
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const norm = (a) => Math.hypot(...a);
export const unit = (a) => scale(a, 1 / (norm(a) || 1));

/** A vector turned about an axis of length one. */
function turned(v, axis, angle) {
  const [sine, cosine] = [Math.sin(angle), Math.cos(angle)];
  return add(add(scale(v, cosine), scale(cross(axis, v), sine)), scale(axis, dot(axis, v) * (1 - cosine)));
}

export class Camera {
  constructor() {
    [this.position, this.target, this.up, this.radius] = [[0, 0, 3], [0, 0, 0], [0, 1, 0], 1];
  }

  /** Looks at a whole box from the front right, a little from above, in a picture `aspect` times as wide as high. */
  showAll({ min, max }, up = this.up, aspect = 1) {
    this.up = up;
    this.target = scale(add(min, max), 0.5);
    this.radius = Math.max(norm(sub(max, min)) / 2, 1e-12);
    const other = Math.abs(up[2]) > 0.5 ? [0, -1, 0] : [0, 0, 1];
    const side = cross(up, other);
    const [azimuth, elevation] = [0.5, 0.25];
    const level = add(scale(other, Math.cos(azimuth)), scale(side, Math.sin(azimuth)));
    const out = add(scale(level, Math.cos(elevation)), scale(up, Math.sin(elevation)));
    // Few models fill the ball around their box.
    const narrower = Math.atan(Math.tan(VERTICAL_FOV / 2) * Math.min(aspect || 1, 1));
    this.position = add(this.target, scale(out, (0.8 * this.radius) / Math.sin(narrower)));
  }

  get forward() {
    return unit(sub(this.target, this.position));
  }

  /** Right, up and forward: unit vectors. */
  get axes() {
    const { forward } = this;
    let right = cross(forward, this.up);
    if (norm(right) < 1e-6) right = cross(forward, [this.up[1], this.up[2], this.up[0]]);
    right = unit(right);
    return [right, cross(right, forward), forward];
  }

  /** The depth of the near plane: as large as it can be without cutting what is near. */
  get near() {
    return Math.max(norm(sub(this.target, this.position)) / 1000, this.radius / 1e6);
  }

  /** Turns about the target. */
  orbit(dx, dy) {
    const offset = sub(this.position, this.target);
    const [right] = this.axes;
    const lifted = turned(offset, right, -dy);
    // Not beyond the poles, where left and right change places.
    const ok = norm(cross(unit(lifted), unit(this.up))) > 0.02 && dot(cross(lifted, this.up), cross(offset, this.up)) > 0;
    this.position = add(this.target, turned(ok ? lifted : offset, unit(this.up), -dx));
  }

  /** Turns the head. */
  look(dx, dy) {
    const offset = sub(this.target, this.position);
    const [right] = this.axes;
    const lifted = turned(offset, right, -dy);
    const ok = norm(cross(unit(lifted), unit(this.up))) > 0.02;
    this.target = add(this.position, turned(ok ? lifted : offset, unit(this.up), -dx));
  }

  /** Moves both along the picture: shares of its height. */
  pan(dx, dy) {
    const [right, up] = this.axes;
    const height = 2 * Math.tan(VERTICAL_FOV / 2) * norm(sub(this.target, this.position));
    this.move(add(scale(right, -dx * height), scale(up, dy * height)));
  }

  move(step) {
    this.position = add(this.position, step);
    this.target = add(this.target, step);
  }

  /** Multiplies the distance; a point that is given keeps its place in the picture. */
  zoom(factor, around = this.target) {
    const distance = norm(sub(this.position, this.target)) * factor;
    if (distance < this.radius * 1e-5 || distance > this.radius * 1e4) return;
    this.position = add(around, scale(sub(this.position, around), factor));
    this.target = add(around, scale(sub(this.target, around), factor));
  }

  /** The direction of a place in the picture, x and y from -1 to 1. */
  ray(x, y, aspect) {
    const [right, up, forward] = this.axes;
    const tangent = Math.tan(VERTICAL_FOV / 2);
    return add(forward, add(scale(right, x * tangent * aspect), scale(up, y * tangent)));
  }

  /** `position:target:up`, as the native viewer takes cameras. */
  toString() {
    const text = (vector) => vector.map((x) => Number(x.toPrecision(9))).join(',');
    return [this.position, this.target, this.up].map(text).join(':');
  }

  /** Takes such a text. Returns whether it was one. */
  parse(text) {
    const vectors = text.split(':').map((part) => part.split(',').map(Number));
    const ok = vectors.length >= 2 && vectors.length <= 3 && vectors.every((v) => v.length === 3 && v.every(Number.isFinite));
    const [position, target, up = this.up] = vectors;
    if (!ok || norm(sub(target, position)) === 0 || norm(up) === 0) return false;
    [this.position, this.target, this.up] = [position, target, unit(up)];
    return true;
  }
}
