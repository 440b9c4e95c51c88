// What is free of something that has a length.

/** Free ranges of a buffer, ascending, none beginning where another ends. */
export class FreeRanges {
  constructor(length) {
    this.ranges = [[0, length]];
  }

  /** The first place that is large enough, or -1. */
  take(count) {
    const { ranges } = this;
    const k = ranges.findIndex(([begin, end]) => end - begin >= count);
    if (k < 0) return -1;
    const [begin, end] = ranges[k];
    if (end - begin === count) ranges.splice(k, 1);
    else ranges[k] = [begin + count, end];
    return begin;
  }

  give(begin, count) {
    if (count === 0) return;
    const { ranges } = this;
    let k = ranges.findIndex(([next]) => next > begin);
    if (k < 0) k = ranges.length;
    ranges.splice(k, 0, [begin, begin + count]);
    if (ranges[k + 1]?.[0] === ranges[k][1]) ranges.splice(k, 2, [begin, ranges[k + 1][1]]);
    if (k > 0 && ranges[k - 1][1] === begin) ranges.splice(k - 1, 2, [ranges[k - 1][0], ranges[k][1]]);
  }

  /** Where the last range that is in use ends. */
  usedEnd(length) {
    const last = this.ranges.at(-1);
    return last?.[1] === length ? last[0] : length;
  }
}
