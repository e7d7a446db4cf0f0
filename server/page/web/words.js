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

/** "12:04", "Mon 12:04", "3 Nov": as short as it can be at the time `now`, both in milliseconds. */
export function timeOf(unixMs, now = Date.now()) {
  const time = new Date(Number(unixMs)), today = new Date(now);
  const clock = time.toLocaleTimeString([], {hour: "2-digit", minute: "2-digit"});
  if (time.toDateString() === today.toDateString()) return clock;
  const days = daysBetween(time, today);
  if (days < 7) return `${time.toLocaleDateString([], {weekday: "short"})} ${clock}`;
  const year = time.getFullYear() === today.getFullYear() ? {} : {year: "numeric"};
  return time.toLocaleDateString([], {day: "numeric", month: "short", ...year});
}

function daysBetween(early, late) {
  const midnight = (time) => new Date(time.getFullYear(), time.getMonth(), time.getDate()).getTime();
  return Math.round((midnight(late) - midnight(early)) / 86400000);
}

/** The heading under which a list has a job. */
export function groupOf(job, now = Date.now()) {
  if (!hasEnded(job)) return "Active";
  const time = new Date(Number(job.submitted_unix_ms));
  const days = daysBetween(time, new Date(now));
  if (days <= 0) return "Today";
  if (days === 1) return "Yesterday";
  if (days < 7) return "This week";
  return time.toLocaleDateString([], {month: "long", year: "numeric"});
}

/** Seconds from the first unit to the last file, as far as that is; 0: nothing has begun. */
export function secondsOf(job) {
  const times = job.times ?? {};
  return ["render_seconds", "assemble_seconds", "filter_seconds", "write_seconds"]
    .reduce((sum, name) => sum + (times[name] ?? 0), 0);
}

/** Whether a job passes what is typed and chosen above the list: {text, user, state}. */
export function passes(job, filter) {
  const state = stateOf(job);
  if (filter.user && userOf(job) !== filter.user) return false;
  if (filter.state === "active" && hasEnded(job)) return false;
  if (filter.state === "done" && !isDone(job)) return false;
  if (["failed", "cancelled"].includes(filter.state) && state !== filter.state) return false;
  const text = filter.text.trim().toLowerCase();
  const texts = [job.display_name, job.job_id, userOf(job)];
  return !text || texts.some((each) => each?.toLowerCase().includes(text));
}

export function userOf(job) {
  return job.scheduling?.user || "anonymous";
}

/**
 * Whether rendering a failed job again can end otherwise: not where workers have said of the scene itself
 * that it cannot be rendered, which is before the first sample.
 */
export function mayRetry(job) {
  if (stateOf(job) === "done with gaps" || stateOf(job) === "cancelled") return true;
  const waited = (job.scheduling?.after ?? []).length > 0;
  return stateOf(job) === "failed" && (Number(job.samples_done) > 0 || waited);
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
