"""same_world.py FOLDER: levels and parts of sform.nii.gz lie where they lay, by nibabel's affines."""
import sys
import nibabel as nib
import numpy as np

folder = sys.argv[1]
source = nib.load(f"{folder}/sform.nii.gz")
voxels = np.asanyarray(source.dataobj)


def world(img, ijk):
    return nib.affines.apply_affine(img.affine, ijk)


for level in range(3):
    img = nib.load(f"{folder}/l{level}.nii")
    assert img.shape == tuple(-(-n // 2**level) for n in source.shape)
    for ijk in [(0, 0, 0), (1, 2, 3), tuple(n - 1 for n in img.shape)]:
        # The centre of voxel i of level k lies at (i + 0.5) * 2^k - 0.5 in voxels of level 0.
        at = [(i + 0.5) * 2**level - 0.5 for i in ijk]
        assert np.allclose(world(img, ijk), world(source, at), atol=1e-4), (level, ijk)
    assert np.allclose(img.header.get_zooms(), np.array(source.header.get_zooms()) * 2**level)

for name in ["part", "roi"]:
    img = nib.load(f"{folder}/{name}.nii")
    assert np.array_equal(np.asanyarray(img.dataobj), voxels[4:20, 2:9, 6:11])
    assert np.allclose(world(img, (0, 0, 0)), world(source, (4, 2, 6)), atol=1e-4)
    assert np.allclose(world(img, (5, 4, 3)), world(source, (9, 6, 9)), atol=1e-4)
