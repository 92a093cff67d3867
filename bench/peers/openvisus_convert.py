#!/usr/bin/env python3
"""OpenVisus writes a raw u16 cube as IDX: openvisus_convert.py RAW N OUT [COMPRESSION]

Its coarser levels are subsamples, no means, and writing does not compress; COMPRESSION (lz4, zip) adds
its own second pass over the file. Imports apart.
"""
import json, os, shutil, sys, time
import numpy as np
import OpenVisus as ov

raw, n, out = sys.argv[1], int(sys.argv[2]), sys.argv[3]
compression = sys.argv[4] if len(sys.argv) > 4 else "raw"
shutil.rmtree(out, ignore_errors=True)
os.makedirs(out)
cpu, started = time.process_time(), time.perf_counter()
source = np.memmap(raw, "<u2", "r", shape=(n, n, n))
store = ov.CreateIdx(url=f"{out}/volume.idx", dims=[n] * 3, fields=[ov.Field("data", "uint16")])
slab = min(256, n)
for z in range(0, n, slab):
    store.write(source[z:z + slab], z=z)
store.compressDataset(compression)
print(json.dumps({"inside_seconds": time.perf_counter() - started,
                  "inside_cpu_seconds": time.process_time() - cpu}))
