// The page's own arithmetic and texts, without a browser.

import assert from "node:assert/strict";
import {readFile} from "node:fs/promises";
import {test} from "node:test";

// Node takes a file .js as a module of another kind; its text it takes as it is.
const web = async (name) => import(`data:text/javascript,${encodeURIComponent(await readFile(`${process.env.LUMIFOLD_WEB}/${name}`, "utf8"))}`);
const {HALVES, eventReader, parsePreview} = await web("decode.js");
const {colourOfId, filmic, heat, paint, rangeOf, toneOf} = await web("tone.js");
const {TimeLeft, bytes, duration, progressOf} = await web("words.js");

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
