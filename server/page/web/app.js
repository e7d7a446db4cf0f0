// The page: what was chosen, and what happens when something changes.

import {call, follow, session, takeFragment} from "/api.js";
import {JobEntry, fillList, frameOfWorker, make, problemsOf, serverFacts, workerItem} from "/farm.js";
import {Strip, framesOf} from "/frames.js";
import {actionsOf, ask, explain, fillLayers, followPreview, showFacts, showLog} from "/job.js";
import {Viewer} from "/viewer.js";
import {TimeLeft, isDone, progressOf, stateOf} from "/words.js";

const $ = (id) => document.getElementById(id);
const state = {
  user: null, jobs: new Map(), ids: [], more: false, workers: [], server: null, job: null, frame: 0,
};
const entries = new Map();
const left = new Map();
let loops = new AbortController();
let closeLoops = new AbortController();

const viewer = new Viewer({
  viewer: $("viewer"), canvas: $("canvas"), region: $("region"), split: $("split"), waiting: $("waiting"),
  values: $("values"), legend: $("legend"),
}, followRegion);
const strip = new Strip($("frames"), $("strip"), $("play"), (frame) => choose(state.job, frame));
strip.current = () => state.frame;

function say(problem) {
  $("problem").textContent = problem;
  $("problem").hidden = !problem;
}

const may = (scope) => !state.user.read_only && state.user.scopes.includes(scope);

async function act(method, request, question, value) {
  const parts = {dialog: $("ask"), text: $("ask-text"), label: $("ask-label"), value: $("ask-value")};
  const answer = question ? await ask(parts, question, value) : true;
  if (answer === false) return;
  try {
    await call(method, value ? {...request, [value[0]]: answer} : request);
    say("");
  } catch (error) {
    say(error.message);
  }
}

function secondsLeft(job) {
  if (!left.has(job.job_id)) left.set(job.job_id, new TimeLeft());
  return left.get(job.job_id).add(progressOf(job), performance.now() / 1000);
}

function showJobs() {
  for (const id of entries.keys()) {
    if (!state.ids.includes(id)) entries.delete(id);
  }
  const shown = state.ids.filter((id) => state.jobs.has(id));
  for (const id of shown) {
    if (!entries.has(id)) entries.set(id, new JobEntry(id, (chosen) => choose(chosen)));
  }
  fillList($("jobs"), shown.map((id) => entries.get(id).element));
  $("job-count").textContent = state.more ? `the newest ${shown.length}` : String(shown.length);
  for (const id of shown) renewEntry(state.jobs.get(id), null);
}

function renewEntry(job, seconds) {
  entries.get(job.job_id)?.renew(job, job.job_id === state.job, seconds);
}

function showFarm() {
  const problems = problemsOf(state.server, state.workers, [...state.jobs.values()]);
  fillList($("wrong"), problems.map((text) => make("li", {text})));
  if (state.server) fillList($("server"), serverFacts(state.server));
  $("worker-count").textContent = String(state.workers.length);
  const itemOf = (worker) => workerItem(worker, workerActions(worker));
  fillList($("workers"), state.workers.map(itemOf));
}

function workerActions(worker) {
  const id = worker.worker_id || worker.name;
  const button = (text, method, question, fields = {}) => {
    const element = make("button", {type: "button", text});
    element.addEventListener("click", () => act(method, {worker: id, ...fields}, question));
    return element;
  };
  const history = make("button", {type: "button", text: "History"});
  history.addEventListener("click", () => showHistory(id).catch((error) => say(error.message)));
  if (!may("admin")) return [history];
  if (["WORKER_STATE_IDLE", "WORKER_STATE_BUSY", "WORKER_STATE_RESTING"].includes(worker.state))
    return [button("Stop", "DrainWorker", "Let the worker finish its units and end?", {finish_units: true}),
      button("Block", "BlockWorker", "Give the worker no more units?"), history];
  return [button("Readmit", "ReadmitWorker"), history];
}

async function showHistory(worker) {
  const {workers} = await call("ListWorkers", {worker});
  const frames = workers.flatMap((each) => each.history).reverse();
  $("history-title").textContent = `Last frames of ${workers[0]?.name ?? worker}`;
  fillList($("history-frames"), frames.map((frame) => make("li", {text: frameOfWorker(frame)})));
  $("history").showModal();
}

function showJob() {
  const job = state.jobs.get(state.job);
  $("no-job").hidden = Boolean(job);
  $("job").hidden = !job;
  if (!job) return;
  const seconds = secondsLeft(job);
  const elements =
    {title: $("job-title"), state: $("job-state"), progress: $("job-progress"), facts: $("job-facts")};
  showFacts(elements, job, seconds);
  renewEntry(job, seconds);
  const actions = may("submit") ? actionsOf(job) : [];
  const shown = actions.map((action) => action[0]).join();
  if ($("job-actions").dataset.shown !== `${job.job_id} ${shown}`) {
    $("job-actions").dataset.shown = `${job.job_id} ${shown}`;
    fillList($("job-actions"), actions.map(([text, method, request, question, value]) => {
      const button = make("button", {type: "button", text});
      button.addEventListener("click", () => act(method, {job_id: job.job_id, ...request}, question, value));
      return button;
    }));
  }
  strip.fill(job.frames_done);
}

/** Shows a job, and a frame of it. */
function choose(id, frame) {
  const job = state.jobs.get(id);
  const isNew = id !== state.job || (job && strip.job !== id);
  state.job = id;
  state.frame = frame ?? (job ? framesOf(job)[0] : 0) ?? 0;
  history.replaceState(null, "", `#${new URLSearchParams({job: id, frame: state.frame})}`);
  if (isNew) {
    if (job) strip.open(job);
    viewer.fitted = true;
    $("explain").open = $("log").open = false;
    say("");
  }
  strip.mark(state.frame);
  for (const each of state.ids) entries.get(each)?.button.setAttribute("aria-current", String(each === id));
  viewer.clear();
  showJob();
  followPicture();
}

function followPicture() {
  loops.abort();
  loops = new AbortController();
  if (!state.jobs.has(state.job)) return;
  for (const layer of new Set(viewer.layers)) {
    followPreview({job: state.job, frame: state.frame, layer}, loops.signal, (picture) => {
      fillLayers($("layer-a"), picture.layers, viewer.layers[0]);
      fillLayers($("layer-b"), picture.layers, viewer.layers[1]);
      viewer.show(layer, picture);
      if (layer === "") strip.keep(state.frame, picture);
    }, (error) => {
      if (error.status !== 400) $("waiting").textContent = error.message;
      else chooseLayer(viewer.layers.indexOf(layer), "");
    });
  }
}

/** What is looked at closely is fetched pixel by pixel. */
function followRegion(region) {
  closeLoops.abort();
  closeLoops = new AbortController();
  if (!region || !state.jobs.has(state.job)) return;
  for (const layer of new Set(viewer.layers)) {
    const show = (picture) => viewer.showRegion(region, layer, picture);
    followPreview({job: state.job, frame: state.frame, layer, region}, closeLoops.signal, show, () => {});
  }
}

function chooseLayer(side, layer) {
  viewer.layers[side] = layer;
  $(side ? "layer-b" : "layer-a").value = layer;
  if (viewer.previews.get(layer)?.finished) viewer.draw();
  else followPicture();
  viewer.lookCloser();
}

function expose(value) {
  viewer.exposure = Math.min(Math.max(value, -8), 8);
  $("exposure").value = viewer.exposure;
  $("exposure-text").textContent = `${viewer.exposure > 0 ? "+" : ""}${viewer.exposure}`;
  viewer.draw();
}

const isOver = (job) => isDone(job) || stateOf(job) === "failed";

/** The picture of a job that runs again is followed again. */
function takeJob(job) {
  const before = state.jobs.get(job.job_id);
  state.jobs.set(job.job_id, job);
  renewEntry(job, secondsLeft(job));
  if (job.job_id !== state.job) return;
  if (!before) choose(job.job_id, state.frame);
  else if (isOver(before) && !isOver(job)) choose(job.job_id, state.frame);
  showJob();
}

const TAKE = {
  server: (server) => (state.server = server),
  workers: ({workers}) => (state.workers = workers),
  jobs: ({ids, more}) => {
    Object.assign(state, {ids, more});
    showJobs();
  },
  job: (job) => {
    takeJob(job);
    if (!entries.has(job.job_id)) showJobs();
  },
};

const KEYS = {
  "+": () => viewer.zoomBy(2), "=": () => viewer.zoomBy(2), "-": () => viewer.zoomBy(0.5),
  0: () => viewer.fit(),
  ArrowLeft: () => viewer.moveBy(40, 0), ArrowRight: () => viewer.moveBy(-40, 0),
  ArrowUp: () => viewer.moveBy(0, 40), ArrowDown: () => viewer.moveBy(0, -40),
  "[": () => expose(viewer.exposure - 0.5), "]": () => expose(viewer.exposure + 0.5),
  l: () => {
    const options = [...$("layer-a").options].map((option) => option.value);
    if (options.length) chooseLayer(0, options[(options.indexOf(viewer.layers[0]) + 1) % options.length]);
  },
  c: () => {
    $("split").value = Number($("split").value) ? 0 : 500;
    viewer.draw();
  },
  ",": () => strip.step(-1, state.frame), ".": () => strip.step(1, state.frame),
  " ": () => strip.frames?.length > 1 && strip.toggle(),
  j: () => stepJob(1), k: () => stepJob(-1), "?": () => $("help").showModal(),
};

function stepJob(by) {
  const at = state.ids.indexOf(state.job);
  const next = state.ids[Math.min(Math.max(at + by, 0), state.ids.length - 1)];
  if (next) choose(next);
}

function listen() {
  for (const [side, id] of [[0, "layer-a"], [1, "layer-b"]]) {
    $(id).addEventListener("change", (event) => chooseLayer(side, event.target.value));
  }
  $("exposure").addEventListener("input", (event) => expose(Number(event.target.value)));
  $("transform").addEventListener("change", (event) => {
    viewer.transform = event.target.value;
    viewer.draw();
  });
  $("fit").addEventListener("click", () => viewer.fit());
  $("help-button").addEventListener("click", () => $("help").showModal());
  const complain = (error) => say(error.message);
  $("explain").addEventListener("toggle",
    () => $("explain").open && explain($("reasons"), state.job).catch(complain));
  $("log").addEventListener("toggle", () => $("log").open && showLog($("events"), state.job).catch(complain));
  document.addEventListener("keydown", (event) => {
    const types = event.target.closest("input, select, button, summary, dialog")
      && ![",", ".", "[", "]", "j", "k", "?", "c", "l"].includes(event.key);
    const hasModifier = event.ctrlKey || event.metaKey || event.altKey;
    if (types || hasModifier || event.target.type === "number") return;
    if (document.querySelector("dialog[open]")) return;
    if (KEYS[event.key]) {
      event.preventDefault();
      KEYS[event.key]();
    }
  });
  const preferred = matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark";
  setTheme(localStorage.getItem("lumifold-theme") ?? preferred);
  $("theme").addEventListener("click",
    () => setTheme(document.documentElement.classList.contains("light") ? "dark" : "light"));
}

function setTheme(theme) {
  document.documentElement.classList.toggle("light", theme === "light");
  $("theme").textContent = theme === "light" ? "Dark" : "Light";
  localStorage.setItem("lumifold-theme", theme);
}

async function run() {
  const fragment = takeFragment();
  listen();
  try {
    state.user = await session();
    state.job = state.user.job || fragment.get("job");
    state.frame = Number(fragment.get("frame") ?? NaN);
    if (Number.isNaN(state.frame)) state.frame = undefined;
    $("user").textContent = state.user.read_only ? "read only" : state.user.user;
    $("farm").hidden = Boolean(state.user.job);
    let lost = false;
    await follow((name, value) => {
      TAKE[name]?.(value);
      if (name !== "job") showFarm();
    }, (text, isLost) => {
      $("connection").textContent = text;
      $("connection").classList.toggle("lost", isLost);
      if (lost && !isLost && state.job) followPicture();
      lost = isLost;
    });
  } catch (error) {
    $("connection").textContent = "not connected";
    say(`${error.message}\nMake a new link with: lumifold page`);
  }
}

run();
