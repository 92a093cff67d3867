"""make_headers.py FOLDER: writes NRRD, MetaImage and DICOM volumes of every form, with pynrrd, SimpleITK and pydicom.

`FOLDER/list.txt` names them: `NAME|FLAGS OF CONVERT|OPTIONS OF same_as_header.py`, one a line.
"""
import os
import sys

import nrrd
import numpy as np
import pydicom
import pydicom.encaps
import SimpleITK as sitk
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.sequence import Sequence
from pydicom.uid import ExplicitVRBigEndian, ExplicitVRLittleEndian, ImplicitVRLittleEndian, RLELossless, generate_uid

folder = sys.argv[1]
rng = np.random.default_rng(11)
listed = []


def path(name):
    return os.path.join(folder, name)


def add(name, flags="", options=""):
    listed.append(f"{name}|{flags}|{options}")


# ---- NRRD

LPS = {
    "space": "left-posterior-superior",
    "space directions": np.array([[0.0, 0.5, 0.1], [-0.75, 0.0, 0.0], [0.0, 0.3, 2.5]]),
    "space origin": np.array([-12.5, 40.0, 7.25]),
}
TYPES = ["int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"]


def numbers(dtype, shape):
    if np.issubdtype(dtype, np.floating):
        return rng.normal(size=shape).astype(dtype)
    info = np.iinfo(dtype)
    return rng.integers(info.min, info.max, size=shape, dtype=dtype, endpoint=True)


for dtype in TYPES:
    voxels = numbers(np.dtype(dtype), (7, 6, 5))
    for encoding in ["raw", "gzip", "bzip2", "ascii"]:
        name = f"{dtype}-{encoding}.nrrd"
        nrrd.write(path(name), voxels, {**LPS, "encoding": encoding})
        # ITK's NRRD knows no bzip2.
        add(name, "", "reader=pynrrd" if encoding in ("bzip2", "ascii") else "")

voxels = numbers(np.dtype("int16"), (7, 6, 5))
nrrd.write(path("big.nrrd"), voxels.astype(">i2"), {**LPS, "encoding": "gzip", "endian": "big"})
add("big.nrrd")
ras = {**LPS, "space": "right-anterior-superior"}
nrrd.write(path("ras.nrrd"), voxels, {**ras, "encoding": "raw"})
add("ras.nrrd")
add("ras.nrrd", "", "reader=pynrrd")
nrrd.write(path("spacings.nrrd"), voxels, {"spacings": [0.5, 0.75, 2.0], "encoding": "gzip"})
add("spacings.nrrd", "", "affine=no")
nrrd.write(path("flat.nrrd"), voxels[:, :, 0], {"spacings": [0.5, 0.75], "encoding": "raw"})
add("flat.nrrd", "", "affine=no reader=pynrrd")
nrrd.write(path("detached.nhdr"), voxels, {**LPS, "encoding": "gzip"}, detached_header=True)
add("detached.nhdr")
nrrd.write(path("detached-raw.nhdr"), voxels, {**LPS, "encoding": "raw"}, detached_header=True)
add("detached-raw.nhdr")

series = numbers(np.dtype("uint16"), (7, 6, 5, 3))
directions = np.vstack([LPS["space directions"], [[np.nan] * 3]])
for kind, flag in [("list", "channel"), ("time", "time")]:
    kinds = ["domain", "domain", "domain", kind]
    for encoding in ["raw", "gzip"]:
        name = f"{kind}-last-{encoding}.nrrd"
        header = {**LPS, "space directions": directions, "kinds": kinds, "encoding": encoding}
        nrrd.write(path(name), series, header)
        add(name, f"--{flag} 2", f"{flag}=2 reader=pynrrd")
    name = f"{kind}-first.nrrd"
    for encoding in ["raw", "gzip", "bzip2", "ascii"]:
        name = f"{kind}-first-{encoding}.nrrd"
        header = {**LPS, "space directions": directions[[3, 0, 1, 2]], "kinds": kinds[3:] + kinds[:3], "encoding": encoding}
        nrrd.write(path(name), np.moveaxis(series, 3, 0).copy(), header)
        add(name, f"--{flag} 1", f"{flag}=1 reader=pynrrd")

# Files of several slices, by hand; the same voxels as in one file are what they must give.
nrrd.write(path("whole.nrrd"), voxels, {**LPS, "encoding": "raw"})
head = open(path("whole.nrrd"), "rb").read().split(b"\n\n")[0].decode()
for z in range(5):
    voxels[:, :, z].T.astype("<i2").tofile(path(f"slice{z + 3:02d}.bin"))
    with open(path(f"skip{z + 3:02d}.bin"), "wb") as f:
        f.write(b"a line\nanother\n1234567" + voxels[:, :, z].T.astype("<i2").tobytes())
import gzip

for z in range(5):
    with open(path(f"slice{z + 3:02d}.gz"), "wb") as f:
        f.write(gzip.compress(voxels[:, :, z].T.astype("<i2").tobytes()))
forms = {
    "pattern.nhdr": "data file: slice%02d.bin 3 7 1\n",
    "pattern-subdim.nhdr": "data file: slice%02d.bin 3 7 1 2\n",
    "pattern-skip.nhdr": "line skip: 2\nbyte skip: 7\ndata file: skip%02d.bin 3 7 1\n",
    "list-skip-end.nhdr": "byte skip: -1\ndata file: LIST\n" + "".join(f"skip{z:02d}.bin\n" for z in range(3, 8)),
    "list.nhdr": "data file: LIST 2\n" + "".join(f"slice{z:02d}.bin\n" for z in range(3, 8)),
}
for name, lines in forms.items():
    open(path(name), "w").write(head + "\n" + lines)
    add(name, "", "as=whole.nrrd reader=pynrrd")
open(path("pattern-gzip.nhdr"), "w").write(head.replace("encoding: raw", "encoding: gzip") + "\ndata file: slice%02d.gz 3 7 1\n")
add("pattern-gzip.nhdr", "", "as=whole.nrrd reader=pynrrd")
open(path("windows.nhdr"), "w", newline="").write((head + "\ndata file: LIST\n" + "\n".join(f"slice{z:02d}.bin" for z in range(3, 8))).replace("\n", "\r\n"))
add("windows.nhdr", "", "as=whole.nrrd reader=pynrrd")

# ---- MetaImage


def image(voxels_xyz, **kwargs):
    img = sitk.GetImageFromArray(np.ascontiguousarray(voxels_xyz.T), **kwargs)
    n = img.GetDimension()
    img.SetSpacing([0.5, 0.75, 2.5, 1.0][:n])
    img.SetOrigin([-12.5, 40.0, 7.25, 0.0][:n])
    if n == 3:
        a, b = 0.3, -0.7
        rz = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
        rx = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
        img.SetDirection((rz @ rx).ravel().tolist())
    return img


for dtype in TYPES:
    voxels = numbers(np.dtype(dtype), (7, 6, 5))
    for compress in [False, True]:
        for end in ["mha", "mhd"]:
            name = f"{dtype}-{'zlib' if compress else 'raw'}.{end}"
            sitk.WriteImage(image(voxels), path(name), useCompression=compress)
            add(name)
sitk.WriteImage(image(voxels[:, :, 0]), path("flat.mha"))
add("flat.mha")
meta_series = numbers(np.dtype("int16"), (7, 6, 5, 3))
for compress in [False, True]:
    name = f"series-{compress}.mha"
    img = sitk.JoinSeries([image(meta_series[..., t]) for t in range(3)])
    sitk.WriteImage(img, path(name), useCompression=compress)
    add(name, "--time 2", "time=2")
    name = f"channels-{compress}.mha"
    img = sitk.Compose([image(meta_series[..., t]) for t in range(3)])
    sitk.WriteImage(img, path(name), useCompression=compress)
    add(name, "--channel 1", "channel=1")
voxels = numbers(np.dtype("int16"), (7, 6, 5))
sitk.WriteImage(image(voxels), path("forms.mhd"))
head = open(path("forms.mhd")).read().split("ElementDataFile")[0]
for z in range(5):
    voxels[:, :, z].T.astype("<i2").tofile(path(f"m{z + 1:03d}.raw"))
    voxels[:, :, z].T.astype(">i2").tofile(path(f"b{z + 1:03d}.raw"))
    with open(path(f"h{z + 1:03d}.raw"), "wb") as f:
        f.write(b"0123456789" + voxels[:, :, z].T.astype("<i2").tobytes())
forms = {
    "pattern.mhd": "ElementDataFile = m%03d.raw 1 5 1\n",
    "list.mhd": "ElementDataFile = LIST\n" + "".join(f"m{z:03d}.raw\n" for z in range(1, 6)),
    "skip.mhd": "HeaderSize = 10\nElementDataFile = h%03d.raw 1 5 1\n",
    "skip-end.mhd": "HeaderSize = -1\nElementDataFile = h%03d.raw 1 5 1\n",
}
for name, lines in forms.items():
    open(path(name), "w").write(head + lines)
    add(name, "", "as=forms.mhd")
    if name in ("pattern.mhd", "list.mhd"):
        add(name)
msb = head.replace("BinaryDataByteOrderMSB = False", "BinaryDataByteOrderMSB = True")
assert msb != head
open(path("msb.mhd"), "w").write(msb + "ElementDataFile = b%03d.raw 1 5 1\n")
add("msb.mhd", "", "as=forms.mhd")
text = head.replace("BinaryData = True", "BinaryData = False")
open(path("text.mha"), "w").write(text + "ElementDataFile = LOCAL\n" + " ".join(map(str, voxels.T.ravel())) + "\n")
add("text.mha", "", "as=forms.mhd")

# ---- DICOM

A, B = 0.2, -0.4
ROW = np.array([np.cos(A), np.sin(A), 0.0])
COLUMN = np.array([-np.sin(A) * np.cos(B), np.cos(A) * np.cos(B), np.sin(B)])
NORMAL = np.cross(ROW, COLUMN)


def data_set(syntax, values, bits, signed, **more):
    ds = Dataset()
    ds.file_meta = FileMetaDataset()
    ds.file_meta.TransferSyntaxUID = syntax
    ds.file_meta.MediaStorageSOPClassUID = ds.SOPClassUID = "1.2.840.10008.5.1.4.1.1.2"
    ds.file_meta.MediaStorageSOPInstanceUID = ds.SOPInstanceUID = generate_uid()
    ds.Modality = "CT"
    ds.StudyInstanceUID = more.pop("study", "1.2.3.4")
    ds.SeriesInstanceUID = more.pop("series", "1.2.3.4.5")
    ds.Rows, ds.Columns = values.shape[-2:]
    ds.SamplesPerPixel = 1
    ds.PhotometricInterpretation = more.pop("photometric", "MONOCHROME2")
    ds.BitsAllocated = values.dtype.itemsize * 8
    ds.BitsStored, ds.HighBit = bits, bits - 1
    ds.PixelRepresentation = int(signed)
    # A private sequence and one of undefined length must be passed over.
    item = Dataset()
    item.CodeValue = "x"
    ds.ConceptNameCodeSequence = Sequence([item])
    ds["ConceptNameCodeSequence"].is_undefined_length = True
    for key, value in more.items():
        setattr(ds, key, value)
    order = ">" if syntax == ExplicitVRBigEndian else "<"
    data = values.astype(values.dtype.newbyteorder(order)).tobytes()
    ds.PixelData = data + b"\0" * (len(data) % 2)
    ds["PixelData"].VR = "OW"
    return ds


def save(ds, name):
    syntax = ds.file_meta.TransferSyntaxUID
    # Implicit where the syntax says so.
    pydicom.dcmwrite(path(name), ds, enforce_file_format=True)


def place(z, distance=1.5):
    position = np.array([-12.5, 40.0, 7.25]) + z * distance * NORMAL
    return {
        "ImagePositionPatient": [f"{v:.10g}" for v in position],
        "ImageOrientationPatient": [f"{v:.10g}" for v in [*ROW, *COLUMN]],
        "PixelSpacing": ["0.75", "0.5"],
        "SliceThickness": "1.5",
    }


def series_of(name, dtype, bits, signed, syntax=ExplicitVRLittleEndian, rescale=None, change=None, **more):
    os.makedirs(path(name))
    low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1)) if signed else (0, 2**bits)
    values = rng.integers(low, high, size=(6, 9, 8)).astype(dtype)
    order = rng.permutation(6)
    for number, z in enumerate(order):
        ds = data_set(syntax, values[z], bits, signed, InstanceNumber=number + 1, **place(z), **more)
        if rescale:
            ds.RescaleSlope, ds.RescaleIntercept = rescale(z)
        if change:
            change(ds)
        save(ds, f"{name}/f{number}.dcm")
    return values


def compressed(uid):
    return lambda ds: ds.compress(uid)


for name, dtype, bits, signed, syntax in [
    ("u8", "u1", 8, False, ExplicitVRLittleEndian),
    ("u16", "u2", 16, False, ExplicitVRLittleEndian),
    ("i16", "i2", 16, True, ImplicitVRLittleEndian),
    ("u12", "u2", 12, False, ImplicitVRLittleEndian),
    ("i12", "i2", 12, True, ExplicitVRLittleEndian),
    ("i16-big", "i2", 16, True, ExplicitVRBigEndian),
]:
    series_of(f"dicom-{name}", dtype, bits, signed, syntax)
    add(f"dicom-{name}", "", "type=any")
series_of("dicom-rle", "u2", 16, False, change=compressed(RLELossless))
add("dicom-rle", "", "type=any slices=pydicom")
series_of("dicom-rle8", "u1", 8, False, change=compressed(RLELossless))
add("dicom-rle8", "", "type=any slices=pydicom")
series_of("dicom-ct", "u2", 12, False, rescale=lambda z: ("1", "-1024"))
add("dicom-ct", "", "type=any")
series_of("dicom-slope", "i2", 16, True, rescale=lambda z: ("0.5", "3"))
add("dicom-slope", "", "type=any")
series_of("dicom-pet", "u2", 16, False, rescale=lambda z: (f"{0.25 * (z + 1)}", "0"))
add("dicom-pet", "", "type=any slices=pydicom")
series_of("dicom-mono1", "u2", 12, False, photometric="MONOCHROME1")
add("dicom-mono1", "", "type=any slices=pydicom")

# A study as archives write it: series in folders below, and a file that lists them.
series_of("dicom-study/ST1/SE1", "u2", 16, False, series="1.2.3.4.1", SeriesDescription="scout")
series_of("dicom-study/ST1/SE2", "u2", 16, False, series="1.2.3.4.2")
open(path("dicom-study/DICOMDIR"), "wb").write(b"\0" * 128 + b"DICM")
add("dicom-study", "--series 1.2.3.4.2", "type=any as=dicom-study/ST1/SE2")
series_of("dicom-below/A/B", "i2", 16, True)
add("dicom-below", "", "type=any as=dicom-below/A/B")
# Two series in one folder.
series_of("dicom-both", "u2", 16, False, series="1.2.3.4.1")
series_of("dicom-second", "u2", 16, False, series="1.2.3.4.2")
for name in os.listdir(path("dicom-second")):
    os.link(path(f"dicom-second/{name}"), path(f"dicom-both/second-{name}"))
add("dicom-both", "--series 1.2.3.4.2", "type=any as=dicom-second")
# Transfer syntaxes that are not read.
for name, syntax in [("jpeg-ls", "1.2.840.10008.1.2.4.80"), ("jpeg-2000", "1.2.840.10008.1.2.4.90")]:
    ds = data_set(ExplicitVRLittleEndian, np.zeros((8, 8), "u2"), 16, False, InstanceNumber=1, **place(0))
    ds.file_meta.TransferSyntaxUID = syntax
    ds.PixelData = pydicom.encaps.encapsulate([b"\0" * 64])
    ds["PixelData"].is_undefined_length = True
    ds["PixelData"].VR = "OB"
    save(ds, f"refused-{name}.dcm")

# Lossless JPEG, by ITK's own writer.
os.mkdir(path("dicom-jpeg"))
values = rng.integers(0, 4096, size=(4, 9, 8)).astype(np.int16)
values[2] = np.linspace(0, 4000, 72).reshape(9, 8)
for z in range(4):
    img = sitk.GetImageFromArray(values[z : z + 1])
    img.SetSpacing([0.5, 0.75, 1.5])
    position = "\\".join(f"{v:.10g}" for v in [1.0, 2.0, 3.0 + 1.5 * z])
    for key, value in {
        "0008|0016": "1.2.840.10008.5.1.4.1.1.2",
        "0020|000d": "1.2.3", "0020|000e": "1.2.3.9", "0020|0013": str(z), "0020|0032": position,
        "0020|0037": "1\\0\\0\\0\\1\\0", "0008|0060": "CT", "0028|0030": "0.75\\0.5",
    }.items():
        img.SetMetaData(key, value)
    writer = sitk.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    writer.SetFileName(path(f"dicom-jpeg/{z}.dcm"))
    writer.UseCompressionOn()
    writer.SetCompressor("JPEG")
    writer.Execute(img)
assert pydicom.dcmread(path("dicom-jpeg/0.dcm")).file_meta.TransferSyntaxUID == "1.2.840.10008.1.2.4.70"
add("dicom-jpeg", "", "type=any")

# Several frames in one file, each with a place of its own, out of order.
for syntax, end in [(ExplicitVRLittleEndian, ""), (ImplicitVRLittleEndian, "-implicit"), (RLELossless, "-rle")]:
    values = rng.integers(0, 4096, size=(6, 9, 8)).astype("u2")
    native = ExplicitVRLittleEndian if syntax == RLELossless else syntax
    ds = data_set(native, values, 12, False, NumberOfFrames=6)
    ds.file_meta.MediaStorageSOPClassUID = ds.SOPClassUID = "1.2.840.10008.5.1.4.1.1.2.1"
    shared = Dataset()
    measures = Dataset()
    measures.PixelSpacing, measures.SliceThickness = ["0.75", "0.5"], "1.5"
    shared.PixelMeasuresSequence = Sequence([measures])
    orientation = Dataset()
    orientation.ImageOrientationPatient = place(0)["ImageOrientationPatient"]
    shared.PlaneOrientationSequence = Sequence([orientation])
    transformation = Dataset()
    transformation.RescaleIntercept, transformation.RescaleSlope = "-1000", "1"
    shared.PixelValueTransformationSequence = Sequence([transformation])
    ds.SharedFunctionalGroupsSequence = Sequence([shared])
    frames = []
    for z in [3, 1, 0, 2, 5, 4]:
        frame, position = Dataset(), Dataset()
        position.ImagePositionPatient = place(z)["ImagePositionPatient"]
        frame.PlanePositionSequence = Sequence([position])
        frames.append(frame)
    ds.PerFrameFunctionalGroupsSequence = Sequence(frames)
    if syntax == RLELossless:
        ds.compress(RLELossless)
    save(ds, f"frames{end}.dcm")
    add(f"frames{end}.dcm", "", "type=any frames=3,1,0,2,5,4")

open(path("list.txt"), "w").write("\n".join(listed) + "\n")
