// The frames of an animation: a strip of small pictures that plays.

import {preview} from "/api.js";
import {make} from "/farm.js";
import {paint} from "/tone.js";

const THUMB = 72;
/** Small pictures that are fetched for a job, at most. */
const MOST = 240;
/** Previews that are kept, so that frames play without being fetched again. */
const MOST_PICTURES = 64;
const FRAME_MS = 1000 / 12;
const REFILL_MS = 1000;

export function framesOf(job) {
  const frames = [];
  for (const range of [{first: job.first_frame, count: job.frame_count}, ...(job.more_frames ?? [])]) {
    for (let i = 0; i < range.count && frames.length < MOST; ++i) frames.push(range.first + i);
  }
  return frames;
}

export class Strip {
  constructor(box, list, button, choose) {
    Object.assign(this, {box, list, button, choose});
    button.addEventListener("click", () => this.toggle());
  }

  /** Makes the strip of a job; `has(frame)` is called when its small picture is there. */
  open(job) {
    this.stop();
    this.job = job.job_id;
    this.frames = framesOf(job);
    this.thumbs = new Map();
    this.pictures = new Map();
    this.box.hidden = this.frames.length < 2;
    if (this.box.hidden) return;
    this.list.replaceChildren(...this.frames.map((frame) => {
      const canvas = make("canvas", {width: THUMB, height: 48});
      const button = make("button", {type: "button", title: `Frame ${frame}`}, canvas);
      button.setAttribute("aria-label", `Frame ${frame}`);
      button.addEventListener("click", () => this.choose(frame));
      this.thumbs.set(frame, {canvas, button, finished: false});
      return make("li", {}, button);
    }));
  }

  mark(frame) {
    for (const [number, {button}] of this.thumbs ?? []) {
      button.setAttribute("aria-current", String(number === frame));
    }
  }

  /** A picture of a frame was fetched, for the viewer or for the strip. */
  keep(frame, picture) {
    const thumb = this.thumbs?.get(frame);
    if (!thumb || this.box.hidden) return;
    const full = new OffscreenCanvas(picture.preview_width, picture.preview_height);
    const image = new ImageData(picture.preview_width, picture.preview_height);
    paint(picture, "", 0, "srgb", image.data);
    full.getContext("2d").putImageData(image, 0, 0);
    thumb.canvas.width = Math.round((48 * picture.preview_width) / picture.preview_height);
    thumb.canvas.getContext("2d").drawImage(full, 0, 0, thumb.canvas.width, 48);
    thumb.finished = picture.finished;
    this.pictures.set(frame, picture);
    if (this.pictures.size > MOST_PICTURES) this.pictures.delete(this.pictures.keys().next().value);
  }

  /** Fetches finished frames that are missing, one after the other. */
  async fill(framesDone) {
    if (this.filling || this.box.hidden) return;
    this.filling = true;
    const job = this.job;
    try {
      const most = Math.max(framesDone, 0) + 2;
      let missing = [...this.thumbs].filter(([, thumb]) => !thumb.finished).slice(0, most);
      for (const [frame] of missing) {
        const picture = await preview(job, frame, "", 0).catch(() => null);
        if (this.job !== job) return;
        if (picture) this.keep(frame, picture);
      }
    } finally {
      this.filling = false;
    }
    // Frames that were finished meanwhile, whether or not the job changes again.
    const finished = [...this.thumbs.values()].filter((thumb) => thumb.finished).length;
    if (finished < Math.min(framesDone, this.frames.length)) {
      setTimeout(() => this.job === job && this.fill(framesDone), REFILL_MS);
    }
  }

  step(by, frame) {
    const at = this.frames.indexOf(frame);
    if (at >= 0) this.choose(this.frames[(at + by + this.frames.length) % this.frames.length]);
  }

  toggle() {
    if (this.timer) return this.stop();
    this.button.textContent = "Stop";
    this.timer = setInterval(() => this.step(1, this.current()), FRAME_MS);
  }

  stop() {
    clearInterval(this.timer);
    this.timer = null;
    this.button.textContent = "Play";
  }
}
