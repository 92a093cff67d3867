"""How a picture differs from another, as displays show them: psnr.py A.png B.png; PSNR in dB of 8 bits a component."""

import sys

import numpy
from PIL import Image


def read(path):
    return numpy.asarray(Image.open(path).convert("RGB"), dtype=float)


error = numpy.mean((read(sys.argv[1]) - read(sys.argv[2])) ** 2)
print("inf" if error == 0 else f"{10 * numpy.log10(255**2 / error):.1f}")
