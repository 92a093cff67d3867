"""packed.py OUT: small volumes of which a plan once asked for much more memory than they take.

Writes TIFF files packed by Zstandard, in strips and tiles of many sizes, a folder of them, a folder of small
pictures, and a DICOM series of nine slices.
"""
import pathlib
import sys

import numpy as np
import tifffile
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.uid import ExplicitVRLittleEndian

out = pathlib.Path(sys.argv[1])
rng = np.random.default_rng(3)


def write(name, voxels, **how):
    tifffile.imwrite(out / name, voxels, photometric="minisblack", metadata=None, **how)


volume = rng.integers(0, 60000, size=(40, 300, 300)).astype("u2")
large = rng.integers(0, 60000, size=(10, 1200, 1200)).astype("u2")
write("strips.tif", volume, compression="zstd", rowsperstrip=32)
write("whole.tif", volume, compression="zstd", rowsperstrip=300)
write("large.tif", large, compression="zstd", rowsperstrip=1200)
write("tiles.tif", large, compression="zstd", tile=(256, 256))
for folder in ["zstd", "small", "dicom"]:
    (out / folder).mkdir()
for z in range(9):
    write(f"zstd/{z}.tif", volume[z], compression="zstd")
    write(f"small/{z}.tif", volume[z, :40, :50])
    meta = FileMetaDataset()
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.2"
    meta.MediaStorageSOPInstanceUID = f"1.2.3.{z + 1}"
    slice = Dataset()
    slice.file_meta = meta
    slice.SeriesInstanceUID = "1.2.3"
    slice.InstanceNumber = z + 1
    slice.Rows = slice.Columns = 32
    slice.PixelSpacing = [1, 1]
    slice.ImagePositionPatient = [0, 0, z]
    slice.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
    slice.SamplesPerPixel = 1
    slice.PhotometricInterpretation = "MONOCHROME2"
    slice.BitsAllocated = slice.BitsStored = 16
    slice.HighBit = 15
    slice.PixelRepresentation = 0
    slice.PixelData = volume[z, :32, :32].tobytes()
    slice["PixelData"].VR = "OW"
    slice.save_as(out / f"dicom/{z}.dcm", enforce_file_format=True)
