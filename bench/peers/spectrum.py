"""spectrum.py SOURCE PLAIN DETAILED SIDE FACTOR: the power of a volume, enlarged, and enlarged with detail.

Prints a table: mean power a frequency, in dB over that of the lowest row, by the greatest component of the
frequency in cycles a source voxel; 0.5 is the source's Nyquist frequency, FACTOR / 2 the new one. A Hann window
keeps the edges, where a spectrum sees a step, out of it.
"""
import sys
import numpy as np

source, plain, detailed, side, factor = *sys.argv[1:4], int(sys.argv[4]), int(sys.argv[5])


def power(path, side, scale):
    v = np.fromfile(path, np.uint16).reshape((side,) * 3).astype(np.float64)
    return spectrum(v, scale)


def spectrum(v, scale):
    side = v.shape[0]
    window = np.hanning(side + 2)[1:-1]
    v = (v - v.mean()) * window[:, None, None] * window[None, :, None] * window[None, None, :]
    p = np.abs(np.fft.fftn(v)) ** 2 / v.size**2
    k = np.abs(np.fft.fftfreq(side)) * scale
    return p, np.maximum(np.maximum(k[:, None, None], k[None, :, None]), k[None, None, :])


wide = side * factor
a, b, c = power(source, side, 1), power(plain, wide, factor), power(detailed, wide, factor)
load = lambda path: np.fromfile(path, np.uint16).reshape((wide,) * 3).astype(np.float64)
d = spectrum(load(detailed) - load(plain), factor)
edges = [0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 1.0, 1.25, 1.5, 2.0, 3.0, 4.0]
edges = [e for e in edges if e <= factor / 2]
inside = lambda k, lo, hi: (k > lo) & (k <= hi + 1e-9)
first = None
print("| cycles a source voxel | source | enlarged | with detail | detail alone |")
print("|---|---|---|---|---|")
for lo, hi in zip(edges, edges[1:]):
    row = []
    for p, k in (a, b, c, d):
        found = p[inside(k, lo, hi)]
        row.append(found.sum() if found.size else 0.0)
    # Sums of the source and of the enlarged are over equally many frequencies up to its Nyquist.
    first = first or row[0]
    cells = [f"{10 * np.log10(v / first):.1f}" if v > 0 else "-" for v in row]
    print(f"| {lo} to {hi} | " + " | ".join(cells) + " |")
low = d[0][inside(d[1], -1, 0.5)].sum() / d[0].sum()
print(f"\nOf the detail's energy {100 * low:.2f} % lies where the source can hold it.")
