// One job: its facts, what may be done with it, and the loops that fetch its picture.

import {call, preview} from "/api.js";
import {fillList, make, nameOf} from "/farm.js";
import {duration, hasEnded, isDone, progressOf, stateOf} from "/words.js";

const PAUSE_MS = 300;
const LAYER_NAMES = {
  "": "Filtered", noisy: "Noisy", direct: "Direct", indirect: "Indirect", albedo: "Texture",
  emission: "Emission", glossy: "Glossy", reflection1: "Reflection", N: "Normal", Z: "Depth",
  distance: "Distance", id: "Objects", samples: "Samples", error: "Error", A: "Coverage",
};

const pause = (ms) => new Promise((done) => setTimeout(done, ms));

/**
 * Fetches a layer of a frame, or of a region of it, again and again, until the frame is finished or `signal`
 * ends it. One request at a time.
 */
export async function followPreview({job, frame, layer, region}, signal, take, fail) {
  let newer = 0;
  while (!signal.aborted) {
    if (document.hidden) {
      await new Promise((seen) => document.addEventListener("visibilitychange", seen, {once: true}));
      continue;
    }
    try {
      const picture = await preview(job, frame, layer, newer, signal, region);
      if (picture && !signal.aborted) {
        newer = picture.units;
        take(picture);
        if (picture.finished) return;
      }
    } catch (error) {
      if (signal.aborted) return;
      if ([400, 401, 403, 404, 409].includes(error.status)) return fail(error);
      await pause(5 * PAUSE_MS);
    }
    await pause(PAUSE_MS);
  }
}

export function fillLayers(select, layers, chosen) {
  if (select.dataset.layers === layers.join()) return;
  select.dataset.layers = layers.join();
  const order = Object.keys(LAYER_NAMES).filter((layer) => layers.includes(layer));
  fillList(select, order.map((layer) => make("option", {value: layer, text: LAYER_NAMES[layer]})));
  select.value = chosen;
}

/** "17, 20-22" */
function skippedFrames(job) {
  return (job.scheduling?.gaps?.skipped ?? [])
    .map(({first, count}) => (count > 1 ? `${first}-${first + count - 1}` : `${first}`)).join(", ");
}

export function showFacts(elements, job, left) {
  const state = stateOf(job);
  const percent = Math.floor(100 * progressOf(job));
  elements.title.textContent = nameOf(job);
  elements.state.textContent = state;
  elements.state.className = `state ${state.split(" ")[0]}`;
  elements.progress.setAttribute("aria-valuenow", percent);
  elements.progress.firstElementChild.style.width = `${percent}%`;
  const facts = [`${job.width} × ${job.height}`, `${job.samples_per_pixel} samples`,
    `${job.units_done} of ${job.units_total} units`];
  if (job.frames_total > 1) facts.push(`${job.frames_done} of ${job.frames_total} frames`);
  if (job.frames_skipped) facts.push(`${job.frames_skipped} skipped: ${skippedFrames(job)}`);
  if (job.frames_filtering) facts.push(`${job.frames_filtering} in the filter`);
  if (job.frames_waiting) facts.push(`${job.frames_waiting} waiting for it`);
  if (job.workers) facts.push(`${job.workers} ${job.workers === 1 ? "worker" : "workers"}`);
  if (job.estimated_error !== undefined) facts.push(`error ${Number(job.estimated_error).toPrecision(3)}`);
  if (!hasEnded(job) && left !== null) facts.push(`${duration(left)} left`);
  if (job.error) facts.push(job.error);
  elements.facts.textContent = facts.join(" · ");
}

/**
 * What may be done with a job now: [label, method, further fields of the request, question, value that is
 * asked for].
 */
export function actionsOf(job) {
  const state = stateOf(job);
  const actions = [];
  if (!hasEnded(job)) {
    actions.push(state === "paused" ? ["Resume", "ResumeJob"] : ["Pause", "PauseJob"]);
    const priority = ["priority", job.scheduling?.priority ?? 0];
    actions.push(["To the front", "SetJobPriority", {to_front: true}]);
    actions.push(["Priority", "SetJobPriority", {}, "Priority of the job, -100 to 100", priority]);
    actions.push(["Cancel", "CancelJob", {}, "Cancel the job? What is rendered so far is lost."]);
  }
  if (state === "failed") {
    actions.push(["Retry", "RetryJob", {}, "Render what failed again?"]);
    if (job.frames_total > 1) {
      actions.push(["Skip", "RetryJob", {skip: true}, "Go on without the frames that cannot be rendered?"]);
    }
  }
  if (state === "done with gaps") {
    actions.push(["Retry", "RetryJob", {}, "Render the skipped frames?"]);
  }
  if (isDone(job) && !job.adaptive) {
    const samples = ["samples_per_pixel", 2 * job.samples_per_pixel];
    actions.push(["More samples", "AddSamples", {}, "Samples of a pixel, in all", samples]);
  }
  return actions;
}

/** Asks in a dialog. False if the answer is no, otherwise what was typed, or true. */
export function ask(elements, question, value) {
  elements.text.textContent = question;
  elements.label.hidden = !value;
  if (value) elements.value.value = value[1];
  elements.dialog.returnValue = "";
  elements.dialog.showModal();
  return new Promise((answer) => {
    elements.dialog.addEventListener("close", () => {
      if (elements.dialog.returnValue !== "yes") return answer(false);
      answer(value ? Math.trunc(Number(elements.value.value)) : true);
    }, {once: true});
  });
}

export async function explain(list, job) {
  const {reasons} = await call("ExplainJob", {job_id: job});
  const texts = reasons.length ? reasons.map((reason) => reason.text) : ["It runs as it should."];
  fillList(list, texts.map((text) => make("li", {text})));
}

export async function showLog(list, job) {
  const {events} = await call("GetLog", {job_id: job, limit: 200});
  const textOf = ({unix_ms: time, level, text}) =>
    `${new Date(Number(time)).toLocaleTimeString()} ${level} ${text}`;
  fillList(list, events.map((event) => make("li", {text: textOf(event)})));
}
