"""serve_hours.py OCTAVO FOLDER SECONDS: a server under mixed load, with stores replaced, added and removed beneath it.

FOLDER gets the stores (150 MB). Two stores of the same shape stay; a third is replaced by one or the other every two
seconds, by the copy and rename that `convert --force` ends with, and a fourth comes and goes. Clients read chunks of
every format, bricks, many bricks, cuts, slices, records, pages and pictures, ask conditionally, leave in the middle of
answers, and send nonsense. Every answer must be one of the two that are right; of a stream, all of it. Memory, handles,
threads and a probe's latency are written down every ten seconds, and the last fifth must not exceed the second.

Needs numpy and aiohttp.
"""
import asyncio
import hashlib
import json
import os
import random
import shutil
import statistics
import struct
import subprocess
import sys
import time

import aiohttp
import numpy as np

octavo, folder, seconds = sys.argv[1], os.path.abspath(sys.argv[2]), float(sys.argv[3])
DIMS = (150, 130, 140)  # x, y, z
KINDS = ["a", "b"]
random.seed(11)


def make_stores():
    os.makedirs(os.path.join(folder, "served"), exist_ok=True)
    noise = np.random.default_rng(5)
    for kind in KINDS:
        z, y, x = np.meshgrid(*(np.arange(n, dtype=np.float32) for n in DIMS[::-1]), indexing="ij")
        ball = 20000 * np.exp(-((x - 75) ** 2 + (y - 65) ** 2 + (z - 70) ** 2) / 3000)
        values = ball + noise.integers(0, 4000, DIMS[::-1]) + (500 if kind == "b" else 0)
        raw = os.path.join(folder, f"{kind}_{DIMS[0]}x{DIMS[1]}x{DIMS[2]}_u16.raw")
        values.astype("<u2").tofile(raw)
        subprocess.run([octavo, "convert", raw, "-o", served(kind), "--force", "--encoding", "lossless", "--spacing", "1,1,1", "--json"],
                       check=True, capture_output=True)
        os.remove(raw)


def served(name):
    return os.path.join(folder, "served", f"{name}.octavo")


def put(kind, name):
    """As `convert --force` does: whole under another name, then renamed."""
    other = os.path.join(folder, "coming")
    shutil.copyfile(served(kind), other)
    os.replace(other, served(name))


def addresses():
    """Of GET requests, with D for the dataset."""
    core = 32
    found = []
    for level in range(3):
        grid = [-(-(-(-n // 2**level)) // core) for n in DIMS]
        for bz in range(grid[2]):
            for by in range(grid[1]):
                for bx in range(grid[0]):
                    found += [f"/zarr2/D/{level}/{bz}/{by}/{bx}", f"/zarr3/D/{level}/c/{bz}/{by}/{bx}",
                              f"/zarr3-5d/D/{level}/c/0/0/{bz}/{by}/{bx}", f"/zarr2-codes/D/{level}/codes/{bz}/{by}/{bx}"]
                    found += [f"/v1/D/bricks/{level}/{bx}/{by}/{bz}?form={form}" for form in ("samples", "stored", "codes")]
        found += [f"/v1/D/nodes?level={level}", f"/v1/D/nodes?level={level}&format=json", f"/zarr2/D/{level}/.zarray"]
        found += [f"/v1/D/slices/{axis}/{n >> level >> 1}?level={level}" for axis, n in zip("xyz", DIMS)]
    return found + ["/zarr2/D/.zattrs", "/zarr3/D/zarr.json"]


CAMERA = {"projection": "perspective", "position": [75, 65, -200], "target": [75, 65, 70], "up": [0, -1, 0], "fov_y_deg": 40}
POSTS = [
    ("/v1/D/bricks?form=samples", {"keys": [[0, x, y, 1] for x in range(5) for y in range(4)] + [[9, 9, 9, 9]]}),
    ("/v1/D/bricks?form=stored", {"keys": [[1, x, y, 0] for x in range(3) for y in range(3)]}),
    ("/v1/D/cut", {"cameras": [CAMERA], "size": [640, 360], "accuracy": 1}),
    ("/v1/D/cut", {"cameras": [CAMERA], "size": [320, 180], "accuracy": 4, "form": "codes"}),
]


def settled(path, body, name):
    """What of an answer does not depend on the dataset's name, which documents have in them."""
    if path.endswith((".zattrs", ".json")):
        body = body.replace(f'"{name}"'.encode(), b'"D"')
    return hashlib.blake2b(body, digest_size=16).digest()


class Counts(dict):
    def add(self, what, by=1):
        self[what] = self.get(what, 0) + by


async def main():
    make_stores()
    put("a", "now")
    log = open(os.path.join(folder, "server.log"), "w")
    server = subprocess.Popen([octavo, "serve", os.path.join(folder, "served"), "--bind", "127.0.0.1:0", "--rescan", "0.5", "--cache", "64MiB"],
                              stdout=subprocess.PIPE, stderr=log, text=True)
    base = server.stdout.readline().strip().rstrip("/")
    counts, windows, waits = Counts(), [], []
    session = aiohttp.ClientSession(auto_decompress=True, timeout=aiohttp.ClientTimeout(total=60), connector=aiohttp.TCPConnector(limit=64))
    gets = addresses()
    right = {}
    for kind in KINDS:
        for path in gets:
            async with session.get(base + path.replace("D", kind, 1)) as answer:
                assert answer.status == 200, (path, answer.status)
                right.setdefault(path, set()).add(settled(path, await answer.read(), kind))
        for number, (path, asked) in enumerate(POSTS):
            async with session.post(base + path.replace("D", kind, 1), json=asked) as answer:
                assert answer.status == 200, (path, answer.status)
                right.setdefault(number, set()).add(settled(path, await answer.read(), kind))
    assert sum(len(of) == 2 for of in right.values()) > len(right) // 2, "the two stores give the same answers"
    end = time.monotonic() + seconds
    begun = time.monotonic()

    def running():
        return time.monotonic() < end

    def gone(status):
        """A store that was just replaced, or is away: it is said, and worth another try."""
        counts.add(f"status {status}")
        return status in (404, 503)

    async def reader(seed):
        chance = random.Random(seed)
        tags = {}
        while running():
            await asyncio.sleep(chance.expovariate(20))
            path = chance.choice(gets)
            name = chance.choice(["now", "now", "now", "a", "b", "guest"])
            at = path.replace("D", name, 1)
            headers = {"if-none-match": tags[at]} if at in tags and chance.random() < 0.7 else {}
            try:
                async with session.get(base + at, headers=headers) as answer:
                    if chance.random() < 0.02:
                        counts.add("left in the middle")
                        answer.close()
                        continue
                    body = await answer.read()
                    if answer.status == 304:
                        counts.add("not modified")
                    elif answer.status == 200:
                        counts.add("right")
                        assert settled(path, body, name) in right[path], f"{at}: an answer that neither store gives"
                        tags[at] = answer.headers["etag"]
                    else:
                        assert gone(answer.status), (at, answer.status, body[:200])
                        assert name in ("now", "guest") , (at, answer.status)
            except (aiohttp.ClientPayloadError, aiohttp.ServerDisconnectedError) as error:
                counts.add(f"cut off: {type(error).__name__}")

    async def asker(seed):
        chance = random.Random(seed)
        while running():
            await asyncio.sleep(chance.expovariate(4))
            number = chance.randrange(len(POSTS))
            path, asked = POSTS[number]
            name = chance.choice(["now", "now", "a", "b"])
            try:
                async with session.post(base + path.replace("D", name, 1), json=asked) as answer:
                    if chance.random() < 0.1:
                        await answer.content.read(1000)
                        counts.add("left in the middle")
                        answer.close()
                        continue
                    body = await answer.read()
                    if answer.status != 200:
                        assert gone(answer.status) and name == "now", (path, answer.status, body[:200])
                    elif settled(path, body, name) in right[number]:
                        counts.add("right")
                    else:
                        # A stream that was under way as its store went away says so, frame by frame.
                        assert name == "now" and told(body), f"{path}: a stream that neither store gives"
                        counts.add("streams with bricks said to be unreadable")
            except (aiohttp.ClientPayloadError, aiohttp.ServerDisconnectedError) as error:
                counts.add(f"cut off: {type(error).__name__}")

    def told(body):
        magic, version, frames = struct.unpack_from("<4sIQ", body)
        at, damaged = 16, 0
        for _ in range(frames):
            _, kind, _, _, length = struct.unpack_from("<QBBHI", body, at)
            at += 32 + length
            damaged += kind == 5
        return magic == b"OCTF" and at == len(body) and damaged > 0

    async def painter():
        while running():
            await asyncio.sleep(5)
            async with session.post(f"{base}/v1/now/render", json={"camera": CAMERA, "size": [96, 64], "accuracy": 4, "seconds": 2}) as answer:
                body = await answer.read()
                if answer.status == 200:
                    assert body.startswith(b"\x89PNG")
                    counts.add("pictures")
                else:
                    assert gone(answer.status) or answer.status == 501, (answer.status, body[:200])

    async def nonsense():
        chance = random.Random(99)
        host, port = base.removeprefix("http://").split(":")
        while running():
            await asyncio.sleep(0.5)
            try:
                receive, send = await asyncio.open_connection(host, int(port))
                send.write(chance.choice([
                    chance.randbytes(200) + b"\r\n\r\n",
                    b"POST /v1/now/cut HTTP/1.1\r\nhost: a\r\ncontent-length: 10000000000\r\n\r\n{",
                    b"GET /v1/" + b"a" * 20000 + b" HTTP/1.1\r\nhost: a\r\n\r\n",
                    b"POST /v1/now/bricks HTTP/1.1\r\nhost: a\r\ncontent-length: 12\r\n\r\n{\"keys\":[[}]",
                    b"GET / HTTP/1.1\r\n",
                ]))
                await send.drain()
                await asyncio.wait_for(receive.read(1000), 2)
                send.close()
            except (asyncio.TimeoutError, ConnectionError):
                pass
            counts.add("nonsense")

    async def replacer():
        turn = 0
        while running():
            await asyncio.sleep(2)
            turn += 1
            put(KINDS[turn % 2], "now")
            counts.add("stores replaced")
            if turn % 5 == 0:
                if os.path.exists(served("guest")):
                    os.remove(served("guest"))
                else:
                    put("a", "guest")
                counts.add("stores that came or went")

    async def probe():
        """How long a small answer takes, beside all the rest, on a connection of its own."""
        async with aiohttp.ClientSession() as own:
            while running():
                await asyncio.sleep(0.1)
                asked = time.perf_counter()
                async with own.get(f"{base}/zarr2/a/1/0/0/0") as answer:
                    await answer.read()
                    assert answer.status == 200
                waits.append(time.perf_counter() - asked)

    async def watcher():
        while running():
            await asyncio.sleep(10)
            with open(f"/proc/{server.pid}/status") as status:
                fields = dict(line.split(":", 1) for line in status)
            own, waits[:] = sorted(waits), []
            windows.append({
                "seconds": round(time.monotonic() - begun),
                "resident_mib": int(fields["VmRSS"].split()[0]) / 1024,
                "threads": int(fields["Threads"]),
                "handles": len(os.listdir(f"/proc/{server.pid}/fd")),
                "p50_ms": 1e3 * statistics.median(own),
                "p99_ms": 1e3 * own[int(len(own) * 0.99)],
            })
            with open(os.path.join(folder, "windows.jsonl"), "a") as file:
                print(json.dumps(windows[-1]), file=file)

    tasks = [reader(seed) for seed in range(12)] + [asker(seed) for seed in range(100, 103)] + [painter(), nonsense(), replacer(), probe(), watcher()]
    await asyncio.gather(*tasks)
    await session.close()
    server.terminate()
    assert server.wait(30) == 0, "it did not end cleanly"
    fifth = max(1, len(windows) // 5)
    early, late = windows[fifth:2 * fifth] or windows, windows[-fifth:]

    def median(of, field):
        return statistics.median(window[field] for window in of)

    print(f"{seconds / 3600:.2f} hours served: " + ", ".join(f"{n} {what}" for what, n in sorted(counts.items())))
    for field, may_grow in [("resident_mib", 1.1), ("handles", 1.25), ("threads", 1.25), ("p50_ms", 1.5), ("p99_ms", 2)]:
        before, after = median(early, field), median(late, field)
        print(f"{field}: median {before:.1f} in the second fifth, {after:.1f} in the last; most {max(window[field] for window in windows):.1f}")
        assert after <= before * may_grow, field
    print("1 passed, 0 failed")


asyncio.run(main())
