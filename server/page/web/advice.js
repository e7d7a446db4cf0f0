// Why there is no picture, or a job does not go on, and what to do: in words.

import {hasEnded, mayRetry, stateOf} from "/words.js";

/** What somebody can do about a reason of ExplainJob, by its code. */
const ADVICE = {
  no_worker: "Start a worker: lumifold-worker --server HOST:PORT. If the job asks for tags or a class, the"
    + " worker needs them.",
  memory: "Start a worker on a machine with more memory, or make the textures smaller.",
  worker_unavailable: "Look at the workers above: readmit those that are blocked, or start another one.",
  slots_busy: "It waits for its turn. A higher priority gives it a larger share.",
  turn: "“To the front” moves it before the other jobs of its user.",
  max_leases: "The job was submitted with this limit (--max-leases).",
  paused: "Resume it when it shall go on.",
  after: "It starts by itself when they are done.",
  asset: "Submit the scene again: only what is missing is uploaded.",
  storage: "Free space on the coordinator's disk, or mend it. Rendering goes on by itself.",
  second_opinion: "Start another worker: it decides whether the scene or the machine is at fault.",
  backoff: "It tries again by itself.",
  worker_set_aside: "Look at the log of these workers: lumifold logs --worker NAME.",
};
/** Reasons that say that a job is being worked on. */
const WELL = new Set(["filter_running", "filter_worker", "filter_queue", "filtering", "slots_busy", "audit"]);

/**
 * What stands where the picture would be: {title, lines, advice, isBad}. `reasons` are those of ExplainJob,
 * empty as long as they are not known.
 */
export function noticeOf(job, frame, reasons) {
  const state = stateOf(job);
  const lines = reasons.map((reason) => reason.text);
  if (state === "failed") return failure(job);
  if (state === "cancelled") {
    const advice = "What was rendered is kept until the job is deleted: Retry goes on.";
    return {title: "Cancelled", lines: [], advice};
  }
  if (isSkipped(job, frame)) {
    return {title: `Frame ${frame} is skipped`, lines: ["It could not be rendered, and the others went on."],
      advice: "Retry renders the skipped frames.", isBad: true};
  }
  if (hasEnded(job)) return {title: "Loading the picture", lines: [], advice: ""};
  const advice = reasons.map((reason) => ADVICE[reason.code]).find(Boolean) ?? "";
  if (state === "paused") return {title: "Paused", lines: [], advice: ADVICE.paused};
  const stands = reasons.some((reason) => !WELL.has(reason.code));
  if (stands && !job.workers) return {title: "Waiting", lines, advice};
  if (state === "filtering") return {title: "Filtering the picture", lines, advice: ""};
  if (state === "running") {
    return {title: "Rendering: the first tiles come soon", lines, advice: ""};
  }
  return {title: "Waiting to begin", lines, advice};
}

function failure(job) {
  let advice;
  const frame = job.scheduling?.gaps?.failed_frame;
  if (!mayRetry(job)) {
    advice = "Nothing was rendered: the scene or its settings are at fault, and another try would end the"
      + " same way. Mend what is named here, and submit it again.";
  } else if (frame !== undefined && job.frames_total > 1) {
    advice = `Frame ${frame} failed. Retry renders it again, Skip goes on without it; what is`
      + " rendered is kept.";
  } else {
    advice = "What is rendered is kept. Retry renders the rest again; if it fails again, the log says on"
      + " which worker.";
  }
  const lines = [job.error || "The coordinator has no reason recorded."];
  return {title: "Failed", lines, advice, isBad: true};
}

function isSkipped(job, frame) {
  return (job.scheduling?.gaps?.skipped ?? [])
    .some(({first, count}) => frame >= first && frame < first + count);
}

/** What stands there without a job, or where the `chosen` one is unknown. */
export function emptyNotice(workers, hasJobs, chosen) {
  if (hasJobs && chosen) {
    const lines = ["It was deleted, or is older than those that are listed."];
    return {title: "This job is not in the list", lines, advice: ""};
  }
  if (hasJobs) return {title: "Choose a job to see its picture", lines: [], advice: ""};
  const lines = ["Submit a scene and its picture grows here:"];
  const commands = ["lumifold submit scene.glb --size 1280x720 --spp 256"];
  if (!workers) commands.unshift("lumifold-worker --server HOST:PORT");
  if (!workers) lines[0] = "No worker is connected yet. Start one, then submit a scene:";
  return {title: "No jobs yet", lines, commands, advice: ""};
}
