"""same_stack.py FOLDER RAW: the raw file holds the folder's slices in the order of their names, as Pillow reads them."""
import pathlib
import sys

import numpy as np
from PIL import Image

slices = [np.asarray(Image.open(path)) for path in sorted(pathlib.Path(sys.argv[1]).glob("*.tif"))]
expected = np.stack(slices)
got = np.fromfile(sys.argv[2], expected.dtype.newbyteorder("<")).reshape(expected.shape)
assert np.array_equal(got, expected)
