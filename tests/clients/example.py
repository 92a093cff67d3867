"""examples/cut.py reads node records and a cut, and what it reads is the source's.

    python example.py BASE DATASET EXAMPLE SOURCE.raw X,Y,Z DTYPE
"""
import importlib.util
import json
import sys
from urllib.request import urlopen

import numpy as np
from volumes import pyramid


def main(base, dataset, example, source, dims, dtype):
    spec = importlib.util.spec_from_file_location("cut", example)
    cut = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(cut)
    dims = tuple(int(n) for n in dims.split(","))
    info = json.load(urlopen(f"{base}/v1/{dataset}/info"))
    levels = pyramid(np.fromfile(source, dtype).reshape(dims[::-1]), len(info["levels"]))
    core, overlap = info["brick_core"], info["brick_overlap"]

    def brick(level, *place):
        """A brick's samples, zyx: outside the volume the edge repeats."""
        volume = levels[level]
        axes = (np.clip(np.arange(at * core - overlap, (at + 1) * core + overlap), 0, n - 1) for at, n in zip(place[::-1], volume.shape))
        return volume[np.ix_(*axes)]

    records = 0
    for level, said in enumerate(info["levels"]):
        met = set()
        for key, state, least, greatest, payload_bytes in cut.node_records(base, dataset, level):
            samples = brick(*key)
            assert (least, greatest) == (samples.min(), samples.max()), key
            assert state == ("uniform" if least == greatest else "stored") and (payload_bytes > 0) == (state == "stored"), key
            met.add(key)
        x, y, z = said["grid_xyz"]
        assert len(met) == x * y * z and {key[0] for key in met} == {level}
        records += len(met)
    size = [n * s for n, s in zip(info["dims_xyz"], info["spacing_xyz"])]
    camera = {"projection": "perspective", "position": [size[0] / 2, size[1] / 2, -size[2] / 10], "target": [v / 2 for v in size], "up": [0, -1, 0], "fov_y_deg": 90}
    leaves, bricks = cut.cut(base, dataset, {"cameras": [camera], "size": [120, 90], "form": "samples"})
    wanted = [cut.coordinates(key) for key, kind, *_ in leaves if kind == 1]
    met = []
    for key, kind, numbers, body in bricks:
        key = cut.coordinates(key)
        assert kind == 1 and np.array_equal(np.frombuffer(body, dtype), brick(*key).ravel()), key
        assert numbers == (brick(*key).min(), brick(*key).max())
        met.append(key)
    assert sorted(met) == sorted(wanted) and len({key[0] for key in met}) > 1, "bricks of several levels"
    print(f"{records} node records, {len(leaves)} leaves and {len(met)} bricks of a cut")


if __name__ == "__main__":
    main(*sys.argv[1:])
