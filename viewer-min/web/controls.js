// Mouse, touch and keys: what they do to the camera.

import { add, norm, scale, sub } from './camera.js';

const KEYS = { KeyW: [0, 0, 1], KeyS: [0, 0, -1], KeyA: [-1, 0, 0], KeyD: [1, 0, 0], KeyE: [0, 1, 0], KeyQ: [0, -1, 0] };

export class Controls {
  #pointers = new Map();
  #keys = new Set();
  #travelled = 0;

  /**
   * `pick(x, y)` returns the point of the surface at a place of the picture, or null; `click(x, y)` hears of clicks.
   */
  constructor(canvas, camera, { changed, pick, click }) {
    Object.assign(this, { canvas, camera, changed, pick, click });
    /** Whether dragging turns the head, and keys move. */
    this.isFlying = false;
    canvas.addEventListener('contextmenu', (event) => event.preventDefault());
    canvas.addEventListener('pointerdown', (event) => this.#down(event));
    canvas.addEventListener('pointermove', (event) => this.#move(event));
    for (const name of ['pointerup', 'pointercancel']) canvas.addEventListener(name, (event) => this.#up(event));
    canvas.addEventListener('wheel', (event) => this.#wheel(event), { passive: false });
    canvas.addEventListener('keydown', (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || !KEYS[event.code]) return;
      this.#keys.add(event.code);
      this.changed();
    });
    canvas.addEventListener('keyup', (event) => this.#keys.delete(event.code));
    canvas.addEventListener('blur', () => this.#keys.clear());
  }

  /** Moves for as long as keys are held. Returns whether it did. */
  step(seconds) {
    if (this.#keys.size === 0) return false;
    const { camera } = this;
    const way = [...this.#keys].map((key) => KEYS[key]).reduce(add);
    // The speed fits the distance of what is looked at.
    const speed = Math.max(norm(sub(camera.target, camera.position)), camera.radius / 50) * Math.min(seconds, 0.1);
    camera.axes.forEach((axis, k) => camera.move(scale(axis, way[k] * speed)));
    return true;
  }

  /** A place in the picture, -1 to 1. */
  place({ clientX, clientY }) {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    return [(2 * (clientX - left)) / width - 1, 1 - (2 * (clientY - top)) / height];
  }

  #down(event) {
    this.canvas.focus({ preventScroll: true });
    this.canvas.setPointerCapture(event.pointerId);
    this.#pointers.set(event.pointerId, event);
    if (this.#pointers.size === 1) this.#travelled = 0;
  }

  #move(event) {
    const before = this.#pointers.get(event.pointerId);
    if (!before) return;
    const { height } = this.canvas.getBoundingClientRect();
    const [dx, dy] = [(event.clientX - before.clientX) / height, (event.clientY - before.clientY) / height];
    this.#travelled += Math.abs(dx) + Math.abs(dy);
    const { camera } = this;
    if (this.#pointers.size === 2) {
      const other = [...this.#pointers.values()].find(({ pointerId }) => pointerId !== event.pointerId);
      const apart = (at) => Math.hypot(at.clientX - other.clientX, at.clientY - other.clientY) || 1;
      camera.zoom(apart(before) / apart(event));
      camera.pan(dx / 2, dy / 2);
    } else if (before.buttons & 2 || before.buttons & 4 || event.shiftKey) {
      camera.pan(dx, dy);
    } else if (this.isFlying) {
      camera.look(dx * 1.5, dy * 1.5);
    } else {
      camera.orbit(dx * 4, dy * 4);
    }
    this.#pointers.set(event.pointerId, event);
    this.changed();
  }

  #up(event) {
    const isLast = this.#pointers.delete(event.pointerId) && this.#pointers.size === 0;
    if (isLast && event.type === 'pointerup' && this.#travelled < 0.01) this.click(...this.place(event));
  }

  #wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 20 : event.deltaMode === 2 ? 400 : 1;
    const factor = Math.exp(Math.max(-200, Math.min(200, event.deltaY * lines)) * 0.002);
    // What is under the mouse stays there.
    this.camera.zoom(factor, this.pick(...this.place(event)) ?? undefined);
    this.changed();
  }
}
