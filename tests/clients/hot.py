"""A hot cube lies at one place of the world, whichever client reads whichever level, by that client's own account of where voxels are.

    python hot.py BASE DATASET X,Y,Z_nm        the cube's middle, from the volume's corner

The cube has 2^k voxels a side and lies on the grid of level k, so it is one voxel there; half a voxel off would show.
"""
import json
import sys
from urllib.request import urlopen

import numpy as np
import tensorstore as ts
import zarr
from cloudvolume import CloudVolume
from ome_zarr.io import parse_url
from ome_zarr.reader import Reader

NANOMETRES = {"nanometer": 1, "micrometer": 1e3, "millimeter": 1e6, "meter": 1e9}


def middle(voxels):
    """Mean index, x first, of the brightest voxels of an array whose last axes are z, y, x."""
    voxels = np.asarray(voxels)
    voxels = voxels.reshape(voxels.shape[-3:])
    return np.argwhere(voxels == voxels.max()).mean(axis=0)[::-1]


def placed(index, transformations, unit, first_scale):
    """OME-Zarr's world, from the corner: its zero is the centre of level 0's first voxel."""
    scale, translation = (next(t[kind] for t in transformations if t["type"] == kind)[-3:] for kind in ("scale", "translation"))
    return (index * scale[::-1] + translation[::-1] + np.array(first_scale[-3:][::-1]) / 2) * unit


def places(base, dataset):
    """Yields (client, level, place)."""
    for root, version in [("zarr2", 2), ("zarr2-5d", 2), ("zarr3", 3), ("zarr3-5d", 3)]:
        url = f"{base}/{root}/{dataset}"
        group = zarr.open_group(url, mode="r", zarr_format=version)
        attributes = dict(group.attrs)
        multiscale = (attributes["ome"] if version == 3 else attributes)["multiscales"][0]
        unit = NANOMETRES[multiscale["axes"][-1]["unit"]]
        levels = multiscale["datasets"]
        first = levels[0]["coordinateTransformations"][0]["scale"]
        node = next(iter(Reader(parse_url(url))()))
        for level, said in enumerate(levels):
            driver = "zarr3" if version == 3 else "zarr"
            store = ts.open({"driver": driver, "kvstore": f"{url}/{said['path']}/"}, read=True, open=True).result()
            where = said["coordinateTransformations"]
            yield f"zarr-python {root}", level, placed(middle(group[said["path"]][...]), where, unit, first)
            yield f"tensorstore {root}", level, placed(middle(store.read().result()), where, unit, first)
            own = node.metadata["coordinateTransformations"][level]
            yield f"ome-zarr-py {root}", level, placed(middle(node.data[level]), own, unit, first)
    url = f"{base}/precomputed/{dataset}"
    volume = CloudVolume(f"precomputed://{url}", progress=False, use_https=True)
    for level in range(len(volume.scales)):
        volume.mip = level
        index = middle(np.asarray(volume[:, :, :])[..., 0].T)
        yield "cloud-volume", level, (index + 0.5 + np.array(volume.voxel_offset)) * np.array(volume.resolution)
        spec = {"driver": "neuroglancer_precomputed", "kvstore": f"{url}/", "scale_index": level}
        store = ts.open(spec, read=True, open=True).result()
        index = middle(store.read().result()[..., 0].T) + np.array(store.domain.inclusive_min[:3])
        size = [unit.multiplier * {"nm": 1}[unit.base_unit] for unit in store.dimension_units[:3]]
        yield "tensorstore precomputed", level, (index + 0.5) * size


def main(base, dataset, expected):
    expected = np.array([float(v) for v in expected.split(",")])
    count = len(json.load(urlopen(f"{base}/v1/{dataset}/info"))["levels"])
    met = {}
    for client, level, place in places(base, dataset):
        assert np.allclose(place, expected, rtol=1e-12), f"{client} level {level}: {place}, not {expected}"
        met.setdefault(client, []).append(level)
    assert all(levels == list(range(count)) for levels in met.values()) and len(met) == 14, met
    print(f"{expected} nm by {len(met)} ways at {count} levels")


if __name__ == "__main__":
    main(*sys.argv[1:])
