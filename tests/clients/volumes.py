"""Every client reads every level of a served dataset, and gets the source's pyramid bit for bit.

    python volumes.py BASE DATASET SOURCE.raw X,Y,Z DTYPE SX,SY,SZ_nm
"""
import asyncio
import json
import sys
from urllib.request import urlopen

import numpy as np
import tensorstore as ts
import zarr
from cloudvolume import CloudVolume


def pyramid(level, count):
    """Mean of the 2x2x2 cells that exist, integers rounded half to even. Arrays are zyx."""
    levels = [level]
    while len(levels) < count:
        fine = levels[-1]
        even = np.pad(fine.astype(np.float64), [(0, n % 2) for n in fine.shape])
        cells = np.pad(np.ones(fine.shape), [(0, n % 2) for n in fine.shape])
        z, y, x = (n // 2 for n in even.shape)
        total, number = (a.reshape(z, 2, y, 2, x, 2).sum(axis=(1, 3, 5)) for a in (even, cells))
        mean = total / number
        levels.append((np.rint(mean) if fine.dtype.kind in "iu" else mean).astype(fine.dtype))
    return levels


def same(what, found, expected):
    found = np.asarray(found)
    found = found.reshape(found.shape[-3:])
    assert found.dtype == expected.dtype, (what, found.dtype, expected.dtype)
    assert found.shape == expected.shape, (what, found.shape, expected.shape)
    wrong = np.count_nonzero(found.view(np.uint8) != expected.view(np.uint8))
    assert wrong == 0, f"{what}: {wrong} bytes of {expected.nbytes} differ"
    print(f"{what}: {expected.size} voxels")


def transforms(multiscale):
    for dataset in multiscale["datasets"]:
        scale, translation = dataset["coordinateTransformations"]
        yield scale["scale"][-3:], translation["translation"][-3:]


def main(base, dataset, source, dims, dtype, spacing_nm):
    dims = tuple(int(n) for n in dims.split(","))
    spacing = np.array([float(s) for s in spacing_nm.split(",")])
    raw = np.fromfile(source, dtype).reshape(dims[::-1])
    count = len(json.load(urlopen(f"{base}/v1/{dataset}/info"))["levels"])
    levels = pyramid(raw, count)
    nanometres = {"nanometer": 1, "micrometer": 1e3, "millimeter": 1e6, "meter": 1e9}
    # World positions of one voxel of each level, from the volume's corner, as each format states them.
    for root, version in [("zarr2", 2), ("zarr2-5d", 2), ("zarr3", 3), ("zarr3-5d", 3)]:
        url = f"{base}/{root}/{dataset}"
        group = zarr.open_group(url, mode="r", zarr_format=version)
        attributes = dict(group.attrs)
        multiscale = (attributes["ome"] if version == 3 else attributes)["multiscales"][0]
        unit = nanometres[multiscale["axes"][-1]["unit"]]
        assert len(multiscale["datasets"]) == count
        for level, (scale, translation) in enumerate(transforms(multiscale)):
            same(f"zarr-python {root} level {level}", group[str(level)][...], levels[level])
            spec = {"driver": "zarr3" if version == 3 else "zarr", "kvstore": f"{url}/{level}/"}
            store = ts.open(spec, read=True, open=True).result()
            same(f"tensorstore {root} level {level}", store.read().result(), levels[level])
            for axis in range(3):
                voxel = 0.5 * dims[axis] / 2**level
                world = (voxel * scale[-1 - axis] + translation[-1 - axis]) * unit + spacing[axis] / 2
                expected = (voxel + 0.5) * 2**level * spacing[axis]
                assert abs(world - expected) <= 1e-9 * expected, (root, level, axis, world, expected)
    info = json.load(urlopen(f"{base}/precomputed/{dataset}/info"))
    offset = info.get("octavo", {}).get("value_offset", 0)
    volume = CloudVolume(f"precomputed://{base}/precomputed/{dataset}", progress=False, use_https=True)
    for level in range(count):
        expected = levels[level]
        if offset:
            expected = (expected.astype(np.int64) - offset).astype(info["data_type"])
        elif str(expected.dtype) != info["data_type"]:
            expected = expected.astype(info["data_type"])
        volume.mip = level
        found = np.asarray(volume[:, :, :])[..., 0].T
        same(f"cloud-volume level {level}", np.ascontiguousarray(found), expected)
        kvstore = {"driver": "neuroglancer_precomputed", "kvstore": f"{base}/precomputed/{dataset}/", "scale_index": level}
        found = ts.open(kvstore, read=True, open=True).result().read().result()
        same(f"tensorstore precomputed level {level}", np.ascontiguousarray(found[..., 0].T), expected)
        assert np.allclose(volume.resolution, spacing * 2**level, rtol=1e-12)
        assert np.all(volume.voxel_offset == 0)


if __name__ == "__main__":
    main(*sys.argv[1:])
