"""upscaled_world.py SOURCE ENLARGED FACTOR HOT_X,HOT_Y,HOT_Z: by nibabel's affines every voxel of an enlarged
volume lies where the tricubic grid puts it, and the hot voxel is where it was."""
import sys
import nibabel as nib
import numpy as np

source, new = nib.load(sys.argv[1]), nib.load(sys.argv[2])
factor = int(sys.argv[3])
hot = np.array([int(v) for v in sys.argv[4].split(",")])


def world(img, ijk):
    return nib.affines.apply_affine(img.affine, ijk)


assert new.shape == tuple(factor * n for n in source.shape), (new.shape, source.shape)
assert new.get_data_dtype() == source.get_data_dtype()
zooms = np.array(source.header.get_zooms())
assert np.allclose(np.array(new.header.get_zooms()) * factor, zooms, rtol=1e-6)
assert new.header.get_xyzt_units() == source.header.get_xyzt_units()
for ijk in [(0, 0, 0), (1, 2, 3), tuple(n - 1 for n in new.shape)]:
    at = (np.array(ijk) + 0.5) / factor - 0.5
    assert np.allclose(world(new, ijk), world(source, at), atol=1e-4), ijk

voxels = np.asanyarray(new.dataobj).astype(np.float64)
assert tuple(np.unravel_index(np.argmax(np.asanyarray(source.dataobj)), source.shape)) == tuple(hot)
# The bright new voxels' centre of mass, in the world, is the hot voxel's place.
bright = np.argwhere(voxels > 0.5 * voxels.max())
centre = bright.mean(axis=0)
assert np.allclose(world(new, centre), world(source, hot), atol=1e-4), (centre, hot)
