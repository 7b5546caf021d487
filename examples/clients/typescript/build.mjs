// Bundles each program into one file: `npm install && npm run build`.
import { copyFile, readFile } from "node:fs/promises";
import { basename } from "node:path";
import * as esbuild from "esbuild";

const folder = process.argv[2] ?? "dist";

// zenoh-ts checks key expressions in WebAssembly. esbuild does not import a .wasm file as a module, so this writes
// its bytes into the bundle, and the code that starts them.
const wasm = {
  name: "wasm",
  setup(build) {
    build.onLoad({ filter: /\.wasm$/ }, async ({ path }) => {
      const bytes = await readFile(path);
      const glue = `./${basename(path, ".wasm")}.js`;
      const names = WebAssembly.Module.exports(new WebAssembly.Module(bytes)).map((each) => each.name);
      return {
        contents: `
          import * as glue from "${glue}";
          const bytes = Uint8Array.from(atob("${bytes.toString("base64")}"), (c) => c.charCodeAt(0));
          const { instance } = await WebAssembly.instantiate(bytes, { "${glue}": glue });
          export const { ${names.join(", ")} } = instance.exports;
        `,
        loader: "js",
      };
    });
  },
};

const common = { bundle: true, format: "esm", target: "es2022", outdir: folder, plugins: [wasm], logLevel: "warning" };
await esbuild.build({ ...common, entryPoints: ["page.ts"] });
await esbuild.build({
  ...common,
  entryPoints: { robot: "node.ts", arc: "arc.ts" },
  outExtension: { ".js": ".mjs" },
  platform: "node",
  external: ["ws"],
});
await copyFile("page.html", `${folder}/index.html`);
