// The files of a scene: the glTF file and those that it names.

import {createHash} from "node:crypto";
import {createReadStream} from "node:fs";
import {open, readFile} from "node:fs/promises";
import {dirname, join} from "node:path";

const GLB_MAGIC = 0x46546c67, JSON_CHUNK = 0x4e4f534a;

async function jsonOf(path) {
  const file = await open(path);
  try {
    const head = Buffer.alloc(20);
    const {bytesRead} = await file.read(head, 0, 20, 0);
    if (bytesRead < 20 || head.readUInt32LE(0) !== GLB_MAGIC) return JSON.parse(await readFile(path, "utf8"));
    const json = Buffer.alloc(head.readUInt32LE(12));
    const read = await file.read(json, 0, json.length, 20);
    if (head.readUInt32LE(16) !== JSON_CHUNK || read.bytesRead < json.length) throw new Error("too short");
    return JSON.parse(json.toString());
  } finally {
    await file.close();
  }
}

async function assetOf(path, uri) {
  const hash = createHash("sha256");
  let size = 0;
  for await (const part of createReadStream(path)) {
    hash.update(part);
    size += part.length;
  }
  return {path, ref: {uri, sha256: hash.digest("hex"), size}};
}

/** The file that a scene names: one within the scene's folder. */
function fileOf(scene, uri) {
  const name = decodeURIComponent(uri);
  const isOther = /^[a-z0-9+.-]{2,}:/i.test(uri) || name.startsWith("environment:") || name.startsWith("/");
  if (!name || isOther || name.includes("\0") || name.split("/").includes("..")) {
    throw new Error(`${scene}: '${uri}' is not the name of a file in its folder`);
  }
  return name;
}

/** The scene file first, with an empty uri. */
export async function assetsOf(scene) {
  const document = await jsonOf(scene).catch((error) => {
    throw error.code ? error : new Error(`${scene}: not a glTF file`);
  });
  if (!document?.asset) throw new Error(`${scene}: not a glTF file`);
  const assets = new Map([["", await assetOf(scene, "")]]);
  for (const {uri} of [...(document.buffers ?? []), ...(document.images ?? [])]) {
    if (uri === undefined || uri.startsWith("data:")) continue;
    const name = fileOf(scene, uri);
    if (!assets.has(name)) assets.set(name, await assetOf(join(dirname(scene), name), name));
  }
  return [...assets.values()];
}
