"""kills.py OCTAVO RAW KILLS: a conversion killed at random moments, by SIGKILL, and gone on with.

Every conversion that is gone on with must end with the digest of an undisturbed one, and redo at most 256 MB of the
source. With `--effort fast` and no uniform bricks all payloads have one length, so that the length of OUT.partial says
how many bricks were written before the kill; `resumed_bricks` of the report says how many of them counted.
"""
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time

octavo, raw, kills = sys.argv[1], sys.argv[2], int(sys.argv[3])
PAYLOAD, CORE_BYTES, FIRST_PAGE = 36**3, 2 * 32**3, 4096
MOST_REDONE = 256_000_000
random.seed(20)


def command(store):
    return [octavo, "convert", raw, "-o", store, "--resume", "--effort", "fast", "--json"]


def finish(store):
    done = subprocess.run(command(store), capture_output=True, text=True)
    assert done.returncode == 0, (done.stderr, os.listdir(os.path.dirname(store)))
    os.remove(store)
    return json.loads(done.stdout)


with tempfile.TemporaryDirectory(dir=os.path.dirname(os.path.abspath(raw))) as folder:
    store = os.path.join(folder, "a.octavo")
    whole = finish(store)
    started = time.monotonic()
    assert finish(store)["digest"] == whole["digest"]
    took = time.monotonic() - started
    bricks = sum(level["stored"] for level in whole["levels"])
    assert whole["payload_bytes"] == bricks * PAYLOAD, "every brick is stored as it is"
    done, most_redone, resumed = 0, 0, 0
    while done < kills:
        written = None
        # One kill, or several before anything is finished.
        for _ in range(random.choice([1, 1, 2, 3])):
            child = subprocess.Popen(command(store), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            time.sleep(random.random() * took)
            child.send_signal(signal.SIGKILL)
            if child.wait() != -signal.SIGKILL:
                break
            done += 1
            partial = store + ".partial"
            written = (os.path.getsize(partial) - FIRST_PAGE) // PAYLOAD if os.path.exists(partial) else 0
        if os.path.exists(store):
            os.remove(store)
            continue
        report = finish(store)
        assert report["digest"] == whole["digest"], (report["digest"], whole["digest"])
        redone = (max(written, 0) - report["resumed_bricks"]) * CORE_BYTES
        assert redone <= MOST_REDONE, f"{redone} bytes of the source were redone"
        assert sorted(os.listdir(folder)) == [], os.listdir(folder)
        most_redone, resumed = max(most_redone, redone), resumed + (report["resumed_bricks"] > 0)
    assert resumed > 0
    print(f"{done} kills of a conversion of {os.path.getsize(raw) / 1e6:.0f} MB, {resumed} gone on with from what was "
          f"durable, one digest, at most {most_redone / 1e6:.0f} MB of the source redone")
