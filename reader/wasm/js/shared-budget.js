// One budget of triangles for several streams in one picture, from frame to frame: the rules of the reader's
// select/shared_budget.rs, for streams that have a worker each.

/** The least tolerance that a budget raises, pixels. */
const LEAST = 1 / 64;
/** How much a tolerance rises in a frame in which triangles lack; the power doubles from frame to frame, up to 16. */
const RAISE = 1.05;
const MOST_RAISES = 16;
/** A tolerance falls where less than this share of the budget is used, towards the other share. */
const TOO_FEW = 0.92;
const ENOUGH = 0.97;
/** What is left over goes to those that lack triangles. */
const LACKS = 16;

export class SharedBudget {
  #tolerance = 0;
  #raises = 0;
  #taken = [];

  limits(maxTriangles, pixelTolerance, count) {
    const whole = Math.min(Math.max(Math.floor(maxTriangles), 0), Number.MAX_SAFE_INTEGER);
    if (this.#taken.length !== count) {
      [this.#tolerance, this.#raises] = [0, 0];
      this.#taken = Array.from({ length: count }, () => ({ triangles: 0, isLimited: false }));
    }
    const sum = this.#taken.reduce((all, { triangles }) => all + triangles, 0);
    const used = sum / Math.max(whole, 1);
    const before = Math.max(this.#tolerance, pixelTolerance);
    const lacks = count > 1 && this.#taken.some(({ isLimited }) => isLimited);
    this.#raises = lacks && used > 0.75 ? Math.min(Math.max(2 * this.#raises, 1), MOST_RAISES) : 0;
    let tolerance = before;
    if (this.#raises > 0) tolerance = Math.max(before, LEAST) * RAISE ** this.#raises;
    else if (!lacks && used < TOO_FEW) tolerance = before * Math.max(Math.sqrt(used / ENOUGH), 0.5);
    this.#tolerance = Math.max(tolerance, pixelTolerance);
    return { pixelTolerance: this.#tolerance, maxTriangles: this.#divided(whole, sum) };
  }

  /** What was taken, and what is left over in parts, or less of everything where nothing is. */
  #divided(whole, sum) {
    const most = Math.max(0, ...this.#taken.map(({ triangles }) => triangles));
    // What is not seen now may come into view.
    const weights = this.#taken.map(({ triangles, isLimited }) => Math.max(triangles, Math.floor(most / 8), 1) * (isLimited ? LACKS : 1));
    const all = weights.reduce((a, b) => a + b, 0);
    let left = whole;
    const shares = this.#taken.map(({ triangles }, k) => {
      const share = Math.min(left, Math.floor(sum > whole ? whole * triangles / sum : triangles + (whole - sum) * weights[k] / all));
      left -= share;
      return share;
    });
    if (shares.length > 0) shares[shares.length - 1] += left;
    return shares;
  }

  record(frames) {
    if (frames.length !== this.#taken.length) return;
    this.#taken = frames.map(({ wantedTriangleCount, limitedBy }) => ({ triangles: wantedTriangleCount, isLimited: limitedBy === 'triangles' }));
  }
}
