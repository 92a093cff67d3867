"""`octavo view` under a display without a screen: window.py OCTAVO STORE FOLDER

Keys and the mouse are pressed as a hand would (xdotool), pictures are taken by the program (p) and of the window itself
(ImageMagick's import), and each is held against what `octavo render` draws for the view that the picture tells.
"""

import json
import os
import subprocess
import sys
import time

import numpy as np
from PIL import Image

octavo, store, folder = sys.argv[1:4]
os.chdir(folder)
stem = os.path.splitext(os.path.basename(store))[0]


def until(what, found, seconds=60):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        value = found()
        if value:
            return value
        time.sleep(0.05)
    raise SystemExit(f"not within {seconds} s: {what}")


display, told = os.pipe()
server = subprocess.Popen(
    ["Xvfb", "-displayfd", str(told), "-screen", "0", "800x600x24", "-nolisten", "tcp", "-noreset"],
    pass_fds=[told], stderr=subprocess.DEVNULL,
)
os.close(told)
number = os.read(display, 16).decode().strip()
assert number, "Xvfb did not start"
environment = os.environ | {"DISPLAY": f":{number}"}
environment.pop("WAYLAND_DISPLAY", None)


def x(*arguments):
    return subprocess.run(["xdotool", *map(str, arguments)], env=environment, capture_output=True, text=True).stdout.strip()


def whole(path):
    """A picture, once it is there: it appears under its name when it is written."""
    until(path, lambda: os.path.exists(path) or viewer.poll() is not None)
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB")), json.loads(image.text["octavo:view"])


def drawn_again(view):
    """What `octavo render` draws for a view that a picture tells."""
    json.dump(view["camera"], open("again-camera.json", "w"))
    json.dump(view["transfer"], open("again-transfer.json", "w"))
    mode = view["mode"]
    kind = mode if isinstance(mode, str) else "iso"
    arguments = [
        octavo, "render", store, "-o", "again.png", "--force", "--backend", "cpu",
        "--size", "x".join(map(str, view["size"])), "--camera", "again-camera.json", "--transfer", "again-transfer.json",
        "--mode", kind, "--shading", "phong" if view["shading"] else "off", "--filter", view["filter"],
        "--step", str(view["step_voxels"]), "--accuracy", str(view["accuracy"]),
    ]
    if kind == "iso":
        arguments += ["--iso", str(mode["iso"])]
    if kind == "mip":
        arguments += ["--window", ",".join(map(str, view["window"]))]
    if view["clip"]:
        arguments += ["--clip", ",".join(map(str, view["clip"]["min"] + view["clip"]["max"]))]
    subprocess.run(arguments, check=True, capture_output=True)
    return np.asarray(Image.open("again.png").convert("RGB"))


taken = 0


def shoot():
    global taken
    taken += 1
    x("key", "p")
    picture, view = whole(f"{stem}-{taken:03}.png")
    assert np.array_equal(picture, drawn_again(view)), f"picture {taken} is not what render draws: {view}"
    return picture, view


viewer = subprocess.Popen(
    [octavo, "view", store, "--size", "320x240", "--view", "z-", "--backend", "cpu"],
    env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
)
try:
    window = until("a window", lambda: x("search", "--name", f"^{stem} - octavo$") or viewer.poll() is not None)
    assert viewer.poll() is None, viewer.communicate()
    until("the keyboard", lambda: x("windowfocus", window) or x("getwindowfocus") == window)
    x("mousemove", "--window", window, 160, 120)

    first, view = shoot()
    assert view["size"] == [320, 240] and view["mode"] == "dvr" and view["clip"] is None
    assert first.max() > 60, "something is seen"

    # The window shows the picture; with figures, text is upon it; without, nothing else.
    def grabbed():
        subprocess.run(["import", "-window", window, "grab.png"], env=environment, check=True)
        return np.asarray(Image.open("grab.png").convert("RGB"))

    until("figures", lambda: (grabbed()[:90] != first[:90]).any())
    assert np.array_equal(grabbed()[150:], first[150:]), "beneath the figures the picture is whole"
    x("key", "f")
    until("the picture alone", lambda: np.array_equal(grabbed(), first))
    x("key", "h")
    until("help", lambda: (grabbed() != first).mean() > 0.05)
    x("key", "h")

    # A drag to the right by a quarter of the height turns by a quarter of pi.
    x("mousedown", 1, "mousemove_relative", "--", 60, 0, "mouseup", 1)
    turned, view_turned = shoot()
    a = np.subtract(view["camera"]["position"], view["camera"]["target"])
    b = np.subtract(view_turned["camera"]["position"], view_turned["camera"]["target"])
    angle = np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b))
    assert abs(angle - np.pi / 4) < 1e-6, angle
    assert (turned != first).any()

    x("click", 4)
    _, view_near = shoot()
    c = np.subtract(view_near["camera"]["position"], view_near["camera"]["target"])
    # A pointer without a scroll axis, as this one is, tells the press of its wheel and the release.
    nearer = np.linalg.norm(b) / np.linalg.norm(c)
    assert abs(nearer - 1.15**2) < 1e-6, f"a notch is 15 %, and this was {nearer}"
    x("mousedown", 3, "mousemove_relative", "--", 0, 48, "mouseup", 3)
    _, view_panned = shoot()
    assert np.linalg.norm(np.subtract(view_panned["camera"]["target"], view["camera"]["target"])) > 1

    # Levels, steps, transfer function, clip box, modes: each shows in what the next picture tells.
    x("key", "A", "S", "c", "o", "bracketright", "x", "x", "l")
    _, changed = shoot()
    assert changed["accuracy"] == 2 * view["accuracy"] and changed["step_voxels"] == 2 * view["step_voxels"]
    assert changed["transfer"] != view["transfer"] and changed["clip"]["min"][0] > 0
    x("key", "r", "5", "m")
    surface, view_surface = shoot()
    assert "iso" in view_surface["mode"] and view_surface["shading"] and view_surface["clip"] is None
    assert np.array_equal(view_surface["camera"]["position"], view["camera"]["position"])
    assert (surface != first).any()
    x("key", "m")
    _, view_mip = shoot()
    assert view_mip["mode"] == "mip"

    # A window of another size is a picture of another size.
    x("windowsize", "--sync", window, 200, 150)
    x("key", "r")
    until("the new size", lambda: grabbed().shape[:2] == (150, 200))
    _, view_small = shoot()
    assert view_small["size"] == [200, 150], view_small["size"]

    x("key", "q")
    code = viewer.wait(timeout=30)
    out, err = viewer.communicate()
    assert code == 0, (code, err)
    assert out.split() == [f"./{stem}-{n:03}.png" for n in range(1, taken + 1)], out

    # No display: said so, as the environment's fault.
    lost = {k: v for k, v in environment.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")}
    said = subprocess.run([octavo, "view", store, "--backend", "cpu"], env=lost, capture_output=True, text=True)
    assert said.returncode == 3 and "display" in said.stderr and "octavo serve" in said.stderr, (said.returncode, said.stderr)
    print(f"{taken} pictures as render draws them")
finally:
    viewer.kill()
    server.terminate()
    server.wait()
