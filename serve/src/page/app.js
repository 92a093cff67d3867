// The page: cards of datasets, and one dataset in detail. The address after # names it.

import { Slices, dimsAt, draw, fetchSlice } from "./slices.js";
import { histogram } from "./histogram.js";
import { Volume } from "./volume.js";

/** The 3-D view that is shown. */
let volume = null;

const by = (id) => document.getElementById(id);
const say = (text) => { by("status").textContent = text; };

async function get(path) {
  const reply = await fetch(path);
  const body = await reply.json();
  if (!reply.ok) throw new Error(body.detail);
  return body;
}

function made(name, text, attributes = {}) {
  const element = Object.assign(document.createElement(name), attributes);
  if (text !== undefined) element.textContent = text;
  return element;
}

function bytes(count) {
  const units = ["B", "KiB", "MiB", "GiB", "TiB"];
  const step = Math.min(Math.floor(Math.log2(Math.max(count, 1)) / 10), 4);
  return `${(count / 1024 ** step).toFixed(step ? 1 : 0)} ${units[step]}`;
}

async function preview(canvas, dataset) {
  const address = encodeURIComponent(dataset.name);
  const { window } = await get(`/v1/${address}/statistics`);
  let level = 0;
  while (level < dataset.levels - 1 && Math.max(...dataset.dims_xyz) / 2 ** level > 256) level++;
  const middle = dimsAt(dataset.dims_xyz, level)[2] >> 1;
  draw(canvas, await fetchSlice(dataset.name, dataset.sample_type, 2, middle, level), window, dataset.spacing_xyz[1] / dataset.spacing_xyz[0]);
  canvas.style.cssText = "";
}

async function list() {
  by("detail").hidden = true;
  by("cards").hidden = false;
  const datasets = await get("/v1/datasets");
  say(datasets.length === 1 ? "1 dataset" : `${datasets.length} datasets`);
  by("cards").replaceChildren(...datasets.map((dataset) => {
    const card = made("a", undefined, { className: "card", href: `#${encodeURIComponent(dataset.name)}` });
    const canvas = made("canvas", undefined, { width: 1, height: 1 });
    canvas.setAttribute("aria-hidden", "true");
    card.append(canvas, made("h2", dataset.name));
    if (dataset.problem) {
      card.append(made("p", dataset.problem));
    } else {
      card.append(made("p", `${dataset.dims_xyz.join(" × ")} · ${dataset.sample_type} · ${bytes(dataset.file_bytes)}`));
      preview(canvas, dataset).catch((error) => card.append(made("p", error.message)));
    }
    return card;
  }));
}

function describe(info) {
  const rows = {
    Dimensions: `${info.dims_xyz.join(" × ")} voxels`,
    Spacing: `${info.spacing_xyz.join(" × ")} ${info.unit}`,
    Samples: `${info.sample_type}, encoded as ${JSON.stringify(info.encoding)}`,
    Values: `${info.value_min} to ${info.value_max}, mean ${info.value_mean}`,
    Error: `RMS ${info.rms}, largest ${info.amax}` + (info.psnr_db === null ? "" : `, PSNR ${info.psnr_db.toFixed(2)} dB`),
    File: `${bytes(info.file_bytes)}, ${info.bits_per_voxel.toFixed(3)} bits a voxel`,
    Source: info.source.path,
    Digest: info.digest,
  };
  by("metadata").replaceChildren(...Object.entries(rows).flatMap(([name, text]) => [made("dt", name), made("dd", text)]));
  const heads = ["Level", "Voxels", "Stored", "Uniform", "Empty", "Payload", "RMS", "Largest", "Level of detail: RMS ≤", "largest ≤"];
  const cells = (level) => [level.level, level.dims_xyz.join(" × "), level.stored, level.uniform, level.empty, bytes(level.payload_bytes),
    ...[level.rms, level.amax, level.lod_rms_bound, level.lod_amax_bound].map((v) => v.toPrecision(4))];
  const row = (name, texts) => { const tr = made("tr"); tr.append(...texts.map((text) => made(name, text))); return tr; };
  by("errors").replaceChildren(row("th", heads), ...info.levels.map((level) => row("td", cells(level))));
}

function links(name, info, window) {
  const address = encodeURIComponent(name);
  const item = (text, href) => { const li = made("li"); li.append(made("a", text, { href })); return li; };
  // Precomputed has no signed samples: they come shifted.
  const shift = { i8: 128, i16: 32768, i32: 2147483648 }[info.sample_type] ?? 0;
  const shaderControls = { normalized: { range: window.map((v) => v + shift) } };
  const source = `${location.origin}/precomputed/${address}/|neuroglancer-precomputed:`;
  const state = { layers: [{ type: "image", source, name, shaderControls }], layout: "4panel" };
  const own = ["zarr2", "zarr2-5d", "zarr3", "zarr3-5d", "precomputed"].map((root) => {
    const document = { zarr2: ".zattrs", "zarr2-5d": ".zattrs", zarr3: "zarr.json", "zarr3-5d": "zarr.json", precomputed: "info" }[root];
    return item(`${location.origin}/${root}/${address}/`, `/${root}/${address}/${document}`);
  });
  by("links").replaceChildren(...own, item("Open in Neuroglancer", `https://neuroglancer-demo.appspot.com/#!${encodeURIComponent(JSON.stringify(state))}`));
}

async function detail(name) {
  const address = encodeURIComponent(name);
  const [info, statistics] = await Promise.all([get(`/v1/${address}/info`), get(`/v1/${address}/statistics`)]);
  by("cards").hidden = true;
  by("detail").hidden = false;
  by("name").textContent = name;
  by("name").focus();
  document.title = `${name} · Octavo`;
  describe(info);
  links(name, info, statistics.window);
  const slices = new Slices(by("views"), info, name, statistics.window, say);
  by("level").replaceChildren(...info.levels.map(({ level, dims_xyz }) => made("option", `${level}: ${dims_xyz.join(" × ")}`, { value: level })));
  volume = new Volume(by("volume"), info, name, statistics.window);
  slices.onlevel = (level) => { by("level").value = level; };
  slices.onwindow = (window) => {
    [by("low").value, by("high").value] = window.map((v) => Number(v.toPrecision(6)));
    histogram(by("histogram"), statistics, window);
    volume.setWindow(window);
  };
  by("level").onchange = () => slices.setLevel(Number(by("level").value));
  by("low").onchange = by("high").onchange = () => slices.setWindow([Number(by("low").value), Number(by("high").value)]);
  by("reset").onclick = () => slices.setWindow(statistics.window);
  by("controls").onsubmit = (event) => event.preventDefault();
  slices.onlevel(slices.level);
  slices.setWindow(statistics.window);
  await slices.show();
  say(`${name}: ready`);
}

async function route() {
  const name = decodeURIComponent(location.hash.slice(1));
  say("Loading…");
  volume?.end();
  try {
    await (name ? detail(name) : list());
  } catch (error) {
    say(error.message);
  }
}

addEventListener("hashchange", route);
route();
