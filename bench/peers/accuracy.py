#!/usr/bin/env python3
"""zfp, SZ3 and blosc2 on one volume at one largest error: accuracy.py RAW X,Y,Z E RUNS

RAW is u16, x fastest. One JSON line a method: bits a voxel, RMS, AMAX, PSNR (peak: the range), MB/s of encoding
and decoding (10^6 bytes of u16; medians of RUNS; one thread), microseconds for one random 32^3 region (median).
Every method is to reach the same measured AMAX, which is E or as near below it as it can come:

- SZ3: absolute bound E, once as f32 and once as i32 (it takes no u16);
- zfp: fixed accuracy as f32 (it has none for integers); its true error is far below the tolerance, which is therefore
  searched among the powers of two that zfp rounds it to;
- blosc2: it has no error bound for integers; q = (v + E) // (2E + 1), whose error is E, then bit shuffle with LZ4 or
  byte shuffle with Zstandard, in chunks of 32^3. Quantising and its reverse are in the times.
- blosc2 lossless, the same without quantising.

zfp and SZ3 decode everything for a region: neither has an index. blosc2 decodes the chunks that it touches.
"""
import json, statistics, sys, time

import blosc2
import numpy as np
import zfpy
from pysz import sz, szConfig, szErrorBoundMode

REGION = 32


def main():
    path, dims, bound, runs = sys.argv[1], sys.argv[2], float(sys.argv[3]), int(sys.argv[4])
    x, y, z = map(int, dims.split(","))
    blosc2.set_nthreads(1)
    volume = np.fromfile(path, "<u2").reshape(z, y, x)
    for name, encode, decode, region in methods(volume, bound):
        measure(name, volume, runs, encode, decode, region)


def measure(name, volume, runs, encode, decode, region):
    encodes, decodes = [], []
    for _ in range(runs):
        started = time.perf_counter()
        coded = encode()
        encodes.append(time.perf_counter() - started)
        started = time.perf_counter()
        back = decode(coded)
        decodes.append(time.perf_counter() - started)
    encode_secs, decode_secs = statistics.median(encodes), statistics.median(decodes)
    error = back.astype("f8") - volume
    rms = float(np.sqrt(np.mean(error**2)))
    span = float(volume.max()) - float(volume.min())
    print(json.dumps({
        "method": name,
        "bits_per_voxel": 8 * size_of(coded) / volume.size,
        "rms": rms,
        "amax": float(np.abs(error).max()),
        "psnr_db": 20 * float(np.log10(span / rms)) if rms > 0 else None,
        "encode_mb_per_sec": volume.nbytes / encode_secs / 1e6,
        "decode_mb_per_sec": volume.nbytes / decode_secs / 1e6,
        "region_micros": 1e6 * (regions(volume, coded, region) if region else decode_secs),
    }), flush=True)


def size_of(coded):
    return coded.schunk.cbytes if isinstance(coded, blosc2.NDArray) else len(bytes(coded))


def regions(volume, coded, region):
    """The median time of random regions, each checked for its size."""
    rng = np.random.default_rng(1)
    side = [min(REGION, n) for n in volume.shape]
    times = []
    for _ in range(200):
        at = [int(rng.integers(0, n - s + 1)) for n, s in zip(volume.shape, side)]
        started = time.perf_counter()
        part = region(coded, tuple(slice(a, a + s) for a, s in zip(at, side)))
        times.append(time.perf_counter() - started)
        assert part.shape == tuple(side)
    return statistics.median(times)


def methods(volume, bound):
    as_f32, as_i32 = volume.astype("f4"), volume.astype("i4")
    for name, array in (("SZ3 f32", as_f32), ("SZ3 i32", as_i32)):
        config = szConfig()
        config.errorBoundMode = szErrorBoundMode.ABS
        config.absErrorBound = bound
        config.openmp = False
        yield (f"{name}, abs {bound:g}",
               lambda array=array, config=config: sz.compress(array, config)[0],
               lambda coded, array=array: rounded(sz.decompress(coded, array.dtype, array.shape)[0]), None)
    tolerance = zfp_tolerance(volume, as_f32, bound)
    yield (f"zfp f32, accuracy {tolerance:g}",
           lambda: zfpy.compress_numpy(as_f32, tolerance=tolerance),
           lambda coded: rounded(zfpy.decompress_numpy(coded)), None)
    step = 2 * int(bound) + 1
    packers = (("LZ4, bit shuffle", blosc2.Codec.LZ4, blosc2.Filter.BITSHUFFLE, 5),
               ("Zstandard, byte shuffle", blosc2.Codec.ZSTD, blosc2.Filter.SHUFFLE, 3))
    for name, codec, shuffle, level in packers:
        params = {"codec": codec, "clevel": level, "filters": [shuffle], "nthreads": 1}
        for words, divisor in (("step", step), ("lossless", 1)):
            yield (f"blosc2 {name}, {words}" + (f" {divisor}" if divisor > 1 else ""),
                   lambda params=params, divisor=divisor: packed(volume, divisor, params),
                   lambda coded, divisor=divisor: unpacked(coded[:], divisor),
                   lambda coded, at, divisor=divisor: unpacked(coded[at], divisor))


def rounded(array):
    return np.clip(np.rint(array), 0, 65535) if array.dtype.kind == "f" else array


def zfp_error(volume, array, tolerance):
    back = rounded(zfpy.decompress_numpy(zfpy.compress_numpy(array, tolerance=tolerance)))
    return float(np.abs(back.astype("f8") - volume).max())


def zfp_tolerance(volume, array, bound):
    """The greatest power of two whose measured error is within the bound."""
    tolerance = 2.0 ** np.floor(np.log2(max(bound, 0.5)) + 6)
    while zfp_error(volume, array, tolerance) > bound:
        tolerance /= 2
    return float(tolerance)


def packed(volume, divisor, params):
    codes = volume if divisor == 1 else ((volume.astype("u4") + divisor // 2) // divisor).astype("u2")
    chunks = tuple(min(REGION, n) for n in volume.shape)
    return blosc2.asarray(np.ascontiguousarray(codes), chunks=chunks, blocks=chunks, cparams=params,
                          dparams={"nthreads": 1})


def unpacked(codes, divisor):
    return codes if divisor == 1 else np.minimum(codes.astype("u4") * divisor, 65535).astype("u2")


if __name__ == "__main__":
    main()
