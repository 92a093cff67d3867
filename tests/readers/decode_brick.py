"""decode_brick.py STORE INFO.json BRICK.json SAMPLES.raw: a brick's payload, read as FORMAT.md says, gives these samples
(of the core alone where the overlap is not stored)."""
import json
import sys

import numpy as np
from octavo_store import decode_payload, sample_dtype

store, info, brick, samples = sys.argv[1:]
info, brick = json.load(open(info)), json.load(open(brick))
dtype, core, overlap = sample_dtype(info), info["brick_core"], info["brick_overlap"]
side = core + 2 * overlap
expected = np.fromfile(samples, dtype).reshape(side, side, side)
if not info["stored_overlap"]:
    cut = slice(overlap, overlap + core)
    expected = expected[cut, cut, cut]
with open(store, "rb") as file:
    file.seek(4096 + brick["payload_offset"])
    payload = file.read(brick["payload_bytes"])
read = decode_payload(payload, brick, info)
bits = f"u{dtype.itemsize}"
assert np.array_equal(read.reshape(-1).view(bits), expected.reshape(-1).view(bits)), brick
