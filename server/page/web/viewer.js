// The picture: two layers of a preview beside each other, moved, zoomed, and read pixel by pixel.

import {paint} from "/tone.js";

const MOST_ZOOM = 64;

export class Viewer {
  /** `elements`: viewer, canvas, split, waiting, values, legend. */
  constructor(elements) {
    Object.assign(this, elements);
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
    for (const end of ["pointerup", "pointercancel"]) this.viewer.addEventListener(end, (event) => this.pointers.delete(event.pointerId));
    new ResizeObserver(() => this.fitted && this.fit()).observe(this.viewer);
  }

  /** Nothing is known of the frame that is shown next. */
  clear() {
    this.previews.clear();
    this.size = null;
    this.canvas.width = 0;
    this.waiting.hidden = false;
    this.values.textContent = "\u00a0";
    this.legend.textContent = "";
  }

  show(layer, preview) {
    this.previews.set(layer, preview);
    const size = `${preview.preview_width}x${preview.preview_height}`;
    this.waiting.hidden = true;
    if (this.size !== size) {
      this.size = size;
      this.canvas.width = preview.preview_width;
      this.canvas.height = preview.preview_height;
      this.fit();
    }
    this.draw();
  }

  /** A on the left of the split, B on the right. */
  draw() {
    const [a, b] = this.layers.map((layer) => this.previews.get(layer));
    if (!a && !b) return;
    const context = this.canvas.getContext("2d");
    const {width, height} = this.canvas;
    const middle = Math.round((width * (1000 - this.split.value)) / 1000);
    const legends = [];
    for (const [preview, layer, from, to] of [[a, this.layers[0], 0, middle], [b, this.layers[1], middle, width]]) {
      if (!preview || from === to || preview.preview_width !== width) continue;
      const image = context.createImageData(width, height);
      legends.push(paint(preview, layer, this.exposure, this.transform, image.data));
      context.putImageData(image, 0, 0, from, 0, to - from, height);
    }
    this.legend.textContent = [...new Set(legends)].filter(Boolean).join(" ");
    this.readPixel();
  }

  place() {
    this.canvas.style.transform = `translate(${this.x}px, ${this.y}px) scale(${this.zoom})`;
    this.canvas.classList.toggle("pixels", this.zoom >= 2);
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
    const [x, y] = event ? [event.clientX - box.left, event.clientY - box.top] : [box.width / 2, box.height / 2];
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
    if (before && this.pointers.size === 1) this.moveBy(event.clientX - before.clientX, event.clientY - before.clientY);
    if (before && this.pointers.size === 2) {
      const other = [...this.pointers.values()].find((pointer) => pointer.pointerId !== event.pointerId);
      const distance = (pointer) => Math.hypot(pointer.clientX - other.clientX, pointer.clientY - other.clientY);
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
    const x = Math.floor((this.at.clientX - box.left - this.x) / this.zoom);
    const y = Math.floor((this.at.clientY - box.top - this.y) / this.zoom);
    const {width, height} = this.canvas;
    if (x < 0 || y < 0 || x >= width || y >= height) return;
    const parts = [];
    for (const layer of new Set(this.layers)) {
      const preview = this.previews.get(layer);
      if (!preview) continue;
      const values = preview.planes.map((plane) => plane[y * width + x].toPrecision(4));
      parts.push(`${layer || "filtered"} ${values.join(" ")}`);
    }
    const reduction = [...this.previews.values()][0].reduction;
    this.values.textContent = `x ${x * reduction} y ${y * reduction}   ${parts.join("   ")}`;
  }
}
