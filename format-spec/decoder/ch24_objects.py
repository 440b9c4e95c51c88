"""Chapter 24: what the input named, and which islands belong to it."""

import zlib
from collections import namedtuple

from .ch02_conventions import Bytes, must
from .ch06_resident import CLUSTER_ITEM_LIMIT, read_part
from .ch21_texels import BitStream, Chance, NumberChances

Node = namedtuple("Node", "name id parent")
Leaf = namedtuple("Leaf", "objects blocks")  # blocks: of each, the object of each island

PAGE, MOST_NODES, MOST_BYTES, MOST_ABOVE = 1024, 2**31 - 1, 4096, 4096
OWNERS, NODES, NAMES, IDS, CHILDREN, FURTHER = range(6)


def islands(triangles):
    """The island of each triangle, and their number."""
    above = {}

    def top(v):
        while above.setdefault(v, v) != v:
            above[v] = above[above[v]]
            v = above[v]
        return v

    for a, b, c in triangles:
        for other in (b, c):
            above[top(other)] = top(a)
    numbers = {}
    labels = [numbers.setdefault(top(a), len(numbers)) for a, _, _ in triangles]
    return labels, len(numbers)


# ---- 24.3
# Lists ----------------------------------------------------------------------------------------------------------


class Lists:
    """All pages of all lists, in the order of their parts: for each list its (first key, bytes)."""

    def __init__(self, roots, page_counts, data):
        self.data, self.at = data, sum(root.length for root in roots)
        places, at = [], 0
        for root in roots:
            places.append((at, root))
            at += root.length
        self.pages = [self.read(kind, place, root, count) for kind, ((place, root), count) in enumerate(zip(places, page_counts))]
        must(self.at == len(data), "OBJECT_PAGES has other parts than its lists")

    def part(self, at, part):
        must(at + part.length <= len(self.data), "a part of objects is not within its section")
        bytes_ = self.data[at : at + part.length]
        must(not bytes_ or zlib.crc32(bytes_) == part.crc, "the checksum of a part of objects is wrong")
        return bytes_

    def read(self, kind, place, root, page_count):
        counts = [page_count]
        while counts[-1] > PAGE:
            counts.append(-(-counts[-1] // PAGE))
        if page_count == 0:
            must(root.length == 0, "a list without pages has a root")
            return []
        parts = [(None, self.part(place, root))]
        for count in reversed(counts):
            below = []
            for number, (first, bytes_) in enumerate(parts):
                directory, key = Bytes(bytes_, "a directory of objects"), 0
                at = directory.number("Q")
                for k in range(min(PAGE, count - PAGE * number)):
                    if kind != NODES:
                        key += directory.varint()
                        must(key < 2**32, "a key of objects exceeds 32 bits")
                        must(k or first in (None, key), "a directory does not begin with the key that the one above says")
                    part = read_part(directory)
                    must(at == self.at, "there is a gap between parts of objects, or they overlap")
                    below.append((key, self.part(at, part)))
                    at += part.length
                    self.at = at
                directory.end()
            parts = below
        keys = [key for key, _ in parts]
        must(keys == sorted(keys), "keys of a list of objects do not ascend")
        return parts


# ---- 24.4
# Pages of owners ------------------------------------------------------------------------------------------------


def read_owners(data, roots, first, object_count):
    """The leaves of a cluster, and the first object after those that are new here."""
    bits, following, room = BitStream(data), first, CLUSTER_ITEM_LIMIT
    count_chances, is_new, back_chances = NumberChances(), [Chance(), Chance()], NumberChances()
    island_chances, is_next, is_same = [NumberChances(), NumberChances()], [Chance() for _ in range(3)], [Chance() for _ in range(3)]
    other, leaves = NumberChances(), []
    for root in roots:
        count, objects, new = bits.number(count_chances), [], 1
        room -= count
        must(room >= 0, "a cluster has too many objects and islands for this decoder")
        for _ in range(count):
            new = bits.bit(is_new[new])
            if new:
                objects.append(following)
                following += 1
                must(following <= object_count, "an owner is beyond the number of objects")
            else:
                back = bits.number(back_chances)
                must(back < following, "an owner is beyond the number of objects")
                objects.append(following - 1 - back)
        must(len(set(objects)) == count, "a leaf names an object twice")
        before, blocks = count, []
        for k, block in enumerate(root.blocks.values()):
            found = before + bits.signed(island_chances[k > 0])
            must(0 <= found <= block.triangle_count, "a block has more islands than triangles, or fewer than none")
            must(count or not found, "an island has no owner")
            before = found
            if count < 2:
                blocks.append(objects * found)
                continue
            room -= found
            must(room >= 0, "a cluster has too many objects and islands for this decoder")
            last, way, owners = -1, 0, []
            for _ in range(found):
                if bits.bit(is_next[way]):
                    last, way = last + 1, 0
                elif bits.bit(is_same[way]):
                    way = 1
                else:
                    last, way = last + bits.signed(other), 2
                must(0 <= last < count, "an island belongs to an object that its leaf does not have")
                owners.append(objects[last])
            blocks.append(owners)
        leaves.append(Leaf(objects, blocks))
    bits.end()
    return leaves, following


# ---- 24.5
# Pages of nodes -------------------------------------------------------------------------------------------------

CURVE = [1, 2, 3, 6, 10, 16, 27, 45, 73, 120, 194, 310, 488, 747, 1101, 1546, 2047, 2549, 2994, 3348]
CURVE += [3607, 3785, 3901, 3975, 4022, 4050, 4068, 4079, 4085, 4089, 4092, 4093, 4094]
END, SEPARATORS = 255, b"-/_. :"


def squash(x):
    x = min(max(x, -2047), 2047)
    place, rest = (x >> 7) + 16, x & 127
    return (CURVE[place] * (128 - rest) + CURVE[min(place + 1, 32)] * rest + 64) >> 7


def stretches():
    table = []
    for x in range(-2047, 2048):
        table += [x] * (squash(x) + 1 - len(table))
    return table + [2047] * (4096 - len(table))


STRETCH = stretches()


class Texts:
    def __init__(self):
        self.slots, self.weights = {}, [[22937] * 6 for _ in range(32)]

    def bit(self, bits, slots, weights):
        states = [self.slots.setdefault(slot, [32768, 0]) for slot in slots]
        inputs = [STRETCH[one >> 4] for one, _ in states]
        one = min(max(squash(sum(a * b for a, b in zip(inputs, weights)) >> 16), 4), 4091)
        b = 0 if bits.below((bits.range >> 12) * (4096 - one)) else 1
        error = (4096 * b - one) * 6
        for k, x in enumerate(inputs):
            weights[k] += (x * error + 512) >> 10
        for slot in slots:  # the same slot may be there twice
            state = self.slots[slot]
            state[0] += ((65535 * b - state[0]) * (655360 // (10 * state[1] + 16))) >> 16
            state[1] = min(state[1] + 1, 60)
        return b

    def text(self, bits, field, reference):
        at = matching = has_missed = letters = word = 0
        text = b""
        while True:
            expected = reference[at] if at < len(reference) else END
            values = [min(len(text), 31), letters & 0xFF, letters & 0xFFFF, letters]
            values += [expected | matching << 8 | has_missed << 11, word]
            node = 1
            for shift in range(7, -1, -1):
                is_expected = (expected | 256) >> (shift + 1) == node
                weights = self.weights[(2 * field + is_expected) * 8 + matching]
                slots = [slot(k, field, value, node) for k, value in enumerate(values)]
                node = 2 * node + self.bit(bits, slots, weights)
            must(bits.at <= len(bits.data) + 5, "a string of bits ends early")
            letter = node - 256
            if letter == END:
                return text
            text += bytes([letter])
            must(len(text) <= MOST_BYTES, "a name or an id has more than 4096 bytes")
            is_separator = letter in SEPARATORS
            if letter == expected:
                matching, at = min(matching + 1, 7), at + 1
            else:
                found = reference.find(bytes([letter]), at) if is_separator else -1
                matching, has_missed, at = 0, 1, (found if found >= 0 else at) + 1
            letters = (letters << 8 | letter) & 0xFFFFFFFF
            word = 0 if is_separator else (word * 271 + letter) & 0xFFFFFFFF


def slot(context, field, value, node):
    key = (value * 12 + 2 * context + field) * 0x9E3779B1 & 0xFFFFFFFF
    return ((key ^ key >> 15) + node) * 0x85EBCA6B % 2**32 >> 14


def read_nodes(data, count, object_count, node_count):
    bits, recent, last_new, is_first, parents = BitStream(data), [0], object_count, 0, []
    ranks, other = [NumberChances(), NumberChances()], NumberChances()
    for _ in range(count):
        rank = bits.number(ranks[is_first])
        is_first = int(rank == 0)
        must(rank <= len(recent), "a parent does not exist")
        if rank < len(recent):
            parent = recent.pop(rank)
        else:
            last_new = parent = last_new + bits.signed(other)
            must(0 <= parent <= node_count, "a parent does not exist")
            recent = recent[:15]
        recent.insert(0, parent)
        parents.append(parent - 1 if parent else None)
    texts, fields = Texts(), []
    for field in range(2):
        has, before, similar, last, found = [Chance(), Chance()], 0, {}, b"", []
        for parent in parents:
            before = bits.bit(has[before])
            if not before:
                found.append(None)
                continue
            last = similar[parent] = texts.text(bits, field, similar.get(parent, last))
            try:
                found.append(last.decode())
            except UnicodeDecodeError:
                must(False, "a name or an id is not UTF-8")
        fields.append(found)
    bits.end()
    return [Node(*node) for node in zip(*fields, parents)]


# ---- 24.6
# Pages of pairs -------------------------------------------------------------------------------------------------


def read_pairs(data, count, first, places, are_hashes):
    bits, key, place, pairs = BitStream(data), first, 0, []
    steps, among, other = NumberChances(), NumberChances(), NumberChances()
    for number in range(count):
        step = bits.number(steps) if number else None
        key += step or 0
        must(key < 2**32, "a key of objects exceeds 32 bits")
        if step == 0:
            place += 1 + bits.number(among)
        elif are_hashes:
            place = bits.raw((places - 1).bit_length())
        else:
            place += bits.signed(other)
        must(0 <= place < places, "a place that an object is looked for in does not exist")
        pairs.append((key, place))
    bits.end()
    return pairs


def hash_of(text, node_count):
    return zlib.crc32(text.encode()) >> max(28 - node_count.bit_length(), 0)


# ---- 24.1
# Sections -------------------------------------------------------------------------------------------------------


class Objects:
    """`nodes`, and `leaves`: of each root without children, by number."""

    def __init__(self, section, pages, clusters, index, patches):
        head = Bytes(section, "OBJECTS")
        self.count = head.varint()
        node_count = self.count + head.varint()
        must(1 <= self.count and node_count <= MOST_NODES, "there are no objects, or more than a file can have")
        pair_counts = [head.varint() for _ in range(4)]
        must(max(pair_counts[:3]) <= node_count and pair_counts[3] < 2**32, "there are more places of objects than objects")
        roots = [read_part(head) for _ in range(6)]
        head.end()
        must(clusters, "a file without roots has objects")
        node_pages = -(-node_count // PAGE)
        page_counts = [len(clusters), node_pages] + [-(-count // PAGE) for count in pair_counts]
        lists = Lists(roots, page_counts, pages).pages
        self.leaves, further = self.read_owners(lists[OWNERS], clusters, index)
        self.nodes = []
        for k, (_, data) in enumerate(lists[NODES]):
            self.nodes += read_nodes(data, min(PAGE, node_count - PAGE * k), self.count, node_count)
        self.check_tree()
        wanted = [set(), set(), set(), further]
        for number, node in enumerate(self.nodes):
            if node.name is not None:
                wanted[0].add((hash_of(node.name, node_count), number // PAGE))
            if node.id is not None:
                wanted[1].add((hash_of(node.id, node_count), number // PAGE))
            wanted[2].add((0 if node.parent is None else node.parent + 1, number // PAGE))
        for kind in (NAMES, IDS, CHILDREN, FURTHER):
            count, found = pair_counts[kind - NAMES], []
            places = len(clusters) if kind == FURTHER else node_pages
            for k, (first, data) in enumerate(lists[kind]):
                found += read_pairs(data, min(PAGE, count - PAGE * k), first, places, kind in (NAMES, IDS))
            must(found == sorted(wanted[kind - NAMES]), "a list of objects leads elsewhere than to what is looked for")
        self.check_islands(patches)

    def read_owners(self, pages, clusters, index):
        leaves, further, following = {}, set(), 0
        for number, (cluster, block, (first, data)) in enumerate(zip(clusters, index, pages)):
            must(first == following, "the owners of a cluster do not begin with the object that its entry says")
            own = [(k, root) for k, root in zip(cluster.roots, block.roots) if not root.children]
            must(bool(own) == bool(data), "a cluster with leaves has no owners, or one without has some")
            if own:
                found, following = read_owners(data, [root for _, root in own], first, self.count)
                leaves.update({k: leaf for (k, _), leaf in zip(own, found)})
                further |= {(x, number) for leaf in found for x in leaf.objects if x < first}
        must(following == self.count, "there are objects that no leaf holds")
        return leaves, further

    def check_tree(self):
        depths, parents = {}, {node.parent for node in self.nodes}
        for number in range(len(self.nodes)):
            path = []
            while number is not None and number not in depths:
                path.append(number)
                must(len(path) <= MOST_ABOVE + 1, "nodes lie above one another in a circle, or too deep")
                number = self.nodes[number].parent
            depth = -1 if number is None else depths[number]
            for node in reversed(path):
                depth += 1
                must(depth <= MOST_ABOVE, "nodes lie above one another in a circle, or too deep")
                depths[node] = depth
        must(all(k in parents for k in range(self.count, len(self.nodes))), "an assembly has no parts")

    def check_islands(self, patches):
        seen = set()
        for number, leaf in self.leaves.items():
            for patch, owners in zip(patches[number].values(), leaf.blocks):
                must(islands(patch.triangles)[1] == len(owners), "a block has other islands than owners")
                seen.update(owners)
        must(len(seen) == self.count, "an object has no island")
