"""What bench/serve.sh asks of a server besides chunks.

    serve_load.py chunks BASE DATASET FOLDER        level 0's chunks as files, and their paths in FOLDER/paths
    serve_load.py connections BASE DATASET PID LUA  memory with 1,000 idle and 256 busy connections
    serve_load.py cut BASE DATASET SIZE             time and bytes of a cut for 1024 x 576 at one voxel a pixel
    serve_load.py packed BASE DATASET FILE          bytes of level 0's chunks over plain ones; their paths into FILE
    serve_load.py read BASE DATASET RUNS            median seconds in which tensorstore reads level 0
"""
import http.client
import itertools
import json
import math
import pathlib
import socket
import statistics
import struct
import subprocess
import sys
import time
from urllib.parse import urlsplit
from urllib.request import urlopen


def chunk_paths(base, dataset):
    array = json.load(urlopen(f"{base}/zarr2/{dataset}/0/.zarray"))
    grid = [-(-n // c) for n, c in zip(array["shape"], array["chunks"])]
    return [f"/zarr2/{dataset}/0/{z}/{y}/{x}" for z, y, x in itertools.product(*map(range, grid))]


def chunks(base, dataset, folder):
    paths = chunk_paths(base, dataset)
    for path in paths:
        file = pathlib.Path(folder + path)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(urlopen(base + path).read())
    pathlib.Path(folder, "paths").write_text("\n".join(paths) + "\n")


def packed(base, dataset, file):
    paths = chunk_paths(base, dataset)
    pathlib.Path(file).write_text("\n".join(paths) + "\n")
    array = json.load(urlopen(f"{base}/zarr2/{dataset}/0/.zarray"))
    plain = len(paths) * int(array["dtype"][2:]) * math.prod(array["chunks"])
    print(f"{sum(len(urlopen(base + path).read()) for path in paths) / plain:.3f}")


def read(base, dataset, runs):
    import tensorstore

    def once():
        spec = {"driver": "zarr3", "kvstore": f"{base}/zarr3/{dataset}/0/"}
        store = tensorstore.open(spec, read=True, open=True).result()
        began = time.perf_counter()
        store.read().result()
        return time.perf_counter() - began

    once()
    print(f"{statistics.median(once() for _ in range(int(runs))):.3f}")


def memory(pid):
    status = pathlib.Path(f"/proc/{pid}/status").read_text()
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS")) / 1024


def cache(base):
    text = urlopen(f"{base}/metrics").read().decode()
    return next(float(line.split()[1]) for line in text.splitlines() if line.startswith("octavo_cache_bytes ")) / 2**20


def connections(base, dataset, pid, script):
    host, port = urlsplit(base).hostname, urlsplit(base).port
    idle = [socket.create_connection((host, port)) for _ in range(1000)]
    for connection in idle:
        connection.sendall(b"GET /healthz HTTP/1.1\r\nhost: a\r\n\r\n")
        connection.recv(4096)
    busy = subprocess.Popen(["wrk", "-t", "1", "-c", "256", "-d", "5s", "-s", script, base], stdout=subprocess.PIPE, text=True)
    peak = 0
    while busy.poll() is None:
        peak = max(peak, memory(pid))
        time.sleep(0.02)
    _, rate, _, _, errors = next(line for line in busy.stdout if line.startswith("RESULT")).split()
    alive = 0
    for connection in idle:
        connection.sendall(b"GET /healthz HTTP/1.1\r\nhost: a\r\n\r\n")
        alive += connection.recv(4096).startswith(b"HTTP/1.1 200")
    print(f"1,000 idle and 256 busy connections: {peak:.0f} MiB resident at most, {cache(base):.0f} MiB of it kept answers; "
          f"{rate} chunks a second, {errors} errors; {alive} of the idle answered afterwards")


def exactly(answer, count):
    data = answer.read(count)
    assert len(data) == count
    return data


def cut(base, dataset, size):
    size = float(size)
    camera = {"projection": "perspective", "position": [size / 2, size / 2, -1.2 * size], "target": [size / 2] * 3, "up": [0, -1, 0], "fov_y_deg": 40}
    host, port = urlsplit(base).hostname, urlsplit(base).port

    def ask(accuracy):
        body = json.dumps({"cameras": [camera], "size": [1024, 576], "accuracy": accuracy, "budget_bricks": 65536})
        client = http.client.HTTPConnection(host, port)
        began = time.perf_counter()
        client.request("POST", f"/v1/{dataset}/cut", body, {"content-type": "application/json"})
        answer = client.getresponse()
        _, _, count = struct.unpack("<4sIQ", exactly(answer, 16))
        total, payload, first = 16, 0, None
        for _ in range(count):
            head = exactly(answer, 32)
            _, kind, _, _, length, _, _ = struct.unpack("<QBBHIdd", head)
            data = exactly(answer, length)
            total += 32 + length
            if kind == 1:
                payload += length - 120
                first = first or time.perf_counter() - began
        return first, time.perf_counter() - began, total, payload, count - 1

    for name, accuracy in [("coarse, 8 pixels a voxel", 8), ("full, 1 pixel a voxel", 1)]:
        runs = [ask(accuracy) for _ in range(5)]
        first, whole = (statistics.median(run[i] for run in runs) for i in (0, 1))
        _, _, total, payload, bricks = runs[0]
        print(f"cut for 1024 x 576, {name}: {bricks} bricks, first after {1e3 * (first or whole):.1f} ms, all after {1e3 * whole:.1f} ms; "
              f"{total} bytes for {payload} of payload: {total / max(payload, 1):.3f}")


if __name__ == "__main__":
    {"chunks": chunks, "connections": connections, "cut": cut, "packed": packed, "read": read}[sys.argv[1]](*sys.argv[2:])
