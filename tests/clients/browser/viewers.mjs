// Neuroglancer and niivue show what the source has: voxels decoded from the screen and from memory.
//
//     node viewers.mjs BASE DATASET SOURCE.raw X,Y,Z DIST [neuroglancer|niivue]      (a u16 volume, 1 mm voxels)
import { readFileSync } from "node:fs";
import { check, open, serveFiles } from "./browser.mjs";

const [base, dataset, source, dimsText, dist, only] = process.argv.slice(2);
const dims = dimsText.split(",").map(Number);
const raw = readFileSync(source);
const at = (x, y, z) => raw.readUInt16LE(2 * ((z * dims[1] + y) * dims[0] + x));

const SHADER = "void main(){uint v=uint(toRaw(getDataValue()));emitRGB(vec3(float(v&255u)/255.,float(v>>8)/255.,1.));}";
const BLOCK = 4;

/** A level's voxels in the plane that lies at level-0 voxel z, as [width, height, value(x, y)]. */
async function plane(level, z) {
  if (level === 0) return [dims[0], dims[1], (x, y) => at(x, y, z)];
  const reply = await fetch(`${base}/v1/${dataset}/slices/z/${z >> level}?level=${level}`);
  const [width, height] = reply.headers.get("x-octavo-dims").split(",").map(Number);
  const view = new DataView(await reply.arrayBuffer());
  return [width, height, (x, y) => view.getUint16(2 * (y * width + x), true)];
}

async function neuroglancer(context, files, root, scheme, corner, level) {
  const page = await context.newPage();
  await page.setViewportSize({ width: 900, height: 700 });
  const faults = [];
  page.on("pageerror", (error) => faults.push(String(error)));
  const z = dims[2] >> 1;
  // Where a voxel's corner is at its index (precomputed), or its centre is (zarr).
  const shift = corner ? 0 : -0.5;
  const middle = [dims[0] >> 1, dims[1] >> 1];
  const state = {
    dimensions: { x: [1e-3, "m"], y: [1e-3, "m"], z: [1e-3, "m"] },
    position: [middle[0] + shift, middle[1] + shift, z + 0.5 + shift],
    crossSectionScale: 1 / BLOCK,
    layers: [{ type: "image", name: "a", source: `${base}/${root}/${dataset}/|${scheme}:`, shader: SHADER, crossSectionRenderScale: level ? BLOCK * 2 ** level : 0.1 }],
    layout: "xy", showAxisLines: false, showScaleBar: false, showDefaultAnnotations: false, crossSectionBackgroundColor: "#000000",
  };
  await page.goto(`${files.url}/neuroglancer/index.html#!${encodeURIComponent(JSON.stringify(state))}`);
  await page.waitForFunction(() => window.viewer?.layerManager.managedLayers.length > 0 &&
    window.viewer.layerManager.managedLayers.every((layer) => layer.isReady()) && window.viewer.isReady(), null, { timeout: 60000 });
  await page.waitForTimeout(1500);
  const box = await page.evaluate(() => {
    const panel = [...window.viewer.display.panels].find((p) => p.sliceView);
    const r = panel.element.getBoundingClientRect();
    const v = panel.renderViewport;
    return { x: r.x + panel.element.clientLeft, y: r.y + panel.element.clientTop, width: v.logicalWidth, height: v.logicalHeight };
  });
  const shot = (await page.screenshot({ path: process.env.SHOTS && `${process.env.SHOTS}/${root}-${level}.png` })).toString("base64");
  const [width, height, value] = await plane(level, z);
  const points = [], expected = [];
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      // The first and the last of the level-0 voxels that this one stands for: half a voxel off would show.
      for (const inner of level ? [0, 2 ** level - 1] : [0]) {
        const [fx, fy] = [x * 2 ** level + inner, y * 2 ** level + inner];
        if (fx >= dims[0] || fy >= dims[1]) continue;
        const px = Math.floor(box.x + box.width / 2 + (fx - middle[0] + 0.5) * BLOCK);
        const py = Math.floor(box.y + box.height / 2 + (fy - middle[1] + 0.5) * BLOCK);
        if (px < box.x + 2 || py < box.y + 2 || px >= box.x + box.width - 2 || py >= box.y + box.height - 2) continue;
        points.push([px, py]);
        expected.push(value(x, y));
      }
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
  const right = found.filter((v, i) => v === expected[i]).length, wrong = found.length - right;
  await page.close();
  check(faults.length === 0, `${root}: ${faults}`);
  check(right > 1000 / 4 ** level && wrong === 0, `Neuroglancer ${root} level ${level}: ${right} voxels right, ${wrong} wrong`);
  console.log(`Neuroglancer ${root} level ${level}: ${right} of ${right} points`);
}

/** Neuroglancer's other layouts are drawn: their panels are there and show something. */
async function layouts(context, files) {
  for (const layout of ["4panel", "3d", "xz"]) {
    const page = await context.newPage();
    const state = { layers: [{ type: "image", name: "a", source: `${base}/precomputed/${dataset}/|neuroglancer-precomputed:`, shader: SHADER }], layout, showAxisLines: false };
    await page.goto(`${files.url}/neuroglancer/index.html#!${encodeURIComponent(JSON.stringify(state))}`);
    await page.waitForFunction(() => window.viewer?.layerManager.managedLayers.length > 0 && window.viewer.isReady(), null, { timeout: 60000 });
    await page.waitForTimeout(1000);
    const panels = await page.evaluate(() => window.viewer.display.panels.size);
    check(panels === (layout === "4panel" ? 4 : 1), `${layout}: ${panels} panels`);
    await page.close();
    console.log(`Neuroglancer layout ${layout}: ${panels} panels`);
  }
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
    return { dims: Array.from(dims ?? []), values: Array.from(img) };
  }, `${base}/${root}/${dataset}`);
  let wrong = 0;
  found.values.forEach((value, i) => { if (value !== raw.readUInt16LE(2 * i)) wrong++; });
  await page.close();
  check(found.values.length === dims[0] * dims[1] * dims[2], `niivue ${root}: ${found.values.length} voxels, ${found.dims}`);
  check(wrong === 0, `niivue ${root}: ${wrong} of ${found.values.length} voxels are wrong`);
  console.log(`niivue ${root}: ${found.values.length} voxels`);
}

const files = await serveFiles(dist);
const browser = await open();
let faults = 0;
const attempt = async (work) => { try { await work; } catch (error) { faults++; console.error(error.message); } };
if (only !== "niivue") {
  for (const level of [0, 1, 2]) {
    await attempt(neuroglancer(browser.context, files, "precomputed", "neuroglancer-precomputed", true, level));
    await attempt(neuroglancer(browser.context, files, "zarr2", "zarr2", false, level));
    await attempt(neuroglancer(browser.context, files, "zarr3", "zarr3", false, level));
  }
  await attempt(layouts(browser.context, files));
}
if (only !== "neuroglancer") {
  for (const root of ["zarr2", "zarr3"]) await attempt(niivue(browser.context, files, root));
}
await browser.close();
files.close();
process.exit(faults ? 1 : 0);
