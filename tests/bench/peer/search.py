"""Looks for the coarsest setting that still reaches an error: each trial costs seconds, so that few have to do."""
import math


def fewest(error_of, start, most, limit, steps=6):
    """The fewest triangles whose error is at most `limit`, within 2 %, or None where `most` does not do either.

    `error_of(count)` gives the error. In logarithms errors are about a line over triangles, falling by one for one at first,
    then through the nearest that is too coarse and the nearest that does."""
    low, high, count = None, None, min(start, most)
    for _ in range(steps):
        error = error_of(int(count))
        if error <= limit:
            high = (count, max(error, limit * 1e-3))
        elif count >= most:
            return None
        else:
            low = (count, error)
        if 0.98 * limit < error <= limit or low and high and high[0] / low[0] < 1.02:
            break
        if low and high:
            share = math.log(low[1] / (0.995 * limit)) / math.log(low[1] / high[1])
            # Never so near to an end that the other one would stay for ever.
            count = low[0] * (high[0] / low[0]) ** min(max(share, 0.15), 0.85)
        else:
            count, known = (high or low)
            count = min(count * min(max(known / (0.99 * limit), 0.25), 4.0), most)
    return int(high[0]) if high else None


def reach(try_count, count, most, limit, tries=3):
    """Tries counts from `count` on, more where the error is above `limit`, fewer where it is far below; `try_count(count)` gives
    the error. Ends where a file reaches the limit and hardly a smaller one would."""
    low, high = 0, None
    for _ in range(tries):
        error = try_count(int(min(count, most)))
        if error <= limit:
            high = count
            if error > 0.98 * limit:
                return
            count = max(count * max(error / (0.99 * limit), 0.7), (low + high) / 2)
        elif count >= most:
            return
        else:
            low = count
            count *= min(max(error / (0.99 * limit), 1.01), 1.5)
        if high and low and high / low < 1.015:
            return
        if high and count >= high:
            count = (low + high) / 2
