#!/usr/bin/env python3
"""Summarises and plots the output of `lodpack-view FILE --path ... --csv frames.csv`.

    python3 tests/bench/frames.py frames.csv frames.svg
"""

import csv
import sys

PARTS = [("select_ms", "select", "#7b6fb0"), ("update_ms", "load, stitch", "#d95f02"), ("upload_ms", "upload", "#e6ab02"),
         ("record_ms", "hand over", "#2a9d6f"), ("wait_ms", "wait for the device", "#1b6ca8")]
WIDTH, HEIGHT, LEFT, TOP = 900, 300, 50, 30


def main() -> None:
    table, picture = sys.argv[1:3]
    with open(table, newline="") as file:
        frames = list(csv.DictReader(file))
    times = {name: [float(frame[name]) for frame in frames] for name, _, _ in PARTS}
    whole = [float(frame["frame_ms"]) for frame in frames]
    own = [whole[i] - times["wait_ms"][i] for i in range(len(frames))]
    drawing = [float(frame["draw_ms"]) for frame in frames]
    middle = lambda column: sorted(column)[len(column) // 2]
    median = middle(whole)
    print(f"{len(frames)} frames: median {median:.1f} ms, longest {max(whole):.1f} ms ({max(whole) / median:.2f} medians)")
    print(f"of the processor: median {middle(own):.1f} ms, longest {max(own):.1f} ms; of the device: {middle(drawing):.1f}, {max(drawing):.1f}")
    print(f"all frames over the larger of all that the processor did and all that the device did: "
          f"{sum(whole) / max(sum(own), sum(drawing)):.3f}")
    # A vertex has 28 bytes, a triangle 12 and half a vertex.
    uploaded = [int(frame["uploaded"]) / max(26 * int(frame["triangles"]), 1) for frame in frames[1:]]
    print(f"uploaded of what is drawn: median {middle(uploaded):.2%}, most {max(uploaded):.1%}")
    print(f"frames without a surface: {sum(frame['surface'] != '1' for frame in frames)}, that waited for pages: "
          f"{sum(int(frame['stalls']) for frame in frames)}, with roots coarser than wanted: "
          f"{sum(int(frame['late']) > 0 for frame in frames)}")
    print(f"triangles up to {max(int(frame['triangles']) for frame in frames)}, "
          f"{sum(int(frame['bytes']) for frame in frames)} bytes read")

    top = max(3 * median, max(whole)) * 1.05
    x = lambda frame: LEFT + frame * (WIDTH - LEFT - 10) / max(len(frames) - 1, 1)
    y = lambda time: TOP + (HEIGHT - TOP - 30) * (1 - time / top)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" font-family="sans-serif" '
           f'font-size="12"><rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>']
    below = [0.0] * len(frames)
    for k, (name, label, colour) in enumerate(PARTS):
        above = [a + b for a, b in zip(below, times[name])]
        edge = [f"{x(i):.1f},{y(t):.1f}" for i, t in enumerate(above)]
        edge += [f"{x(i):.1f},{y(t):.1f}" for i, t in reversed(list(enumerate(below)))]
        out.append(f'<polygon points="{" ".join(edge)}" fill="{colour}"/>')
        out.append(f'<rect x="{LEFT + 150 * k}" y="8" width="12" height="12" fill="{colour}"/>'
                   f'<text x="{LEFT + 150 * k + 17}" y="18">{label}</text>')
        below = above
    for label, time in [("median", median), ("3 medians", 3 * median)]:
        out.append(f'<path d="M{LEFT},{y(time):.1f}H{WIDTH - 10}" stroke="#333" stroke-dasharray="4 4"/>'
                   f'<text x="{WIDTH - 75}" y="{y(time) - 4:.1f}">{label}</text>')
    for time in [0, median, 3 * median]:
        out.append(f'<text x="{LEFT - 5}" y="{y(time) + 4:.1f}" text-anchor="end">{time:.0f}</text>')
    out.append(f'<text x="{LEFT}" y="{HEIGHT - 8}">frame 0 to {len(frames) - 1}; milliseconds</text></svg>')
    with open(picture, "w") as file:
        file.write("\n".join(out) + "\n")


main()
