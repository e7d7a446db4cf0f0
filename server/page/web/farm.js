// The farm: its workers, its storage, and what is wrong.

import {bytes, duration, hasEnded, stateOf} from "/words.js";

/** An element with a class and a text. Texts of others are never markup. */
export function make(tag, {text, title, ...properties} = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  if (text !== undefined) element.textContent = text;
  if (title) element.title = title;
  element.append(...children);
  return element;
}

export function fillList(list, items) {
  list.replaceChildren(...items);
}

const WORKER_STATES = {
  WORKER_STATE_IDLE: "idle", WORKER_STATE_BUSY: "busy", WORKER_STATE_DRAINING: "draining",
  WORKER_STATE_SILENT: "silent",
  WORKER_STATE_SET_ASIDE: "set aside", WORKER_STATE_BLOCKED: "blocked", WORKER_STATE_RESTING: "resting",
};

export function nameOf(job) {
  return job.display_name || job.job_id;
}

export function workerItem(worker, actions) {
  const state = WORKER_STATES[worker.state] ?? worker.state;
  const speed = worker.seconds_per_unit > 0 ? ` · ${worker.seconds_per_unit.toFixed(2)} s a unit` : "";
  const about = `${worker.leases} leases, ${worker.slots} slots · ${worker.units_done} units${speed}`
    + (Number(worker.units_failed) ? ` · ${worker.units_failed} failed` : "");
  const item = make("li", {},
    make("div", {className: "row"},
      make("span", {className: "name", text: worker.name || worker.process, title: worker.process}),
      make("span", {className: "grow"}),
      make("span", {className: `state ${state === "busy" ? "done" : ""}`, text: state})),
    make("div", {className: "dim", text: about}));
  const note = (text, title) => item.append(make("div", {className: "dim name", text, ...title}));
  if (worker.reason) note(worker.reason, {title: worker.reason});
  if (worker.job_ids?.length) note(`renders ${worker.job_ids.join(", ")}`);
  if (actions.length) item.append(make("div", {className: "actions"}, ...actions));
  return item;
}

/** A line about a frame that a worker has rendered units of. */
export function frameOfWorker(frame) {
  const time = (ms) => new Date(Number(ms)).toLocaleString();
  const failures = Number(frame.failed) ? `, ${frame.failed} failed` : "";
  const units = `${frame.units} units${failures}, ${duration(frame.seconds)}`;
  return `${frame.job_id}, frame ${frame.frame}: ${units}`
    + ` · ${time(frame.first_unix_ms)} to ${time(frame.last_unix_ms)}`;
}

/** Failed jobs that are named; the list has all. */
const MOST_FAILURES = 3;

/** What an operator should know, in words: [text, id of a job that it is about]. */
export function problemsOf(server, workers, jobs) {
  const problems = [];
  if (server?.storage_error) problems.push([`The storage cannot be written: ${server.storage_error}`]);
  for (const worker of workers) {
    const state = WORKER_STATES[worker.state];
    if (["silent", "set aside", "blocked"].includes(state)) {
      problems.push([`Worker ${worker.name} is ${state}. ${worker.reason}`]);
    }
  }
  if (jobs.some((job) => !hasEnded(job)) && workers.length === 0) {
    problems.push(["Jobs wait, and no worker is connected."]);
  }
  const failed = jobs.filter((job) => stateOf(job) === "failed");
  for (const job of failed.slice(0, MOST_FAILURES)) {
    problems.push([`${nameOf(job)} failed: ${job.error}`, job.job_id]);
  }
  const others = failed.length - MOST_FAILURES;
  if (others > 0) problems.push([`${others} more ${others === 1 ? "job has" : "jobs have"} failed.`]);
  return problems;
}

/** The farm in a line. */
export function farmLine(server, workers) {
  if (!server) return "";
  const count = `${workers.length} ${workers.length === 1 ? "worker" : "workers"}`;
  // Workers have further leases in hand.
  return `${count} · ${Math.min(server.leases, server.slots)} of ${server.slots} slots busy`;
}

/** Terms and their values for the description list of the farm. */
export function serverFacts(server) {
  const facts = [
    ["Disk", `${bytes(server.free_bytes)} free`], ["Version", server.version],
  ];
  if (server.insecure) facts.push(["Connections", "not encrypted"]);
  for (const each of server.coordinators ?? []) {
    facts.push(["Coordinator", `${each.name} · ${each.active_jobs} jobs`]);
  }
  return facts.flatMap(([term, value]) => [make("dt", {text: term}), make("dd", {text: String(value)})]);
}
