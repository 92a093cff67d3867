"""Codes and their map are the dequantised samples, as zarr-python and tensorstore read both.

    python codes.py BASE DATASET...        datasets of integers of at most 16 bits
"""
import sys

import numpy as np
import tensorstore as ts
import zarr


def values(codes, numbers, core, dtype):
    """What docs/HTTP.md says ("Codes as zarr")."""
    place = np.ix_(*(np.arange(n) // core for n in codes.shape))
    scale, offset, least, greatest = (numbers[..., i][place] for i in range(4))
    return np.rint(np.clip(offset + scale * codes, least, greatest)).astype(dtype)


def main(base, *datasets):
    for dataset in datasets:
        for version in (2, 3):
            url, driver = f"{base}/zarr{version}-codes/{dataset}", {2: "zarr", 3: "zarr3"}[version]
            group = zarr.open_group(url, mode="r", zarr_format=version)
            said = group.attrs["octavo"]
            plain = zarr.open_group(f"{base}/zarr{version}/{dataset}", mode="r", zarr_format=version)
            for level, paths in enumerate(said["levels"]):
                expected = plain[str(level)][...]
                own = [group[paths[name]][...] for name in ("codes", "map")]
                other = [
                    ts.open({"driver": driver, "kvstore": f"{url}/{paths[name]}/"}, read=True, open=True).result().read().result()
                    for name in ("codes", "map")
                ]
                for client, (codes, numbers) in [("zarr-python", own), ("tensorstore", other)]:
                    found = values(codes, numbers, said["core"], expected.dtype)
                    wrong = np.count_nonzero(found != expected)
                    assert codes.any() and wrong == 0, f"{client} {url} level {level}: {wrong} of {expected.size} voxels differ"
                print(f"codes of {dataset}, zarr {version}, level {level}: {expected.size} voxels of {own[0].dtype}")


if __name__ == "__main__":
    main(*sys.argv[1:])
