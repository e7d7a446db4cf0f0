// The picture: two layers of a preview beside each other, moved, zoomed, and read pixel by pixel.

import {MOST_PIECES, piecesOf} from "/pieces.js";
import {alphaOf, paint} from "/tone.js";

const MOST_ZOOM = 64;
/** After the last change of the view, until parts of the frame are fetched. */
const PIECES_PAUSE_MS = 300;
/** Squares behind transparent pictures, on the screen. */
const CHECKER_PX = 16;

/**
 * Draws previews by layer on a canvas, as the view {layers, exposure, transform, previews} shows them: A up
 * to the column `middle`, B from there on. Returns what their colours mean.
 */
export function drawBeside(canvas, previews, view, middle) {
  const {layers, exposure, transform} = view;
  const context = canvas.getContext("2d");
  const {width, height} = canvas;
  context.clearRect(0, 0, width, height);
  context.imageSmoothingEnabled = false;
  const sides = [[layers[0], 0, middle], [layers[1], middle, width]];
  return sides.map(([layer, from, to]) => {
    const preview = previews.get(layer);
    if (!preview || from >= to) return "";
    const image = new ImageData(preview.preview_width, preview.preview_height);
    const legend = paint(preview, layer, exposure, transform, image.data, view.previews.get(layer));
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
   * `elements`: viewer, canvas, box (of the pieces), split, values, legend. `wantPieces` is called with the
   * names of the parts of the frame that are looked at, "x0,y0,x1,y1", when its preview has fewer pixels than
   * the screen shows of it, and with [] when that is over.
   */
  constructor(elements, wantPieces) {
    Object.assign(this, elements, {wantPieces});
    this.pieces = new Map(); // by name
    this.wanted = ""; // the last names, with the layers
    this.layers = ["", "noisy"];
    this.previews = new Map(); // by layer
    this.exposure = 0;
    this.transform = "srgb";
    this.fitted = true;
    this.pointers = new Map();
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
    this.leavePieces();
    this.fitted = true;
    this.canvas.width = 0;
    this.values.textContent = "\u00a0";
    this.legend.textContent = "";
  }

  show(layer, preview) {
    this.previews.set(layer, preview);
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

  /** The layers that are seen: of one side where the split leaves none of the other. */
  get seen() {
    const at = Number(this.split.value);
    return [...new Set([...(at > 0 ? [this.layers[0]] : []), ...(at < 1000 ? [this.layers[1]] : [])])];
  }

  /** The column of a picture of this width where B begins. */
  middleOf(width) {
    return Math.round((width * this.split.value) / 1000);
  }

  /** A on the left of the split, B on the right. */
  draw() {
    if (!this.size) return;
    const legends = drawBeside(this.canvas, this.previews, this, this.middleOf(this.canvas.width));
    const middle = this.middleOf(this.size.width);
    this.viewer.classList.toggle("transparent", [...this.previews.values()].some(alphaOf));
    for (const piece of this.pieces.values()) {
      const {width} = piece.canvas;
      drawBeside(piece.canvas, this.newEnough(piece), this, Math.min(Math.max(middle - piece.x0, 0), width));
    }
    this.legend.textContent = [...new Set(legends)].filter(Boolean).join(" ");
    this.readPixel();
  }

  /** Of a piece's layers those that have half of the samples of the whole frame's, which may be newer. */
  newEnough(piece) {
    const samplesOf = (layer) => this.previews.get(layer)?.samples_per_pixel ?? 0;
    const isNew = ([layer, {samples_per_pixel: samples}]) => 2 * samples >= samplesOf(layer);
    return new Map([...piece.previews].filter(isNew));
  }

  /** A layer of a part of the frame that was wanted. */
  showPiece(name, layer, preview) {
    if (!this.size) return;
    if (!this.isFinished) { // the part that was shown before is no longer the newest
      for (const other of this.pieces.keys()) other !== name && this.drop(other);
    }
    if (!this.pieces.has(name)) {
      const canvas = document.createElement("canvas");
      canvas.width = preview.preview_width;
      canvas.height = preview.preview_height;
      this.box.append(canvas);
      this.pieces.set(name, {canvas, x0: preview.x0, y0: preview.y0, previews: new Map()});
    }
    this.pieces.get(name).previews.set(layer, preview);
    for (const other of this.pieces.keys()) {
      if (this.pieces.size > 2 * MOST_PIECES && !this.wanted.includes(other)) this.drop(other);
    }
    this.place();
    this.draw();
  }

  drop(name) {
    this.pieces.get(name).canvas.remove();
    this.pieces.delete(name);
  }

  leavePieces() {
    for (const name of this.pieces.keys()) this.drop(name);
    this.wanted = "";
    this.wantPieces([]);
  }

  get isFinished() {
    return [...this.previews.values()].some((preview) => preview.finished);
  }

  /**
   * The parts of the frame that the screen shows, if it shows them larger than the preview is. All of a frame
   * that grows comes sooner, and again and again.
   */
  visiblePieces() {
    if (!this.size || this.size.reduction === 1 || this.zoom * devicePixelRatio <= 1) return [];
    if (this.fitted && !this.isFinished) return [];
    const {width, height, reduction} = this.size;
    const scale = this.zoom / reduction; // pixels of the screen for each of the frame
    const side = (offset, shown, most) =>
      [Math.max(0, Math.floor(-offset / scale)), Math.min(most, Math.ceil((shown - offset) / scale))];
    const [x0, x1] = side(this.x, this.viewer.clientWidth, width);
    const [y0, y1] = side(this.y, this.viewer.clientHeight, height);
    return piecesOf(this.size, [x0, y0, x1, y1], this.isFinished);
  }

  /** Wants what is looked at, once the view stays as it is. */
  lookCloser() {
    clearTimeout(this.looking);
    this.looking = setTimeout(() => {
      const names = this.visiblePieces();
      const wanted = names.length ? [...names, ...this.seen].join(" ") : "";
      if (wanted === this.wanted) return;
      if (!names.length && !this.isFinished) return this.leavePieces();
      this.wanted = wanted;
      const lacks = (name) => this.seen.some((layer) => !this.pieces.get(name)?.previews.has(layer));
      this.wantPieces(this.isFinished ? names.filter(lacks) : names);
    }, PIECES_PAUSE_MS);
  }

  place() {
    this.canvas.style.transform = `translate(${this.x}px, ${this.y}px) scale(${this.zoom})`;
    this.canvas.classList.toggle("pixels", this.zoom >= 2);
    this.canvas.style.backgroundSize = `${CHECKER_PX / this.zoom}px ${CHECKER_PX / this.zoom}px`;
    for (const {canvas, x0, y0} of this.pieces.values()) {
      const scale = this.zoom / this.size.reduction;
      const [x, y] = [this.x + x0 * scale, this.y + y0 * scale];
      canvas.style.transform = `translate(${x}px, ${y}px) scale(${scale})`;
      canvas.classList.toggle("pixels", scale >= 2);
      canvas.style.backgroundSize = `${CHECKER_PX / scale}px ${CHECKER_PX / scale}px`;
      canvas.style.backgroundPosition = `${-x0}px ${-y0}px`; // the squares are those of the whole picture
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
      const values = this.closeValues(layer, x, y) ?? this.valuesOf(this.previews.get(layer), x, y);
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

  /** The same of a part that is fetched pixel by pixel. */
  closeValues(layer, x, y) {
    for (const piece of this.pieces.values()) {
      const preview = this.newEnough(piece).get(layer);
      const [column, row] = [x - piece.x0, y - piece.y0];
      if (!preview || column < 0 || row < 0) continue;
      if (column >= preview.preview_width || row >= preview.preview_height) continue;
      return preview.planes.map((plane) => plane[row * preview.preview_width + column]);
    }
    return null;
  }
}
