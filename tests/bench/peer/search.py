"""Searches for the coarsest setting that still reaches an error. Each trial costs seconds, so few must be enough."""
import math


def fewest(error_of, start, most, limit, steps=6):
    """The fewest triangles whose error is at most `limit`, within 2 %, or None if even `most` are not enough.

    `error_of(count)` gives the error. In logarithms, errors over triangles are about a line: first one that falls by
    one for one, then the line through the nearest count that is too coarse and the nearest that is fine enough. The
    largest error may stay constant for long: after two counts that are not enough, steps become large, and the last but
    one is `most` itself."""
    low, high, count = None, None, min(start, most)
    for step in range(steps):
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
            # Never so near one end that the other would never move.
            count = low[0] * (high[0] / low[0]) ** min(max(share, 0.15), 0.85)
        else:
            count, known = high or low
            least = 0.25 if high else 2.5 if step else 1.01
            count = most if low and step == steps - 3 else min(count * min(max(known / (0.99 * limit), least), 4.0), most)
    return int(high[0]) if high else None


def reach(try_count, count, most, limit, loss=0.0, tries=4):
    """Tries counts from `count` on: more triangles if the error is above `limit`, fewer if it is below.
    `try_count(count)` gives the error, of which about `loss` remains whatever the count. Ends near the limit, or after
    `tries` tries."""
    low, high = 0, None
    share = lambda error: math.sqrt(max(error**2 - loss**2, (0.3 * error) ** 2))
    for _ in range(tries):
        error = try_count(int(min(count, most)))
        if error <= limit:
            high = min(high or count, count)
            if error > 0.98 * limit:
                return
        elif count >= most:
            return
        else:
            low = max(low, count)
        if high and low and high / low < 1.015:
            return
        count *= min(max(share(error) / share(0.99 * limit), 0.6), 1.6)
        # Errors jump, so counts known to be too small or large enough bound the next try.
        if high and count >= high or count <= low:
            count = (low + high) / 2 if high else low * 1.05
