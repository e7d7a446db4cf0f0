// Pictures and files that leave the page.

import {downloadUrl, ownSession, call, preview} from "/api.js";
import {drawBeside} from "/viewer.js";
import {gridOf} from "/pieces.js";

const LINK_HOURS = 48;

function saveAs(url, name) {
  const link = Object.assign(document.createElement("a"), {href: url, download: name});
  document.body.append(link);
  link.click();
  link.remove();
}

/** A file of the coordinator's, by the browser's own download. */
export async function saveResult(job, frame) {
  saveAs(await downloadUrl("result", job.job_id, frame), "");
}

export async function saveAllFrames(job) {
  saveAs(await downloadUrl("results", job.job_id), "");
}

/**
 * The whole frame at full resolution, as the viewer shows it: layers, exposure, view transform and split.
 * `progress` is called with parts of 1.
 */
export async function savePng(job, frame, viewer, progress) {
  const {width, height} = viewer.size;
  const canvas = new OffscreenCanvas(width, height);
  const context = canvas.getContext("2d");
  const middle = viewer.middleOf(width);
  const grid = gridOf(width, height);
  for (const [number, [x0, y0, x1, y1]] of grid.entries()) {
    progress(number / grid.length);
    const previews = new Map();
    for (const layer of viewer.seen) {
      const name = [x0, y0, x1, y1].join();
      const held = viewer.pieces.get(name)?.previews.get(layer);
      previews.set(layer, held ?? await preview(job.job_id, frame, layer, 0, undefined, name));
    }
    const part = new OffscreenCanvas(x1 - x0, y1 - y0);
    drawBeside(part, previews, viewer, Math.min(Math.max(middle - x0, 0), x1 - x0));
    context.drawImage(part, x0, y0);
  }
  progress(1);
  const name = (job.display_name || job.job_id).replace(/\.[^.]*$/, "");
  const suffix = job.frames_total > 1 ? `.${String(frame).padStart(4, "0")}` : "";
  const url = URL.createObjectURL(await canvas.convertToBlob({type: "image/png"}));
  saveAs(url, `${name}${suffix}.png`);
  setTimeout(() => URL.revokeObjectURL(url), 60000);
}

/** A link for others to this job alone, which changes nothing. */
export async function linkTo(job, frame, user) {
  const session = user.read_only ? ownSession()
    : (await call("CreatePageLink", {job_id: job.job_id, hours: LINK_HOURS})).session;
  const fragment = new URLSearchParams({session, job: job.job_id, frame});
  const time = user.read_only ? "" : ` Valid for ${LINK_HOURS} hours.`;
  const note = `Whoever has this link sees this job, and changes nothing.${time}`;
  return {url: `${location.origin}/#${fragment}`, note};
}
