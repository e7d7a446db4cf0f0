// Renders glTF scenes on a Lumifold farm, by the coordinator's calls over HTTP.

import {createHash, randomBytes} from "node:crypto";
import {createWriteStream} from "node:fs";
import {mkdir, open, rename, rm, stat} from "node:fs/promises";
import {userInfo} from "node:os";
import {basename, dirname} from "node:path";
import {pipeline} from "node:stream/promises";
import {setTimeout as pause} from "node:timers/promises";

import {assetsOf} from "./scene.js";
import {FarmError, Transport} from "./transport.js";

export {FarmError};

const PART = 1 << 20;
const LOOK_MS = 500, SLOWEST_LOOK_MS = 5000;
const ENDED = ["done", "done with gaps", "failed", "cancelled"];

/** A job that has not become a picture; `status` is its last one. */
export class JobError extends Error {
  constructor(status) {
    super(`${status.name} (${status.id}) ${status.state}${status.error ? `: ${status.error}` : ""}`);
    this.name = "JobError";
    this.status = status;
  }
}

function statusOf(message) {
  const state = message.state.replace("JOB_STATE_", "").toLowerCase().replaceAll("_", " ");
  const total = Number(message.samples_total);
  const isDone = state.startsWith("done");
  return {
    id: message.job_id, name: message.display_name || message.job_id, state, error: message.error, isDone,
    hasEnded: ENDED.includes(state),
    progress: isDone ? 1 : total > 0 ? Math.min(1, Number(message.samples_done) / total) : 0,
    framesDone: message.frames_done, framesTotal: message.frames_total, message,
  };
}

export class Farm {
  /**
   * `address`: that of the status page, such as "https://farm.example:7701", or a link of `lumifold page`.
   * `token`: of the farm, if the address is no link. `ca`: certificates in PEM, such as the farm's ca.pem.
   * `patience`: seconds for which calls wait for a farm that is away.
   */
  constructor(address, {token, ca, patience = 30} = {}) {
    const url = new URL(address);
    const session = new URLSearchParams(url.hash.slice(1)).get("session");
    if (!token && !session) throw new Error("a token, or a link of 'lumifold page', says how one gets in");
    this.transport = new Transport(url.origin, token ?? session, ca, patience);
  }

  /** Submits a scene, a .gltf or .glb file; files that the farm lacks are uploaded. See index.d.ts. */
  async render(path, {
    size = [1024, 768], samples = 64, frames = [0], camera = "", method = "default", maxBounces = 8, seed = 0,
    framesPerSecond = 0, name = "", user, priority = 0, tags = [], after = [],
    paused = false, webhook = "", spec = {}, uploaded = () => {},
  } = {}) {
    const [file, ...others] = await assetsOf(path);
    await this.#upload([file, ...others], uploaded);
    const [first, ...more] = rangesOf([frames].flat());
    const job = {
      scene: {file: file.ref, dependencies: others.map(({ref}) => ref), display_name: basename(path)},
      camera, width: size[0], height: size[1], samples_per_pixel: samples,
      first_frame: first.first, frame_count: first.count, more_frames: more, seed: String(seed),
      max_bounces: maxBounces, frames_per_second: framesPerSecond, filter: {method}, ...spec,
    };
    const scheduling = {
      name, user: user ?? await this.#user(), priority, tags, after: after.map(({id}) => id), paused, webhook,
    };
    const request = {spec: job, request_id: randomBytes(16).toString("hex"), scheduling};
    return new Job(this.transport, (await this.transport.call("SubmitJob", request)).job_id);
  }

  /** Whose a job is: the farm knows who has a token. */
  async #user() {
    const {user} = await this.transport.again(() => this.transport.json("GET", "/api/session"));
    return user === "local" ? userInfo().username : user;
  }

  async #upload(assets, uploaded) {
    const found = await this.transport.call("FindMissingAssets", {assets: assets.map(({ref}) => ref)});
    const lacking = new Map(assets.map((asset) => [asset.ref.sha256, asset]));
    const missing = found.missing_sha256.map((sha256) => lacking.get(sha256));
    const total = missing.reduce((sum, {ref}) => sum + ref.size, 0);
    let before = 0;
    for (const {path, ref} of missing) {
      await this.#uploadFile(path, ref, (bytes) => uploaded(before + bytes, total));
      before += ref.size;
    }
  }

  async #uploadFile(path, {sha256, size}, sent) {
    const file = await open(path);
    try {
      for (let complete = false; !complete;) {
        const found = await this.transport.call("FindUpload", {asset: {sha256, size}});
        let offset = Number(found.received_bytes);
        try {
          while (!complete) {
            const {buffer, bytesRead} = await file.read(Buffer.alloc(PART), 0, PART, offset);
            const query = new URLSearchParams({sha256, size, offset});
            const part = buffer.subarray(0, bytesRead);
            const answer = await this.transport.json("PUT", `/api/asset?${query}`, part);
            ({received_bytes: offset, complete} = answer);
            sent(offset);
          }
        } catch (error) {
          if (error.code !== "UNAVAILABLE") throw error; // FindUpload waits for the farm
        }
      }
    } finally {
      await file.close();
    }
  }

  job(id) {
    return new Job(this.transport, id);
  }

  /** The status of each job that the caller may see, newest first. */
  async* jobs({user = ""} = {}) {
    for (let token = ""; ;) {
      const page = await this.transport.call("ListJobs", {limit: 1000, page_token: token, user});
      yield* page.jobs.map(statusOf);
      if (!(token = page.next_page_token)) return;
    }
  }
}

export class Job {
  constructor(transport, id) {
    Object.assign(this, {transport, id});
  }

  async status() {
    return statusOf(await this.transport.call("GetJob", {job_id: this.id}));
  }

  /** Waits until the job is done; returns its status. `progress` is called with each status that differs. */
  async wait({progress = () => {}, signal} = {}) {
    let last = "";
    for (let wait = LOOK_MS; ; wait = Math.min(1.2 * wait, SLOWEST_LOOK_MS)) {
      const status = await this.status();
      const text = JSON.stringify(status.message);
      if (text !== last) progress(status);
      last = text;
      if (status.isDone) return status;
      if (status.hasEnded) throw new JobError(status);
      await pause(wait, undefined, {signal});
    }
  }

  /** Writes the OpenEXR file of a frame, by default of the first one. */
  save(path, frame) {
    const query = new URLSearchParams({job: this.id, ...(frame !== undefined && {frame})});
    return this.#download(`/api/result?${query}`, path, true);
  }

  /** Writes the files of all finished frames, as a ZIP archive. */
  saveAll(path) {
    return this.#download(`/api/results?${new URLSearchParams({job: this.id})}`, path, false);
  }

  /** A file has its name once it is whole. */
  async #download(url, path, resumes) {
    const part = `${path}.part`;
    await mkdir(dirname(path), {recursive: true});
    await rm(part, {force: true});
    try {
      const digest = await this.transport.again(() => this.#downloadOnce(url, part, resumes));
      if (digest && digest !== await sha256Of(part)) throw new FarmError("DATA_LOSS", `${path} is damaged`);
      await rename(part, path);
    } finally {
      await rm(part, {force: true});
    }
  }

  /** Returns the SHA-256 that the farm states, in base64. */
  async #downloadOnce(url, part, resumes) {
    const offset = resumes ? await stat(part).then(({size}) => size, () => 0) : 0;
    const headers = offset > 0 ? {Range: `bytes=${offset}-`} : {};
    const answer = await this.transport.once("GET", url, undefined, headers);
    try {
      await pipeline(answer, createWriteStream(part, {flags: answer.statusCode === 206 ? "a" : "w"}));
    } catch (error) {
      if (error.code !== "ECONNRESET") throw error;
      throw new FarmError("UNAVAILABLE", "the download broke off");
    }
    return /sha-256=:(.*):/.exec(answer.headers["repr-digest"])?.[1];
  }

  async explain() {
    return (await this.transport.call("ExplainJob", {job_id: this.id})).reasons;
  }

  async cancel() {
    return statusOf(await this.transport.call("CancelJob", {job_id: this.id}));
  }

  async pause() {
    return statusOf(await this.transport.call("PauseJob", {job_id: this.id}));
  }

  async resume() {
    return statusOf(await this.transport.call("ResumeJob", {job_id: this.id}));
  }

  async retry({frames = [], skip = false} = {}) {
    return statusOf(await this.transport.callOnce("RetryJob", {job_id: this.id, frames, skip}));
  }

  /** Deletes the job, which must have ended, with its pictures. */
  async delete() {
    await this.transport.call("DeleteJob", {job_id: this.id});
  }
}

async function sha256Of(path) {
  const hash = createHash("sha256");
  const file = await open(path);
  for await (const part of file.createReadStream()) hash.update(part);
  return hash.digest("base64");
}

function rangesOf(frames) {
  const ranges = [];
  for (const frame of [...new Set(frames)].sort((a, b) => a - b)) {
    const last = ranges.at(-1);
    if (last && frame === last.first + last.count) ++last.count;
    else ranges.push({first: frame, count: 1});
  }
  if (!ranges.length) throw new Error("frames: there is none");
  return ranges;
}
