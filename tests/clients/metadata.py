"""The metadata is valid by other people's models: ome-zarr-models, ome-zarr-py, the OpenAPI schema.

    python metadata.py BASE DATASET
"""
import json
import sys
from urllib.request import urlopen

import zarr
from ome_zarr.io import parse_url
from ome_zarr.reader import Reader
from ome_zarr_models.v04.image import Image as Image04
from ome_zarr_models.v05.image import Image as Image05
from openapi_spec_validator import validate


def main(base, dataset):
    for root in ("zarr2", "zarr2-5d"):
        image = Image04.from_zarr(zarr.open_group(f"{base}/{root}/{dataset}", mode="r", zarr_format=2))
        print(root, "0.4:", [axis.name for axis in image.attributes.multiscales[0].axes])
    for root in ("zarr3", "zarr3-5d"):
        image = Image05.from_zarr(zarr.open_group(f"{base}/{root}/{dataset}", mode="r", zarr_format=3))
        print(root, "0.5:", [axis.name for axis in image.attributes.ome.multiscales[0].axes])
    for root in ("zarr2", "zarr2-5d", "zarr3", "zarr3-5d"):
        nodes = list(Reader(parse_url(f"{base}/{root}/{dataset}"))())
        assert nodes and nodes[0].data, root
        print(root, "ome-zarr-py:", [level.shape for level in nodes[0].data])
    validate(json.load(urlopen(f"{base}/openapi.json")))
    print("OpenAPI document: valid")


if __name__ == "__main__":
    main(*sys.argv[1:])
