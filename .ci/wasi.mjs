// Runs a program built for wasm32-wasip1:
// node --no-turbo-fast-api-calls .ci/wasi.mjs program.wasm [arguments].
// It gets the environment and standard output, but no folders.
import { readFile } from "node:fs/promises";
import { WASI } from "node:wasi";

const args = process.argv.slice(2);
const wasi = new WASI({ version: "preview1", args, env: process.env });
const program = await WebAssembly.compile(await readFile(args[0]));
// A panic traps, which ends node with an error.
process.exitCode = wasi.start(await WebAssembly.instantiate(program, wasi.getImportObject()));
