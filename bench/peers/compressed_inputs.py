#!/usr/bin/env python3
"""Packs a raw u16 cube as p_N.nii.gz and as stacks of TIFF slices: compressed_inputs.py RAW N FOLDER

Slice by slice, so that memory does not depend on the size. gzip and Deflate at level 1, as nibabel does;
strips as tifffile makes them, no predictor.
"""
import gzip, os, sys
import nibabel as nib
import numpy as np
import tifffile

raw, n, folder = sys.argv[1], int(sys.argv[2]), sys.argv[3]
source = np.memmap(raw, "<u2", "r", shape=(n, n, n))

header = nib.Nifti1Header()
header.set_data_dtype(np.uint16)
header.set_data_shape((n, n, n))
header.set_xyzt_units("mm")
header["magic"] = b"n+1"
header["vox_offset"] = 352
with gzip.open(f"{folder}/p_{n}.nii.gz", "wb", compresslevel=1) as out:
    out.write(header.binaryblock + bytes(4))
    for z in range(n):
        out.write(source[z].tobytes())

packings = {"deflate": {"compression": "zlib", "compressionargs": {"level": 1}},
            "lzw": {"compression": "lzw"}}
for name, packing in packings.items():
    stack = f"{folder}/stack_{name}"
    os.makedirs(stack, exist_ok=True)
    for z in range(n):
        tifffile.imwrite(f"{stack}/{z:05}.tif", source[z], photometric="minisblack", **packing)
