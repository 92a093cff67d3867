"""A store, read as octree-store/FORMAT.md says and with nothing else of Octavo's: slow, and strict about every byte.

    Store(PATH) checks the first page, both metadata frames, all records, payload checksums and the digest;
    .brick(key) gives (state, samples), indexed z, y, x, overlap included; None where it is lost.
"""
import json
import struct

import blake3
import imagecodecs
import numpy as np
import xxhash

PAGE, RECORD = 4096, 120
STATES = {1: "stored", 2: "uniform", 3: "empty", 4: "lost"}


def morton(x, y, z):
    return sum((v >> bit & 1) << (3 * bit + axis) for axis, v in enumerate((x, y, z)) for bit in range(19))


def unpack_words(payload, record, n, side, width):
    """Decompressed, arranged and predicted words of a payload; FORMAT.md, "Payload"."""
    bits = record["bits"]
    prediction, arrangement = divmod(record["filter"], 16)
    planes = bits if prediction == 0 else 8 * width
    length = planes * -(-n // 8) if arrangement == 2 else n * width
    if record["compression"] == 1:
        payload = imagecodecs.lz4_decode(payload, header=False, out=length)
    elif record["compression"] == 2:
        payload = imagecodecs.zstd_decode(payload, out=length)
    data = np.frombuffer(bytes(payload), "u1")
    words = np.zeros(n, "u8")
    if bits == 0:
        return words
    assert len(data) == length, (len(data), length)
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
    return words


def decode_payload(payload, record, info):
    """The samples of a stored brick, z, y, x: with the overlap, or the core alone where the overlap is not stored."""
    dtype = sample_dtype(info)
    side = info["brick_core"] + (2 * info["brick_overlap"] if info["stored_overlap"] else 0)
    coding, bits, low, high = record["coding"], record["bits"], record["brick_min"], record["brick_max"]
    width = {1: 1, 2: dtype.itemsize, 3: 1 if bits <= 8 else 2}[coding]
    words = unpack_words(payload, record, side**3, side, width)
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
            if info["stored_overlap"]:
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
    return read.reshape(side, side, side)


def sample_dtype(info):
    return np.dtype(info["sample_type"][0] + str(int(info["sample_type"][1:]) // 8)).newbyteorder("<")


class Store:
    def __init__(self, path):
        with open(path, "rb") as file:
            self.bytes = file.read()
        magic, version, features, payload_bytes, index_at, index_bytes = struct.unpack_from("<8sIIQQQ", self.bytes)
        assert magic == b"OCTAVO\r\n" and version == 1 and features == 0
        assert xxhash.xxh3_64_intdigest(self.bytes[:40]) == struct.unpack_from("<Q", self.bytes, 40)[0]
        page_after = lambda at: -(-at // PAGE) * PAGE
        text = self._frame(page_after(PAGE + payload_bytes), index_at)
        assert index_at % PAGE == 0 and text == self._frame(page_after(index_at + index_bytes), len(self.bytes))
        self.info = json.loads(text)
        self._geometry()
        assert index_bytes == RECORD * len(self.keys) == RECORD * sum(g[0] * g[1] * g[2] for g in self.grids)
        blocks = [self.bytes[at : at + RECORD] for at in range(index_at, index_at + index_bytes, RECORD)]
        self.records = {key: self._record(key, block) for key, block in zip(self.keys, blocks)}
        assert self._digest(text, blocks) == self.info["digest"] and self.info["complete"] is True

    def _frame(self, at, end):
        magic, version, checksum = struct.unpack_from("<4sIQ", self.bytes, at)
        # The text ends where zeros begin, or the file does.
        text = self.bytes[at + 16 : end].rstrip(b"\0")
        assert magic == b"OCTV" and version == 1 and xxhash.xxh3_64_intdigest(text, seed=version) == checksum
        return text.decode()

    def _geometry(self):
        core, dims = self.info["brick_core"], self.info["dims_xyz"]
        self.dims, self.grids, self.keys = [], [], []
        while not self.grids or self.grids[-1] != [1, 1, 1]:
            k = len(self.grids)
            self.dims.append([-(-n // 2**k) for n in dims])
            self.grids.append([-(-n // core) for n in self.dims[-1]])
            gx, gy, gz = self.grids[-1]
            places = [(x, y, z) for z in range(gz) for y in range(gy) for x in range(gx)]
            self.keys += [(k, *place) for place in sorted(places, key=lambda place: morton(*place))]

    def _record(self, key, block):
        level, x, y, z = key
        names = ("key state coding bits filter compression child_mask stream offset length measured checksum "
                 "brick_min brick_max subtree_min subtree_max squared_errors amax lod_rms_bound lod_amax_bound own").split()
        record = dict(zip(names, struct.unpack("<QBBBBBBHQII16s8dQ", block)))
        assert record["own"] == xxhash.xxh3_64_intdigest(block[:112])
        assert record["key"] == level << 58 | morton(x, y, z)
        children = [o for o in range(8) if level > 0 and all(
            2 * v + (o >> axis & 1) < self.grids[level - 1][axis] for axis, v in enumerate((x, y, z)))]
        assert record["child_mask"] == sum(1 << o for o in children)
        payload = self.payload(record)
        assert record["checksum"] == (xxhash.xxh3_128(payload).intdigest().to_bytes(16, "little") if payload else bytes(16))
        return record

    def payload(self, record):
        at = PAGE + record["offset"]
        assert record["length"] == 0 or record["stream"] == 0 and at + record["length"] <= len(self.bytes)
        return self.bytes[at : at + record["length"]]

    def _digest(self, text, blocks):
        info = dict(json.loads(text), complete=True, digest="", created_by="", created_unix_secs=0)
        info["source"] = {"path": "", "bytes": 0, "sample_type": None}
        compact = self._without(text, info)
        index = blake3.blake3(b"".join(b[:14] + bytes(10) + b[24:112] for b in blocks)).digest()
        return blake3.blake3(compact.encode() + index).hexdigest()

    @staticmethod
    def _without(text, info):
        """The stored text with the values of five keys exchanged: numbers must keep the digits they are written with."""
        out, at, decoder = "{", 1, json.JSONDecoder()
        while text[at] != "}":
            name, at = decoder.raw_decode(text, at)
            begin = at + 1
            _, at = decoder.raw_decode(text, begin)
            changed = name in ("complete", "digest", "source", "created_by", "created_unix_secs")
            value = json.dumps(info[name], separators=(",", ":")) if changed else text[begin:at]
            out += ("," if len(out) > 1 else "") + json.dumps(name) + ":" + value
            at += text[at] == ","
        return out + "}"

    def core(self, key):
        """The core samples of a brick that is not lost."""
        record, core, overlap = self.records[key], self.info["brick_core"], self.info["brick_overlap"]
        inner = slice(overlap, overlap + core) if self.info["stored_overlap"] else slice(None)
        constant = self._constant(record)
        if constant is not None:
            return np.full((core,) * 3, constant)
        return decode_payload(self.payload(record), record, self.info)[inner, inner, inner]

    def _constant(self, record):
        """The value of every sample of a brick without a payload."""
        dtype = sample_dtype(self.info)
        if record["state"] == 2:
            return dtype.type(record["brick_min"])
        if record["state"] == 3:
            return dtype.type(self.info["empty_value"])
        if record["state"] == 1 and record["bits"] == 0:
            return decode_payload(b"", record, self.info).flat[0]
        return None

    def brick(self, key):
        record, core, overlap = self.records[key], self.info["brick_core"], self.info["brick_overlap"]
        state, side = STATES[record["state"]], core + 2 * overlap
        if state == "lost":
            return state, None
        constant = self._constant(record)
        if constant is not None:
            return state, np.full((side,) * 3, constant)
        if self.info["stored_overlap"]:
            return state, decode_payload(self.payload(record), record, self.info)
        level, dims = key[0], self.dims[key[0]]
        samples = np.empty((side,) * 3, sample_dtype(self.info))
        inner = slice(overlap, overlap + core)
        samples[inner, inner, inner] = self.core(key)
        cores = {}
        for k, j, i in np.ndindex(samples.shape):
            if all(overlap <= v < overlap + core for v in (i, j, k)):
                continue
            voxel = [min(max(b * core + v - overlap, 0), n - 1) for b, v, n in zip(key[1:], (i, j, k), dims)]
            owner = (level, *(v // core for v in voxel))
            if STATES[self.records[owner]["state"]] == "lost":
                return "needs a lost neighbour", None
            if owner not in cores:
                cores[owner] = self.core(owner)
            x, y, z = (v % core for v in voxel)
            value = cores[owner][z, y, x]
            samples[k, j, i] = value if np.isnan(value) else np.clip(value, record["brick_min"], record["brick_max"])
        return state, samples
