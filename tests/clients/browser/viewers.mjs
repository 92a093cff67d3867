// Neuroglancer and niivue show what the source has: voxels decoded from the screen and from memory.
//
//     node viewers.mjs BASE DATASET SOURCE.raw X,Y,Z DIST LINK [neuroglancer|niivue]      (a u16 volume, 1 mm voxels)
import { readFileSync } from "node:fs";
import { check, open, serveFiles } from "./browser.mjs";

const [base, dataset, source, dimsText, dist, link, only] = process.argv.slice(2);
const dims = dimsText.split(",").map(Number);
const raw = readFileSync(source);

const SHADER = "void main(){uint v=uint(toRaw(getDataValue()));emitRGB(vec3(float(v&255u)/255.,float(v>>8)/255.,1.));}";
const BLOCK = 4;

/** The levels of the source, each the mean of the 2x2x2 cells that exist of the one below, half to even. */
const pyramid = [{ dims, values: Uint16Array.from({ length: dims[0] * dims[1] * dims[2] }, (_, i) => raw.readUInt16LE(2 * i)) }];
const value = (level, x, y, z) => pyramid[level].values[(z * pyramid[level].dims[1] + y) * pyramid[level].dims[0] + x];
for (const level of [1, 2]) {
  const below = pyramid[level - 1].dims, here = below.map((n) => (n + 1) >> 1);
  const values = new Uint16Array(here[0] * here[1] * here[2]);
  for (let i = 0; i < values.length; i++) {
    const place = [i % here[0], Math.floor(i / here[0]) % here[1], Math.floor(i / here[0] / here[1])];
    let sum = 0, count = 0;
    for (let cell = 0; cell < 8; cell++) {
      const [x, y, z] = place.map((v, axis) => 2 * v + (cell >> axis & 1));
      if (x < below[0] && y < below[1] && z < below[2]) { sum += value(level - 1, x, y, z); count++; }
    }
    const low = Math.floor(sum / count), twice = 2 * (sum - low * count);
    values[i] = low + (twice > count || (twice === count && low % 2) ? 1 : 0);
  }
  pyramid.push({ dims: here, values });
}

/** Axes of a plane of Neuroglancer's: to the right, down, through it; and which way the first goes. */
const PLANES = { xy: [0, 1, 2, 1], xz: [0, 2, 1, 1], yz: [2, 1, 0, -1] };

/** Waits until Neuroglancer says that it is ready, and a little more: it says so of chunks that are missing, too. */
async function ready(page) {
  await page.waitForFunction(() => window.viewer?.layerManager.managedLayers.length > 0 &&
    window.viewer.layerManager.managedLayers.every((layer) => layer.isReady()) && window.viewer.isReady(), null, { timeout: 60000 });
  await page.waitForTimeout(1500);
}

async function neuroglancer(context, files, root, scheme, corner, level, plane) {
  const page = await context.newPage();
  await page.setViewportSize({ width: 900, height: 700 });
  const faults = [];
  page.on("pageerror", (error) => faults.push(String(error)));
  const [right, down, through, way] = PLANES[plane];
  // The last of the level-0 voxels that a voxel of the level stands for: half a voxel off would show.
  const last = 2 ** level - 1;
  const middle = dims.map((n) => n >> 1);
  middle[through] |= last;
  // Where a voxel's corner is at its index (precomputed), or its centre is (zarr); the eye is at a voxel's centre.
  const shift = corner ? 0.5 : 0;
  const state = {
    dimensions: { x: [1e-3, "m"], y: [1e-3, "m"], z: [1e-3, "m"] },
    position: middle.map((v) => v + shift),
    crossSectionScale: 1 / BLOCK,
    layers: [{ type: "image", name: "a", source: `${base}/${root}/${dataset}/|${scheme}:`, shader: SHADER, crossSectionRenderScale: level ? BLOCK * 2 ** level : 0.1 }],
    layout: plane, showAxisLines: false, showScaleBar: false, showDefaultAnnotations: false, crossSectionBackgroundColor: "#000000",
  };
  await page.goto(`${files.url}/neuroglancer/index.html#!${encodeURIComponent(JSON.stringify(state))}`);
  await ready(page);
  const box = await page.evaluate(() => {
    const panel = [...window.viewer.display.panels].find((p) => p.sliceView);
    const r = panel.element.getBoundingClientRect();
    const v = panel.renderViewport;
    return { x: r.x + panel.element.clientLeft, y: r.y + panel.element.clientTop, width: v.logicalWidth, height: v.logicalHeight };
  });
  const shot = (await page.screenshot({ path: process.env.SHOTS && `${process.env.SHOTS}/${root}-${level}.png` })).toString("base64");
  const points = [], expected = [];
  for (let v = 0; v < dims[down]; v++) {
    for (let u = 0; u < dims[right]; u++) {
      // Of a voxel of a coarser level, the first and the last of the level-0 voxels that it stands for.
      if (![0, last].includes(u & last) || ![0, last].includes(v & last)) continue;
      const px = Math.floor(box.x + box.width / 2 + way * (u - middle[right]) * BLOCK);
      const py = Math.floor(box.y + box.height / 2 + (v - middle[down]) * BLOCK);
      if (px < box.x + 2 || py < box.y + 2 || px >= box.x + box.width - 2 || py >= box.y + box.height - 2) continue;
      const place = [];
      [place[right], place[down], place[through]] = [u, v, middle[through]];
      points.push([px, py]);
      expected.push(value(level, ...place.map((n) => n >> level)));
    }
  }
  // The browser itself decodes the picture.
  const found = await page.evaluate(async ({ shot, points }) => {
    const image = await createImageBitmap(await (await fetch(`data:image/png;base64,${shot}`)).blob());
    const drawing = new OffscreenCanvas(image.width, image.height).getContext("2d");
    drawing.drawImage(image, 0, 0);
    const { data } = drawing.getImageData(0, 0, image.width, image.height);
    const at = ([x, y]) => 4 * (y * image.width + x);
    return points.map((point) => data[at(point) + 2] === 255 ? data[at(point)] + 256 * data[at(point) + 1] : -1);
  }, { shot, points });
  const same = found.filter((v, i) => v === expected[i]).length, wrong = found.length - same;
  await page.close();
  check(faults.length === 0, `${root}: ${faults}`);
  const what = `Neuroglancer ${root} level ${level} ${plane}`;
  check(same > 4000 / 2 ** level && wrong === 0, `${what}: ${same} points right, ${wrong} wrong`);
  console.log(`${what}: ${same} of ${same} points`);
}

/** The link that `octavo serve` printed, with Neuroglancer from here in place of the public one: all panels show the volume. */
async function printed(context, files) {
  const page = await context.newPage();
  await page.goto(`${files.url}/neuroglancer/index.html#!${link.split("#!")[1]}`);
  await ready(page);
  const panels = await page.evaluate(() => [...window.viewer.display.panels].map((panel) => {
    const { x, y, width, height } = panel.element.getBoundingClientRect();
    return { x, y, width, height };
  }));
  check(panels.length === 4, `the printed link: ${panels.length} panels`);
  const shades = [];
  for (const clip of panels) {
    const shot = (await page.screenshot({ clip })).toString("base64");
    shades.push(await page.evaluate(async (shot) => {
      const image = await createImageBitmap(await (await fetch(`data:image/png;base64,${shot}`)).blob());
      const drawing = new OffscreenCanvas(image.width, image.height).getContext("2d");
      drawing.drawImage(image, 0, 0);
      return new Set(new Uint32Array(drawing.getImageData(0, 0, image.width, image.height).data.buffer)).size;
    }, shot));
  }
  await page.close();
  check(shades.every((count) => count > 100), `the printed link: panels of ${shades} colours`);
  console.log(`the printed link: panels of ${shades} colours`);
}

async function niivue(context, files, root) {
  const page = await context.newPage();
  await page.goto(`${files.url}/niivue/index.html`);
  await page.waitForFunction(() => window.Niivue);
  const found = await page.evaluate(async (url) => {
    const nv = new window.Niivue();
    await nv.attachTo("gl");
    await nv.loadVolumes([{ url, name: "a.zarr", zarrLevel: 0, zarrMaxVolumeSize: 256 }]);
    // Chunks go on arriving after that.
    let before = -1;
    for (let i = 0; i < 100; i++) {
      await new Promise((resolve) => setTimeout(resolve, 200));
      const sum = nv.volumes[0].img.reduce((a, b) => a + b, 0);
      if (sum === before && i > 5) break;
      before = sum;
    }
    const { img, dims } = nv.volumes[0];
    return { dims: Array.from(dims ?? []), values: Array.from(img), affine: nv.volumes[0].hdr.affine };
  }, `${base}/${root}/${dataset}`);
  let wrong = 0;
  found.values.forEach((value, i) => { if (value !== raw.readUInt16LE(2 * i)) wrong++; });
  await page.close();
  check(found.values.length === dims[0] * dims[1] * dims[2], `niivue ${root}: ${found.values.length} voxels, ${found.dims}`);
  check(wrong === 0, `niivue ${root}: ${wrong} of ${found.values.length} voxels are wrong`);
  // Millimetres.
  const world = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
  check(JSON.stringify(found.affine) === JSON.stringify(world), `niivue ${root}: ${JSON.stringify(found.affine)}`);
  console.log(`niivue ${root}: ${found.values.length} voxels, in their place`);
}

const files = await serveFiles(dist);
const browser = await open();
let faults = 0;
const attempt = async (work) => { try { await work; } catch (error) { faults++; console.error(error.message); } };
if (only !== "niivue") {
  for (const [level, plane] of ["xy", "xz", "yz"].entries()) {
    await attempt(neuroglancer(browser.context, files, "precomputed", "neuroglancer-precomputed", true, level, plane));
    await attempt(neuroglancer(browser.context, files, "zarr2", "zarr2", false, level, plane));
    await attempt(neuroglancer(browser.context, files, "zarr3", "zarr3", false, level, plane));
  }
  await attempt(printed(browser.context, files));
}
if (only !== "neuroglancer") {
  for (const root of ["zarr2", "zarr3"]) await attempt(niivue(browser.context, files, root));
}
await browser.close();
files.close();
process.exit(faults ? 1 : 0);
