// The list of jobs: rows in groups, what is searched for, and their small pictures.

import {preview} from "/api.js";
import {fillList, make, nameOf} from "/farm.js";
import {framesOf} from "/frames.js";
import {paint} from "/tone.js";
import {
  duration, groupOf, hasEnded, isDone, passes, progressOf, secondsOf, stateOf, timeOf, userOf,
} from "/words.js";

const THUMB_WIDTH = 64, THUMB_HEIGHT = 48;
/** Rows of groups that are open at first. */
const ROWS = 40;
/** Between two small pictures: they are made for nobody else. */
const THUMB_PAUSE_MS = 200;

/** The button of a job, made once and renewed with each status. */
class JobEntry {
  constructor(id, choose) {
    this.canvas = make("canvas", {width: THUMB_WIDTH, height: THUMB_HEIGHT, className: "thumb"});
    this.name = make("span", {className: "name"});
    this.state = make("span", {className: "state"});
    this.about = make("span", {className: "dim name"});
    this.bar = make("span");
    this.progress = make("span", {className: "bar"}, this.bar);
    this.button = make("button", {type: "button"}, this.canvas,
      make("span", {className: "texts"},
        make("span", {className: "row"}, this.name, make("span", {className: "grow"}), this.state),
        this.about, this.progress));
    this.button.addEventListener("click", () => choose(id));
    this.element = make("li", {}, this.button);
    this.element.dataset.job = id;
  }

  renew(job, chosen, left) {
    const state = stateOf(job);
    const percent = Math.floor(100 * progressOf(job));
    this.job = job;
    this.name.textContent = this.name.title = nameOf(job);
    this.state.textContent = state === "running" ? `${percent} %` : state;
    this.state.className = `state ${state.split(" ")[0]}`;
    this.bar.style.width = `${percent}%`;
    this.progress.hidden = hasEnded(job) || percent === 0;
    const seconds = secondsOf(job);
    const parts = [userOf(job), timeOf(job.submitted_unix_ms)];
    if (state === "running" && left !== null) parts.push(`${duration(left)} left`);
    else if (seconds > 0) parts.push(duration(seconds));
    parts.push(`${job.samples_per_pixel} spp`);
    if (job.frames_total > 1) parts.push(`${job.frames_total} frames`);
    if (job.scheduling?.priority) parts.push(`priority ${job.scheduling.priority}`);
    this.about.textContent = parts.join(" · ");
    this.about.title = `${job.job_id} · ${parts.join(" · ")}`;
    this.button.setAttribute("aria-current", String(chosen));
  }

  paint(picture) {
    const image = new ImageData(picture.preview_width, picture.preview_height);
    paint(picture, "", 0, "srgb", image.data);
    const full = new OffscreenCanvas(image.width, image.height);
    full.getContext("2d").putImageData(image, 0, 0);
    const scale = Math.max(THUMB_WIDTH / image.width, THUMB_HEIGHT / image.height);
    const [width, height] = [image.width * scale, image.height * scale];
    this.canvas.getContext("2d")
      .drawImage(full, (THUMB_WIDTH - width) / 2, (THUMB_HEIGHT - height) / 2, width, height);
    this.finished = picture.finished;
  }
}

export class JobList {
  /** `elements`: box, count, search, user, state. */
  constructor(elements, choose) {
    Object.assign(this, elements, {choose});
    this.entries = new Map();
    this.groups = new Map();
    this.waiting = new Set(); // rows on the screen without a picture
    const isSeen = (seen) => seen.forEach(({target, isIntersecting}) => {
      if (isIntersecting) this.waiting.add(target.dataset.job);
      else this.waiting.delete(target.dataset.job);
      this.fetchThumbs();
    });
    this.observer = new IntersectionObserver(isSeen);
    for (const element of [this.search, this.user, this.state]) {
      element.addEventListener("input", () => this.show());
    }
  }

  get filter() {
    return {text: this.search.value, user: this.user.value, state: this.state.value};
  }

  /** Takes the jobs, newest first, and whether there are more. */
  fill(jobs, chosen, more) {
    Object.assign(this, {jobs, chosen, more});
    const ids = new Set(jobs.map((job) => job.job_id));
    for (const [id, entry] of this.entries) {
      if (ids.has(id)) continue;
      this.observer.unobserve(entry.element);
      this.entries.delete(id);
    }
    for (const job of jobs) {
      if (this.entries.has(job.job_id)) continue;
      const entry = new JobEntry(job.job_id, this.choose);
      this.entries.set(job.job_id, entry);
      entry.renew(job, job.job_id === chosen, null);
      this.observer.observe(entry.element);
    }
    this.fillUsers();
    this.show();
  }

  fillUsers() {
    const users = [...new Set(this.jobs.map(userOf))].sort();
    if (this.user.dataset.users === users.join("\n")) return;
    this.user.dataset.users = users.join("\n");
    const chosen = users.includes(this.user.value) ? this.user.value : "";
    fillList(this.user, [make("option", {value: "", text: "All users"}),
      ...users.map((user) => make("option", {value: user, text: user}))]);
    this.user.value = chosen;
    this.user.hidden = users.length < 2;
  }

  /** Ids of the jobs that are listed, in their order. */
  get shown() {
    return this.listed.map((job) => job.job_id);
  }

  show() {
    const filter = this.filter;
    this.listed = this.jobs.filter((job) => passes(job, filter));
    const groups = groupBy(this.listed, (job) => groupOf(job));
    const ordered = [...groups].sort(([a], [b]) => (b === "Active") - (a === "Active"));
    this.listed = ordered.flatMap(([, jobs]) => jobs);
    let rows = 0;
    const sections = ordered.map(([name, jobs]) => {
      const section = this.sectionOf(name, rows < ROWS);
      rows += jobs.length;
      section.count.textContent = String(jobs.length);
      fillIfOther(section.list, jobs.map((job) => this.entries.get(job.job_id).element));
      return section.element;
    });
    this.search.parentElement.hidden = this.jobs.length === 0;
    if (!sections.length) {
      const text = this.jobs.length ? "No job is like that." : "There is no job yet.";
      sections.push(make("p", {className: "dim", text}));
    }
    fillIfOther(this.box, sections);
    const all = this.more ? `the newest ${this.jobs.length}` : String(this.jobs.length);
    const isAll = this.listed.length === this.jobs.length;
    this.count.textContent = isAll ? all : `${this.listed.length} of ${all}`;
  }

  sectionOf(name, open) {
    if (!this.groups.has(name)) {
      const count = make("span"), list = make("ol");
      const element = make("details", {className: "group", open},
        make("summary", {}, make("span", {text: name}), " ", count), list);
      this.groups.set(name, {element, list, count});
    }
    return this.groups.get(name);
  }

  renew(job, left) {
    const entry = this.entries.get(job.job_id);
    if (!entry) return;
    const at = this.jobs.findIndex((each) => each.job_id === job.job_id);
    const before = this.jobs[at];
    this.jobs[at] = job;
    entry.renew(job, job.job_id === this.chosen, left);
    if (stateOf(before) !== stateOf(job)) this.show();
    if (!entry.finished) this.fetchThumbs();
  }

  mark(id) {
    this.chosen = id;
    for (const [each, entry] of this.entries) entry.button.setAttribute("aria-current", String(each === id));
  }

  /** The picture of the chosen job is there anyhow. */
  keep(id, picture) {
    this.entries.get(id)?.paint(picture);
  }

  /** Fetches pictures of rows on the screen, one after the other. */
  async fetchThumbs() {
    if (this.fetching) return;
    this.fetching = true;
    try {
      for (let id = this.nextThumb(); id; id = this.nextThumb()) {
        const entry = this.entries.get(id);
        entry.tried = stateOf(entry.job);
        const frame = framesOf(entry.job)[0];
        const picture = await preview(id, frame, "", 0).catch(() => null);
        if (picture) entry.paint(picture);
        await new Promise((done) => setTimeout(done, THUMB_PAUSE_MS));
      }
    } finally {
      this.fetching = false;
    }
  }

  nextThumb() {
    return [...this.waiting].find((id) => {
      const entry = this.entries.get(id);
      return entry && !entry.finished && isDone(entry.job) && entry.tried !== stateOf(entry.job);
    });
  }
}

function groupBy(items, keyOf) {
  const groups = new Map();
  for (const item of items) {
    const key = keyOf(item);
    if (!groups.has(key)) groups.set(key, []);
    groups.get(key).push(item);
  }
  return groups;
}

/** Leaves a list alone that has these items: whoever reads it keeps the focus. */
function fillIfOther(list, items) {
  const isSame = list.children.length === items.length && items.every((item, i) => list.children[i] === item);
  if (!isSame) fillList(list, items);
}
