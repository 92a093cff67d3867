// The web page in a browser: by mouse and by keyboard, light and dark, wide and narrow; nothing from elsewhere.
//
//     node page.mjs BASE DATASET SHOTS
import { check, open } from "./browser.mjs";

const [base, dataset, shots] = process.argv.slice(2);
const { context, close } = await open();
const page = await context.newPage();
page.setDefaultTimeout(30000);
const asked = [], faults = [];
page.on("request", (request) => asked.push(request.url()));
page.on("pageerror", (error) => faults.push(String(error)));
page.on("console", (message) => message.type() === "error" && faults.push(message.text()));

const ready = () => page.waitForFunction((name) => document.getElementById("status").textContent === `${name}: ready`, dataset);
const pixels = (index) => page.evaluate((index) => {
  const canvas = document.querySelectorAll("#views canvas")[index];
  return { width: canvas.width, height: canvas.height, data: Array.from(canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data) };
}, index);
const widest = () => page.evaluate(() => document.documentElement.scrollWidth - innerWidth);

// The 3-D view: how its picture is, and whether it shows anything.
const whole = () => page.waitForFunction(() => document.getElementById("volume").dataset.state === "whole", undefined, { timeout: 90000 });
const volume = () => page.evaluate(async () => {
  const image = document.querySelector("#volume img");
  const canvas = new OffscreenCanvas(image.naturalWidth, image.naturalHeight);
  const context = canvas.getContext("2d");
  context.drawImage(image, 0, 0);
  const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
  let lit = 0;
  const grid = [];
  for (let i = 0; i < data.length; i += 4) if (data[i] + data[i + 1] + data[i + 2] > 60) lit++;
  for (let y = 0; y < 24; y++) for (let x = 0; x < 24; x++) {
    const at = 4 * (Math.floor((y + 0.5) / 24 * canvas.height) * canvas.width + Math.floor((x + 0.5) / 24 * canvas.width));
    grid.push(data[at]);
  }
  return { width: canvas.width, lit: lit / (data.length / 4), grid, alt: image.alt };
});
const apart = (a, b) => a.grid.filter((v, i) => Math.abs(v - b.grid[i]) > 8).length;

for (const [scheme, width] of [["light", 1200], ["dark", 1200], ["dark", 360]]) {
  await page.emulateMedia({ colorScheme: scheme });
  await page.setViewportSize({ width, height: 900 });
  await page.goto(`${base}/`);
  await page.waitForSelector(".card canvas");
  await page.waitForTimeout(800);
  await page.screenshot({ path: `${shots}/cards-${scheme}-${width}.png`, fullPage: true });
  check(await widest() <= 0, `cards stand out of a screen of ${width}`);
  await page.goto(`${base}/#${dataset}`);
  await ready();
  await whole();
  await page.screenshot({ path: `${shots}/detail-${scheme}-${width}.png`, fullPage: true });
  check(await widest() <= 0, `the detail stands out of a screen of ${width}`);
  const [ink, paper] = await page.evaluate(() => { const s = getComputedStyle(document.body); return [s.color, s.backgroundColor].map((c) => c.match(/\d+/g).map(Number).reduce((a, b) => a + b)); });
  check(scheme === "dark" ? ink > paper : ink < paper, `${scheme}: ink ${ink} on ${paper}`);
}

// By keyboard alone: to the card, into it, to a view, through it.
await page.setViewportSize({ width: 1200, height: 900 });
await page.goto(`${base}/`);
await page.waitForSelector(`.card[href="#${dataset}"]`);
for (let i = 0; i < 20 && !(await page.evaluate((name) => document.activeElement.getAttribute("href") === `#${name}`, dataset)); i++) await page.keyboard.press("Tab");
await page.keyboard.press("Enter");
await ready();
check(await page.evaluate(() => document.activeElement.id) === "name", "the focus is on what was opened");
await page.keyboard.press("Tab");
check(await page.evaluate(() => document.activeElement.tagName) === "CANVAS", "the first view is next");
const info = await (await fetch(`${base}/v1/${dataset}/info`)).json();
const [nx, ny, nz] = info.dims_xyz;
const caption = () => page.locator("figcaption").first().textContent();
await page.keyboard.press("Home");
await page.waitForFunction(() => document.querySelector("figcaption").textContent.startsWith("z = 0 "));
await page.keyboard.press("ArrowUp");
await page.keyboard.press("PageUp");
await page.waitForFunction(() => document.querySelector("figcaption").textContent.startsWith("z = 11 "));

// What is drawn is what the server says, through the window.
await page.fill("#low", "0");
await page.fill("#high", "1000");
await page.keyboard.press("Tab");
await page.waitForTimeout(300);
const slice = new DataView(await (await fetch(`${base}/v1/${dataset}/slices/z/11`)).arrayBuffer());
const drawn = await pixels(0);
check(drawn.width === nx && drawn.height === ny, `a canvas of ${drawn.width} x ${drawn.height}`);
for (let i = 0; i < nx * ny; i++) {
  const expected = Math.min(Math.max(slice.getUint16(2 * i, true) * 255 / 1000, 0), 255);
  check(Math.abs(drawn.data[4 * i] - expected) <= 0.5 + 1e-6, `pixel ${i}: ${drawn.data[4 * i]} for ${expected}`);
}
// Coarser and finer.
await page.locator("#views canvas").first().focus();
await page.keyboard.press("]");
await page.waitForFunction(() => document.querySelector("figcaption").textContent.endsWith("level 1"));
check((await pixels(0)).width === Math.ceil(nx / 2), "a coarser level has half the voxels");
await page.keyboard.press("[");
await page.waitForFunction(() => document.querySelector("figcaption").textContent.endsWith("level 0"));
// Dragging changes the window.
const box = await page.locator("#views canvas").first().boundingBox();
await page.mouse.move(box.x + 50, box.y + 50);
await page.mouse.down();
await page.mouse.move(box.x + 90, box.y + 70, { steps: 4 });
await page.mouse.up();
check(await page.inputValue("#high") !== "1000", "the window follows the pointer");

// The 3-D view turns by keyboard and by mouse, coarser while it moves, and comes back to where it was.
await whole();
const first = await volume();
check(first.lit > 0.02 && first.lit < 0.95, `a share of ${first.lit} of the picture is lit`);
const sizes = [];
page.on("request", (request) => request.url().endsWith("/render") && sizes.push(request.postDataJSON().size[0]));
await page.locator("#volume img").focus();
for (let i = 0; i < 9; i++) await page.keyboard.press("ArrowLeft");
await page.waitForFunction(() => document.querySelector("#volume img").alt.includes("turned 75°"));
await page.waitForTimeout(300);
await whole();
const turned = await volume();
check(apart(first, turned) > 20, `turning changes ${apart(first, turned)} of 576 places`);
check(sizes[0] < sizes.at(-1) && sizes.at(-1) === first.width, `sizes while turning and at rest: ${sizes}`);
await page.keyboard.press("Home");
await page.waitForFunction(() => document.querySelector("#volume img").alt.includes("turned 30°"));
await page.waitForTimeout(300);
await whole();
check(apart(first, await volume()) === 0, "Home is where it was");
const frame = await page.locator("#volume img").boundingBox();
await page.mouse.move(frame.x + 200, frame.y + 100);
await page.mouse.down();
await page.mouse.move(frame.x + 320, frame.y + 140, { steps: 6 });
await page.mouse.up();
await page.waitForTimeout(300);
await whole();
check(apart(first, await volume()) > 20, "it turns with the pointer");
const farther = await volume();
for (let i = 0; i < 3; i++) await page.locator("#volume button").first().click();
await page.waitForTimeout(300);
await whole();
check((await volume()).lit > farther.lit, "nearer is larger");
await page.locator("#volume select").selectOption("window");
await page.waitForTimeout(1000);
await whole();
await page.screenshot({ path: `${shots}/volume.png` });

check(await page.locator("#histogram rect.bar").count() === 256, "the histogram has its bars");
check(await page.locator("#errors tr").count() === info.levels.length + 1, "each level has its row");
check((await page.locator("#metadata").textContent()).includes(`${nx} × ${ny} × ${nz}`), "the dimensions are told");
check(faults.length === 0, `faults: ${faults}`);
const elsewhere = asked.filter((url) => !url.startsWith(base) && !url.startsWith("data:") && !url.startsWith("blob:"));
check(elsewhere.length === 0, `asked elsewhere: ${elsewhere}`);
console.log(`the page: ${asked.length} requests, none elsewhere; ${await caption()}`);
await close();
