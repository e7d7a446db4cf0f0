// The page's own arithmetic and texts, without a browser.

import assert from "node:assert/strict";
import {readFile} from "node:fs/promises";
import {test} from "node:test";

// Node takes a file .js as a module of another kind; its text it takes as it is, with what it imports.
async function urlOf(name) {
  let text = await readFile(`${process.env.LUMIFOLD_WEB}/${name}`, "utf8");
  for (const [whole, other] of text.matchAll(/from "\/([a-z]+\.js)"/g)) text = text.replace(whole, `from "${await urlOf(other)}"`);
  return `data:text/javascript,${encodeURIComponent(text)}`;
}
const web = async (name) => import(await urlOf(name));
const {HALVES, eventReader, parsePreview} = await web("decode.js");
const {colourOfId, filmic, heat, paint, rangeOf, toneOf} = await web("tone.js");
const {TimeLeft, bytes, duration, groupOf, mayRetry, passes, progressOf, timeOf} = await web("words.js");
const {gridOf, piecesOf} = await web("pieces.js");
const {emptyNotice, noticeOf} = await web("advice.js");

function previewBytes(about, numbers) {
  const text = new TextEncoder().encode(JSON.stringify(about));
  const buffer = new ArrayBuffer(4 + text.length + numbers.length);
  new DataView(buffer).setUint32(0, text.length, true);
  new Uint8Array(buffer, 4, text.length).set(text);
  new Uint8Array(buffer, 4 + text.length).set(numbers);
  return buffer;
}

test("halves", () => {
  for (const [bits, value] of [[0, 0], [0x3c00, 1], [0xc000, -2], [0x7bff, 65504], [1, 2 ** -24], [0x03ff, 1023 * 2 ** -24], [0x7c00, Infinity]])
    assert.equal(HALVES[bits], value);
  assert.ok(Number.isNaN(HALVES[0x7e00]));
});

test("a preview has halves and floats behind an odd text", () => {
  const about = {preview_width: 2, preview_height: 1, types: ["half", "float"], note: "é"};
  const preview = parsePreview(previewBytes(about, [0, 0x3c, 0, 0xc0, 0, 0, 0x80, 0x3f, 0, 0, 0, 0xc0]));
  assert.deepEqual(preview.planes.map((plane) => [...plane]), [[1, -2], [1, -2]]);
  assert.throws(() => parsePreview(previewBytes(about, [0])));
});

test("events arrive in any pieces", () => {
  const stream = new TextEncoder().encode(": ping\n\nevent: job\ndata: {\"name\":\"é\\n\"}\n\nevent: jobs\ndata: {\"ids\":[]}\n\n");
  for (let size = 1; size <= stream.length; ++size) {
    const seen = [];
    const read = eventReader((name, value) => seen.push([name, value]));
    for (let at = 0; at < stream.length; at += size) read(stream.subarray(at, at + size));
    assert.deepEqual(seen, [["job", {name: "é\n"}], ["jobs", {ids: []}]]);
  }
});

test("tones begin at black and end at white", () => {
  for (const transform of ["srgb", "filmic", "raw"]) {
    const tone = toneOf(transform);
    assert.equal(tone(0), 0);
    assert.equal(tone(-1), 0);
    assert.equal(tone(NaN), 0);
    let last = 0;
    for (let x = 0; x <= 12; x += 0.01) {
      assert.ok(tone(x) >= last);
      last = tone(x);
    }
    assert.equal(last, 255);
  }
  assert.equal(toneOf("srgb")(0.18), 118);
  assert.ok(filmic(4) < 1 && filmic(1) < 1);
});

test("each kind of layer is painted", () => {
  const preview = {preview_width: 2, preview_height: 1, planes: [Float32Array.of(0, 2), Float32Array.of(0, 2), Float32Array.of(0, 2)]};
  const painted = (layer, planes = preview.planes) => {
    const pixels = new Uint8ClampedArray(8);
    return [paint({...preview, planes}, layer, -1, "srgb", pixels), [...pixels]];
  };
  assert.deepEqual(painted(""), ["", [0, 0, 0, 255, 255, 255, 255, 255]]);
  assert.deepEqual(painted("N", preview.planes.map(() => Float32Array.of(0, 1)))[1], [128, 128, 128, 255, 255, 255, 255, 255]);
  for (const layer of ["Z", "samples", "error", "id"]) {
    const [legend, pixels] = painted(layer, [Float32Array.of(0, 2)]);
    assert.notEqual(legend, "");
    assert.deepEqual(pixels.slice(0, 4), [0, 0, 0, 255]);
    assert.ok(pixels[4] + pixels[5] + pixels[6] > 0, layer);
  }
  const alpha = [...preview.planes, Float32Array.of(0, 0.5)];
  const pixels = new Uint8ClampedArray(8);
  paint({...preview, planes: alpha, channels: ["R", "G", "B", "A"]}, "", -2, "srgb", pixels);
  assert.deepEqual([...pixels], [0, 0, 0, 0, 255, 255, 255, 128], "as bright as without A, and half of it is there");
  assert.deepEqual(rangeOf(Float32Array.of(0, 3, Infinity, 1, NaN)), [1, 3]);
  assert.deepEqual(rangeOf(Float32Array.of(0)), [0, 1]);
  assert.notDeepEqual(colourOfId(1), colourOfId(2));
  assert.ok(heat(1)[1] > heat(0)[1]);
});

test("numbers in words", () => {
  assert.equal(duration(3), "3 s");
  assert.equal(duration(600), "10 min");
  assert.equal(duration(7500), "2 h 5 min");
  assert.equal(bytes("74625056768"), "74.6 GB");
  assert.equal(progressOf({state: "JOB_STATE_RUNNING", samples_done: "5", samples_total: "20"}), 0.25);
  assert.equal(progressOf({state: "JOB_STATE_DONE", samples_done: "0", samples_total: "0"}), 1);
  assert.equal(progressOf({state: "JOB_STATE_RUNNING", samples_done: "0", samples_total: "0"}), 0);
});

test("time left", () => {
  const left = new TimeLeft();
  assert.equal(left.add(0, 0), null);
  assert.equal(left.add(0.25, 10), 30);
  assert.equal(left.add(0.5, 20), 20);
  assert.equal(left.add(0.1, 30), null, "it runs again");
  assert.equal(left.add(0.2, 40), 80);
});

test("times and groups are as short as they can be", () => {
  const now = new Date(2026, 10, 18, 15, 0).getTime(); // a Wednesday
  const at = (...date) => new Date(...date).getTime();
  assert.match(timeOf(at(2026, 10, 18, 9, 5), now), /^0?9:05/);
  assert.match(timeOf(at(2026, 10, 17, 23, 59), now), /Tue/);
  assert.match(timeOf(at(2026, 10, 3), now), /Nov/);
  assert.match(timeOf(at(2025, 10, 3), now), /2025/);
  const groups = [at(2026, 10, 18, 0, 1), at(2026, 10, 17), at(2026, 10, 13), at(2026, 9, 2)]
    .map((time) => groupOf({state: "JOB_STATE_DONE", submitted_unix_ms: String(time)}, now));
  assert.deepEqual(groups, ["Today", "Yesterday", "This week", "October 2026"]);
  assert.equal(groupOf({state: "JOB_STATE_PAUSED", submitted_unix_ms: "0"}, now), "Active");
});

test("jobs are searched for by what is typed and chosen", () => {
  const job = {job_id: "j-1a", display_name: "Kitchen.glb", state: "JOB_STATE_DONE_WITH_GAPS", scheduling: {user: "ann"}};
  const found = (filter) => passes(job, {text: "", user: "", state: "", ...filter});
  for (const filter of [{}, {text: " kitch"}, {text: "1A"}, {text: "ann"}, {user: "ann"}, {state: "done"}]) assert.ok(found(filter));
  for (const filter of [{text: "bath"}, {user: "ben"}, {state: "active"}, {state: "failed"}, {state: "cancelled"}]) assert.ok(!found(filter));
  assert.ok(passes({job_id: "j", state: "JOB_STATE_RUNNING"}, {text: "", user: "anonymous", state: "active"}));
});

test("a frame is cut into parts that the coordinator gives", () => {
  assert.deepEqual(gridOf(640, 480), [[0, 0, 640, 480]]);
  const grid = gridOf(1920, 1081);
  assert.equal(grid.length, 6);
  assert.ok(grid.every(([x0, y0, x1, y1]) => x1 - x0 <= 768 && y1 - y0 <= 768 && x0 < x1 && y0 < y1));
  assert.equal(grid.reduce((sum, [x0, y0, x1, y1]) => sum + (x1 - x0) * (y1 - y0), 0), 1920 * 1081, "all pixels, each once");
  const frame = {width: 1920, height: 1080};
  assert.deepEqual(piecesOf(frame, [700, 600, 720, 610], true), ["640,540,1280,1080"]);
  assert.equal(piecesOf(frame, [0, 0, 1920, 1080], true)[0].split(",")[0], "640", "the middle first");
  assert.deepEqual(piecesOf(frame, [9, 9, 99, 99], false), ["9,9,99,99"]);
  assert.deepEqual(piecesOf(frame, [0, 0, 1920, 1080], false), []);
  assert.deepEqual(piecesOf(frame, [5, 5, 5, 9], true), []);
  assert.deepEqual(piecesOf({width: 16384, height: 16384}, [0, 0, 16384, 16384], true), []);
});

test("a notice says why, and what to do", () => {
  const job = (more) => ({job_id: "j", state: "JOB_STATE_PLANNED", samples_done: "0", frames_total: 1, workers: 0, ...more});
  const waits = noticeOf(job(), 0, [{code: "no_worker", text: "none of the 0 workers is"}]);
  assert.deepEqual([waits.title, waits.lines], ["Waiting", ["none of the 0 workers is"]]);
  assert.match(waits.advice, /lumifold-worker/);
  const broken = job({state: "JOB_STATE_FAILED", error: "no camera 'x'"});
  assert.deepEqual(noticeOf(broken, 0, []).lines, ["no camera 'x'"]);
  assert.match(noticeOf(broken, 0, []).advice, /submit it again/);
  assert.ok(!mayRetry(broken));
  const lost = job({state: "JOB_STATE_FAILED", error: "lost", samples_done: "9", frames_total: 3, scheduling: {gaps: {failed_frame: 2}}});
  assert.match(noticeOf(lost, 1, []).advice, /Frame 2 failed/);
  assert.ok(mayRetry(lost));
  assert.match(noticeOf(job({state: "JOB_STATE_DONE_WITH_GAPS", scheduling: {gaps: {skipped: [{first: 4, count: 2}]}}}), 5, []).title, /5 is skipped/);
  assert.match(noticeOf(job({state: "JOB_STATE_RUNNING", workers: 1}), 0, []).title, /Rendering/);
  assert.equal(noticeOf(job({state: "JOB_STATE_PAUSED"}), 0, []).title, "Paused");
  assert.equal(emptyNotice(0, false).commands.length, 2);
  assert.equal(emptyNotice(2, false).commands.length, 1);
});
