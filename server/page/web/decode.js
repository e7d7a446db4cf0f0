// The bytes of previews as numbers.

/** Values of all binary16 numbers; one look-up is faster than the arithmetic. */
export const HALVES = (() => {
  const values = new Float32Array(65536);
  for (let bits = 0; bits < 65536; ++bits) {
    const exponent = (bits >> 10) & 31,
      mantissa = bits & 1023;
    const size =
      exponent === 0
        ? mantissa * 2 ** -24
        : exponent === 31
          ? mantissa
            ? NaN
            : Infinity
          : (1024 + mantissa) * 2 ** (exponent - 25);
    values[bits] = bits & 0x8000 ? -size : size;
  }
  return values;
})();

/** A preview of `GET /api/preview`: its description, with `planes`, a Float32Array for each channel. */
export function parsePreview(buffer) {
  const view = new DataView(buffer);
  const length = view.getUint32(0, true);
  const about = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const count = about.preview_width * about.preview_height;
  let at = 4 + length;
  about.planes = about.types.map((type) => {
    const plane = new Float32Array(count);
    if (type === "half") {
      for (let i = 0; i < count; ++i, at += 2) plane[i] = HALVES[view.getUint16(at, true)];
    } else {
      for (let i = 0; i < count; ++i, at += 4) plane[i] = view.getFloat32(at, true);
    }
    return plane;
  });
  return about;
}

/** Takes pieces of an event stream and calls `take(name, value)` for each event that is complete. */
export function eventReader(take) {
  const decoder = new TextDecoder();
  let text = "",
    name = "message",
    data = [];
  return (bytes) => {
    text += decoder.decode(bytes, {stream: true});
    const lines = text.split("\n");
    text = lines.pop();
    for (const line of lines) {
      if (line === "") {
        if (data.length) take(name, JSON.parse(data.join("\n")));
        name = "message";
        data = [];
      } else if (line.startsWith("event: ")) {
        name = line.slice(7);
      } else if (line.startsWith("data: ")) {
        data.push(line.slice(6));
      }
    }
  };
}
