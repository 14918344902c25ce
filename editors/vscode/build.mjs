// Builds dist/: the extension and its libraries in one file, and the grammar of the folder above.
// Non-goals: packaging (`npm run package`).
import { copyFileSync, mkdirSync } from "node:fs";
import { build } from "esbuild";

mkdirSync("dist", { recursive: true });
copyFileSync("../soter.tmLanguage.json", "dist/soter.tmLanguage.json");
await build({
  entryPoints: ["src/extension.js"],
  outfile: "dist/extension.js",
  bundle: true,
  platform: "node",
  target: "node20",
  format: "cjs",
  external: ["vscode"],
  minify: true,
});
