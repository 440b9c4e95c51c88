"""lodpack compared with the best peer: the ratios for a mesh, and the table of them."""
from dataclasses import dataclass


@dataclass(frozen=True)
class Measure:
    key: str
    heading: str
    value: object  # of a row; none if the row does not count
    show: object = "{:,}".format


def seconds(value):
    return f"{value:.2f}" if value < 10 else f"{value:.1f}"


def megabytes(value):
    return f"{value / 1e6:.0f} MB"


def reaching(measure, get, only=lambda row: True):
    """`get` for rows whose error is no larger than that of our finest level."""
    def value(row, ours):
        error = getattr(row, measure)
        return get(row) if error is not None and error <= getattr(ours, measure) and only(row) else None
    return value


MEASURES = [
    Measure("cpu", "build, CPU s", lambda row, _: row.cpu if row.hierarchy else None, seconds),
    Measure("cpu_written", "build, CPU s, of those that write a file", lambda row, _: row.cpu if row.writes else None, seconds),
    Measure("memory", "build, peak memory", lambda row, _: row.memory if row.hierarchy else None, megabytes),
    Measure("rms", "bytes at equal RMS", reaching("rms", lambda row: row.bytes)),
    Measure("rms_pyramid", "bytes at equal RMS, pyramids that stream", reaching("rms", lambda row: row.bytes, lambda row: row.pyramid)),
    Measure("max", "bytes at equal maximum", reaching("max", lambda row: row.bytes)),
    Measure("max_pyramid", "bytes at equal maximum, pyramids that stream", reaching("max", lambda row: row.bytes, lambda row: row.pyramid)),
    Measure("triangles", "triangles at equal RMS", reaching("rms", lambda row: row.triangles)),
    Measure("first_bytes", "first picture, bytes", reaching("rms", lambda row: row.first and row.first[1])),
    Measure("first_requests", "first picture, requests", reaching("rms", lambda row: row.first and row.first[0])),
]
# The measures that a failed peer is missing from, by its kind.
OURS = {"cpu_written": "cpu", "rms": "bytes", "rms_pyramid": "bytes", "max": "bytes", "max_pyramid": "bytes"}


def ours_of(measure, ours):
    if measure.key.startswith("first_"):
        return ours.first[measure.key == "first_bytes"]
    return getattr(ours, OURS.get(measure.key, measure.key))


def verdicts(result):
    """For each measure our figure, the best peer's, and the ratio: above 1, ours is better."""
    found = {}
    for measure in MEASURES:
        own = ours_of(measure, result.ours)
        # Among equals, the smallest file.
        candidates = [(value, row.bytes or 0, row.peer, row.setting) for row in result.rows
                      if (value := measure.value(row, result.ours)) is not None]
        best = min(candidates, default=None)
        failures = [(peer, why) for peer, measures, why in result.failures if measure.key in measures]
        found[measure.key] = {"ours": own, "theirs": best and best[0], "peer": best and best[2],
                              "setting": best and best[3], "ratio": best and best[0] / own,
                              "failed": failures}
    return found


def cell(measure, found):
    text = "no peer does"
    if found["peer"]:
        text = f"**{found['ratio']:.2f}** {found['peer']}<br>{measure.show(found['theirs'])} : {measure.show(found['ours'])}"
    return "<br>".join([text] + [f"({peer}: {why})" for peer, why in found["failed"]])


def table(results):
    """The table in Markdown: one row per mesh, one column per measure."""
    head = ["mesh", "triangles"] + [measure.heading for measure in MEASURES]
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1)]
    for result in results:
        found = verdicts(result)
        cells = [result.mesh, f"{result.triangles:,}"] + [cell(measure, found[measure.key]) for measure in MEASURES]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
