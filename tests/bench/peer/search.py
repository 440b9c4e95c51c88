"""Looks for the coarsest setting that still reaches an error: each trial costs seconds, so that few have to do."""
import math


def fewest(error_of, start, most, limit, steps=6):
    """The fewest triangles whose error is at most `limit`, within 2 %, or None where `most` does not do either.

    `error_of(count)` gives the error. In logarithms errors are about a line over triangles, falling by one for one at first,
    then through the nearest that is too coarse and the nearest that does. Largest errors may stay as they are for long: after
    two that do not do steps are large, and the last but one is `most` itself."""
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
            # Never so near to an end that the other one would stay for ever.
            count = low[0] * (high[0] / low[0]) ** min(max(share, 0.15), 0.85)
        else:
            count, known = high or low
            least = 0.25 if high else 2.5 if step else 1.01
            count = most if low and step == steps - 3 else min(count * min(max(known / (0.99 * limit), least), 4.0), most)
    return int(high[0]) if high else None


def reach(try_count, count, most, limit, loss=0.0, tries=4):
    """Tries counts from `count` on, more where the error is above `limit`, fewer where it is below; `try_count(count)` gives the
    error, of which about `loss` stays whatever the count. Ends near the limit, or after so many tries."""
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
        # Errors jump: what is known to be too few or enough bounds what is tried.
        if high and count >= high or count <= low:
            count = (low + high) / 2 if high else low * 1.05
