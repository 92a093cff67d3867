"""VTK's volume mappers on one view of a cube of u16: render.py RAW SIDE MAPPER(gpu|fixed) SCENE.json [RUNS]

SCENE.json has the camera (position, target, up, fov_y_deg), the image's size, and a transfer function (points of value, color,
extinction per voxel), as Octavo is given them. Samples lie one voxel apart; no shading. One line of JSON: median seconds of a frame, the first excluded.
"""

import json
import math
import resource
import statistics
import sys
import time

import numpy
import vtk
from vtk.util import numpy_support

raw, side, mapper_name, scene_file = sys.argv[1], int(sys.argv[2]), sys.argv[3], sys.argv[4]
runs = int(sys.argv[5]) if len(sys.argv) > 5 else 5
picture = sys.argv[6] if len(sys.argv) > 6 else None
scene = json.load(open(scene_file))

voxels = numpy.fromfile(raw, "<u2")
image = vtk.vtkImageData()
image.SetDimensions(side, side, side)
# A voxel's middle is half a voxel from its corner.
image.SetOrigin(0.5, 0.5, 0.5)
scalars = numpy_support.numpy_to_vtk(voxels, deep=0, array_type=vtk.VTK_UNSIGNED_SHORT)
image.GetPointData().SetScalars(scalars)

opacity, color = vtk.vtkPiecewiseFunction(), vtk.vtkColorTransferFunction()
for point in scene["transfer"]["points"]:
    opacity.AddPoint(point["value"], 1.0 - math.exp(-point["extinction"]))
    color.AddRGBPoint(point["value"], *point["color"])
look = vtk.vtkVolumeProperty()
look.SetScalarOpacity(opacity)
look.SetColor(color)
look.SetInterpolationTypeToLinear()
look.ShadeOff()

if mapper_name == "gpu":
    mapper = vtk.vtkOpenGLGPUVolumeRayCastMapper()
    mapper.SetUseJittering(0)
    mapper.SetMaxMemoryInBytes(8 << 30)
    mapper.SetMaxMemoryFraction(1.0)
else:
    mapper = vtk.vtkFixedPointVolumeRayCastMapper()
    mapper.SetImageSampleDistance(1.0)
mapper.SetAutoAdjustSampleDistances(0)
mapper.SetSampleDistance(1.0)
mapper.SetInputData(image)

volume = vtk.vtkVolume()
volume.SetMapper(mapper)
volume.SetProperty(look)
renderer = vtk.vtkRenderer()
renderer.AddVolume(volume)
renderer.SetBackground(0, 0, 0)
window = vtk.vtkRenderWindow()
window.SetOffScreenRendering(1)
window.SetMultiSamples(0)
window.SetSize(*scene["size"])
window.AddRenderer(renderer)
camera = renderer.GetActiveCamera()
camera.SetPosition(*scene["camera"]["position"])
camera.SetFocalPoint(*scene["camera"]["target"])
camera.SetViewUp(*scene["camera"]["up"])
camera.SetViewAngle(scene["camera"]["fov_y_deg"])
renderer.ResetCameraClippingRange()

seconds = []
for _ in range(runs + 1):
    # A frame is drawn anew only if something changed.
    volume.Modified()
    camera.Modified()
    started = time.perf_counter()
    window.Render()
    window.WaitForCompletion()
    seconds.append(time.perf_counter() - started)
grab = vtk.vtkWindowToImageFilter()
grab.SetInput(window)
grab.ReadFrontBufferOff()
grab.Update()
pixels = numpy_support.vtk_to_numpy(grab.GetOutput().GetPointData().GetScalars())
if picture:
    writer = vtk.vtkPNGWriter()
    writer.SetFileName(picture)
    writer.SetInputConnection(grab.GetOutputPort())
    writer.Write()
print(json.dumps({
    "mapper": mapper_name,
    "vtk": vtk.vtkVersion().GetVTKVersion(),
    "first_secs": seconds[0],
    "median_secs": statistics.median(seconds[1:]),
    "mean_pixel": float(pixels.mean()),
    "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
}))
