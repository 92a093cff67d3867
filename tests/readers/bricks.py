"""Every brick of a store, read as FORMAT.md says (octavo_store.py).

    bricks.py table STORE...             a table: file, level, brick x, y, z, state, and the first 16 digits of the BLAKE3 of
                                         the samples, overlap included, x fastest, little-endian
    bricks.py same TABLE STORE...        the table is the same
    bricks.py program OCTAVO STORE...    `octavo brick` gives the same samples
"""
import os
import subprocess
import sys
import tempfile

import blake3
from octavo_store import Store


def table(paths):
    for path in paths:
        store = Store(path)
        for key in store.keys:
            state, samples = store.brick(key)
            digits = "-" if samples is None else blake3.blake3(samples.tobytes()).hexdigest()[:16]
            yield "\t".join([os.path.basename(path), *map(str, key), state.replace(" ", "-"), digits])


def program(octavo, paths):
    with tempfile.TemporaryDirectory() as folder:
        raw = os.path.join(folder, "brick.raw")
        for path in paths:
            store = Store(path)
            for level, *at in store.keys:
                state, samples = store.brick((level, *at))
                place = ["--level", str(level), "--at", ",".join(map(str, at))]
                done = subprocess.run([octavo, "brick", path, *place, "-o", raw, "--force"], capture_output=True, text=True)
                assert (done.returncode == 0) == (samples is not None), (path, level, at, state, done.stderr)
                with open(raw, "rb") as file:
                    assert samples is None or file.read() == samples.tobytes(), (path, level, at)


what, *arguments = sys.argv[1:]
if what == "table":
    print(*table(arguments), sep="\n")
elif what == "same":
    with open(arguments[0]) as file:
        expected = file.read().splitlines()
    read = list(table(arguments[1:]))
    assert read == expected, [pair for pair in zip(read, expected) if pair[0] != pair[1]][:3] or (len(read), len(expected))
else:
    assert what == "program"
    program(arguments[0], arguments[1:])
