// What the strips of `valid-drawn` should show.

import assert from 'node:assert/strict';

/**
 * Opaque, cut out at 0.3, blended, double-sided, unlit, and cut out at 0.5: opacity is 0.2, 0.4, 0.6 and 0.8 in a
 * quarter of each.
 */
const SHOWN = [1, 0.75, 0.5, 1, 1, 0.5];
const UNLIT = 4;

/** Checks what `stripsOf` has found. */
export function checkStrips(strips) {
  strips.forEach(({ all, shown, plain }, k) => {
    assert.ok(all > 500 && Math.abs(shown - SHOWN[k]) < 0.05, `strip ${k}: ${JSON.stringify(strips)}`);
    // Light changes nearly all colours.
    assert.ok(k === UNLIT ? plain > 0.95 : plain < 0.5, `light of strip ${k}: ${JSON.stringify(strips)}`);
  });
}
