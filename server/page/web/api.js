// Calls of the coordinator, in the name of the link's maker.

import {eventReader, parsePreview} from "/decode.js";

const KEY = "lumifold-session";
const PAUSES = [500, 1000, 2000, 4000, 5000];

/** What was in the link; the secret is taken out of the address bar. */
export function takeFragment() {
  const fragment = new URLSearchParams(location.hash.slice(1));
  if (fragment.has("session")) {
    sessionStorage.setItem(KEY, fragment.get("session"));
    fragment.delete("session");
    history.replaceState(null, "", `#${fragment}`);
  }
  return fragment;
}

export class ApiError extends Error {
  constructor(status, code, message) {
    super(message);
    this.status = status;
    this.code = code;
  }
}

async function fetchApi(path, options = {}) {
  const answer = await fetch(`/api/${path}`, {
    ...options,
    headers: {...options.headers, Authorization: `Bearer ${sessionStorage.getItem(KEY) ?? ""}`},
    cache: "no-store",
  });
  if (answer.ok) return answer;
  const unknown = {error: {code: "UNKNOWN", message: `HTTP ${answer.status}`}};
  const {error} = await answer.json().catch(() => unknown);
  throw new ApiError(answer.status, error.code, error.message);
}

export async function session() {
  return (await fetchApi("session")).json();
}

export async function call(method, request = {}) {
  const answer = await fetchApi(`call/${method}`, {
    method: "POST", headers: {"Content-Type": "application/json"}, body: JSON.stringify(request),
  });
  return answer.json();
}

/**
 * A preview that is newer than the units `newer`, of all or of the `region` "x0,y0,x1,y1"; null if there is
 * none yet.
 */
export async function preview(job, frame, layer, newer, signal, region) {
  const query = new URLSearchParams({job, frame, layer, newer, ...(region && {region})});
  const answer = await fetchApi(`preview?${query}`, {signal});
  return answer.status === 204 ? null : parsePreview(await answer.arrayBuffer());
}

/** A URL from which the browser itself downloads: `what` is "result" or "results", for a minute. */
export async function downloadUrl(what, job, frame) {
  const {ticket} = await (await fetchApi(`ticket?${new URLSearchParams({job})}`, {method: "POST"})).json();
  return `/api/${what}?${new URLSearchParams({job, ...(frame !== undefined && {frame}), ticket})}`;
}

/** The link's own secret, for a link to what it shows. */
export const ownSession = () => sessionStorage.getItem(KEY) ?? "";

/**
 * Follows the farm for as long as the link is valid: `take(name, value)` for each event, `state(text, lost)`
 * for the connection. Ends with the error of a link that is not valid.
 */
export async function follow(take, state) {
  for (let lost = 0; ; ++lost) {
    try {
      const reader = (await fetchApi("events")).body.getReader();
      const read = eventReader(take);
      state("connected", false);
      for (let part = await reader.read(); !part.done; part = await reader.read()) {
        read(part.value);
        lost = 0;
      }
    } catch (error) {
      if (error.status === 401 || error.status === 403) throw error;
    }
    state("connection lost, trying again", true);
    await new Promise((done) => setTimeout(done, PAUSES[Math.min(lost, PAUSES.length - 1)]));
  }
}
