#!/usr/bin/env python3
"""Prints the table of a file of measure.py's lines: table.py RESULTS VOXELS REFERENCE_LABEL

A row for each label in the order of first runs; medians, and the best run's seconds. Lines with a
`remark` and no figures become rows that say why there are none.
"""
import json, sys
from statistics import median


def main():
    path, voxels, reference = sys.argv[1], int(sys.argv[2]), sys.argv[3]
    rows, remarks = {}, {}
    with open(path) as lines:
        for line in map(json.loads, lines):
            if "remark" in line:
                remarks[line["label"]] = line["remark"]
            else:
                rows.setdefault(line["label"], []).append(line)
    middle = {
        label: {key: median(run[key] for run in runs)
                for key in ("seconds", "cpu_seconds", "own_bytes", "output_bytes", "files")}
        for label, runs in rows.items()
    }
    base = middle.get(reference, {}).get("seconds")
    print("| tool | seconds (best) | CPU s | ns a voxel | own memory MB | output MB | files "
          f"| time over {reference} |")
    print("|---|---|---|---|---|---|---|---|")
    for label, row in middle.items():
        best = min(run["seconds"] for run in rows[label])
        ratio = f"{row['seconds'] / base:.2f}" if base else "-"
        print(f"| {label} | {row['seconds']:.2f} ({best:.2f}) | {row['cpu_seconds']:.2f} "
              f"| {1e9 * row['seconds'] / voxels:.2f} | {row['own_bytes'] / 1e6:.0f} "
              f"| {row['output_bytes'] / 1e6:.1f} | {row['files']:.0f} | {ratio} |")
    for label, remark in remarks.items():
        if label not in middle:
            print(f"| {label} | {remark} | - | - | - | - | - | - |")


main()
