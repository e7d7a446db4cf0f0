// Numbers and states in words.

export const STATES = {
  JOB_STATE_SUBMITTED: "submitted", JOB_STATE_PLANNED: "planned", JOB_STATE_RUNNING: "running",
  JOB_STATE_FILTERING: "filtering",
  JOB_STATE_DONE: "done", JOB_STATE_FAILED: "failed", JOB_STATE_CANCELLED: "cancelled",
  JOB_STATE_PAUSED: "paused", JOB_STATE_DONE_WITH_GAPS: "done with gaps",
};
const ENDED = ["done", "done with gaps", "failed", "cancelled"];

export function stateOf(job) {
  return STATES[job.state] ?? job.state;
}
export function isDone(job) {
  return ["done", "done with gaps"].includes(stateOf(job));
}
export function hasEnded(job) {
  return ENDED.includes(stateOf(job));
}

/** "2 h 5 min", "3 min", "40 s". */
export function duration(seconds) {
  const whole = Math.max(0, Math.round(seconds));
  if (whole < 90) return `${whole} s`;
  const minutes = Math.round(whole / 60);
  return minutes < 90 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

/** Part of a job's samples that is there, 0 to 1: units of a first pass are small. */
export function progressOf(job) {
  if (isDone(job)) return 1;
  const total = Number(job.samples_total);
  return total > 0 ? Math.min(1, Number(job.samples_done) / total) : 0;
}

/**
 * Guesses the time that a job needs from how fast its progress was seen to grow. Forgets what is older than
 * `memory` seconds.
 */
export class TimeLeft {
  constructor(memory = 60) {
    this.memory = memory;
    this.seen = [];
  }
  /** Seconds, or null while nothing is known. `now` in seconds. */
  add(progress, now) {
    if (this.seen.length && progress < this.seen.at(-1)[0]) this.seen = [];
    this.seen.push([progress, now]);
    while (this.seen.length > 2 && now - this.seen[0][1] > this.memory) this.seen.shift();
    const [first, then] = this.seen[0];
    return progress > first && now > then ? ((1 - progress) * (now - then)) / (progress - first) : null;
  }
}

export function bytes(count) {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let value = Number(count), unit = 0;
  while (value >= 1000 && unit < units.length - 1) {
    value /= 1000;
    ++unit;
  }
  return `${value >= 100 || unit === 0 ? value.toFixed(0) : value.toFixed(1)} ${units[unit]}`;
}
