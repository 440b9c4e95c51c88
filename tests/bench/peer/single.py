"""Meshes and files of one level: simplifiers, Draco after them, gltfpack, and Nexus over what is simplified first."""
import math, os

from peer import nexus
from peer.coders import draco_timed
from peer.run import Distance, extent, read_ply
from peer.search import fewest, reach
from peer.simplify import Simplifier


class Scale:
    """Steps of lattices on one mesh, in mean edges, and what they leave of an error."""

    def __init__(self, positions, edge):
        self.extent, self.edge = extent(positions) / edge, edge

    def step(self, bits):
        return self.extent / (2**bits - 1)

    def room(self, measure, limit, step):
        """What a simplifier may take of `limit` (mean edges) if rounding takes its share: along the normal, evenly spread."""
        return math.sqrt(max(limit**2 - step**2 / 12, 0)) if measure == "rms" else limit - 0.6 * step

    def bits(self, measure, limit):
        """The fewest that leave half of the error, and one more."""
        first = next((b for b in range(6, 17) if self.room(measure, limit, self.step(b)) > 0.5 * limit), 16)
        return range(first, min(first + 2, 17))

    def lattice(self, measure, limit, share=0.5):
        """For Nexus: the largest power of two, in input units, that leaves `share` of the error. It truncates, which moves
        surfaces as far as rounding to twice the step."""
        exponent = 40
        while self.room(measure, limit, 2.0 * 2.0**exponent / self.edge) <= share * limit and exponent > -60:
            exponent -= 1
        return 2.0**exponent


def measure_simplifier(result, tool, source, mesh, work):
    """Meshes with our errors and as few triangles as can be; gives the simplifier, and what it needs for each measure."""
    simplifier, needs = Simplifier(tool, source, result.triangles, mesh, work), {}
    start = result.ours.triangles
    for measure, steps in (("rms", 6), ("max", 4)):
        limit, seen = getattr(result.ours, measure), set(simplifier.measured)

        def error_of(count):
            distance = simplifier.distance(count)
            if count not in seen:
                seen.add(count)
                result.add(tool, f"{distance.triangles} triangles", cpu=simplifier.mesh(count)[1], distance=distance)
            return getattr(distance, measure)

        # More than nine tenths is no simplification.
        needs[measure] = fewest(error_of, start, 0.9 * result.triangles, limit, steps)
        start = needs[measure] or start
    return simplifier, needs


def measure_draco(result, positions, triangles, scale, mesh, work):
    """The mesh as it is, with more bits until both errors are ours."""
    path = os.path.join(work, "level.ply")
    first = min(min(scale.bits(measure, getattr(result.ours, measure))) for measure in ("rms", "max")) - 1
    for bits in range(max(first, 4), 17):
        size, cpu = draco_timed(positions, triangles, bits, path)
        distance = Distance(mesh, path)
        result.add("Draco", f"{bits} bits", cpu=cpu, bytes=size, first=(1, size), distance=distance)
        if distance.rms <= result.ours.rms and distance.max <= result.ours.max:
            break


def measure_coded(result, simplifier, measure, scale, work):
    """Draco after a simplifier: for each number of bits, as few triangles as then reach our error."""
    limit, path = getattr(result.ours, measure), os.path.join(work, "level.ply")
    for bits in scale.bits(measure, limit):
        def one(count):
            simplified, seconds = simplifier.mesh(count)
            size, cpu = draco_timed(*read_ply(simplified), bits, path)
            distance = Distance(simplifier.reference, path)
            result.add(f"{simplifier.tool} + Draco", f"{bits} bits {distance.triangles} triangles", cpu=seconds + cpu, bytes=size,
                       first=(1, size), distance=distance)
            return getattr(distance, measure)

        reach(one, simplifier.guess(measure, scale.room(measure, limit, scale.step(bits))), 0.9 * result.triangles, limit)


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

    reach(one, start, result.triangles, limit, 5)


def measure_nexus_over(result, simplifier, measure, scale, work):
    """Simplified first, then Nexus's pyramid over that: how a pyramid of Nexus can have our error at its finest."""
    limit = getattr(result.ours, measure)
    nxs, nxz, path = (os.path.join(work, name) for name in ("over.nxs", "over.nxz", "level.ply"))
    for share in (0.5, 0.85):
        step = scale.lattice(measure, limit, share)

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

        reach(one, simplifier.guess(measure, scale.room(measure, limit, 2.0 * step / scale.edge)), 0.9 * result.triangles, limit, 4)
