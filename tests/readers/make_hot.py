"""make_hot.py FOLDER: hot.nii.gz, one bright voxel at 6,4,5 in the dark, oriented as sform.nii.gz is."""
import sys
import nibabel as nib
import numpy as np

folder = sys.argv[1]
oriented = nib.load(f"{folder}/sform.nii.gz")
voxels = np.full((13, 10, 11), 100, np.int16)
voxels[6, 4, 5] = 5000
img = nib.Nifti1Image(voxels, oriented.affine)
img.header.set_xyzt_units("mm")
nib.save(img, f"{folder}/hot.nii.gz")
