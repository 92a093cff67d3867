#!/usr/bin/env python3
"""tensorstore writes a raw u16 cube as sharded zarr3 with a pyramid of 2x2x2 means.

tensorstore_convert.py RAW N OUT LEVELS

Chunks of 32^3 in shards of 256^3, blosc-lz4 (level 5, byte shuffle). Level 1 is made from the mapped
source, which is faster than reading level 0 back; each level above from the one below. The time
counts from the first open to the last write, imports apart.
"""
import json, os, shutil, sys, time
import numpy as np
import tensorstore as ts

raw, n, out, levels = sys.argv[1], int(sys.argv[2]), sys.argv[3], int(sys.argv[4])
context = ts.Context({"data_copy_concurrency": {"limit": 2}, "file_io_concurrency": {"limit": 4}})
little = {"name": "bytes", "configuration": {"endian": "little"}}
blosc = {"name": "blosc",
         "configuration": {"cname": "lz4", "clevel": 5, "shuffle": "shuffle", "typesize": 2}}


def spec(level):
    side = n >> level
    sharding = {"chunk_shape": [32] * 3, "codecs": [little, blosc],
                "index_codecs": [little, {"name": "crc32c"}]}
    return {
        "driver": "zarr3",
        "kvstore": {"driver": "file", "path": f"{out}/{level}/"},
        "metadata": {
            "shape": [side] * 3,
            "data_type": "uint16",
            "fill_value": 0,
            "chunk_grid": {"name": "regular",
                           "configuration": {"chunk_shape": [min(256, side)] * 3}},
            "codecs": [{"name": "sharding_indexed", "configuration": sharding}],
        },
    }


shutil.rmtree(out, ignore_errors=True)
os.makedirs(out)
cpu, started = time.process_time(), time.perf_counter()
source = np.memmap(raw, "<u2", "r", shape=(n, n, n))
below = None
for level in range(levels + 1):
    side = n >> level
    store = ts.open(spec(level), create=True, open=True, context=context).result()
    slab = min(256, side)
    if level == 1 and os.environ.get("REREAD") != "1":
        below = ts.array(source, context=context)
    means = ts.downsample(below, [2, 2, 2], "mean") if level else None
    for z in range(0, side, slab):
        store[z:z + slab].write(means[z:z + slab] if level else source[z:z + slab]).result()
    below = ts.open(spec(level), open=True, context=context).result()
print(json.dumps({"inside_seconds": time.perf_counter() - started,
                  "inside_cpu_seconds": time.process_time() - cpu}))
