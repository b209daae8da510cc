"""Writes small OpenStreetMap extracts (.osm.pbf) without a library."""

import struct
import zlib


def varint(value):
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes(out) + bytes([value])


def field(number, value):
    """Returns a field of a message: an integer, or bytes."""
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    return varint(number << 3 | 2) + varint(len(value)) + value


def packed(number, values):
    return field(number, b"".join(map(varint, values)))


def deltas(values):
    """Returns differences, as zigzag-encoded signed numbers."""
    steps = [b - a for a, b in zip([0, *values], values)]
    return [step << 1 if step >= 0 else (-step << 1) - 1 for step in steps]


def blob(kind, message):
    data = field(2, len(message)) + field(3, zlib.compress(message))
    head = field(1, kind.encode()) + field(3, len(data))
    return struct.pack(">I", len(head)) + head + data


def extract(nodes, ways, relations=()):
    """Returns the bytes of a file.

    Nodes are (id, lat, lon), ways (id, ids of nodes, tags), relations (tags, members), and members (role,
    0 for a node or 1 for a way, id).
    """
    strings = [""]

    def number(text):
        if text not in strings:
            strings.append(text)
        return strings.index(text)

    def tagged(id, tags):
        return field(1, id) + packed(2, map(number, tags)) + packed(3, map(number, tags.values()))

    columns = [[id for id, _, _ in nodes], *([round(1e7 * node[k]) for node in nodes] for k in (1, 2))]
    dense = b"".join(packed(number, deltas(values)) for number, values in zip((1, 8, 9), columns))
    groups = [field(2, dense)]
    groups.append(b"".join(field(3, tagged(id, tags) + packed(8, deltas(refs))) for id, refs, tags in ways))
    groups.append(b"".join(
        field(4, tagged(k + 1, tags) + packed(8, [number(role) for role, _, _ in members])
              + packed(9, deltas([id for _, _, id in members])) + packed(10, [kind for _, kind, _ in members]))
        for k, (tags, members) in enumerate(relations)))
    table = field(1, b"".join(field(1, text.encode()) for text in strings))
    header = field(4, b"OsmSchema-V0.6") + field(4, b"DenseNodes")
    return blob("OSMHeader", header) + b"".join(blob("OSMData", table + field(2, group)) for group in groups if group)
