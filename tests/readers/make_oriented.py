"""Writes small oriented NIfTI volumes with nibabel: sform, qform, scaled, big-endian, NIfTI-2, a series."""
import sys
import nibabel as nib
import numpy as np

folder = sys.argv[1]
rng = np.random.default_rng(5)
voxels = rng.integers(0, 4000, size=(23, 14, 17)).astype(np.int16)

# A rotation about two axes, anisotropic spacing, an offset.
a, b = 0.3, -0.7
rz = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
rx = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
affine = np.eye(4)
affine[:3, :3] = rz @ rx @ np.diag([0.5, 0.75, 2.5])
affine[:3, 3] = [-12.5, 40.0, 7.25]


def image(data, cls=nib.Nifti1Image, **kwargs):
    img = cls(data, affine, **kwargs)
    img.header.set_xyzt_units("mm")
    return img


img = image(voxels)
img.set_sform(affine, code=1)
img.set_qform(None, code=0)
nib.save(img, f"{folder}/sform.nii.gz")

img = image(voxels)
img.set_qform(affine, code=1)
img.set_sform(None, code=0)
nib.save(img, f"{folder}/qform.nii")

img = image(voxels)
img.set_sform(affine, code=1)
img.header.set_slope_inter(0.25, -1000.0)
nib.save(img, f"{folder}/scaled.nii")
# nibabel rescales on saving: put the slope into the file by hand, as scanners do.
with open(f"{folder}/scaled.nii", "r+b") as f:
    f.seek(112)
    f.write(np.array([0.25, -1000.0], "<f4").tobytes())

header = nib.Nifti1Header(endianness=">")
header.set_data_dtype(">i2")
img = nib.Nifti1Image(voxels, affine, header)
img.header.set_xyzt_units("micron")
nib.save(img, f"{folder}/big.nii")

nib.save(image(voxels.astype(np.uint16), nib.Nifti2Image), f"{folder}/nifti2.nii")

series = rng.normal(size=(9, 8, 7, 4)).astype(np.float32)
nib.save(image(series), f"{folder}/series.nii.gz")
