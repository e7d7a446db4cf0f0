// What node_package_test.py asks of the Node package: node_package.mjs ADDRESS SCENE FOLDER [TOKEN CA]. Prints JSON.

import {readFile} from "node:fs/promises";

const {Farm, FarmError, JobError} = await import(process.env.LUMIFOLD_NODE);
const [address, scene, folder, token, ca] = process.argv.slice(2);

const small = {size: [48, 32], samples: 2, maxBounces: 2, user: "ann"};
const farm = new Farm(address, {token, ca: ca && await readFile(ca)});
const uploads = [], states = [];
const job = await farm.render(scene, {...small, frames: [2, 1], framesPerSecond: 24, name: "a box",
  uploaded: (...bytes) => uploads.push(bytes)});
const early = await job.save(`${folder}/early.exr`).catch((error) => error);
const status = await job.wait({progress: ({state, progress}) => states.push([state, progress])});
await job.save(`${folder}/deep/second.exr`, 2);
await job.saveAll(`${folder}/all.zip`);
const broken = await farm.render(scene, {...small, user: undefined, camera: "no such camera"});
const failure = await broken.wait().catch((error) => error);
const paused = await farm.render(scene, {...small, paused: true, after: [job]});
await paused.resume();
const cancelled = await paused.cancel();
const listed = [];
for await (const each of farm.jobs({user: "ann"})) listed.push(each.id);
await broken.delete();
const gone = await broken.status().catch((error) => error);
const noScene = await farm.render(new URL(import.meta.url).pathname).catch((error) => error.message);
console.log(JSON.stringify({
  job: job.id, uploads, states, status, listed, noScene, early: [early instanceof FarmError, early.code],
  failure: [failure instanceof JobError, failure.message, failure.status?.state],
  cancelled: cancelled.state, gone: gone.code,
}));
