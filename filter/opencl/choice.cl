// Choice (filter/layers/choice.h) and what leads to it, for a device and as C++. Follows shared.cl in a program of its own; cells are
// those of wide windows, of kChoiceCell pixels.
//
// The host defines the constants of filter/manifold/layer_call.h by their names.
//
// Layouts: pictures as shared.cl has them. A run is the points of one pixel; `firsts`: of each run, its first
// point, and the end of the last. Sums over cells: plane TERMS * kind + term. No sum crosses work-items; those over a window have
// the order of CorrelateRows (filter/kernels/row_kernels.h).

#define TERMS 6  // that are summed: n, d, n^2, n d, d^2 and d times the relative variance

size_t PixelOfPoint(int point, Grid grid, __global const int* places) {
  return (size_t)places[2 * point + 1] * grid.width + places[2 * point];
}
size_t PixelOfSite(size_t site, Grid grid, __global const int* places) {
  return site < PixelsOf(grid) ? site : PixelOfPoint((int)(site - PixelsOf(grid)), grid, places);
}
// A filtered half, added to its base if it `has_base`. Points that the filter found nothing for get their own light, if they have
// `weights`.
__kernel void TakeFiltered(Grid grid, int half_of, int has_base, __global const float* weights, __global const float* found,
                           __global const float* signals, __global const float* filtered, __global const float* base,
                           __global float* picture) {
  const size_t site = get_global_id(0);
  if (site >= SitesOf(grid)) return;
  const size_t pixels = PixelsOf(grid);
  const int is_lost = site >= pixels && !(found[site - pixels] > 0.0f) && weights[site - pixels] > 0.0f;
  for (int c = 0; c < 3; ++c) {
    const size_t at = PlaneOf(half_of, c, grid) + site, of_half = c * SitesOf(grid) + site;
    const float value = is_lost ? signals[of_half] : filtered[of_half];
    picture[at] = has_base ? value + base[at] : value;
  }
}

// Sets pixels that have points to their means, weighted by their coverage, if that is over 0. A work-item a run.
__kernel void MeanOfPoints(Grid grid, int half_of, int runs, __global const int* firsts, __global const int* places,
                           __global const float* coverage, __global float* picture) {
  const size_t run = get_global_id(0);
  if (run >= (size_t)runs) return;
  float mean[3] = {0.0f, 0.0f, 0.0f}, total = 0.0f;
  for (int i = firsts[run]; i < firsts[run + 1]; ++i) {
    total += coverage[i];
    for (int c = 0; c < 3; ++c) mean[c] += coverage[i] * picture[PlaneOf(half_of, c, grid) + PixelsOf(grid) + i];
  }
  if (!(total > 0.0f)) return;
  const size_t pixel = PixelOfPoint(firsts[run], grid, places);
  for (int c = 0; c < 3; ++c) picture[PlaneOf(half_of, c, grid) + pixel] = mean[c] / total;
}

// LightOf.
__kernel void LightOf(Grid grid, float share, __global const float* picture, __global float* light) {
  const size_t pixel = get_global_id(0);
  if (pixel >= PixelsOf(grid)) return;
  float sum = 0.0f;
  for (int c = 0; c < 3; ++c)
    sum += share * (fabs(picture[PlaneOf(0, c, grid) + pixel]) + fabs(picture[PlaneOf(1, c, grid) + pixel]));
  light[pixel] = sum;
}

float ErrorWeight(float light, float dim) {
  const float relative_to = light + dim;
  return 1.0f / (relative_to * relative_to);
}

// The weight of errors, and the kind of each pixel. `mask_a`, `mask_b`: over 0 where a half is known.
__kernel void WeighErrors(Grid grid, float dim, __global const float* mask_a, __global const float* mask_b,
                          __global const float* mixed, __global const float* light, __global float* weight,
                          __global int* kind) {
  const size_t pixel = get_global_id(0);
  if (pixel >= PixelsOf(grid)) return;
  const float both = mask_a[pixel] * mask_b[pixel];
  weight[pixel] = both > 0.0f ? ErrorWeight(light[pixel], dim) : both;
  kind[pixel] = mixed[pixel] > 0.0f ? kMixedKind : 0;
}

// The same of pixels that have points, where errors are those of the points. A work-item a run.
__kernel void WeighErrorsOfPoints(Grid grid, float dim, int runs, __global const int* firsts, __global const int* places,
                                  __global const float* light, __global float* weight, __global int* kind) {
  const size_t run = get_global_id(0);
  if (run >= (size_t)runs) return;
  const size_t pixel = PixelOfPoint(firsts[run], grid, places);
  kind[pixel] = kPointKind;
  weight[pixel] = ErrorWeight(light[pixel], dim);
}

// n, d, and d times the relative variance of a half, of one pixel or point.
typedef struct {
  float numerator, denominator, variance;
} PairTerms;

// Those of F and G at a site; `variance`: what is known of the halves' difference.
PairTerms TermsOfSite(size_t site, Grid grid, float variance, float weight, float samples, __global const float* f,
                      __global const float* g, __global const float* noisy) {
  PairTerms terms = {0.0f, 0.0f, variance};
  for (int c = 0; c < 3; ++c) {
    const size_t in_a = PlaneOf(0, c, grid) + site, in_b = PlaneOf(1, c, grid) + site;
    const float fa = f[in_a], fb = f[in_b], a = noisy[in_a], b = noisy[in_b];
    const float da = g[in_a] - fa, db = g[in_b] - fb;
    terms.numerator += da * (b - fa) + db * (a - fb) + 0.5f * (da - db) * (fa - fb);
    terms.denominator += 0.5f * (da + db) * (da + db);
    terms.variance += (a - b) * (a - b);
  }
  terms.numerator *= weight;
  terms.denominator *= weight;
  terms.variance = weight * terms.variance + 2.0f * terms.denominator / samples;
  return terms;
}

void PutTerms(PairTerms terms, size_t pixel, Grid grid, __global float* planes) {
  planes[pixel] = terms.numerator;
  planes[PixelsOf(grid) + pixel] = terms.denominator;
  planes[2 * PixelsOf(grid) + pixel] = terms.variance;
}

// Three planes, of pixels without points.
__kernel void TermsOfPixels(Grid grid, __global const float* f, __global const float* g, __global const float* noisy,
                            __global const float* samples, __global const float* expected, __global const float* weight,
                            __global const int* kind, __global float* terms) {
  const size_t pixel = get_global_id(0);
  if (pixel >= PixelsOf(grid)) return;
  PairTerms of_pixel =
      TermsOfSite(pixel, grid, expected[pixel], weight[pixel], samples[pixel], f, g, noisy);
  if (kind[pixel] == kPointKind || !(weight[pixel] > 0.0f))
    of_pixel.numerator = of_pixel.denominator = of_pixel.variance = 0.0f;
  PutTerms(of_pixel, pixel, grid, terms);
}

// Of pixels with points: sums over these. `own`: their weights in their pixels. A work-item a run.
__kernel void TermsOfPoints(Grid grid, int runs, __global const int* firsts, __global const int* places,
                            __global const float* f, __global const float* g, __global const float* noisy,
                            __global const float* own, __global const float* samples, __global const float* weight,
                            __global float* terms) {
  const size_t run = get_global_id(0);
  if (run >= (size_t)runs) return;
  const size_t pixel = PixelOfPoint(firsts[run], grid, places);
  PairTerms sum = {0.0f, 0.0f, 0.0f};
  for (int i = firsts[run]; i < firsts[run + 1]; ++i) {
    if (!(own[i] > 0.0f)) continue;
    const PairTerms of_point =
        TermsOfSite(PixelsOf(grid) + i, grid, 0.0f, weight[pixel] * own[i], samples[i], f, g, noisy);
    sum.numerator += of_point.numerator;
    sum.denominator += of_point.denominator;
    sum.variance += of_point.variance;
  }
  PutTerms(sum, pixel, grid, terms);
}

// What term k of a pixel is.
float TermOfPixel(int k, float n, float d, float variance) {
  return k == 0 ? n : k == 1 ? d : k == 2 ? n * n : k == 3 ? n * d : k == 4 ? d * d : variance;
}

// Sums of all terms over the pixels of a cell, kind by kind.
__kernel void TermsOfCells(Grid grid, int kinds, __global const int* kind, __global const float* terms,
                           __global float* cells) {
  const size_t cell = get_global_id(0);
  if (cell >= CellsOf(grid)) return;
  const int x0 = (int)(cell % grid.columns) * kChoiceCell, y0 = (int)(cell / grid.columns) * kChoiceCell;
  float sums[kMostKinds * TERMS];
  for (int i = 0; i < kinds * TERMS; ++i) sums[i] = 0.0f;
  for (int y = y0; y < y0 + kChoiceCell && y < grid.height; ++y) {
    for (int x = x0; x < x0 + kChoiceCell && x < grid.width; ++x) {
      const size_t pixel = (size_t)y * grid.width + x;
      const float n = terms[pixel], d = terms[PixelsOf(grid) + pixel], variance = terms[2 * PixelsOf(grid) + pixel];
      for (int k = 0; k < TERMS; ++k) sums[kind[pixel] * TERMS + k] += TermOfPixel(k, n, d, variance);
    }
  }
  for (int i = 0; i < kinds * TERMS; ++i) cells[i * CellsOf(grid) + cell] = sums[i];
}

// Sums along the rows of cells.
__kernel void SumRowsOfCells(Grid grid, int planes, int radius, __global const float* cells, __global float* sums) {
  const size_t item = get_global_id(0);
  if (item >= planes * CellsOf(grid)) return;
  const int x = (int)(item % grid.columns), side = 2 * radius + 1;
  __global const float* row = cells + (item - x);
  float sum = 0.0f, group = 0.0f;
  for (int j = 0; j < side; ++j) {
    const int at = x + j - radius;
    const float value = at >= 0 && at < grid.columns ? row[at] : 0.0f;
    const int is_single = j >= side / 3 * 3;
    group = is_single || j % 3 == 0 ? value : group + value;
    if (is_single || j % 3 == 2) sum += group;
  }
  sums[item] = sum;
}

// Of a row or column of `size` in the window of this radius around i.
int CountInWindow(int i, int radius, int size) {
  const int last = i + radius < size - 1 ? i + radius : size - 1;
  return last - (i - radius > 0 ? i - radius : 0) + 1;
}

// VarianceOf of filter/layers/choice.cc.
float VarianceOf(float t, const float* mean, float cells, int by_pixel) {
  const float residuals = Greatest(0.0f, mean[2] - t * (2.0f * mean[3] - t * mean[4]));
  const float squared = mean[1] * mean[1] * cells;
  const float chance = by_pixel ? Least(1.0f, sqrt(mean[5] / mean[1])) : 1.0f;
  const float leverage = chance * Least(mean[4] / squared, kMostLeverage);
  return residuals / (squared * (1.0f - leverage) * (1.0f - leverage)) + leverage * leverage * t * t;
}

// Refined of the same.
float RefinedShare(float t, const float* mean, float cells, float significance, int by_pixel) {
  const float of_window = mean[0] / mean[1];
  const float difference = of_window - t;
  const float least = significance * VarianceOf(of_window, mean, cells, by_pixel);
  const float square = difference * difference;
  return mean[1] > 0.0f && square > least ? t + (1.0f - least / square) * difference : t;
}

// Moves the shares of cells towards those of the windows around them, kind by kind, by the sums along rows.
__kernel void RefineCells(Grid grid, int kinds, int radius, float significance, __global const float* sums,
                          __global float* shares) {
  const size_t item = get_global_id(0);
  if (item >= kinds * CellsOf(grid)) return;
  const size_t cell = item % CellsOf(grid);
  const int x = (int)(cell % grid.columns), y = (int)(cell / grid.columns);
  const float count =
      (float)(CountInWindow(x, radius, grid.columns) * CountInWindow(y, radius, grid.rows));
  float mean[TERMS];
  for (int k = 0; k < TERMS; ++k) {
    __global const float* column = sums + (item / CellsOf(grid) * TERMS + k) * CellsOf(grid) + x;
    float sum = 0.0f;
    for (int j = y - radius; j <= y + radius; ++j) {
      if (j >= 0 && j < grid.rows) sum += column[(size_t)j * grid.columns];
    }
    mean[k] = sum / count;
  }
  shares[item] = RefinedShare(shares[item], mean, count, significance, 0);
}

__kernel void ShareOfCells(Grid grid, __global const int* kind, __global const float* shares,
                           __global float* share) {
  const size_t pixel = get_global_id(0);
  if (pixel >= PixelsOf(grid)) return;
  const int x = (int)(pixel % grid.width), y = (int)(pixel / grid.width);
  share[pixel] = shares[kind[pixel] * CellsOf(grid) + (size_t)(y / kChoiceCell) * grid.columns + x / kChoiceCell];
}

// Moves the shares of pixels towards those of the windows around them, of pixels of their kind.
__kernel void RefinePixels(Grid grid, int radius, float significance, __global const int* kind,
                           __global const float* terms, __global float* share) {
  const size_t pixel = get_global_id(0);
  if (pixel >= PixelsOf(grid)) return;
  const int x = (int)(pixel % grid.width), y = (int)(pixel / grid.width), side = 2 * radius + 1;
  float sums[TERMS];
  for (int k = 0; k < TERMS; ++k) sums[k] = 0.0f;
  for (int at_y = y - radius; at_y <= y + radius; ++at_y) {
    if (at_y < 0 || at_y >= grid.height) continue;
    float in_row[TERMS], group[TERMS];
    for (int k = 0; k < TERMS; ++k) in_row[k] = group[k] = 0.0f;
    for (int j = 0; j < side; ++j) {
      const int at_x = x + j - radius;
      const size_t at = (size_t)at_y * grid.width + at_x;
      const int counts = at_x >= 0 && at_x < grid.width && kind[at] == kind[pixel];
      const float n = counts ? terms[at] : 0.0f, d = counts ? terms[PixelsOf(grid) + at] : 0.0f;
      const float variance = counts ? terms[2 * PixelsOf(grid) + at] : 0.0f;
      const int is_single = j >= side / 3 * 3;
      for (int k = 0; k < TERMS; ++k) {
        const float value = TermOfPixel(k, n, d, variance);
        group[k] = is_single || j % 3 == 0 ? value : group[k] + value;
        if (is_single || j % 3 == 2) in_row[k] += group[k];
      }
    }
    for (int k = 0; k < TERMS; ++k) sums[k] += in_row[k];
  }
  const float count = (float)(CountInWindow(y, radius, grid.height) * CountInWindow(x, radius, grid.width));
  for (int k = 0; k < TERMS; ++k) sums[k] /= count;
  share[pixel] = RefinedShare(share[pixel], sums, count, significance, 1);
}

// Means of the shares, within 0 and 1, over the pixels of one kind in a window.
__kernel void SmoothShare(Grid grid, int radius, __global const float* weight, __global const int* kind,
                          __global const float* share, __global float* smooth) {
  const size_t pixel = get_global_id(0);
  if (pixel >= PixelsOf(grid)) return;
  const int x = (int)(pixel % grid.width), y = (int)(pixel / grid.width), side = 2 * radius + 1;
  float sum = 0.0f, mass = 0.0f;
  for (int at_y = y - radius; at_y <= y + radius; ++at_y) {
    if (at_y < 0 || at_y >= grid.height) continue;
    float row_sum = 0.0f, row_mass = 0.0f, group = 0.0f, group_mass = 0.0f;
    for (int j = 0; j < side; ++j) {
      const int at_x = x + j - radius;
      const size_t at = (size_t)at_y * grid.width + at_x;
      const int counts = at_x >= 0 && at_x < grid.width && kind[at] == kind[pixel];
      const float by = counts ? weight[at] : 0.0f;
      const float t = counts ? share[at] : 0.0f;
      const float value = by * (t < 0.0f ? 0.0f : 1.0f < t ? 1.0f : t);
      const int is_single = j >= side / 3 * 3, begins = is_single || j % 3 == 0;
      group = begins ? value : group + value;
      group_mass = begins ? by : group_mass + by;
      if (!is_single && j % 3 != 2) continue;
      row_sum += group;
      row_mass += group_mass;
    }
    sum += row_sum;
    mass += row_mass;
  }
  smooth[pixel] = mass > 0.0f ? sum / mass : 0.0f;
}

// Moves a picture towards another by the shares of pixels; if that one `is_noisy`, without the points of a half in which these have no
// weight. A work-item a site.
__kernel void MoveTowards(Grid grid, int is_noisy, __global const int* places, __global const float* weights_a,
                          __global const float* weights_b, __global const float* share, __global const float* towards,
                          __global float* picture) {
  const size_t site = get_global_id(0), pixels = PixelsOf(grid);
  if (site >= SitesOf(grid)) return;
  const float t = share[PixelOfSite(site, grid, places)];
  for (int i = 0; i < 6; ++i) {
    if (is_noisy && site >= pixels && !((i < 3 ? weights_a : weights_b)[site - pixels] > 0.0f)) continue;
    const size_t at = i * SitesOf(grid) + site;
    picture[at] += t * (towards[at] - picture[at]);
  }
}
