// Requests to the coordinator's calls over HTTP (docs/http.md), again where it is away.

import {request as requestPlain} from "node:http";
import {request as requestTls} from "node:https";
import {setTimeout as pause} from "node:timers/promises";

const PAUSES_MS = [100, 200, 500, 1000, 2000, 5000];
const SILENCE_MS = 60000;

/** `code` is that of the protocol, such as "NOT_FOUND"; "UNAVAILABLE" where no farm answers. */
export class FarmError extends Error {
  constructor(code, message) {
    super(message);
    this.name = "FarmError";
    this.code = code;
  }
}

export class Transport {
  constructor(origin, token, ca, patience) {
    Object.assign(this, {origin, token, ca, patience});
  }

  /** The answer as a stream, with its headers. Errors of the farm are thrown. */
  async once(method, path, body, headers = {}) {
    const make = this.origin.startsWith("https:") ? requestTls : requestPlain;
    const length = body === undefined ? {} : {"Content-Length": Buffer.byteLength(body)};
    const answer = await new Promise((resolve, reject) => {
      const all = {Authorization: `Bearer ${this.token}`, ...length, ...headers};
      const sent = make(new URL(path, this.origin), {method, ca: this.ca, headers: all}, resolve);
      sent.on("error", (error) => reject(new FarmError("UNAVAILABLE", `${this.origin}: ${error.message}`)));
      sent.setTimeout(SILENCE_MS, () => sent.destroy(new Error("it does not answer")));
      sent.end(body);
    });
    if (answer.statusCode < 300) return answer;
    const text = (await readAll(answer)).toString();
    const {statusCode} = answer;
    let error = {code: statusCode >= 500 ? "UNAVAILABLE" : "UNKNOWN", message: `HTTP ${statusCode}`};
    try {
      error = JSON.parse(text).error;
    } catch {} // not of the farm
    throw new FarmError(error.code, error.message);
  }

  /** Does what may be done twice until it succeeds, or the farm has been away for the patience. */
  async again(work) {
    const end = Date.now() + 1000 * this.patience;
    for (let tries = 0; ; ++tries) {
      try {
        return await work();
      } catch (error) {
        if (error.code !== "UNAVAILABLE" || Date.now() >= end) throw error;
        await pause(PAUSES_MS[Math.min(tries, PAUSES_MS.length - 1)]);
      }
    }
  }

  async json(method, path, body, headers) {
    return JSON.parse(await readAll(await this.once(method, path, body, headers)));
  }

  /** A call of the protocol that may be made twice. */
  call(name, message) {
    return this.again(() => this.callOnce(name, message));
  }

  callOnce(name, message) {
    const headers = {"Content-Type": "application/json"};
    return this.json("POST", `/api/call/${name}`, JSON.stringify(message), headers);
  }
}

export async function readAll(stream) {
  const parts = [];
  try {
    for await (const part of stream) parts.push(part);
  } catch (error) {
    throw new FarmError("UNAVAILABLE", `the answer broke off: ${error.message}`);
  }
  return Buffer.concat(parts);
}
