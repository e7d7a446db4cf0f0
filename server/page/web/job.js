// One job: its facts, what may be done with it, and the loops that fetch its picture.

import {call, preview} from "/api.js";
import {fillList, make, nameOf} from "/farm.js";
import {duration, hasEnded, isDone, mayRetry, progressOf, secondsOf, stateOf, timeOf} from "/words.js";

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

/** "2 in the filter, 40 %": of both together. */
function filteringText({frames_filtering: count, frames_filtered: done}) {
  return `${count} in the filter${done ? `, ${Math.floor((100 * done) / count)} %` : ""}`;
}

export function showFacts(elements, job, left) {
  const state = stateOf(job);
  const percent = Math.floor(100 * progressOf(job));
  elements.title.textContent = nameOf(job);
  elements.state.textContent = state;
  elements.state.className = `state ${state.split(" ")[0]}`;
  elements.progress.setAttribute("aria-valuenow", percent);
  elements.progress.firstElementChild.style.width = `${percent}%`;
  const samples = job.samples_per_pixel === 1 ? "1 sample" : `${job.samples_per_pixel} samples`;
  const facts = [`${job.width} × ${job.height}`, samples];
  if (!hasEnded(job)) facts.push(`${percent} %, ${job.units_done} of ${job.units_total} units`);
  if (job.frames_total > 1) facts.push(`${job.frames_done} of ${job.frames_total} frames`);
  if (job.frames_skipped) facts.push(`${job.frames_skipped} skipped: ${skippedFrames(job)}`);
  if (job.frames_filtering) facts.push(filteringText(job));
  if (job.frames_waiting) facts.push(`${job.frames_waiting} waiting for it`);
  if (job.workers) facts.push(`${job.workers} ${job.workers === 1 ? "worker" : "workers"}`);
  if (job.estimated_error !== undefined) facts.push(`error ${Number(job.estimated_error).toPrecision(3)}`);
  if (state === "running" && left !== null) facts.push(`${duration(left)} left`);
  const took = secondsOf(job);
  if (took > 0) facts.push(`${hasEnded(job) ? "took" : "for"} ${duration(took)}`);
  facts.push(`submitted ${timeOf(job.submitted_unix_ms)}`);
  elements.progress.hidden = hasEnded(job);
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
  if (mayRetry(job)) {
    const question = state === "done with gaps" ? "Render the skipped frames?" : "Render what is missing?";
    actions.push(["Retry", "RetryJob", {}, question]);
  }
  if (state === "failed" && job.scheduling?.gaps?.failed_frame !== undefined && job.frames_total > 1) {
    actions.push(["Skip", "RetryJob", {skip: true}, "Go on without the frames that cannot be rendered?"]);
  }
  if (isDone(job) && !job.adaptive) {
    const samples = ["samples_per_pixel", 2 * job.samples_per_pixel];
    actions.push(["More samples", "AddSamples", {}, "Samples of a pixel, in all", samples]);
  }
  if (hasEnded(job)) {
    actions.push(["Delete", "DeleteJob", {}, "Delete the job with its pictures? This cannot be undone."]);
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

export function showReasons(list, reasons) {
  const texts = reasons.length ? reasons.map((reason) => reason.text) : ["It runs as it should."];
  fillList(list, texts.map((text) => make("li", {text})));
}

const pairs = (facts) =>
  facts.flatMap(([term, value]) => [make("dt", {text: term}), make("dd", {text: String(value)})]);

const cropText = (crop) => `at ${crop.x}, ${crop.y} of ${crop.frame_width} × ${crop.frame_height}`;

/** Terms and values of what was submitted. */
function settingsOf(job) {
  const {settings: spec, scheduling} = job;
  const settings = [
    ["Job", job.job_id], ["Size", `${job.width} × ${job.height}`],
    ["Samples", job.adaptive ? `adaptive, at most ${job.samples_per_pixel}` : job.samples_per_pixel],
    ["Method", spec?.filter?.method || "default"], ["Camera", spec?.camera || "the scene's first"],
    ["Bounces", spec?.max_bounces], ["Seed", spec?.seed],
    ["Environment", spec?.environment?.uri?.replace(/^environment:/, "")],
    ["Lens", spec?.lens && `f/${spec.lens.f_stop}, focus at ${spec.lens.focus_metres} m`],
    ["Frames a second", spec?.frames_per_second || ""], ["Variant", spec?.variant],
    ["Animation", spec?.animation], ["Crop", spec?.crop && cropText(spec.crop)],
    ["Film kept", spec?.save_film ? "yes" : ""], ["Cryptomatte", spec?.cryptomatte ? "yes" : ""],
    ["Priority", scheduling?.priority || ""], ["Tags", (scheduling?.tags ?? []).join(", ")],
    ["Most leases", scheduling?.max_leases || ""], ["After", (scheduling?.after ?? []).join(", ")],
    ["Trace", scheduling?.trace_id],
  ];
  return settings.filter(([, value]) => value !== undefined && value !== null && value !== "");
}

function decisionText({value, source, reason}) {
  const who = {DECISION_SOURCE_SCENE: "scene", DECISION_SOURCE_PROBE: "probe", DECISION_SOURCE_FULL: "full",
    DECISION_SOURCE_FORCED: "forced"}[source] ?? "";
  return [value, who, reason].filter((part) => part !== "").join(" · ");
}

/** What was submitted, and what was decided of it. `explained`: of ExplainJob. */
export function showSettings(elements, {status, plan}) {
  fillList(elements.spec, pairs(settingsOf(status)));
  elements.planTitle.hidden = !plan;
  fillList(elements.plan, pairs((plan?.decisions ?? []).map((each) => [each.name, decisionText(each)])));
}

/** Shows a notice of advice.js, with what may be done. */
export function showNotice(box, notice, actions = []) {
  const text = notice && JSON.stringify([notice, actions.map(([label]) => label)]);
  box.hidden = !notice;
  if (!notice || box.dataset.shown === text) return;
  box.dataset.shown = text;
  box.classList.toggle("bad", Boolean(notice.isBad));
  fillList(box, [
    make("p", {className: "title", text: notice.title}),
    ...notice.lines.map((line) => make("p", {text: line})),
    ...(notice.commands ?? []).map((command) => make("p", {}, make("code", {text: command}))),
    ...(notice.advice ? [make("p", {className: "dim", text: notice.advice})] : []),
    ...(actions.length ? [make("p", {className: "actions"}, ...actions.map(([, button]) => button))] : []),
  ]);
}

export async function showLog(list, job) {
  const {events} = await call("GetLog", {job_id: job, limit: 200});
  const textOf = ({unix_ms: time, level, text}) =>
    `${new Date(Number(time)).toLocaleTimeString()} ${level} ${text}`;
  fillList(list, events.map((event) => make("li", {text: textOf(event)})));
}
