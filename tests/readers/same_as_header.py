"""same_as_header.py SOURCE BACK [KEY=VALUE ...]: what SimpleITK (or another) reads of SOURCE is what nibabel reads of BACK.

`same_as_header.py FOLDER` checks all that FOLDER/list.txt names, each against NAME.back.nii.

`time=N` and `channel=N` say which volume of a series BACK holds; `reader=pynrrd` chooses the reader;
`affine=no` says that SOURCE does not place its voxels in the world; `as=FILE` that FILE, beside SOURCE, holds the
same in a form that the reader knows. A folder is a DICOM series; `slices=pydicom` and `frames=PLACES` (the place of
each frame of a file) read DICOM with pydicom.
"""
import os
import sys

import nibabel as nib
import numpy as np

LPS_TO_RAS = np.diag([-1.0, -1.0, 1.0])


def by_itk(path, options):
    """Voxels with x first, spacing, and the affine from voxel to RAS."""
    import SimpleITK as sitk

    if os.path.isdir(path):
        image = sitk.ReadImage(sitk.ImageSeriesReader.GetGDCMSeriesFileNames(path))
    else:
        image = sitk.ReadImage(path)
    voxels = sitk.GetArrayFromImage(image)
    if image.GetNumberOfComponentsPerPixel() > 1:
        voxels = voxels[..., int(options.get("channel", 0))]
    voxels = voxels.T
    if voxels.ndim == 4:
        voxels = voxels[..., int(options.get("time", 0))]
    n = image.GetDimension()
    spacing, affine = np.ones(3), np.eye(4)
    dims = min(n, 3)
    spacing[:dims] = image.GetSpacing()[:dims]
    direction = np.eye(3)
    direction[:dims, :dims] = np.array(image.GetDirection()).reshape(n, n)[:dims, :dims]
    affine[:3, :3] = LPS_TO_RAS @ direction @ np.diag(spacing)
    origin = np.zeros(3)
    origin[:dims] = image.GetOrigin()[:dims]
    affine[:3, 3] = LPS_TO_RAS @ origin
    return voxels, spacing, affine


def by_pynrrd(path, options):
    """As by_itk, for the spaces that pynrrd leaves as they are."""
    import nrrd

    voxels, header = nrrd.read(path)
    kinds = header.get("kinds", [])
    if voxels.ndim > 3 or any(kind in ("list", "vector", "time") for kind in kinds):
        at = next((i for i, kind in enumerate(kinds) if kind in ("list", "vector", "time")), 3)
        voxels = np.take(voxels, int(options.get("channel", options.get("time", 0))), axis=at)
        keep = [i for i in range(voxels.ndim + 1) if i != at]
    else:
        keep = list(range(voxels.ndim))
    spacing, affine = np.ones(3), np.eye(4)
    if "space directions" in header:
        directions = np.array(header["space directions"], dtype=float)[keep]
        spacing[: len(keep)] = np.linalg.norm(directions, axis=1)
        affine[:3, : len(keep)] = directions.T
        affine[:3, 3] = header.get("space origin", np.zeros(3))
        if header.get("space", "").lower() in ("left-posterior-superior", "lps"):
            affine[:3] = LPS_TO_RAS @ affine[:3]
    elif "spacings" in header:
        spacing[: len(keep)] = np.array(header["spacings"])[keep]
    return voxels, spacing, affine


def by_pydicom(path, options):
    """As by_itk; slices go by their places along the normal."""
    import pydicom

    if os.path.isdir(path):
        sets = [pydicom.dcmread(os.path.join(path, name)) for name in os.listdir(path)]
        orientation = [float(v) for v in sets[0].ImageOrientationPatient]
        normal = np.cross(orientation[:3], orientation[3:])
        sets.sort(key=lambda ds: np.dot(normal, [float(v) for v in ds.ImagePositionPatient]))
        positions = [np.array(ds.ImagePositionPatient, dtype=float) for ds in sets]
        pixel_spacing = sets[0].PixelSpacing
        slices = [ds.pixel_array * float(ds.get("RescaleSlope", 1)) + float(ds.get("RescaleIntercept", 0)) for ds in sets]
    else:
        ds = pydicom.dcmread(path)
        shared = ds.SharedFunctionalGroupsSequence[0]
        order = np.argsort([int(place) for place in options["frames"].split(",")])
        groups = [ds.PerFrameFunctionalGroupsSequence[int(i)] for i in order]
        positions = [np.array(g.PlanePositionSequence[0].ImagePositionPatient, dtype=float) for g in groups]
        orientation = [float(v) for v in shared.PlaneOrientationSequence[0].ImageOrientationPatient]
        pixel_spacing = shared.PixelMeasuresSequence[0].PixelSpacing
        values = shared.PixelValueTransformationSequence[0]
        pixels = ds.pixel_array[order]
        slices = list(pixels * float(values.RescaleSlope) + float(values.RescaleIntercept))
    voxels = np.stack(slices).astype(np.float32).T
    step = (positions[-1] - positions[0]) / (len(positions) - 1)
    spacing = np.array([float(pixel_spacing[1]), float(pixel_spacing[0]), np.linalg.norm(step)])
    affine = np.eye(4)
    affine[:3, 0] = np.array(orientation[:3]) * spacing[0]
    affine[:3, 1] = np.array(orientation[3:]) * spacing[1]
    affine[:3, 2], affine[:3, 3] = step, positions[0]
    affine[:3] = LPS_TO_RAS @ affine[:3]
    return voxels, spacing, affine


def check(source_path, back_path, options):
    if "as" in options:
        source_path = os.path.join(os.path.dirname(source_path), options["as"])
    if "slices" in options or "frames" in options:
        reader = by_pydicom
    else:
        reader = by_pynrrd if options.get("reader") == "pynrrd" else by_itk
    expected, spacing, affine = reader(source_path, options)
    back = nib.load(back_path)
    got = np.asanyarray(back.dataobj)
    expected = expected.reshape(expected.shape + (1,) * (3 - expected.ndim))
    got = got.reshape(got.shape + (1,) * (3 - got.ndim))
    assert got.shape == expected.shape, (got.shape, expected.shape)
    if options.get("type") != "any":
        types = got.dtype.newbyteorder("="), expected.dtype.newbyteorder("=")
        assert types[0] == types[1], types
    assert np.array_equal(got.astype(np.float64), expected.astype(np.float64), equal_nan=True)
    zooms = back.header.get_zooms()[:3]
    assert np.allclose(zooms, spacing, rtol=1e-5), (zooms, spacing)
    if options.get("affine") != "no":
        assert back.header["sform_code"] > 0
        assert np.allclose(back.affine, affine, rtol=1e-5, atol=1e-4), (back.affine, affine)


def parsed(words):
    return dict(option.split("=") for option in words)


if len(sys.argv) == 2:
    folder = sys.argv[1]
    for line in open(os.path.join(folder, "list.txt")):
        name, _, options = line.rstrip("\n").split("|")
        source = os.path.join(folder, name)
        try:
            check(source, source + ".back.nii", parsed(options.split()))
        except Exception as error:
            raise AssertionError(f"{name}|{options}: {error}") from error
else:
    check(sys.argv[1], sys.argv[2], parsed(sys.argv[3:]))
