"""pngs.py OUT: grey PNG files as Pillow writes them, and what is in them; see tiffs.py for expected.json."""
import json
import pathlib
import sys

import numpy as np
from PIL import Image

out = pathlib.Path(sys.argv[1])
expected = []
rng = np.random.default_rng(5)
for dtype, name, top in [(np.uint8, "u8", 256), (np.uint16, "u16", 65536)]:
    voxels = rng.integers(0, top, size=(12, 21, 35)).astype(dtype)
    folder = out / name
    folder.mkdir()
    for z, picture in enumerate(voxels):
        Image.fromarray(picture).save(folder / f"slice{z}.png", dpi=(254, 508))
    raw = out / f"{name}.raw"
    raw.write_bytes(voxels.astype(voxels.dtype.newbyteorder("<")).tobytes())
    # Resolutions in PNG are whole pixels a metre.
    more = {"raw": str(raw), "dtype": name, "spacing_xyz": [0.1, 0.05, 0.1], "unit": "mm"}
    expected.append({"file": str(folder), "dims_xyz": [35, 21, 12], **more})
    one = out / f"{name}-one.raw"
    one.write_bytes(voxels[10].astype(voxels.dtype.newbyteorder("<")).tobytes())
    expected.append({"file": str(folder / "slice10.png"), "dims_xyz": [35, 21, 1], **more, "raw": str(one)})
for mode, words in [("RGB", "RGB"), ("RGBA", "transparency"), ("LA", "transparency"), ("P", "a palette"), ("1", "1 bits")]:
    name = out / f"{mode}.png"
    Image.new(mode, (9, 11)).save(name)
    expected.append({"file": str(name), "refused": [words]})
(out / "expected.json").write_text(json.dumps(expected))
