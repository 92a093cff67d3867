// Three orthogonal slices of one level. Samples come raw; window and level are applied here.

const READERS = {
  u8: [1, (v, i) => v.getUint8(i)], i8: [1, (v, i) => v.getInt8(i)],
  u16: [2, (v, i) => v.getUint16(i, true)], i16: [2, (v, i) => v.getInt16(i, true)],
  u32: [4, (v, i) => v.getUint32(i, true)], i32: [4, (v, i) => v.getInt32(i, true)],
  f32: [4, (v, i) => v.getFloat32(i, true)], f64: [8, (v, i) => v.getFloat64(i, true)],
};

/** The dimensions of a level. */
export function dimsAt(dims, level) {
  return dims.map((n) => Math.ceil(n / 2 ** level));
}

/** Fetches a slice: { width, height, values }. */
export async function fetchSlice(dataset, type, axis, index, level, signal) {
  const url = `/v1/${encodeURIComponent(dataset)}/slices/${"xyz"[axis]}/${index}?level=${level}`;
  const reply = await fetch(url, { signal });
  if (!reply.ok) throw new Error((await reply.json()).detail);
  const [width, height] = reply.headers.get("x-octavo-dims").split(",").map(Number);
  const view = new DataView(await reply.arrayBuffer());
  const [bytes, read] = READERS[type];
  const values = Float64Array.from({ length: width * height }, (_, i) => read(view, i * bytes));
  return { width, height, values };
}

/** Draws a slice; `aspect` is the size of a row over that of a column. */
export function draw(canvas, slice, [low, high], aspect = 1) {
  const { width, height, values } = slice;
  const image = new ImageData(width, height);
  const scale = 255 / (high - low || 1);
  for (let i = 0; i < values.length; i++) {
    const grey = (values[i] - low) * scale;
    image.data.set([grey, grey, grey, 255], 4 * i);
  }
  canvas.width = width;
  canvas.height = height;
  canvas.getContext("2d").putImageData(image, 0, 0);
  canvas.style.aspectRatio = `${width} / ${height * aspect}`;
  canvas.style.objectFit = "fill";
  canvas.style.height = "auto";
}

/** The three views of a dataset. */
export class Slices {
  constructor(root, info, name, window, say) {
    Object.assign(this, { info, name, window, say, level: 0 });
    const most = Math.max(...info.dims_xyz);
    // A level that the screen can show.
    while (this.level < info.levels.length - 1 && most / 2 ** this.level > 1024) this.level++;
    root.replaceChildren();
    this.views = [2, 1, 0].map((axis) => this.#view(root, axis));
    this.show();
  }

  #view(root, axis) {
    const letter = "xyz"[axis];
    const figure = document.createElement("figure");
    const canvas = document.createElement("canvas");
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    const caption = document.createElement("figcaption");
    const range = document.createElement("input");
    Object.assign(range, { type: "range", min: 0, max: this.info.dims_xyz[axis] - 1, value: this.info.dims_xyz[axis] >> 1 });
    range.setAttribute("aria-label", `slice along ${letter}`);
    figure.append(canvas, range, caption);
    root.append(figure);
    const view = { axis, letter, canvas, caption, range, slice: null, abort: null };
    range.addEventListener("input", () => this.load(view));
    canvas.addEventListener("keydown", (event) => this.#key(view, event));
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.step(view, Math.sign(event.deltaY));
    }, { passive: false });
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons & 1) this.drag(event.movementX, event.movementY);
    });
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    return view;
  }

  #key(view, event) {
    const voxel = 2 ** this.level;
    const steps = { ArrowUp: voxel, ArrowRight: voxel, ArrowDown: -voxel, ArrowLeft: -voxel, PageUp: 10 * voxel, PageDown: -10 * voxel, Home: -1e9, End: 1e9 };
    if (event.key in steps) this.step(view, steps[event.key]);
    else if (event.key === "[") this.setLevel(this.level - 1);
    else if (event.key === "]") this.setLevel(this.level + 1);
    else return;
    event.preventDefault();
  }

  step(view, by) {
    view.range.value = Number(view.range.value) + by;
    this.load(view);
  }

  drag(dx, dy) {
    const [low, high] = this.window;
    const width = Math.max((high - low) * 1.01 ** dx, Number.EPSILON);
    const centre = (low + high) / 2 + (high - low) * 0.005 * dy;
    this.setWindow([centre - width / 2, centre + width / 2]);
  }

  setWindow(window) {
    this.window = window;
    this.views.forEach((view) => this.paint(view));
    this.onwindow?.(window);
  }

  setLevel(level) {
    this.level = Math.min(Math.max(level, 0), this.info.levels.length - 1);
    this.onlevel?.(this.level);
    this.show();
  }

  show() {
    return Promise.all(this.views.map((view) => this.load(view)));
  }

  async load(view) {
    const { dims_xyz, sample_type } = this.info;
    const last = dimsAt(dims_xyz, this.level)[view.axis] - 1;
    const index = Math.min(Math.floor(Number(view.range.value) / 2 ** this.level), last);
    view.abort?.abort();
    view.abort = new AbortController();
    try {
      view.slice = await fetchSlice(this.name, sample_type, view.axis, index, this.level, view.abort.signal);
      const label = `${view.letter} = ${view.range.value} of ${dims_xyz[view.axis]}, level ${this.level}`;
      view.caption.textContent = label;
      view.canvas.setAttribute("aria-label", `slice at ${label}`);
      this.paint(view);
    } catch (error) {
      if (error.name === "AbortError") return;
      view.caption.textContent = error.message;
      view.slice = null;
      view.canvas.getContext("2d").clearRect(0, 0, view.canvas.width, view.canvas.height);
      this.say(error.message);
    }
  }

  paint(view) {
    if (!view.slice) return;
    const [column, row] = [0, 1, 2].filter((axis) => axis !== view.axis);
    draw(view.canvas, view.slice, this.window, this.info.spacing_xyz[row] / this.info.spacing_xyz[column]);
  }
}
