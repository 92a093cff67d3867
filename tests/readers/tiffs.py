"""tiffs.py OUT SUITE: what tifffile writes and reads, for Octavo to be held against.

Writes TIFF files of every kind into OUT, and for each of them, and for each file of the folder SUITE, what
tifffile reads there. OUT/expected.json is a list of
  {"file", "raw", "dims_xyz", "dtype", "spacing_xyz", "unit", "channel", "time"}
where raw is a file of little-endian samples, x fastest, or of {"file", "refused": [words of the message]}.
"""
import json
import logging
import pathlib
import sys

import numpy as np
import tifffile

logging.disable(logging.CRITICAL)
out, suite = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
expected = []
rng = np.random.default_rng(5)
NAMES = {"u1": "u8", "i1": "i8", "u2": "u16", "i2": "i16", "u4": "u32", "i4": "i32", "f4": "f32", "f8": "f64"}


def expect(file, voxels, **more):
    """`voxels` is indexed z, y, x."""
    kind = voxels.dtype.kind + str(voxels.dtype.itemsize)
    raw = out / f"{len(expected)}.raw"
    raw.write_bytes(np.ascontiguousarray(voxels.astype("<" + kind)).tobytes())
    expected.append({"file": str(file), "raw": str(raw), "dims_xyz": voxels.shape[::-1],
                     "dtype": NAMES[kind], **more})


def volume(kind, shape=(3, 21, 43)):
    """Steps and noise, so that codecs and predictors have both."""
    base = np.add.outer(np.arange(shape[0]) * 9, np.add.outer(np.arange(shape[1]) * 5, np.arange(shape[2]) // 4))
    noise = rng.integers(0, 5, size=shape)
    if kind[0] == "f":
        return ((base + noise) * 1.37e3 - 2e4).astype(kind)
    return ((base + noise) * (1 if kind[1] == "1" else 257)).astype(kind)


# Every byte order, type, compression, predictor and arrangement.
for kind in NAMES:
    voxels = volume(kind)
    for order in "<>":
        for compression in [None, "lzw", "zlib", "adobe_deflate", "packbits", "zstd"]:
            for predictor in [1, 2, 3]:
                if predictor > 1 and compression in (None, "packbits"):
                    continue
                # tifffile predicts floats by predictor 3 alone.
                if predictor > 1 and (predictor == 3) != (kind[0] == "f"):
                    continue
                for arrangement in [{"rowsperstrip": 8}, {"rowsperstrip": 21}, {"tile": (16, 32)}]:
                    for big in [False, True]:
                        # Half of all combinations, spread evenly, are enough.
                        if (len(expected) + big) % 2:
                            continue
                        name = out / f"{kind}-{'le' if order == '<' else 'be'}-{compression}-{predictor}-{len(expected)}.tif"
                        tifffile.imwrite(name, voxels, byteorder=order, bigtiff=big, compression=compression,
                                         predictor=None if predictor == 1 else predictor,
                                         photometric="minisblack", metadata=None, **arrangement)
                        written = tifffile.imread(name)
                        assert np.array_equal(written, voxels), name
                        expect(name, voxels)

# Floats of 16 bits become floats of 32.
halves = (volume("f4") / 50).astype("f2")
halves[0, 0, :6] = [np.inf, -np.inf, np.nan, 6e-8, -0.0, 65504]
for order in "<>":
    for compression, predictor in [(None, None), ("lzw", None), ("zlib", 3), ("zstd", 3), ("packbits", None)]:
        for arrangement in [{"rowsperstrip": 8}, {"tile": (16, 32)}]:
            name = out / f"half-{'le' if order == '<' else 'be'}-{compression}-{len(arrangement)}-{len(expected)}.tif"
            tifffile.imwrite(name, halves, byteorder=order, compression=compression, predictor=predictor,
                             photometric="minisblack", metadata=None, **arrangement)
            assert np.array_equal(tifffile.imread(name), halves, equal_nan=True)
            expect(name, halves.astype("f4"))
# A tile's row of halves as long as the slice's row of floats.
name = out / "half-wide-tile.tif"
tifffile.imwrite(name, halves[:, :, :8], tile=(16, 16), photometric="minisblack", metadata=None)
expect(name, halves[:, :, :8].astype("f4"))
# Tiles that are left out are zeros.
for compression in [None, "zlib", "lzw"]:
    for left_out in [(2, 5), (1,), range(1, 6)]:
        tiles = [None if i in left_out else volume("u2", (1, 16, 16))[0] + 1 for i in range(6)]
        name = out / f"sparse-{compression}-{len(left_out)}.tif"
        tifffile.imwrite(name, iter(tiles), shape=(1, 30, 40), dtype="u2", tile=(16, 16), photometric="minisblack",
                         compression=compression, metadata=None)
        with tifffile.TiffFile(name) as tif:
            assert all((tif.pages[0].dataoffsets[i] == 0) == (i in left_out) for i in range(6))
        expect(name, tifffile.imread(name).reshape(1, 30, 40))
# Tiles as wide as the picture, which would lie plainly in the file but for the last.
name = out / "sparse-plain.tif"
tifffile.imwrite(name, iter([np.ones((16, 32), "u2"), None]), shape=(1, 32, 32), dtype="u2", tile=(16, 32),
                 photometric="minisblack", metadata=None)
expect(name, tifffile.imread(name).reshape(1, 32, 32))

# ImageJ: a hyperstack, and a stack with one directory for all its planes.
hyper = rng.integers(0, 4000, size=(3, 4, 2, 9, 11)).astype(np.uint16)
name = out / "hyperstack.tif"
tifffile.imwrite(name, hyper, imagej=True, resolution=(4.0, 2.0), metadata={"spacing": 3.0, "unit": "um", "axes": "TZCYX"})
for time, channel in [(0, 0), (2, 1)]:
    expect(name, hyper[time, :, channel], time=time, channel=channel, spacing_xyz=[0.25, 0.5, 3.0], unit="um")
stack = volume("u2", (17, 20, 30))
name = out / "imagej.tif"
tifffile.imwrite(name, stack, imagej=True, resolution=(10.0, 10.0), metadata={"spacing": 0.2, "unit": "mm", "axes": "ZYX"})
expect(name, stack, spacing_xyz=[0.1, 0.1, 0.2], unit="mm")
name = out / "imagej-one-directory.tif"
with tifffile.TiffWriter(name, imagej=True) as writer:
    writer.write(stack, metadata={"spacing": 2.0, "unit": "\\u00B5m", "axes": "ZYX"}, resolution=(1.0, 1.0), truncate=True)
expect(name, stack, spacing_xyz=[1.0, 1.0, 2.0], unit="um")
# Without names of axes tifffile calls planes channels.
name = out / "imagej-channels.tif"
tifffile.imwrite(name, stack, imagej=True)
expect(name, stack)
# The same samples, contiguous, as any other program's.
for order in "<>":
    name = out / f"plain-{'be' if order == '>' else 'le'}.tif"
    tifffile.imwrite(name, stack, byteorder=order, photometric="minisblack")
    expect(name, stack)

# The last axes of a shape of tifffile's may be one sample of a pixel.
for shape, voxels in [((7, 1, 1), (1, 7, 1)), ((33, 1, 1), (1, 33, 1)), ((5, 4, 1), (1, 5, 4)), ((7, 5, 4, 1), (7, 5, 4)),
                      ((1, 7, 1, 1), (1, 1, 7)), ((7, 1, 5), (7, 1, 5)), ((1, 1, 7), (1, 1, 7))]:
    array = np.arange(np.prod(shape)).reshape(shape).astype("u2")
    name = out / f"shape-{'-'.join(map(str, shape))}.tif"
    tifffile.imwrite(name, array, photometric="minisblack")
    assert np.array_equal(tifffile.imread(name), array)
    expect(name, array.reshape(voxels))

# OME: every order of dimensions is in unit tests; here channels, times and units.
name = out / "stack.ome.tif"
tifffile.imwrite(name, hyper, photometric="minisblack", tile=(16, 16), compression="zlib",
                 metadata={"axes": "TZCYX", "PhysicalSizeX": 0.5, "PhysicalSizeXUnit": "mm", "PhysicalSizeY": 250.0,
                           "PhysicalSizeZ": 2.0, "PhysicalSizeZUnit": "mm"})
for time, channel in [(0, 1), (1, 0)]:
    expect(name, hyper[time, :, channel], time=time, channel=channel, spacing_xyz=[0.5, 0.25, 2.0], unit="mm")
# A pyramid in SubIFDs, which are no slices.
name = out / "pyramid.ome.tif"
with tifffile.TiffWriter(name, bigtiff=True) as writer:
    writer.write(stack, subifds=1, tile=(16, 16), photometric="minisblack", metadata={"axes": "ZYX"})
    writer.write(stack[:, ::2, ::2], subfiletype=1, tile=(16, 16), photometric="minisblack")
expect(name, stack)
# Resolution tags alone.
name = out / "cm.tif"
tifffile.imwrite(name, stack, resolution=(200.0, 400.0), resolutionunit="CENTIMETER", photometric="minisblack")
expect(name, stack, spacing_xyz=[0.05, 0.025, 0.05], unit="mm")
# A folder of slices, and files that are none beside them.
folder = out / "slices"
folder.mkdir()
for z in range(17):
    tifffile.imwrite(folder / f"s_{z + 95}.tif", stack[z], compression="lzw", photometric="minisblack")
(folder / "scan.log").write_text("a log")
expect(folder, stack)
expect(folder / "s_1*.tif", stack[5:])

# What is no grey volume of a type that is read.
for label, voxels, words in [
    ("rgb", np.zeros((9, 11, 3), np.uint8), ["colour (RGB, 3 samples a pixel)"]),
    ("u64", np.zeros((9, 11), np.uint64), ["64-bit unsigned integers"]),
    ("complex", np.zeros((9, 11), np.complex64), ["complex"]),
    ("bool", np.zeros((9, 11), bool), ["1-bit unsigned integers"]),
]:
    name = out / f"{label}.tif"
    tifffile.imwrite(name, voxels, photometric="rgb" if label == "rgb" else "minisblack")
    expected.append({"file": str(name), "refused": ["page 0", *words]})
for orientation in range(2, 9):
    name = out / f"orientation-{orientation}.tif"
    tifffile.imwrite(name, volume("u2", (1, 9, 11)), photometric="minisblack", extratags=[(274, 3, 1, orientation, True)])
    words = ["page 0", f"Orientation is {orientation}", "tiffset -s 274 1"]
    expected.append({"file": str(name), "refused": words})
name = out / "jpeg.tif"
tifffile.imwrite(name, np.zeros((16, 16), np.uint8), compression="jpeg")
expected.append({"file": str(name), "refused": ["JPEG (7)", "save it anew"]})

# The bundled files: what tifffile reads as grey of these types, Octavo reads.
for path in sorted(suite.rglob("*.tif*")):
    try:
        with tifffile.TiffFile(path) as tif:
            pages = [page for page in tif.pages if not page.is_reduced]
            grey = all(int(page.photometric) in (0, 1) and page.samplesperpixel == 1
                       and f"{page.dtype.kind}{page.bitspersample // 8}" in [*NAMES, "f2"]
                       and ("Orientation" not in page.tags or page.tags["Orientation"].value in (0, 1))
                       and page.bitspersample % 8 == 0 for page in pages)
            voxels = np.stack([page.asarray() for page in pages]) if grey else None
    except Exception as error:  # what tifffile refuses
        voxels = None
    if voxels is not None:
        expect(path, voxels.astype("f4") if voxels.dtype.itemsize == 2 and voxels.dtype.kind == "f" else voxels)
    else:
        expected.append({"file": str(path), "refused": [path.name]})

(out / "expected.json").write_text(json.dumps(expected))
print(len(expected))
