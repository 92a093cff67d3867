"""simpleitk_resample.py RAW SIDE FACTOR [OUT]: enlarges a cube of u16 by ITK and prints how long that took.

The resample filter with sitkBSplineResampler: sums of cubic B-splines, the samples taken as their coefficients.
It is told the same grid, and uses all cores.
"""
import json, sys, time
import numpy as np
import SimpleITK as sitk

path, side, factor = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
image = sitk.GetImageFromArray(np.fromfile(path, np.uint16).reshape((side,) * 3))
started, cpu = time.perf_counter(), time.process_time()
first = 0.5 / factor - 0.5
new = sitk.Resample(image, [side * factor] * 3, sitk.Transform(), sitk.sitkBSplineResampler, [first] * 3,
                    [1 / factor] * 3, [1, 0, 0, 0, 1, 0, 0, 0, 1], 0.0, sitk.sitkUInt16, True)
print(json.dumps({"inside_seconds": time.perf_counter() - started,
                  "inside_cpu_seconds": time.process_time() - cpu}))
if len(sys.argv) > 4:
    sitk.GetArrayFromImage(new).tofile(sys.argv[4])
