// The picture: two layers of a preview beside each other, moved, zoomed, and read pixel by pixel.

import {paint} from "/tone.js";

const MOST_ZOOM = 64;
/** Of a region that is fetched pixel by pixel, across and down: the coordinator's limit. */
const MOST_REGION = 768;
/** After the last change of the view, until a region is fetched. */
const REGION_PAUSE_MS = 300;

/**
 * Draws previews by layer on a canvas: A up to the column `middle`, B from there on. Returns what their
 * colours mean.
 */
function drawBeside(canvas, previews, layers, middle, exposure, transform) {
  const context = canvas.getContext("2d");
  const {width, height} = canvas;
  context.imageSmoothingEnabled = false;
  const sides = [[layers[0], 0, middle], [layers[1], middle, width]];
  return sides.map(([layer, from, to]) => {
    const preview = previews.get(layer);
    if (!preview || from >= to) return "";
    const image = new ImageData(preview.preview_width, preview.preview_height);
    const legend = paint(preview, layer, exposure, transform, image.data);
    const painted = new OffscreenCanvas(image.width, image.height);
    painted.getContext("2d").putImageData(image, 0, 0);
    const scale = image.width / width; // below 1 until all layers are of the newest preview
    const columns = to - from;
    context.drawImage(painted, from * scale, 0, columns * scale, image.height, from, 0, columns, height);
    return legend;
  });
}

export class Viewer {
  /**
   * `elements`: viewer, canvas, region, split, waiting, values, legend. `wantRegion` is called with the part
   * of the frame that is looked at, "x0,y0,x1,y1", when previews have fewer pixels than the screen shows of
   * it, and with null when that is over.
   */
  constructor(elements, wantRegion) {
    Object.assign(this, elements, {wantRegion});
    this.closer = null; // the region that is shown, and its previews by layer
    this.wanted = null; // the last one, with the layers
    this.layers = ["", "noisy"];
    this.previews = new Map(); // by layer
    this.exposure = 0;
    this.transform = "srgb";
    this.fitted = true;
    this.pointers = new Map();
    this.split.addEventListener("input", () => this.draw());
    this.viewer.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoomBy(2 ** (-event.deltaY / 300), event);
    }, {passive: false});
    this.viewer.addEventListener("pointerdown", (event) => this.press(event));
    this.viewer.addEventListener("pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel"]) {
      this.viewer.addEventListener(end, (event) => this.pointers.delete(event.pointerId));
    }
    new ResizeObserver(() => this.fitted && this.fit()).observe(this.viewer);
  }

  /** Nothing is known of the frame that is shown next. */
  clear() {
    this.previews.clear();
    this.size = null;
    this.leaveRegion();
    this.fitted = true;
    this.canvas.width = 0;
    this.waiting.hidden = false;
    this.values.textContent = "\u00a0";
    this.legend.textContent = "";
  }

  show(layer, preview) {
    this.previews.set(layer, preview);
    this.waiting.hidden = true;
    this.resize();
    this.draw();
    this.lookCloser();
  }

  /** The canvas is as large as the largest preview. What is looked at stays where it is. */
  resize() {
    const largest = [...this.previews.values()].reduce((a, b) => (b.preview_width > a.preview_width ? b : a));
    const {preview_width: width, preview_height: height} = largest;
    if (this.canvas.width === width && this.canvas.height === height) return;
    this.zoom *= this.canvas.width / width;
    this.canvas.width = width;
    this.canvas.height = height;
    this.size = largest;
    if (this.fitted) this.fit();
    else this.place();
  }

  /** A on the left of the split, B on the right. */
  draw() {
    if (!this.size) return;
    const middle = Math.round((this.canvas.width * (1000 - this.split.value)) / 1000);
    const {previews, layers, exposure, transform} = this;
    const legends = drawBeside(this.canvas, previews, layers, middle, exposure, transform);
    const {width, height} = this.region;
    this.region.getContext("2d").clearRect(0, 0, width, height);
    if (this.closer) {
      const inRegion = Math.min(Math.max(middle * this.size.reduction - this.closer.x0, 0), width);
      drawBeside(this.region, this.newEnough(), layers, inRegion, exposure, transform);
    }
    this.legend.textContent = [...new Set(legends)].filter(Boolean).join(" ");
    this.readPixel();
  }

  /** Of the region's layers those that have half of the samples of the whole frame's, which may be newer. */
  newEnough() {
    const samplesOf = (layer) => this.previews.get(layer)?.samples_per_pixel ?? 0;
    const isNew = ([layer, {samples_per_pixel: samples}]) => 2 * samples >= samplesOf(layer);
    return new Map([...this.closer.previews].filter(isNew));
  }

  /** A layer of a region that was wanted. */
  showRegion(name, layer, preview) {
    if (this.closer?.name !== name) {
      this.closer = {name, x0: preview.x0, y0: preview.y0, previews: new Map()};
      this.region.width = preview.preview_width;
      this.region.height = preview.preview_height;
    }
    this.closer.previews.set(layer, preview);
    this.place();
    this.draw();
  }

  leaveRegion() {
    this.closer = null;
    this.wanted = null;
    this.region.width = 0;
    this.wantRegion(null);
  }

  /**
   * The part of the frame that the screen shows, if it shows it larger than the preview is and it may be
   * fetched. All of a frame that grows comes sooner, and again and again.
   */
  visibleRegion() {
    if (!this.size || this.size.reduction === 1 || this.zoom < 1) return null;
    if (this.fitted && ![...this.previews.values()].some((preview) => preview.finished)) return null;
    const {width, height, reduction} = this.size;
    const scale = this.zoom / reduction; // pixels of the screen for each of the frame
    const side = (offset, shown, most) =>
      [Math.max(0, Math.floor(-offset / scale)), Math.min(most, Math.ceil((shown - offset) / scale))];
    const [x0, x1] = side(this.x, this.viewer.clientWidth, width);
    const [y0, y1] = side(this.y, this.viewer.clientHeight, height);
    if (x0 >= x1 || y0 >= y1 || x1 - x0 > MOST_REGION || y1 - y0 > MOST_REGION) return null;
    return [x0, y0, x1, y1].join();
  }

  /** Wants what is looked at, once the view stays as it is. */
  lookCloser() {
    clearTimeout(this.looking);
    this.looking = setTimeout(() => {
      const region = this.visibleRegion();
      const wanted = region && [region, ...this.layers].join();
      if (wanted === this.wanted) return;
      if (!region) return this.leaveRegion();
      this.wanted = wanted;
      this.wantRegion(region);
    }, REGION_PAUSE_MS);
  }

  place() {
    this.canvas.style.transform = `translate(${this.x}px, ${this.y}px) scale(${this.zoom})`;
    this.canvas.classList.toggle("pixels", this.zoom >= 2);
    if (this.closer) {
      const scale = this.zoom / this.size.reduction;
      const [x, y] = [this.x + this.closer.x0 * scale, this.y + this.closer.y0 * scale];
      this.region.style.transform = `translate(${x}px, ${y}px) scale(${scale})`;
      this.region.classList.toggle("pixels", scale >= 2);
    }
    this.lookCloser();
  }

  fit() {
    const {clientWidth, clientHeight} = this.viewer;
    const {width, height} = this.canvas;
    if (!width || !clientWidth) return;
    this.zoom = Math.min(clientWidth / width, clientHeight / height);
    this.x = (clientWidth - width * this.zoom) / 2;
    this.y = (clientHeight - height * this.zoom) / 2;
    this.fitted = true;
    this.place();
  }

  /** Keeps the point of `event`, or the middle, where it is. */
  zoomBy(factor, event) {
    if (!this.size) return;
    const box = this.viewer.getBoundingClientRect();
    const [x, y] = event ? [event.clientX - box.left, event.clientY - box.top]
      : [box.width / 2, box.height / 2];
    const zoom = Math.min(Math.max(this.zoom * factor, 0.1), MOST_ZOOM);
    this.x = x - ((x - this.x) * zoom) / this.zoom;
    this.y = y - ((y - this.y) * zoom) / this.zoom;
    this.zoom = zoom;
    this.fitted = false;
    this.place();
  }

  moveBy(x, y) {
    if (!this.size) return;
    this.x += x;
    this.y += y;
    this.fitted = false;
    this.place();
  }

  press(event) {
    if (event.target === this.split) return;
    this.viewer.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, event);
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (before && this.pointers.size === 1) {
      this.moveBy(event.clientX - before.clientX, event.clientY - before.clientY);
    }
    if (before && this.pointers.size === 2) {
      const other = [...this.pointers.values()].find((pointer) => pointer.pointerId !== event.pointerId);
      const distance = ({clientX, clientY}) => Math.hypot(clientX - other.clientX, clientY - other.clientY);
      this.zoomBy(distance(event) / Math.max(distance(before), 1), event);
    }
    if (before) this.pointers.set(event.pointerId, event);
    this.at = event;
    this.readPixel();
  }

  /** Values under the pointer, and where that is in the frame. */
  readPixel() {
    if (!this.at || !this.size) return;
    const box = this.viewer.getBoundingClientRect();
    // Where that is in the frame, whose pixels are the preview's where it is not looked at closely.
    const scale = this.zoom / this.size.reduction;
    const x = Math.floor((this.at.clientX - box.left - this.x) / scale);
    const y = Math.floor((this.at.clientY - box.top - this.y) / scale);
    if (x < 0 || y < 0 || x >= this.size.width || y >= this.size.height) return;
    const parts = [];
    for (const layer of new Set(this.layers)) {
      const values = this.closerValues(layer, x, y) ?? this.valuesOf(this.previews.get(layer), x, y);
      const text = values?.map((value) => value.toPrecision(4)).join(" ");
      if (values) parts.push(`${layer || "filtered"} ${text}`);
    }
    this.values.textContent = `x ${x} y ${y}   ${parts.join("   ")}`;
  }

  /** Of a pixel of the frame. */
  valuesOf(preview, x, y) {
    if (!preview) return null;
    const at = Math.floor(y / preview.reduction) * preview.preview_width + Math.floor(x / preview.reduction);
    return preview.planes.map((plane) => plane[at]);
  }

  closerValues(layer, x, y) {
    const preview = this.closer && this.newEnough().get(layer);
    const [column, row] = [x - this.closer?.x0, y - this.closer?.y0];
    if (!preview || column < 0 || row < 0) return null;
    if (column >= preview.preview_width || row >= preview.preview_height) return null;
    return preview.planes.map((plane) => plane[row * preview.preview_width + column]);
  }
}
