"""Meshes and files of a single level: simplifiers, Draco after them, gltfpack, and Nexus over a simplified mesh."""
import math, os

from peer import nexus
from peer.coders import draco_timed
from peer.run import Distance, extent, read_ply
from peer.search import fewest, reach
from peer.simplify import Simplifier


class Scale:
    """Steps of lattices for one mesh, in mean edges, and what they leave of an error."""

    def __init__(self, positions, edge):
        self.extent, self.edge = extent(positions) / edge, edge

    def step(self, bits):
        return self.extent / (2**bits - 1)

    def loss(self, measure, step):
        """The error that rounding to a lattice adds. Between vertices that are off along the normal independently, half
        of the mean square remains; a largest error comes from one vertex."""
        return step / math.sqrt(24) if measure == "rms" else 0.6 * step

    def truncation(self, measure, step):
        """The same for Nexus, which truncates, so that surfaces also move by half a step (as measured on a scan)."""
        return 0.59 * step if measure == "rms" else 1.2 * step

    def bits(self, measure, limit):
        """The fewest bits that leave half of the error, and one more."""
        first = next((b for b in range(6, 17) if room(measure, limit, self.loss(measure, self.step(b))) > 0.5 * limit), 16)
        return range(first, min(first + 2, 17))

    def lattice(self, measure, limit):
        """For Nexus: the largest power of two, in input units, that leaves half of the error."""
        exponent = 40
        while room(measure, limit, self.truncation(measure, 2.0**exponent / self.edge)) <= 0.5 * limit and exponent > -60:
            exponent -= 1
        return 2.0**exponent


def room(measure, limit, loss):
    """The share of an error that a simplifier may use, given the share of rounding."""
    return math.sqrt(max(limit**2 - loss**2, 0)) if measure == "rms" else limit - loss


def measure_simplifier(result, tool, source, mesh, work):
    """Meshes with our errors and as few triangles as possible. Returns the simplifier, and its triangles for each
    measure."""
    simplifier, needs = Simplifier(tool, source, result.triangles, mesh, work), {}
    start = result.ours.triangles
    for measure, steps in (("rms", 6), ("max", 6)):
        limit, seen = getattr(result.ours, measure), set(simplifier.measured)

        def error_of(count):
            distance = simplifier.distance(count)
            if count not in seen:
                seen.add(count)
                result.add(tool, f"{distance.triangles} triangles", cpu=simplifier.mesh(count)[1], distance=distance)
            return getattr(distance, measure)

        # More than nine tenths of the triangles is not a simplification.
        needs[measure] = fewest(error_of, start, 0.9 * result.triangles, limit, steps)
        start = needs[measure] or start
    return simplifier, needs


def measure_draco(result, positions, triangles, scale, mesh, work):
    """The mesh as it is, with more bits until both errors reach ours."""
    path = os.path.join(work, "level.ply")
    first = min(min(scale.bits(measure, getattr(result.ours, measure))) for measure in ("rms", "max")) - 1
    for bits in range(max(first, 4), 17):
        size, cpu = draco_timed(positions, triangles, bits, path)
        distance = Distance(mesh, path)
        result.add("Draco", f"{bits} bits", cpu=cpu, bytes=size, first=(1, size), distance=distance)
        if distance.rms <= result.ours.rms and distance.max <= result.ours.max:
            break


def starting(simplifier, needs, measure, limit, loss):
    """The number of triangles to start with, given the share of rounding. The largest error falls in jumps and cannot
    be predicted."""
    return simplifier.guess(measure, room(measure, limit, loss)) if measure == "rms" else 1.05 * needs[measure]


def measure_coded(result, simplifier, needs, measure, scale, work):
    """Draco after a simplifier: for each number of bits, as few triangles as reach our error."""
    limit, path = getattr(result.ours, measure), os.path.join(work, "level.ply")
    for bits in scale.bits(measure, limit):
        def one(count):
            simplified, seconds = simplifier.mesh(count)
            size, cpu = draco_timed(*read_ply(simplified), bits, path)
            distance = Distance(simplifier.reference, path)
            result.add(f"{simplifier.tool} + Draco", f"{bits} bits {distance.triangles} triangles", cpu=seconds + cpu, bytes=size,
                       first=(1, size), distance=distance)
            return getattr(distance, measure)

        loss = scale.loss(measure, scale.step(bits))
        start = starting(simplifier, needs, measure, limit, loss)
        reach(one, start, 0.9 * result.triangles, limit, loss if measure == "rms" else 0)


def measure_gltfpack(result, packer, measure, start, scale, mesh, work):
    limit, path = getattr(result.ours, measure), os.path.join(work, "level.ply")
    bits = scale.bits(measure, limit)[-1]

    def one(count):
        size, zipped, cpu = packer.pack(count, bits, path)
        distance = Distance(mesh, path)
        result.add("gltfpack", f"-cz -vp {bits} {distance.triangles} triangles", cpu=cpu, bytes=size, first=(1, size), distance=distance)
        result.add("gltfpack + gzip", f"-cz -vp {bits} {distance.triangles} triangles", cpu=cpu, bytes=zipped, first=(1, zipped),
                   distance=distance)
        return getattr(distance, measure)

    reach(one, start, result.triangles, limit, scale.loss(measure, scale.step(bits)) if measure == "rms" else 0)


def measure_nexus_over(result, simplifier, needs, measure, scale, work):
    """Simplifies first, then builds Nexus's pyramid over the result, so that the pyramid can have our error at its
    finest level."""
    limit = getattr(result.ours, measure)
    nxs, nxz, path = (os.path.join(work, name) for name in ("over.nxs", "over.nxz", "level.ply"))
    for step in (scale.lattice(measure, limit), scale.lattice(measure, limit) / 2):

        def one(count):
            simplified, _ = simplifier.mesh(count)
            nexus.build_only(simplified, nxs, count)
            size = nexus.compress(nxs, nxz, step)
            index = nexus.Index(nxz)
            nexus.truncated(simplified, path, step)
            distance = Distance(simplifier.reference, path)
            result.add(f"{simplifier.tool} + Nexus", f"step {step:.3g} {distance.triangles} triangles", bytes=size,
                       pyramid=index.sink > 1, first=index.first_picture(), distance=distance)
            return getattr(distance, measure)

        loss = scale.truncation(measure, step / scale.edge)
        start = starting(simplifier, needs, measure, limit, loss)
        reach(one, start, 0.9 * result.triangles, limit, loss if measure == "rms" else 0)
