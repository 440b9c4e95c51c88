"""Chapter 7: tables and streams of symbols."""

import struct

from .ch02_conventions import must, unzigzag


# ---- 7.3 Section
# TABLES --------------------------------------------------------------------------------------------------

FREQUENCY_SUM = 4096


class Bits:
    def __init__(self, data):
        self.data, self.at = data, 0

    def number(self, count):
        must(self.at + count <= 8 * len(self.data), "TABLES is too short")
        value = 0
        for k in range(count):
            value |= (self.data[self.at // 8] >> (self.at % 8) & 1) << k
            self.at += 1
        return value

    def gamma(self):
        k = 0
        while self.number(1) == 0:
            k += 1
            must(k <= 23, "a gamma code in TABLES is too long")
        return (1 << k) + self.number(k)


def read_tables(section):
    """The table of each context that has one: for each s below 4096, (token, its frequency, its start)."""
    bits = Bits(section)
    table_count = bits.gamma() - 1
    must(table_count <= 255, "there are more than 255 tables")
    tables = [read_frequencies(bits) for _ in range(table_count)]
    index_bits = (table_count - 1).bit_length() if table_count > 0 else 0
    table_of_context, used, context = {}, set(), -1
    for _ in range(bits.gamma() - 1):
        context += bits.gamma()
        must(context <= 4095, "a context is above 4095")
        table = bits.number(index_bits)
        must(table < table_count, "a context uses a table that is not there")
        table_of_context[context] = tables[table]
        used.add(table)
    must(len(used) == table_count, "a table is used by no context")
    must(bits.number(-bits.at % 8) == 0 and bits.at == 8 * len(section), "TABLES does not end with its last byte")
    return table_of_context


def read_frequencies(bits):
    frequencies, rest = [], None  # by token
    while True:
        code = bits.number(4)
        must(code != 15, "a frequency has code 15")
        if code == 14:
            break
        if code == 0:
            frequencies += [0] * min(bits.gamma(), 257)
        elif code == 13:
            must(rest is None, "two tokens of a table take the rest")
            rest = len(frequencies)
            frequencies.append(0)
        else:
            n = min(code - 1, 3)
            frequencies.append((1 << (code - 1)) + (bits.number(n) << (code - 1 - n)))
        must(len(frequencies) <= 256, "a table has more than 256 tokens")
    must(rest is not None, "no token of a table takes the rest")
    frequencies[rest] = FREQUENCY_SUM - sum(frequencies)
    must(frequencies[rest] >= 1, "the frequencies of a table add up to more than 4096")
    table = []
    for token, frequency in enumerate(frequencies):
        table += [(token, frequency, len(table))] * frequency
    return table


# ---- 7.4
# Streams ---------------------------------------------------------------------------------------------------------

FIRST_STATE = 65536


class Stream:
    def __init__(self, data, tables):
        self.tables, self.at = tables, 4
        if not data:
            self.state, self.words = FIRST_STATE, ()
            self.next_word = iter(())
            return
        must(len(data) >= 4 and len(data) % 2 == 0, "a stream has a wrong size")
        (self.state,) = struct.unpack("<I", data[:4])
        self.words = struct.unpack(f"<{len(data) // 2 - 2}H", data[4:])
        must(self.state >= FIRST_STATE, "a stream begins with a wrong state")
        must(self.state != FIRST_STATE or self.words, "a stream without symbols has bytes")
        self.next_word = iter(self.words)

    def renormalise(self):
        if self.state < FIRST_STATE:
            word = next(self.next_word, None)
            must(word is not None, "a stream is too short")
            self.state = self.state * 65536 + word

    def get(self, context):
        table = self.tables.get(context)
        must(table is not None, f"a symbol has context {context}, which has no table")
        s = self.state % FREQUENCY_SUM
        token, frequency, start = table[s]
        self.state = frequency * (self.state // FREQUENCY_SUM) + s - start
        self.renormalise()
        if token < 16:
            return token
        n, e, done = (token - 16) // 4 + 2, 0, 0
        while done < n:
            k = min(n - done, 16)
            e += (self.state % (1 << k)) << done
            self.state >>= k
            self.renormalise()
            done += k
        return ((4 + token % 4) << n) + e

    def get_signed(self, context):
        return unzigzag(self.get(context))

    def flag(self, context):
        value = self.get(context)
        must(value <= 1, "a flag is neither 0 nor 1")
        return value

    def end(self):
        must(self.state == FIRST_STATE and next(self.next_word, None) is None, "a stream does not end with its last symbol")
