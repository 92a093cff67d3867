#!/usr/bin/env python3
"""beside_2010.py RESULTS: the last of measure.py's lines, of `convert --upscale --json`, beside what the 2010 text says of its
chameleon (4096 x 4096 x 4320 voxels of 16 bits, values below 6400 filtered out, a 2.4 GHz PC)."""
import json, sys

with open(sys.argv[1]) as lines:
    line = [json.loads(text) for text in lines][-1]
report = line["report"]
x, y, z = report["dims_xyz"]
voxels, source_bytes = x * y * z, 2 * x * y * z
then_voxels, then_secs = 64 * 2**30, 12.3 * 3600
rows = [
    ("voxels, 10^9", f"{then_voxels / 1e9:.1f}", f"{voxels / 1e9:.2f}"),
    ("time, s", f"{then_secs:.0f}", f"{line['seconds']:.1f}"),
    ("voxels a second, 10^6", f"{then_voxels / then_secs / 1e6:.2f}", f"{voxels / line['seconds'] / 1e6:.1f}"),
    ("processor time, s", "-", f"{line['cpu_seconds']:.1f}"),
    ("own memory, MB", "-", f"{line['own_bytes'] / 1e6:.1f} ({report['predicted_memory_bytes'] / 1e6:.1f} predicted)"),
    ("peak RSS, mapped pages of the source included, MB", "-", f"{line['rss_bytes'] / 1e6:.0f}"),
    ("source, GB", "135", f"{source_bytes / 1e9:.1f}"),
    ("store, GB", "15", f"{line['output_bytes'] / 1e9:.2f}"),
    ("store / source", f"{15 / 135:.2f}", f"{line['output_bytes'] / source_bytes:.2f}"),
    ("bricks dropped, level 0", "-", f"{report['levels'][0]['empty']} of "
     f"{sum(report['levels'][0][key] for key in ('stored', 'uniform', 'empty'))}"),
    ("RMS", "14.6", f"{report['rms']:.1f}"),
    ("AMAX", "116", f"{report['amax']:.0f}"),
    ("clamped voxels", "-", str(report["clamped_voxels"])),
]
print("| | 2010 | here |")
print("|---|---|---|")
for row in rows:
    print("| " + " | ".join(row) + " |")
