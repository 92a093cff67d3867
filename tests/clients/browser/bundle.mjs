// Bundles Neuroglancer and niivue, as their packages are, into one folder of static files.
//
//     node bundle.mjs OUT        (in a folder where package.json was installed)
import { build } from "esbuild";
import { copyFileSync, mkdirSync, readdirSync, statSync, writeFileSync } from "node:fs";
import { join } from "node:path";

const out = process.argv[2];
const lib = join(process.cwd(), "node_modules/neuroglancer/lib");
mkdirSync(join(out, "neuroglancer"), { recursive: true });

const odd = {
  name: "what a bundler of Neuroglancer must know",
  setup(build) {
    build.onResolve({ filter: /\.svg\?raw$/ }, (args) => ({ path: args.path, namespace: "svg" }));
    build.onLoad({ filter: /.*/, namespace: "svg" }, () => ({ contents: "<svg/>", loader: "text" }));
    // Workers lie beside the page's own script.
    build.onEnd((result) => {
      for (const file of result.outputFiles) {
        writeFileSync(file.path, file.text.replaceAll("../async_computation.bundle.js", "./async_computation.bundle.js"));
      }
    });
  },
};
await build({
  entryPoints: ["main", "chunk_worker", "async_computation"].map((name) => join(lib, `${name}.bundle.js`)),
  outdir: join(out, "neuroglancer"),
  bundle: true,
  format: "esm",
  target: "es2022",
  write: false,
  conditions: [
    "neuroglancer/datasource:none_by_default", "neuroglancer/kvstore:none_by_default",
    "neuroglancer/datasource/zarr:enabled", "neuroglancer/datasource/precomputed:enabled", "neuroglancer/kvstore/http:enabled",
  ],
  loader: { ".html": "file", ".wasm": "file", ".svg": "text" },
  assetNames: "[name]",
  plugins: [odd],
  logLevel: "error",
});

function wasms(folder) {
  for (const name of readdirSync(folder)) {
    const path = join(folder, name);
    if (statSync(path).isDirectory()) wasms(path);
    else if (name.endsWith(".wasm")) copyFileSync(path, join(out, "neuroglancer", name));
  }
}
wasms(lib);
writeFileSync(join(out, "neuroglancer/index.html"), `<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,">
<link rel="stylesheet" href="main.bundle.css"><div id="neuroglancer-container"></div><script type="module" src="main.bundle.js"></script>`);

await build({
  stdin: { contents: 'export * from "@niivue/niivue";', resolveDir: process.cwd() },
  outfile: join(out, "niivue/niivue.js"),
  bundle: true,
  format: "esm",
  logLevel: "error",
});
writeFileSync(join(out, "niivue/index.html"), `<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,"><canvas id="gl" width="320" height="240"></canvas>
<script type="module">import { Niivue } from "./niivue.js"; window.Niivue = Niivue;</script>`);
