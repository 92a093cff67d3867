"""make_samples.py SOURCES: writes the bundled volumes and MANIFEST.tsv from copies of their origins.

SOURCES holds the origins' files under the paths that the table below names. Needs nibabel, numpy and
tifffile. The result is the same bytes every time: gzip files carry no time and no name.
"""
import gzip
import hashlib
import pathlib
import shutil
import sys

import nibabel as nib
import numpy as np
import tifffile

sources = pathlib.Path(sys.argv[1])
here = pathlib.Path(__file__).parent
rows = []


def row(name, what, dims, sample_type, spacing, origin, licence):
    digest = hashlib.sha256((here / name).read_bytes()).hexdigest()
    rows.append("\t".join([name, what, dims, sample_type, spacing, origin, licence, digest]))


def nifti(name, voxels_xyz, spacing):
    img = nib.Nifti1Image(voxels_xyz, np.diag([*spacing, 1.0]))
    img.header.set_xyzt_units("mm")
    img.set_sform(img.affine, code=1)
    with open(here / name, "wb") as f:
        f.write(gzip.compress(img.to_bytes(), 9, mtime=0))


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
        row(str(target.relative_to(here)), what, "-", "-", "-",
            f"Enet4/nifti-rs resources/{path.relative_to(suite)}", "MIT OR Apache-2.0")

header = "file\twhat\tdims_xyz\tsample_type\tspacing\torigin\tlicence\tsha256"
(here / "MANIFEST.tsv").write_text("\n".join([header, *rows]) + "\n")
