"""scipy_zoom.py RAW SIDE FACTOR [OUT]: enlarges a cube of u16 by scipy and prints how long that took.

ndimage.zoom(order=3, prefilter=False, mode='nearest') weighs the samples with the cubic B-spline. grid_mode=True
gives it the grid of voxels as areas, o -> (o + 0.5) / f - 0.5; without it the first and last voxels' centres
would be the volume's corners.
"""
import json, sys, time
import numpy as np
from scipy import ndimage

path, side, factor = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
voxels = np.fromfile(path, np.uint16).reshape((side,) * 3)
started, cpu = time.perf_counter(), time.process_time()
new = ndimage.zoom(voxels, factor, order=3, prefilter=False, mode="nearest", grid_mode=True)
print(json.dumps({"inside_seconds": time.perf_counter() - started,
                  "inside_cpu_seconds": time.process_time() - cpu}))
if len(sys.argv) > 4:
    new.tofile(sys.argv[4])
