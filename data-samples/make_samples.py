"""make_samples.py SOURCES: writes the bundled volumes and MANIFEST.tsv from copies of their origins.

SOURCES holds the origins' files under the paths that the lines below name. Needs nibabel, numpy and
tifffile. The result is the same bytes every time: gzip files carry no time and no name. (Another zlib
may compress to other bytes; the voxels stay.)
"""
import gzip
import hashlib
import logging
import pathlib
import shutil
import struct
import sys

import nibabel as nib
import numpy as np
import tifffile

sources = pathlib.Path(sys.argv[1])
here = pathlib.Path(__file__).parent
rows = []
# tifffile tells at length what is wrong with damaged files.
logging.disable(logging.CRITICAL)


def row(name, what, dims, sample_type, spacing, origin, licence):
    digest = hashlib.sha256((here / name).read_bytes()).hexdigest()
    rows.append("\t".join([name, what, dims, sample_type, spacing, origin, licence, digest]))


def nifti(name, voxels_xyz, spacing):
    img = nib.Nifti1Image(voxels_xyz, np.diag([*spacing, 1.0]))
    img.header.set_xyzt_units("mm")
    img.set_sform(img.affine, code=1)
    with open(here / name, "wb") as f:
        f.write(gzip.compress(img.to_bytes(), 9, mtime=0))


NIFTI_TYPES = {2: "u8", 4: "i16", 8: "i32", 16: "f32", 32: "complex64", 64: "f64", 128: "rgb24",
               256: "i8", 512: "u16", 768: "u32", 1024: "i64", 1280: "u64", 1792: "complex128",
               2304: "rgba32"}


def described(path):
    """dims, type and spacing as a NIfTI-1 header states them; an image has those of its header."""
    path = path.with_name(path.name.replace(".img", ".hdr"))
    if not path.exists():
        path = path.with_name(path.name.removesuffix(".gz"))
    data = path.read_bytes()
    data = gzip.decompress(data) if path.suffix == ".gz" else data
    order = "<" if struct.unpack("<i", data[:4])[0] == 348 else ">"
    dim = struct.unpack(order + "8h", data[40:56])
    code, = struct.unpack(order + "h", data[70:72])
    pixdim = struct.unpack(order + "8f", data[76:108])
    unit = {1: " m", 2: " mm", 3: " um"}.get(data[123] & 7, "")
    endian = " big-endian" if order == ">" else ""
    return ("x".join(map(str, dim[1:dim[0] + 1])), NIFTI_TYPES[code] + endian,
            " ".join(f"{p:g}" for p in pixdim[1:4]) + unit)


# 103 x 94 x 161 big-endian u16, x fastest.
tooth = np.fromfile(sources / "nrrd/tooth.raw", ">u2").reshape(161, 94, 103).transpose(2, 1, 0)
nifti("tooth.nii.gz", tooth.astype("<u2"), (1, 1, 1))
row("tooth.nii.gz", "CT of a human tooth, a crop", "103x94x161", "u16", "1 1 1 mm",
    "CIBC-Internal/Seg3DData test/small_volumes/tooth.nhdr", "MIT")

bone = tifffile.imread(sources / "tiff/bone_128x128x128.tif").transpose(2, 1, 0)
nifti("bone.nii.gz", bone, (1, 1, 1))
row("bone.nii.gz", "micro-CT of bone", "128x128x128", "u8", "1 1 1 mm (not in the origin)",
    "qim-center/qim3d qim3d/examples/bone_128x128x128.tif", "MIT")

shutil.copyfile(sources / "raw8/bucky_32x32x32_uint8.raw", here / "bucky_32x32x32_u8.raw")
row("bucky_32x32x32_u8.raw", "computed density of a C60 molecule", "32x32x32", "u8", "1 1 1",
    "NVIDIA/cuda-samples Samples/5_Domain_Specific/volumeRender/data/Bucky.raw", "BSD-3-Clause")

shutil.copyfile(sources / "nifti/nibabel/anatomical.nii", here / "anatomical.nii")
row("anatomical.nii", "MRI of a head, big-endian file", *described(here / "anatomical.nii"),
    "nipy/nibabel nibabel/tests/data/anatomical.nii", "MIT")

suite = sources / "nifti/nifti-rs"
for folder, kind, what in [("27", "nifti-suite", "one file a sample type"),
                           ("rgb", "nifti-suite", "colour"), ("rgba", "nifti-suite", "colour"),
                           ("complex", "nifti-suite", "complex numbers"),
                           ("fuzz_artifacts", "damaged", "crashed an older reader"),
                           ("", "nifti-suite", "header and image, together and apart")]:
    for path in sorted((suite / folder).glob("minimal*" if folder == "" else "*")):
        parts = [kind] + ([folder] if kind == "nifti-suite" and folder else []) + [path.name]
        target = here.joinpath(*parts)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, target)
        says = ("-", "-", "-") if kind == "damaged" else described(path)
        row(str(target.relative_to(here)), what, *says,
            f"Enet4/nifti-rs resources/{path.relative_to(suite)}", "MIT OR Apache-2.0")

# The test pictures of the Rust crate tiff: every grey one up to 50 kB, and some of each kind in colour,
# of few bits, of compressions that Octavo refuses, and damaged ones.
suite = sources / "tiff_suite/image-tiff"
REFUSED = ["12bit.cropped", "cmyk-3c-8b", "gradient-1c-64b.", "gradient-3c-32b.", "fax4", "minisblack-1c-3b",
           "minisblack-2c-8b-alpha", "miniswhite-1c-1b", "palette-1c-8b", "random-fp16", "seq-1c-10b-",
           "seq-1c-1b-fax3-71", "seq-1c-24b-072", "seq-1c-8b-palette", "seq-3c-8b-bigendian", "seq-4c-8b-cmyk",
           "quad-tile.jpg", "fuzz_images", "subsubifds"]
for path in sorted(p for p in suite.rglob("*.tif*") if p.stat().st_size < 50_000):
    name = str(path.relative_to(suite))
    says = ("-", "-", "-")
    try:
        with tifffile.TiffFile(path) as tif:
            page = tif.pages[0]
            grey = (int(page.photometric) in (0, 1) and page.samplesperpixel == 1 and page.bitspersample in (8, 16, 32, 64)
                    and page.dtype.name not in ("float16", "uint64") and int(page.compression) not in (2, 3, 4, 7))
            if grey:
                says = (f"{page.imagewidth}x{page.imagelength}x{len(tif.pages)}", page.dtype.name, "-")
    except Exception:
        grey = False
    if not grey and not any(word in name for word in REFUSED):
        continue
    target = here / "tiff-suite" / path.relative_to(suite)
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, target)
    row(str(target.relative_to(here)), "a TIFF picture" if grey else "no grey TIFF picture of whole bytes, or damaged",
        *says, f"image-rs/image-tiff tests/{name}", "MIT")

bone = sources / "tiff_stack/lhdl_bone_200x200x200"
for z in range(96, 104):
    path = bone / f"3155_D_4_bc_{z:04}.tif"
    target = here / "tiff-slices" / path.name
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, target)
    row(str(target.relative_to(here)), "micro-CT of bone, a slice", "200x200x1", "u8", "-",
        f"gianthk/ciclope test_data/LHDL/3155_D_4_bc/cropped/{path.name}", "MIT")

header = "file\twhat\tdims_xyz\tsample_type\tspacing\torigin\tlicence\tsha256"
(here / "MANIFEST.tsv").write_text("\n".join([header, *rows]) + "\n")
