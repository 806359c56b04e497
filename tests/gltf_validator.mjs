// Usage: node gltf_validator.mjs <folder that holds node_modules> <file.glb>. Prints the issues as JSON.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { dirname, join, resolve } from "node:path";

const [folder, file] = process.argv.slice(2);
const validator = createRequire(join(resolve(folder), "index.js"))("gltf-validator");
const report = await validator.validateBytes(new Uint8Array(readFileSync(file)), {
  externalResourceFunction: async (uri) => new Uint8Array(readFileSync(join(dirname(file), uri))),
});
console.log(JSON.stringify(report.issues));
