"""A scene for Octavo and VTK both: scene.py SIDE opaque|transparent FOLDER [PIXELS]; writes scene.json, camera.json, transfer.json.

A cube of SIDE voxels of 1, from a corner of a sphere around it. Its side covers PIXELS pixels where the camera aims [521: it fills
the picture's height].
"""

import json
import math
import sys

side, kind, folder = float(sys.argv[1]), sys.argv[2], sys.argv[3]
pixels = float(sys.argv[4]) if len(sys.argv) > 4 else 521
turn, raise_ = math.radians(30), math.radians(20)
away = side * math.sqrt(3) / 2 / math.sin(math.radians(15))
direction = [math.cos(raise_) * math.sin(turn), math.sin(raise_), math.cos(raise_) * math.cos(turn)]
camera = {
    "projection": "perspective",
    "position": [side / 2 + away * d for d in direction],
    "target": [side / 2] * 3,
    "up": [0, 1, 0],
    "fov_y_deg": math.degrees(2 * math.atan(side * 576 / pixels / 2 / away)),
}
# The opacity that one voxel of a volume of 512^3 has, as an extinction: the same picture whatever the side.
opacities = {
    "opaque": [(0, 0.0), (8000, 0.0), (12000, 0.6), (20000, 0.9), (65535, 0.999)],
    "transparent": [(0, 0.0005), (3500, 0.0005), (8000, 0.002), (20000, 0.006), (45000, 0.012), (65535, 0.02)],
}[kind]
ramp = [(0, (0, 0, 0)), (20000, (0.8, 0.4, 0.2)), (30000, (0.9, 0.9, 0.8)), (45000, (1, 1, 1)), (65535, (1, 1, 1))]


def at(value, points):
    for (v0, c0), (v1, c1) in zip(points, points[1:]):
        if v0 <= value <= v1:
            t = (value - v0) / (v1 - v0)
            mix = lambda a, b: a + (b - a) * t
            return tuple(map(mix, c0, c1)) if isinstance(c0, tuple) else mix(c0, c1)


values = sorted({v for v, _ in opacities} | {v for v, _ in ramp})
points = [
    {"value": v, "color": at(v, ramp), "extinction": -math.log1p(-at(v, opacities)) * 512 / side} for v in values
]
scene = {"size": [1024, 576], "camera": camera, "transfer": {"points": points}}
for name, content in [("scene", scene), ("camera", camera), ("transfer", scene["transfer"])]:
    with open(f"{folder}/{name}.json", "w") as file:
        json.dump(content, file)
