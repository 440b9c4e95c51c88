// Queries as numbers: src/query.rs reads them.

import { LodpackError } from './errors.js';

const PART = { tolerance: 1, maxTriangles: 2, maxNodes: 4, maxBytes: 8, box: 16, sphere: 32, frustum: 64, view: 128, coarsest: 256 };
const KNOWN = new Set(['tolerance', 'maxTriangles', 'maxNodes', 'maxBytes', 'box', 'sphere', 'frustum', 'view', 'outside']);
const VIEW = {
  position: [0, 0, 0], forward: [0, 0, -1], up: [0, 1, 0], viewport: [1920, 1080], verticalFov: Math.PI / 3, near: 1e-3,
  pixelTolerance: 1, window: [0, 0, 1, 1],
};

const wrong = (what) => new LodpackError('query', what);

export function packQuery(query = {}) {
  for (const name of Object.keys(query)) {
    if (!KNOWN.has(name)) throw wrong(`a query has no ${name}; it has ${[...KNOWN].join(', ')}`);
  }
  const numbers = [0];
  const add = (part, ...values) => {
    numbers[0] |= PART[part];
    for (const value of values.flat(2)) {
      if (typeof value !== 'number' || Number.isNaN(value)) throw wrong(`${part} has to consist of numbers, not of ${value}`);
      numbers.push(value);
    }
  };
  const exactly = (part, values, count) => {
    const flat = Array.from(values ?? []).flat();
    if (flat.length !== count) throw wrong(`${part} has ${count} numbers, not ${flat.length}`);
    return flat;
  };
  for (const part of ['tolerance', 'maxTriangles', 'maxNodes', 'maxBytes']) {
    if (query[part] != null) add(part, query[part]);
  }
  if (['box', 'sphere', 'frustum'].filter((part) => query[part] != null).length > 1) {
    throw wrong('a query has one volume: box, sphere or frustum');
  }
  if (query.box) add('box', exactly('box', query.box, 6));
  if (query.sphere) add('sphere', exactly('sphere', query.sphere.centre, 3), query.sphere.radius);
  if (query.frustum) {
    if (query.frustum.length !== 6) throw wrong('a frustum has 6 planes');
    add('frustum', query.frustum.map(({ normal, offset }) => [exactly('frustum', normal, 3), offset].flat()));
  }
  if (query.view) {
    const view = { ...VIEW, ...query.view };
    const extra = Object.keys(view).find((name) => !(name in VIEW));
    if (extra) throw wrong(`a view has no ${extra}; it has ${Object.keys(VIEW).join(', ')}`);
    for (const name of ['position', 'forward', 'up']) exactly(`view.${name}`, view[name], 3);
    exactly('view.viewport', view.viewport, 2);
    exactly('view.window', view.window, 4);
    const { position, forward, up, viewport, verticalFov, near, pixelTolerance, window } = view;
    add('view', ...[position, forward, up, viewport].map((values) => [...values]), verticalFov, near, pixelTolerance, [...window]);
  }
  if (query.outside === 'coarsest') numbers[0] |= PART.coarsest;
  else if (query.outside != null && query.outside !== 'drop') throw wrong("outside is 'drop' or 'coarsest'");
  return Float64Array.from(numbers);
}
