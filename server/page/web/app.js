// The page: what was chosen, and what happens when something changes.

import {emptyNotice, noticeOf} from "/advice.js";
import {call, follow, session, takeFragment} from "/api.js";
import {
  farmLine, fillList, frameOfWorker, make, problemsOf, serverFacts, workerItem,
} from "/farm.js";
import {Strip, framesOf} from "/frames.js";
import {
  actionsOf, ask, fillLayers, followPreview, showFacts, showLog, showNotice, showReasons, showSettings,
} from "/job.js";
import {JobList} from "/list.js";
import {linkTo, saveAllFrames, savePng, saveResult} from "/save.js";
import {Viewer} from "/viewer.js";
import {TimeLeft, hasEnded, isDone, progressOf, stateOf} from "/words.js";

const $ = (id) => document.getElementById(id);
const EXPLAIN_MS = 3000;
const state = {
  user: null, jobs: new Map(), ids: [], more: false, workers: [], server: null, job: null, frame: 0,
  reasons: [], // of the job
  opened: false, // the job was opened by the page itself
};
const left = new Map();
let loops = new AbortController();
let closeLoops = new AbortController();

const viewer = new Viewer({
  viewer: $("viewer"), canvas: $("canvas"), box: $("pieces"), split: $("split"), values: $("values"),
  legend: $("legend"),
}, followPieces);
const strip = new Strip($("frames"), $("strip"), $("play"), (frame) => choose(state.job, frame));
strip.current = () => state.frame;
const list = new JobList({
  box: $("jobs"), count: $("job-count"), search: $("search"), user: $("of-user"), state: $("of-state"),
}, (id) => {
  choose(id);
  $("main").scrollIntoView({block: "nearest"});
});

function say(problem) {
  $("problem").textContent = problem;
  $("problem").hidden = !problem;
}

const complain = (error) => say(error.message);
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

/** Lists the jobs once what has arrived together is taken. */
function showJobsSoon() {
  clearTimeout(state.showing);
  state.showing = setTimeout(() => {
    showJobs();
    openNewest();
    showFarm();
  });
}

function showJobs() {
  const jobs = state.ids.filter((id) => state.jobs.has(id)).map((id) => state.jobs.get(id));
  list.fill(jobs, state.job, state.more);
  showEmpty();
}

/** The newest job opens by itself, until somebody has chosen one. */
function openNewest() {
  const newest = state.ids.find((id) => state.jobs.has(id));
  if (!newest || newest === state.job) return;
  const shown = state.jobs.get(state.job);
  if (state.job && !(state.opened && (!shown || hasEnded(shown)))) return;
  choose(newest);
  state.opened = true;
}

function showEmpty() {
  const isKnown = state.server !== null || state.user?.job;
  const notice = emptyNotice(state.workers.length, state.ids.length > 0, state.job);
  showNotice($("no-job"), isKnown && !state.jobs.has(state.job) ? notice : null);
}

function showFarm() {
  const problems = problemsOf(state.server, state.workers, [...state.jobs.values()]);
  fillList($("wrong"), problems.map(([text, job]) => {
    if (!job) return make("li", {text});
    const button = make("button", {type: "button", text, title: text});
    button.addEventListener("click", () => choose(job));
    return make("li", {}, button);
  }));
  $("farm-line").textContent = farmLine(state.server, state.workers);
  if (state.server) fillList($("server"), serverFacts(state.server));
  $("worker-count").textContent = String(state.workers.length);
  const itemOf = (worker) => workerItem(worker, workerActions(worker));
  fillList($("workers"), state.workers.map(itemOf));
  showEmpty();
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

const buttonOf = (job, [text, method, request, question, value]) => {
  const button = make("button", {type: "button", text});
  button.addEventListener("click", () => act(method, {job_id: job.job_id, ...request}, question, value));
  return button;
};

/** Fills a place with buttons, unless it has them. */
function fillActions(place, key, actions) {
  const shown = [key, ...actions.map(([text]) => text)].join();
  if (place.dataset.shown === shown) return;
  place.dataset.shown = shown;
  fillList(place, actions.map(([, makeButton]) => makeButton()));
}

function showJob() {
  const job = state.jobs.get(state.job);
  $("job").hidden = !job;
  showEmpty();
  if (!job) return;
  const seconds = secondsLeft(job);
  const elements =
    {title: $("job-title"), state: $("job-state"), progress: $("job-progress"), facts: $("job-facts")};
  showFacts(elements, job, seconds);
  list.renew(job, seconds);
  const actions = may("submit") ? actionsOf(job) : [];
  const buttons = actions.map((action) => [action[0], () => buttonOf(job, action)]);
  fillActions($("job-actions"), job.job_id, buttons);
  fillActions($("save"), `${job.job_id} ${state.frame}`, saveActions(job));
  showReason(job, actions);
  strip.fill(job.frames_done);
}

/** What leaves the page: of a picture that is finished, and a link. */
function saveActions(job) {
  const button = (text, title, save) => [text, () => {
    const element = make("button", {type: "button", text, title});
    element.addEventListener("click", () => save(element).then(() => say(""), complain));
    return element;
  }];
  const actions = [];
  const frame = state.frame;
  if (viewer.isFinished) {
    actions.push(button("EXR", "The file of this frame, with all its layers", () => saveResult(job, frame)));
    actions.push(button("PNG", "The picture as it is shown, at full resolution", async (element) => {
      const tell = (part) => (element.textContent = `PNG ${Math.round(100 * part)} %`);
      await savePng(job, frame, viewer, tell);
      element.textContent = "PNG";
    }));
  }
  if (job.frames_total > 1 && job.frames_done > 0) {
    const title = "The files of all finished frames, as a ZIP archive";
    actions.push(button("All frames", title, () => saveAllFrames(job)));
  }
  actions.push(button("Copy link", "A link to this job for others, which changes nothing", copyLink));
  return actions;
}

async function copyLink(element) {
  const {url, note} = await linkTo(state.jobs.get(state.job), state.frame, state.user);
  try {
    await navigator.clipboard.writeText(url);
    element.textContent = "Copied";
    element.title = note;
    setTimeout(() => (element.textContent = "Copy link"), 2000);
  } catch { // not allowed off loopback without encryption
    $("link-text").textContent = note;
    $("link-value").value = url;
    $("link").showModal();
    $("link-value").select();
  }
}

/** Why nothing is seen, or the job has failed: where the picture would be, or above one that is there. */
function showReason(job, actions) {
  const has = viewer.size !== null;
  const urgent = ["failed", "paused"].includes(stateOf(job));
  const notice = !has || urgent ? noticeOf(job, state.frame, state.reasons) : null;
  const offered = actions.filter(([text]) => ["Retry", "Skip", "Resume"].includes(text))
    .map((action) => [action[0], buttonOf(job, action)]);
  showNotice($("notice"), has ? null : notice, offered);
  showNotice($("banner"), has ? notice : null);
}

/** Asks why there is no picture, as long as there is none. */
async function explainOften() {
  for (;; await new Promise((done) => setTimeout(done, EXPLAIN_MS))) {
    const job = state.jobs.get(state.job);
    const isOpen = $("explain").open;
    if (!job || document.hidden || (!isOpen && (viewer.size || hasEnded(job)))) continue;
    await explainNow().catch(() => {});
  }
}

async function explainNow() {
  const id = state.job;
  const explained = await call("ExplainJob", {job_id: id});
  if (state.job !== id) return;
  state.reasons = explained.reasons;
  showReasons($("reasons"), explained.reasons);
  showSettings({spec: $("spec"), plan: $("plan"), planTitle: $("plan-title")}, explained);
  if (!state.jobs.has(id)) return;
  if (stateOf(explained.status) === "failed") state.jobs.get(id).error = explained.status.error; // all of it
  showJob();
}

/** Shows a job, and a frame of it. */
function choose(id, frame) {
  const job = state.jobs.get(id);
  const isNew = id !== state.job || (job && strip.job !== id);
  state.job = id;
  state.opened = false;
  state.frame = frame ?? (job ? framesOf(job)[0] : 0) ?? 0;
  history.replaceState(null, "", `#${new URLSearchParams({job: id, frame: state.frame})}`);
  if (isNew) {
    if (job) strip.open(job);
    state.reasons = [];
    for (const part of ["explain", "log", "settings"]) $(part).open = false;
    say("");
  }
  strip.mark(state.frame);
  list.mark(id);
  viewer.clear();
  const held = strip.pictures?.get(state.frame);
  if (held) viewer.show("", held);
  showJob();
  followPicture();
  if (isNew && job) explainNow().catch(complain);
}

/** A job that has ended without a frame has none. */
const hasPicture = (job) => Boolean(job) && (!hasEnded(job) || job.frames_done > 0);

function followPicture() {
  loops.abort();
  loops = new AbortController();
  if (!hasPicture(state.jobs.get(state.job))) return;
  const {job, frame} = state;
  for (const layer of viewer.seen) {
    followPreview({job, frame, layer}, loops.signal, (picture) => {
      fillLayers($("layer-a"), picture.layers, viewer.layers[0]);
      fillLayers($("layer-b"), picture.layers, viewer.layers[1]);
      viewer.show(layer, picture);
      if (layer === "") {
        strip.keep(frame, picture);
        list.keep(job, picture);
      }
      showJob();
    }, (error) => {
      if (error.status === 400) chooseLayer(viewer.layers.indexOf(layer), "");
      else if (error.status !== 409) say(error.message); // 409: it ended without it, as the notice says
    });
  }
}

/** What is looked at closely is fetched pixel by pixel, of a finished frame part by part. */
async function followPieces(names) {
  closeLoops.abort();
  closeLoops = new AbortController();
  const {signal} = closeLoops;
  const {job, frame} = state;
  const layers = viewer.seen;
  for (const region of names) {
    const fetched = layers.map((layer) => {
      const show = (picture) => viewer.showPiece(region, layer, picture);
      return followPreview({job, frame, layer, region}, signal, show, () => {});
    });
    await Promise.all(fetched);
    if (signal.aborted) return;
  }
}

function chooseLayer(side, layer) {
  viewer.layers[side] = layer;
  $(side ? "layer-b" : "layer-a").value = layer;
  if (viewer.previews.get(layer)?.finished) viewer.draw();
  else followPicture();
  viewer.lookCloser();
}

/** A side that comes into sight is fetched. */
function moveSplit() {
  viewer.draw();
  if (viewer.size && viewer.seen.some((layer) => !viewer.previews.has(layer))) followPicture();
  viewer.lookCloser();
}

function expose(value) {
  viewer.exposure = Math.min(Math.max(value, -8), 8);
  $("exposure").value = viewer.exposure;
  $("exposure-text").textContent = `${viewer.exposure > 0 ? "+" : ""}${viewer.exposure}`;
  viewer.draw();
}

/** The picture of a job that runs again is followed again. */
function takeJob(job) {
  const before = state.jobs.get(job.job_id);
  state.jobs.set(job.job_id, job);
  list.renew(job, secondsLeft(job));
  if (job.job_id !== state.job) return;
  if (before && hasEnded(before) && stateOf(before) === stateOf(job)) job.error = before.error; // all of it
  const opened = state.opened;
  if (!before || (hasEnded(before) && !hasEnded(job))) choose(job.job_id, state.frame);
  else if (stateOf(before) !== stateOf(job) && hasEnded(job)) explainNow().catch(complain);
  state.opened = opened;
  showJob();
}

const TAKE = {
  server: (server) => (state.server = server),
  workers: ({workers}) => (state.workers = workers),
  jobs: ({ids, more}) => {
    Object.assign(state, {ids, more});
    for (const id of state.jobs.keys()) {
      if (!ids.includes(id)) state.jobs.delete(id);
    }
    showJob();
    showJobsSoon();
  },
  job: (job) => {
    takeJob(job);
    if (!list.entries.has(job.job_id) || hasEnded(job)) showJobsSoon();
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
    $("split").value = Number($("split").value) < 1000 ? 1000 : 500;
    moveSplit();
  },
  ",": () => strip.step(-1, state.frame), ".": () => strip.step(1, state.frame),
  " ": () => strip.frames?.length > 1 && strip.toggle(),
  j: () => stepJob(1), k: () => stepJob(-1), "/": () => $("search").focus(), "?": () => $("help").showModal(),
};

function stepJob(by) {
  const ids = list.shown;
  const next = ids[Math.min(Math.max(ids.indexOf(state.job) + by, 0), ids.length - 1)];
  if (next) choose(next);
}

function onKey(event) {
  const types = event.target.closest("input, select, button, summary, dialog")
    && ![",", ".", "[", "]", "j", "k", "?", "c", "l"].includes(event.key);
  const hasModifier = event.ctrlKey || event.metaKey || event.altKey;
  if (types || hasModifier || ["number", "search"].includes(event.target.type)) return;
  if (document.querySelector("dialog[open]")) return;
  if (KEYS[event.key]) {
    event.preventDefault();
    KEYS[event.key]();
  }
}

function listen() {
  for (const [side, id] of [[0, "layer-a"], [1, "layer-b"]]) {
    $(id).addEventListener("change", (event) => chooseLayer(side, event.target.value));
  }
  $("split").addEventListener("input", moveSplit);
  $("exposure").addEventListener("input", (event) => expose(Number(event.target.value)));
  $("transform").addEventListener("change", (event) => {
    viewer.transform = event.target.value;
    viewer.draw();
  });
  $("fit").addEventListener("click", () => viewer.fit());
  $("help-button").addEventListener("click", () => $("help").showModal());
  $("controls-button").addEventListener("click", () => {
    const isOpen = $("controls").classList.toggle("open");
    $("controls-button").setAttribute("aria-expanded", String(isOpen));
  });
  for (const part of ["explain", "settings"]) {
    $(part).addEventListener("toggle", () => $(part).open && explainNow().catch(complain));
  }
  $("log").addEventListener("toggle", () => $("log").open && showLog($("events"), state.job).catch(complain));
  document.addEventListener("keydown", onKey);
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
    document.body.classList.toggle("one", Boolean(state.user.job));
    explainOften();
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
