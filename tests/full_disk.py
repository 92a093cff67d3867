"""full_disk.py OCTAVO RAW SIZES: a conversion onto disks that are too small, SIZES of them (root mounts a tmpfs).

Each must end with exit code 3 and a message that says what to do, leave nothing under the store's name, and go on
with --resume once there is room, to the same digest.
"""
import json
import os
import subprocess
import sys
import tempfile

octavo, raw, sizes = sys.argv[1], os.path.abspath(sys.argv[2]), int(sys.argv[3])


def convert(store, *more):
    command = [octavo, "convert", raw, "-o", store, "--effort", "fast", "--json", *more]
    return subprocess.run(command, capture_output=True, text=True)


with tempfile.TemporaryDirectory() as folder:
    store = os.path.join(folder, "a.octavo")
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4G", "octavo-full", folder], check=True)
    try:
        whole = json.loads(convert(store).stdout)
        peak = whole["file_bytes"]
        os.remove(store)
        ended, resumed, said = 0, 0, set()
        for step in range(sizes):
            # From next to nothing to nearly all of it.
            room = max(64 << 10, peak * (step + 1) // (sizes + 1)) // 4096 * 4096
            subprocess.run(["mount", "-o", f"remount,size={room}", folder], check=True)
            done = convert(store)
            assert done.returncode == 3, (room, done.returncode, done.stderr)
            assert "free" in done.stderr, done.stderr
            assert not os.path.exists(store), os.listdir(folder)
            ended += 1
            said.add(done.stderr.strip().rsplit(folder, 1)[-1])
            left = sorted(os.listdir(folder))
            for name in left:
                opened = subprocess.run([octavo, "info", os.path.join(folder, name)], capture_output=True)
                assert opened.returncode == 2, name
            subprocess.run(["mount", "-o", "remount,size=4G", folder], check=True)
            done = convert(store, "--resume")
            assert done.returncode == 0, (room, done.stderr)
            done = json.loads(done.stdout)
            assert done["digest"] == whole["digest"]
            resumed += done["resumed_bricks"] > 0
            assert bool(left) == (done["resumed_bricks"] > 0), (left, done["resumed_bricks"])
            assert subprocess.run([octavo, "verify", store], capture_output=True).returncode == 0
            os.remove(store)
            assert os.listdir(folder) == [], os.listdir(folder)
        assert resumed > 0
        print(f"{ended} disks too small for {peak / 1e6:.0f} MB, each said so; {resumed} conversions gone on with "
              f"when there was room, the others begun anew; one digest")
        for message in sorted(said):
            print("  ", message)
    finally:
        subprocess.run(["umount", folder], check=True)
