// Numbers of layers as colours of the screen.

function srgb(x) {
  return x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055;
}

/** Bytes of sRGB by the linear value times 4095, clipped. */
const SRGB = Uint8ClampedArray.from({length: 4096}, (_, i) => Math.round(255 * srgb(i / 4095)));

/** A shoulder that keeps detail above white: Hable's curve of 2010, scaled so that 11.2 is white. */
export function filmic(x) {
  const hable = (v) => (v * (0.15 * v + 0.05) + 0.004) / (v * (0.15 * v + 0.5) + 0.06) - 0.02 / 0.3;
  return hable(2 * x) / hable(11.2);
}

/** What a transform makes of a linear value: 0 to 255. */
export function toneOf(transform) {
  const byte = (x) => SRGB[x > 0 ? (x < 1 ? (x * 4095) | 0 : 4095) : 0];
  if (transform === "raw") return (x) => (x > 0 ? (x < 1 ? x * 255 : 255) : 0);
  if (transform === "filmic") return (x) => byte(filmic(x > 0 ? x : 0));
  return byte;
}

/** Dark blue over green to yellow, for counts and errors; 0 to 1. */
export function heat(x) {
  const t = Math.min(Math.max(x, 0), 1);
  const red = t < 0.5 ? 0.1 + 0.3 * t : 0.25 + 1.5 * (t - 0.5);
  const blue = t < 0.5 ? 0.35 + 0.3 * t : 0.5 - 0.8 * (t - 0.5);
  return [255 * red, 255 * (0.05 + 0.87 * t), 255 * blue];
}

/** A colour for a number of an object, far from those of its neighbours. */
export function colourOfId(id) {
  if (!id) return [0, 0, 0];
  const turn = (id * 0.61803398875) % 1;
  return [0, 1 / 3, 2 / 3].map((shift) => 70 + 170 * Math.abs(2 * ((turn + shift) % 1) - 1));
}

/** Lowest and highest finite value above 0 of a plane. */
export function rangeOf(plane) {
  let least = Infinity, most = 0;
  for (const value of plane) {
    if (value > 0 && value < Infinity) {
      least = Math.min(least, value);
      most = Math.max(most, value);
    }
  }
  return most > 0 ? [least, most] : [0, 1];
}

/** A of a transparent picture, by which its colours are premultiplied; null of others. */
export function alphaOf(preview) {
  return preview.channels?.[3] === "A" ? preview.planes[3] : null;
}

/**
 * Fills `pixels` (RGBA) with a layer of a preview. Returns what the colours mean, where they are no picture.
 * A of a transparent picture is that of the pixels, which are not premultiplied, as in PNG.
 * @param {object} preview of parsePreview
 * @param {object} whole preview of the whole frame: a part of it has the same colours
 */
export function paint(preview, layer, exposure, transform, pixels, whole = preview) {
  const [r, g, b] = preview.planes;
  const gain = 2 ** exposure;
  const count = preview.preview_width * preview.preview_height;
  const set = (i, colour) => {
    pixels[4 * i] = colour[0];
    pixels[4 * i + 1] = colour[1];
    pixels[4 * i + 2] = colour[2];
    pixels[4 * i + 3] = 255;
  };
  if (layer === "N") {
    const byte = (v) => 127.5 + 127.5 * v;
    for (let i = 0; i < count; ++i) set(i, [byte(r[i]), byte(g[i]), byte(b[i])]);
    return "Directions: x is red, y green, z blue.";
  }
  if (layer === "id") {
    for (let i = 0; i < count; ++i) set(i, colourOfId(r[i]));
    return "A colour for each object.";
  }
  if (layer === "samples" || layer === "error") {
    const [least, most] = rangeOf(whole.planes[0]);
    const part = (value) => (most > least ? (value - least) / (most - least) : 0.5);
    for (let i = 0; i < count; ++i) set(i, r[i] > 0 ? heat(part(r[i])) : [0, 0, 0]);
    const what = layer === "error" ? "Estimated error of the filtered picture, in steps of 8 bits"
      : "Samples";
    return `${what}: ${least.toPrecision(3)} is dark, ${most.toPrecision(3)} bright; black has none.`;
  }
  if (preview.planes.length === 1) {
    const [least, most] = rangeOf(whole.planes[0]);
    const depth = (x) => (x > 0 ? 255 * (1 - (0.9 * (x - least)) / (most - least || 1)) : 0);
    const grey = layer === "A" ? (x) => 255 * x : depth;
    for (let i = 0; i < count; ++i) set(i, [grey(r[i]), grey(r[i]), grey(r[i])]);
    if (layer === "A") return "Coverage.";
    return `From ${least.toPrecision(3)} (bright) to ${most.toPrecision(3)}; black is nothing.`;
  }
  const tone = toneOf(transform);
  const alpha = alphaOf(preview);
  for (let i = 0; i < count; ++i) {
    const scale = alpha && alpha[i] > 0 ? gain / alpha[i] : gain;
    set(i, [tone(scale * r[i]), tone(scale * g[i]), tone(scale * b[i])]);
    if (alpha) pixels[4 * i + 3] = 255 * alpha[i];
  }
  return "";
}
