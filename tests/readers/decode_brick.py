"""decode_brick.py STORE INFO.json BRICK.json SAMPLES.raw: a brick's payload, read as FORMAT.md says, gives these samples
(of the core alone where the overlap is not stored)."""
import json
import sys
import imagecodecs
import numpy as np

store, info, brick, samples = sys.argv[1:]
info, brick = json.load(open(info)), json.load(open(brick))
dtype = np.dtype(info["sample_type"][0] + str(int(info["sample_type"][1:]) // 8)).newbyteorder("<")
core, overlap, stored = info["brick_core"], info["brick_overlap"], info["stored_overlap"]
side = core + 2 * overlap
expected = np.fromfile(samples, dtype).reshape(side, side, side)
if not stored:
    cut = slice(overlap, overlap + core)
    expected, side = expected[cut, cut, cut], core
n, bits, coding = side**3, brick["bits"], brick["coding"]
low, high = brick["brick_min"], brick["brick_max"]
width = {1: 1, 2: dtype.itemsize, 3: 1 if bits <= 8 else 2}[coding]
prediction, arrangement = divmod(brick["filter"], 16)

# Compression.
with open(store, "rb") as file:
    file.seek(4096 + brick["payload_offset"])
    payload = file.read(brick["payload_bytes"])
planes = bits if prediction == 0 else 8 * width
length = planes * -(-n // 8) if arrangement == 2 else n * width
if brick["compression"] == 1:
    payload = imagecodecs.lz4_decode(payload, header=False, out=length)
elif brick["compression"] == 2:
    payload = imagecodecs.zstd_decode(payload, out=length)
data = np.frombuffer(bytes(payload), "u1")
words = np.zeros(n, "u8")
if bits > 0:
    assert len(data) == length, (len(data), length)
    # Arrangement.
    if arrangement == 0:
        words += data.view(f"<u{width}")
    elif arrangement == 1:
        for byte, plane in enumerate(data.reshape(width, n)):
            words += plane.astype("u8") << np.uint64(8 * byte)
    else:
        for bit, plane in enumerate(data.reshape(planes, -1)):
            for start in range(0, n, 512):
                count = min(512, n - start)
                lanes = -(-count // 8)
                block = plane[start // 8 : start // 8 + lanes]
                ones = np.concatenate([block >> g & 1 for g in range(8)])[:count]
                words[start : start + count] |= ones.astype("u8") << np.uint64(bit)
    # Prediction, modulo the word.
    words = words.astype(f"u{width}")
    if prediction:
        words = (words >> 1) ^ (-(words & 1).astype(f"i{width}")).astype(f"u{width}")
    if prediction == 1:
        words = np.cumsum(words, dtype=f"u{width}")
    elif prediction == 2:
        cube = words.reshape(side, side, side)
        for axis in (0, 1, 2):
            cube = np.cumsum(cube, axis=axis, dtype=f"u{width}")
        words = cube.reshape(-1)
    elif prediction == 3:
        d, cube = words.reshape(side, side, side), np.zeros((side, side, side), "O")
        for z, y, x in np.ndindex(d.shape):
            b = cube[z, y - 1, x] if y else None
            c = cube[z - 1, y, x] if z else None
            a = cube[z, y, x - 1] if x else None
            if b is None and c is None:
                mean = a or 0
            else:
                b, c = b if b is not None else c, c if c is not None else b
                mean = ((a if a is not None else b) + b + c + 1) // 3
            cube[z, y, x] = (mean + int(d[z, y, x])) % 2 ** (8 * width)
        words = cube.reshape(-1).astype(f"u{width}")

# Coding.
if coding == 2:
    read = words.astype(f"<u{width}").view(dtype)
else:
    if coding == 1:
        value = low + words.astype("f8") * (high - low) / 255
    else:
        error = float(info["encoding"].removeprefix("max-error="))
        if dtype.kind == "f":
            step = 2 * (error * (1 - (2.0**-7 if dtype.itemsize == 4 else 2.0**-20)))
        else:
            step = 2 * min(int(error), 2 ** (8 * dtype.itemsize) - 1) + 1
        if stored:
            first, count = 0, (high - low) // step + 1
            left = (high - low) - (count - 1) * step
            base = low + (left / 2 if dtype.kind == "f" else left // 2)
        else:
            nearest = (lambda v: np.rint(v / step)) if dtype.kind == "f" else (lambda v: (v + step // 2) // step)
            base, first = 0, nearest(low)
            count = nearest(high) - first + 1
        assert bits == max(int(count) - 1, 0).bit_length(), (bits, count)
        value = np.clip(base + (first + words.astype("f8")) * step, low, high)
    read = (value if dtype.kind == "f" else np.rint(value)).astype(dtype)
assert np.array_equal(read.view(f"u{dtype.itemsize}"), expected.reshape(-1).view(f"u{dtype.itemsize}")), brick
