"""same_export.py make FOLDER: volumes of every sample type with an oblique affine, as NIfTI, and their list.

same_export.py check FOLDER: of each line SOURCE|BACK.nrrd|BACK.tif|LEVEL|X0:X1,Y0:Y1,Z0:Z1 of FOLDER/list.txt pynrrd,
SimpleITK and tifffile read from both what nibabel reads of that part of SOURCE (of a level above 0 the grid alone), in the
same place and size.
"""
import os
import sys

import nibabel as nib
import nrrd
import numpy as np
import SimpleITK as sitk
import tifffile

TYPES = ["u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"]
LPS_TO_RAS = np.diag([-1.0, -1.0, 1.0])
SPACING = np.array([0.5, 0.0123, 2.5])


def make(folder):
    rng = np.random.default_rng(7)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    affine = np.eye(4)
    affine[:3, :3] = turn @ np.diag(SPACING)
    affine[:3, 3] = [-12.5, 30.25, 7.0]
    for name in TYPES:
        dtype = np.dtype("<" + name)
        if dtype.kind == "f":
            voxels = (rng.normal(size=(37, 21, 43)) * 1e3).astype(dtype)
            voxels[1, 2, 3], voxels[4, 5, 6], voxels[7, 8, 9] = np.nan, np.inf, -np.inf
        else:
            limits = np.iinfo(dtype)
            voxels = rng.integers(limits.min, limits.max, (37, 21, 43), dtype=dtype, endpoint=True)
        image = nib.Nifti1Image(voxels, affine)
        image.header.set_xyzt_units("micron")
        image.header["pixdim"][1:4] = SPACING
        nib.save(image, os.path.join(folder, f"{name}.nii"))


def check(source_path, nrrd_path, tiff_path, level, region):
    source = nib.load(source_path)
    scale = 2 ** level
    bounds = [[int(v) for v in axis.split(":")] for axis in region.split(",")]
    low = np.array([a >> level for a, _ in bounds])
    high = np.array([((b - 1) >> level) + 1 for _, b in bounds])
    part = tuple(slice(a, b) for a, b in zip(low, high))
    expected = np.asanyarray(source.dataobj)[part] if level == 0 else None
    affine = source.affine.copy()
    affine[:3, 3] = nib.affines.apply_affine(source.affine, (low + 0.5) * scale - 0.5)
    affine[:3, :3] *= scale
    spacing = np.linalg.norm(affine[:3, :3], axis=0)

    voxels, header = nrrd.read(nrrd_path)
    assert header["space"] == "right-anterior-superior" and header["space units"] == ["um"] * 3, header
    assert np.allclose(np.array(header["space directions"]).T, affine[:3, :3], rtol=0, atol=1e-6)
    assert np.allclose(header["space origin"], affine[:3, 3], rtol=0, atol=1e-5), header["space origin"]
    image = sitk.ReadImage(nrrd_path)
    itk = sitk.GetArrayFromImage(image).T
    direction = np.array(image.GetDirection()).reshape(3, 3)
    assert np.allclose(LPS_TO_RAS @ direction @ np.diag(image.GetSpacing()), affine[:3, :3], rtol=0, atol=1e-5)
    assert np.allclose(LPS_TO_RAS @ image.GetOrigin(), affine[:3, 3], rtol=0, atol=1e-4)

    with tifffile.TiffFile(tiff_path) as file:
        pages = file.asarray().T.reshape(voxels.shape)
        by_page = np.stack([page.asarray() for page in file.pages]).T
        meta = file.imagej_metadata
        assert meta["unit"] == "micron" and meta["images"] == voxels.shape[2], meta
        tags = file.pages[-1].tags
        sizes = [tags[name].value[1] / tags[name].value[0] for name in ("XResolution", "YResolution")]
        assert np.allclose([*sizes, meta["spacing"]], spacing, rtol=1e-6), (sizes, meta, spacing)
        assert not file.is_bigtiff
    assert voxels.shape == tuple(high - low), voxels.shape
    for found in (voxels, itk, pages, by_page):
        dtype = np.asanyarray(source.dataobj).dtype
        assert found.dtype.newbyteorder("=") == dtype.newbyteorder("="), (found.dtype, dtype)
        assert np.array_equal(found, voxels, equal_nan=dtype.kind == "f")
        if expected is not None:
            assert np.array_equal(found, expected, equal_nan=dtype.kind == "f")
    # ITK's TIFF knows no doubles.
    if dtype.itemsize < 8:
        by_itk = sitk.GetArrayFromImage(sitk.ReadImage(tiff_path)).T.reshape(voxels.shape)
        assert by_itk.dtype == dtype and np.array_equal(by_itk, voxels, equal_nan=dtype.kind == "f")


if sys.argv[1] == "make":
    make(sys.argv[2])
else:
    for line in open(os.path.join(sys.argv[2], "list.txt")):
        *names, level, region = line.rstrip("\n").split("|")
        try:
            check(*(os.path.join(sys.argv[2], name) for name in names), int(level), region)
        except Exception as error:
            raise AssertionError(f"{line}: {error}") from error
