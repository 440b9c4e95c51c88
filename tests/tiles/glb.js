// Validates binary glTF with Khronos' validator: node glb.js FILE... Prints for each file the codes of its errors and
// warnings; exit status 1 if there are any.

import { readFile } from 'node:fs/promises';
import validator from 'gltf-validator';

for (const path of process.argv.slice(2)) {
  const report = await validator.validateBytes(new Uint8Array(await readFile(path)), { maxIssues: 100 });
  const wrong = report.issues.messages.filter(({ severity }) => severity < 2).map(({ code, pointer }) => `${code} ${pointer}`);
  console.log(JSON.stringify({ path, wrong }));
  if (wrong.length > 0) process.exitCode = 1;
}
