// A 3-D view: pictures that the server draws. Small and coarse while it turns, whole when it rests.

const FIELD = 30;
const WIDEST = 1024;
/** Milliseconds that a picture may take while the view turns. */
const PATIENCE = 120;

export class Volume {
  constructor(root, info, name, window) {
    Object.assign(this, { root, info, name, window, turn: 30, tilt: 20, zoom: 1, scale: 0.4, moving: false, busy: false, again: false, ended: false });
    const make = (name, attributes) => Object.assign(document.createElement(name), attributes);
    this.image = make("img", { tabIndex: 0, alt: "3-D view", draggable: false });
    this.caption = make("p", { className: "hint" });
    this.look = make("select");
    this.look.append(make("option", { value: "own", textContent: "chosen from the values" }), make("option", { value: "window", textContent: "the window's ramp" }));
    const label = make("label", { textContent: "Transfer function " });
    label.append(this.look);
    const button = (text, title, by) => {
      const made = make("button", { type: "button", textContent: text, title });
      made.setAttribute("aria-label", title);
      made.onclick = () => this.move(0, 0, by);
      return made;
    };
    const controls = make("div", { className: "row" });
    controls.append(label, button("+", "nearer", 1.25), button("−", "farther", 0.8));
    root.replaceChildren(make("h3", { textContent: "3-D view" }), this.image, controls, this.caption);
    root.hidden = false;
    this.look.onchange = () => this.ask();
    this.image.addEventListener("keydown", (event) => this.#key(event));
    this.image.addEventListener("pointerdown", (event) => this.image.setPointerCapture(event.pointerId));
    this.image.addEventListener("pointermove", (event) => {
      if (event.buttons & 1) this.move(-0.4 * event.movementX, 0.4 * event.movementY);
    });
    this.image.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.move(0, 0, 0.9 ** Math.sign(event.deltaY));
    }, { passive: false });
    this.ask();
  }

  /** Ends its asking. */
  end() {
    this.ended = true;
    clearTimeout(this.rest);
  }

  /** The window has changed. */
  setWindow(window) {
    this.window = window;
    if (this.look.value === "window") this.ask();
  }

  move(turn, tilt, nearer = 1) {
    this.turn = (this.turn + turn + 360) % 360;
    this.tilt = Math.min(Math.max(this.tilt + tilt, -89), 89);
    this.zoom = Math.min(Math.max(this.zoom * nearer, 0.2), 50);
    this.moving = true;
    clearTimeout(this.rest);
    this.rest = setTimeout(() => { this.moving = false; this.ask(); }, 250);
    this.ask();
  }

  #key(event) {
    const moves = { ArrowLeft: [5, 0], ArrowRight: [-5, 0], ArrowUp: [0, 5], ArrowDown: [0, -5], "+": [0, 0, 1.25], "-": [0, 0, 0.8] };
    if (event.key === "Home") [this.turn, this.tilt, this.zoom] = [30, 20, 1];
    else if (!(event.key in moves)) return;
    this.move(...(moves[event.key] ?? [0, 0]));
    event.preventDefault();
  }

  #extent() {
    return this.info.dims_xyz.map((n, axis) => n * this.info.spacing_xyz[axis]);
  }

  #camera() {
    const extent = this.#extent();
    const target = extent.map((e) => e / 2);
    const away = Math.hypot(...extent) / 2 / Math.sin(FIELD / 2 * Math.PI / 180) / this.zoom;
    const [turn, tilt] = [this.turn, this.tilt].map((degrees) => degrees * Math.PI / 180);
    const direction = [Math.cos(tilt) * Math.sin(turn), -Math.sin(tilt), -Math.cos(tilt) * Math.cos(turn)];
    return { projection: "perspective", position: target.map((t, axis) => t + away * direction[axis]), target, up: [0, -1, 0], fov_y_deg: FIELD };
  }

  #transfer() {
    const [low, high] = this.window;
    if (this.look.value === "own" || !(high > low)) return undefined;
    const extinction = 30 / Math.hypot(...this.#extent());
    return { points: [{ value: low, color: [0, 0, 0], extinction: 0 }, { value: high, color: [1, 1, 1], extinction }] };
  }

  /** Asks for pictures until the last is as fine as it gets; one at a time. */
  async ask() {
    this.again = true;
    this.root.dataset.state = "asked";
    if (this.busy) return;
    this.busy = true;
    while (this.again && !this.ended) {
      this.again = false;
      try {
        const { converged, milliseconds, moving } = await this.#draw();
        if (moving) this.scale = Math.min(Math.max(this.scale * Math.sqrt(PATIENCE / milliseconds), 0.12), 1);
        else if (!converged) this.again = true;
      } catch (error) {
        this.caption.textContent = error.message;
      }
    }
    this.busy = false;
  }

  async #draw() {
    const moving = this.moving;
    const width = Math.min(Math.round((this.image.clientWidth || 640) * devicePixelRatio), WIDEST);
    const size = [width, width * 9 / 16].map((side) => Math.max(Math.round(side * (moving ? this.scale : 1)), 16));
    const body = { camera: this.#camera(), size, transfer: this.#transfer(), accuracy: moving ? 2 : 1, step: moving ? 1 : 0.5, seconds: moving ? 0 : 0.5 };
    const started = performance.now();
    const reply = await fetch(`/v1/${encodeURIComponent(this.name)}/render`, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) });
    if (reply.status === 503) {
      await new Promise((done) => setTimeout(done, 1000 * Number(reply.headers.get("retry-after") ?? 1)));
      this.again = true;
      return { converged: true, milliseconds: PATIENCE, moving };
    }
    if (!reply.ok) {
      // A server without a renderer has no such view.
      if (reply.status === 501) this.root.hidden = this.ended = true;
      throw new Error((await reply.json()).detail);
    }
    const converged = reply.headers.get("x-octavo-converged") === "true";
    const picture = URL.createObjectURL(await reply.blob());
    const milliseconds = performance.now() - started;
    if (this.ended) return { converged: true, milliseconds, moving };
    const before = this.image.src;
    this.image.src = picture;
    await this.image.decode().catch(() => {});
    if (before) URL.revokeObjectURL(before);
    const state = moving ? "turning" : converged ? "whole" : "loading";
    this.image.alt = `3-D view: turned ${Math.round(this.turn)}°, raised ${Math.round(this.tilt)}°`;
    this.caption.textContent = `${size.join(" × ")} pixels, ${Math.round(milliseconds)} ms, ${state}. Drag or arrow keys turn, + and − or the wheel go nearer, Home goes back.`;
    if (!this.again && !this.moving) this.root.dataset.state = state;
    return { converged, milliseconds, moving };
  }
}
