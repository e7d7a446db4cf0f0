// Parts of a frame that are fetched pixel by pixel.

/** Of a part, across and down, at most: the coordinator's limit. */
export const MOST_REGION = 768;
/** Parts of a finished frame that are shown at a time, at most: 3840 x 2160 pixels have 15. */
export const MOST_PIECES = 40;

/** Cuts a length into equal parts of at most MOST_REGION. */
function cuts(length) {
  const count = Math.ceil(length / MOST_REGION);
  return Array.from({length: count + 1}, (_, i) => Math.round((i * length) / count));
}

/** All parts of a finished frame, as [x0, y0, x1, y1], row by row. */
export function gridOf(width, height) {
  const columns = cuts(width), rows = cuts(height);
  return rows.slice(1).flatMap((y1, row) =>
    columns.slice(1).map((x1, column) => [columns[column], rows[row], x1, y1]));
}

/**
 * The parts of a frame to fetch for what the screen shows of it, [x0, y0, x1, y1], as names "x0,y0,x1,y1",
 * the middle first: of a finished frame those of its grid, which stay; of one that grows what is shown, if
 * that is small enough. Empty: the preview of the whole frame has to do.
 */
export function piecesOf({width, height}, seen, isFinished) {
  const [x0, y0, x1, y1] = seen;
  if (x0 >= x1 || y0 >= y1) return [];
  if (!isFinished) return x1 - x0 > MOST_REGION || y1 - y0 > MOST_REGION ? [] : [seen.join()];
  const distance = ([left, top, right, bottom]) =>
    Math.hypot((left + right - x0 - x1) / 2, (top + bottom - y0 - y1) / 2);
  const shown = gridOf(width, height).filter(([left, top, right, bottom]) =>
    left < x1 && right > x0 && top < y1 && bottom > y0);
  if (shown.length > MOST_PIECES) return [];
  return shown.sort((a, b) => distance(a) - distance(b)).map((piece) => piece.join());
}
