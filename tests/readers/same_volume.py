"""same_volume.py SOURCE BACK TIME: both hold the same values, spacing, unit and affine, as nibabel reads them."""
import sys
import nibabel as nib
import numpy as np

source, back = nib.load(sys.argv[1]), nib.load(sys.argv[2])
expected = np.asanyarray(source.dataobj)
if expected.ndim == 4:
    expected = expected[..., int(sys.argv[3])]
got = np.asanyarray(back.dataobj)
assert got.shape == expected.shape, (got.shape, expected.shape)
if source.dataobj.slope == 1 and source.dataobj.inter == 0:
    assert got.dtype.newbyteorder("=") == expected.dtype.newbyteorder("="), (got.dtype, expected.dtype)
    assert np.array_equal(got, expected)
else:
    # Scaled values become f32.
    assert got.dtype == np.float32, got.dtype
    assert np.array_equal(got, expected.astype(np.float32))
assert np.allclose(back.affine, source.affine, rtol=0, atol=1e-5), (back.affine, source.affine)
assert np.allclose(back.header.get_zooms()[:3], source.header.get_zooms()[:3], rtol=1e-6)
assert back.header.get_xyzt_units()[0] == source.header.get_xyzt_units()[0]
assert back.header["sform_code"] > 0
