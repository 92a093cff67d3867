#!/usr/bin/env python3
"""Asks a server for the bricks of a view and reads what comes: docs/HTTP.md in 60 lines, standard library only.

    octavo serve tooth.octavo &
    python3 examples/cut.py http://127.0.0.1:8642 tooth
"""
import json
import struct
import sys
from urllib.request import Request, urlopen


def node_records(base, dataset, level):
    """Yields (key, state, brick_min, brick_max, payload_bytes) of a level's nodes."""
    data = urlopen(f"{base}/v1/{dataset}/nodes?level={level}").read()
    for at in range(0, len(data), 120):
        record = data[at:at + 120]
        (key, state), (length,) = struct.unpack_from("<QB", record), struct.unpack_from("<I", record, 24)
        brick_min, brick_max = struct.unpack_from("<dd", record, 48)
        yield coordinates(key), {1: "stored", 2: "uniform", 3: "empty"}.get(state, "damaged"), brick_min, brick_max, length


def coordinates(key):
    """A key's level and brick coordinates: the level in the top six bits, Morton code below, x lowest."""
    axis = lambda a: sum((key >> (3 * bit + a) & 1) << bit for bit in range(19))
    return key >> 58, axis(0), axis(1), axis(2)


def frames(stream):
    """Yields (key, kind, numbers, body) of a framed stream."""
    magic, version, count = struct.unpack("<4sIQ", stream.read(16))
    assert magic == b"OCTF" and version == 1
    for _ in range(count):
        key, kind, _format, _zero, length, first, second = struct.unpack("<QBBHIdd", stream.read(32))
        body = stream.read(length)
        assert len(body) == length, "the stream was cut off"
        yield key, kind, (first, second), body


def cut(base, dataset, request):
    """The leaves of a cut, and its bricks as they come."""
    body = json.dumps(request).encode()
    stream = frames(urlopen(Request(f"{base}/v1/{dataset}/cut", body, {"content-type": "application/json"})))
    _, kind, _, leaves = next(stream)
    assert kind == 16
    return [struct.unpack_from("<QBBHf", leaves, at) for at in range(0, len(leaves), 16)], stream


if __name__ == "__main__":
    base, dataset = sys.argv[1:3]
    info = json.load(urlopen(f"{base}/v1/{dataset}/info"))
    size = [n * s for n, s in zip(info["dims_xyz"], info["spacing_xyz"])]
    middle, away = [v / 2 for v in size], 2 * max(size)
    camera = {"projection": "perspective", "position": [middle[0], middle[1], -away], "target": middle, "up": [0, -1, 0], "fov_y_deg": 40}
    leaves, bricks = cut(base, dataset, {"cameras": [camera], "size": [1024, 576], "form": "samples"})
    print(f"{len(leaves)} leaves, {sum(kind == 1 for _, kind, *_ in leaves)} of them bricks")
    for key, kind, numbers, body in bricks:
        print("level {} brick {},{},{}".format(*coordinates(key)), f"{numbers[0]}..{numbers[1]}", f"{len(body)} bytes")
    top = len(info["levels"]) - 1
    print("the whole in one brick:", *next(node_records(base, dataset, top)))
