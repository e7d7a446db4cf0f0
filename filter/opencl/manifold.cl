// ManifoldFilterAtPoints (filter/manifold/manifold_filter.h) for a device of OpenCL 1.2, a kernel a stage, with the bits of the
// processor's code. The tests compile this file as C++, too: there it is the oracle of that code.
//
// The host defines, as numbers: FEATURES, CHANNELS (signals that are given), FITS (0 or 1: with positions, a plane is fitted),
// STEP (side of a cell, a power of two); the constants of filter/manifold/manifold_constants.h and first_order.h by their names;
// DOUBLES (1: the device has double precision), for covariance.cl, which follows in the program; and for arrays MOST_FEATURES,
// MOST_PLANES and MOST_STEP, the greatest numbers.
//
// It follows shared.cl, which says what sites are. Layouts: planes of sites one after another; of cells, all planes of a cell side by
// side, manifold by manifold. No sum crosses work-items.
#if defined(__OPENCL_VERSION__) && DOUBLES
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#endif

#define SIGNALS (CHANNELS + 2 * FITS)          // that are splatted: with x and y where planes are fitted
#define RESULTS (FITS ? 14 : CHANNELS)         // that are sliced: the moments
#define PLANES (RESULTS + 1)                   // and the weight
#define PAIRS (FEATURES * (FEATURES + 1) / 2)  // entries of a symmetric matrix: its lower triangle
#define ENTRIES (PAIRS + 1)                    // and the weight

// A place between the centres of four cells, as a pixel has it.
typedef struct {
  int left, right, upper, lower;
  float across, down;
} Place;

// Exp of filter/image/portable_math.h for x <= 88.
float Exp(float x) {
  const float rounder = 12582912.0f;
  const float clamped = x < -87.0f ? -87.0f : x;
  const float shifted = clamped * 1.44269504f + rounder;
  const float n = shifted - rounder;
  const float r = (clamped - n * 0.693359375f) - n * -2.12194440e-4f;
  float p = 1.9875691500e-4f;
  p = p * r + 1.3981999507e-3f;
  p = p * r + 8.3334519073e-3f;
  p = p * r + 4.1665795894e-2f;
  p = p * r + 1.6666665459e-1f;
  p = p * r + 5.0000001201e-1f;
  const float mantissa = (p * (r * r) + r) + 1.0f;
  const int exponent = as_int(shifted) - as_int(rounder);
  return x < -87.0f ? 0.0f : mantissa * as_float((exponent + 127) << 23);
}

Place PlaceOf(int x, int y, Grid grid) {
  Place at;
  if (STEP == 1) {
    at.left = at.right = x;
    at.upper = at.lower = y;
    at.across = at.down = 0.0f;
    return at;
  }
  const int from_x = x + STEP / 2,
            from_y = y + STEP / 2;  // counted from the centre of the cell before the first
  const int column = from_x / STEP - 1, row = from_y / STEP - 1;
  at.across = ((float)(from_x & (STEP - 1)) + 0.5f) / (float)STEP;
  at.down = ((float)(from_y & (STEP - 1)) + 0.5f) / (float)STEP;
  at.left = column < 0 ? 0 : column;
  at.right = column + 1 < grid.columns ? column + 1 : grid.columns - 1;
  at.upper = row < 0 ? 0 : row;
  at.lower = row + 1 < grid.rows ? row + 1 : grid.rows - 1;
  return at;
}

// Plane k of the cells, each of `planes`, at a place.
float Read(__global const float* cells, int planes, int k, Place at, Grid grid) {
  const int upper = at.upper * grid.columns, lower = at.lower * grid.columns;
  const float upper_left = cells[(size_t)(upper + at.left) * planes + k];
  const float lower_left = cells[(size_t)(lower + at.left) * planes + k];
  const float upper_right = cells[(size_t)(upper + at.right) * planes + k];
  const float lower_right = cells[(size_t)(lower + at.right) * planes + k];
  const float left = upper_left + at.down * (lower_left - upper_left);
  const float right = upper_right + at.down * (lower_right - upper_right);
  return left + at.across * (right - left);
}

// The position of a pixel on an axis, relative to the centre, in units.
float PositionOf(int pixel, int size, float unit) { return ((float)pixel - 0.5f * (float)(size - 1)) / unit; }

// Pixel i of a cell, row by row; -1: the picture ends before.
int PixelOfCell(int cell, int i, Grid grid) {
  const int x = cell % grid.columns * STEP + i % STEP;
  const int y = cell / grid.columns * STEP + i / STEP;
  return x < grid.width && y < grid.height ? y * grid.width + x : -1;
}
int AreaOf(int cell, Grid grid) {
  const int columns = grid.width - cell % grid.columns * STEP,
            rows = grid.height - cell / grid.columns * STEP;
  return (columns < STEP ? columns : STEP) * (rows < STEP ? rows : STEP);
}

// The sum of mass * value over a cell: row by row, in a row four by four, and these as pairs.
float CellSum(const float* masses, const float* values) {
  const int together = STEP < 4 ? STEP : 4;
  float sum = 0.0f;
  for (int i = 0; i < STEP * STEP; i += together) {
    float pair = masses[i] * values[i];
    if (together > 1) pair += masses[i + 1] * values[i + 1];
    if (together > 2) pair += masses[i + 2] * values[i + 2] + masses[i + 3] * values[i + 3];
    sum += pair;
  }
  return sum;
}

// --- What sites have -------------------------------------------------------------------------------------------------------

__kernel void Clear(int count, __global float* values) {
  const size_t item = get_global_id(0);
  if (item < (size_t)count) values[item] = 0.0f;
}

// The first `shared` features of points are their pixels'.
__kernel void ShareFeatures(Grid grid, int shared, __global const int* places, __global float* features) {
  const size_t item = get_global_id(0);
  if (item >= (size_t)shared * grid.points) return;
  const size_t point = item % grid.points;
  __global float* plane = features + item / grid.points * SitesOf(grid);
  plane[PixelsOf(grid) + point] = plane[(size_t)places[2 * point + 1] * grid.width + places[2 * point]];
}

// Pixels for which their points stand weigh nothing themselves.
__kernel void Replace(int count, __global const int* pixels, __global float* masses) {
  const size_t item = get_global_id(0);
  if (item < (size_t)count) masses[pixels[item]] = 0.0f;
}

// --- The tree of manifolds -------------------------------------------------------------------------------------------------

// Of `clusters` clusters from `first` on in each cell, the means of mass * feature and of mass. The root: labels are 0, masses the
// mask.
__kernel void ClusterSums(Grid grid, int clusters, int first, __global const float* features,
                          __global const int* labels, __global const float* masses, __global float* sums) {
  const size_t item = get_global_id(0);
  if (item >= (size_t)clusters * CellsOf(grid)) return;
  const int cell = (int)(item % CellsOf(grid)), cluster = first + (int)(item / CellsOf(grid));
  float own[MOST_STEP * MOST_STEP], values[MOST_STEP * MOST_STEP];
  int has_members = 0;
  for (int i = 0; i < STEP * STEP; ++i) {
    const int pixel = PixelOfCell(cell, i, grid);
    const int is_own = pixel >= 0 && labels[pixel < 0 ? 0 : pixel] == cluster;
    has_members |= is_own;
    own[i] = is_own ? masses[pixel] : 0.0f;
    values[i] = 1.0f;
  }
  __global float* to = sums + item * (FEATURES + 1);
  if (!has_members) {
    for (int k = 0; k <= FEATURES; ++k) to[k] = 0.0f;
    return;
  }
  to[FEATURES] = CellSum(own, values) / (float)AreaOf(cell, grid);
  for (int k = 0; k < FEATURES; ++k) {
    for (int i = 0; i < STEP * STEP; ++i) {
      const int pixel = PixelOfCell(cell, i, grid);
      values[i] = pixel < 0 ? 0.0f : features[(size_t)k * SitesOf(grid) + pixel];
    }
    to[k] = CellSum(own, values) / (float)AreaOf(cell, grid);
  }
}

// The low-pass of one feedback coefficient along the rows of all planes of some images; a work-item a chain.
__kernel void EvenRows(Grid grid, int images, float link, __global const float* from, __global float* to) {
  const size_t item = get_global_id(0);
  if (item >= (size_t)images * grid.rows * (FEATURES + 1)) return;
  const size_t first = item / (FEATURES + 1) * grid.columns * (FEATURES + 1) + item % (FEATURES + 1);
  float last = from[first];
  to[first] = last;
  for (int x = 1; x < grid.columns; ++x) {
    const float value = from[first + x * (FEATURES + 1)];
    last = value + link * (last - value);
    to[first + x * (FEATURES + 1)] = last;
  }
  for (int x = grid.columns - 2; x >= 0; --x) {
    const float value = to[first + x * (FEATURES + 1)];
    last = value + link * (last - value);
    to[first + x * (FEATURES + 1)] = last;
  }
}

// Then along the columns, in place.
__kernel void EvenColumns(Grid grid, int images, float link, __global float* cells) {
  const size_t item = get_global_id(0);
  const size_t row = (size_t)grid.columns * (FEATURES + 1);
  if (item >= (size_t)images * row) return;
  __global float* at = cells + item / row * grid.rows * row + item % row;
  float last = at[0];
  for (int y = 1; y < grid.rows; ++y) {
    const float value = at[y * row];
    last = value + link * (last - value);
    at[y * row] = last;
  }
  for (int y = grid.rows - 2; y >= 0; --y) {
    const float value = at[y * row];
    last = value + link * (last - value);
    at[y * row] = last;
  }
}

// The manifolds from `first` on: low-passed features over low-passed weight, drawn to the parents, two to each from `parent` on;
// the root has none: -1.
__kernel void Heights(Grid grid, int images, int first, int parent, __global const float* low,
                      __global float* eta) {
  const size_t item = get_global_id(0);
  if (item >= (size_t)images * CellsOf(grid)) return;
  const size_t image = item / CellsOf(grid), cell = item % CellsOf(grid);
  const float drawn = parent < 0 ? 0.0f : kParentMass;
  const float weight = low[item * (FEATURES + 1) + FEATURES] + drawn;
  for (int k = 0; k < FEATURES; ++k) {
    float sum = low[item * (FEATURES + 1) + k];
    if (parent >= 0) sum += drawn * eta[((parent + image / 2) * CellsOf(grid) + cell) * FEATURES + k];
    eta[((first + image) * CellsOf(grid) + cell) * FEATURES + k] =
        weight < kLeastClusterMass ? 0.0f : sum / weight;
  }
}

// The weights of sites on the `count` manifolds from `first` on, written where they `stay`, from manifold `origin` on. Squared
// distances of points over the first `shared` features, which are their pixels', are divided. `splits`: each pixel goes into one of
// the two parts of its cluster, with a mass.
__kernel void Weigh(Grid grid, int count, int first, int stay, int origin, int splits, int shared, float divisor,
                    __global const int* places, __global const float* features, __global const float* eta,
                    __global const float* axes, __global float* members, __global int* labels,
                    __global float* total, __global float* weights, __global float* masses) {
  const size_t site = get_global_id(0);
  if (site >= SitesOf(grid)) return;
  const int is_pixel = site < PixelsOf(grid);
  const Place at = PlaceOf(XOf(site, grid, places), YOf(site, grid, places), grid);
  float own_features[MOST_FEATURES];
  for (int k = 0; k < FEATURES; ++k) own_features[k] = features[k * SitesOf(grid) + site];
  const int own = splits && is_pixel ? labels[site] : -1;
  const int divided = is_pixel ? 0 : shared;
  float sum = total[site], along = 0.0f, own_weight = 0.0f;
  for (int m = 0; m < count; ++m) {
    __global const float* heights = eta + (size_t)(first + m) * CellsOf(grid) * FEATURES;
    float square = 0.0f;
    for (int k = 0; k < FEATURES && (m == own || k < divided || square < kFarthest); ++k) {
      const float offset = own_features[k] - Read(heights, FEATURES, k, at, grid);
      square += offset * offset;
      if (k + 1 == divided) square /= divisor;
      if (m == own) along += axes[m * FEATURES + k] * offset;
    }
    const float weight = square < kFarthest ? Exp(-square) : 0.0f;
    sum += weight;
    own_weight = m == own ? weight : own_weight;
    if (stay) weights[(first + m - origin) * SitesOf(grid) + site] = weight;
  }
  total[site] = sum;
  if (own < 0) return;
  const float member = members[site] * Least(1.0f, fabs(along) * (1.0f / kSeam));
  members[site] = member;
  labels[site] = 2 * own + (along >= 0.0f ? 1 : 0);
  masses[site] = member * (1.0f - own_weight);
}

// --- Splat, blur and slice -------------------------------------------------------------------------------------------------

// What sites weigh in splats.
__kernel void KeepMass(Grid grid, __global const float* total, __global float* masses) {
  const size_t site = get_global_id(0);
  if (site < SitesOf(grid)) masses[site] /= Least(1.0f, total[site]) + kLeastTotal;
}

// Signal k of a site, its position among them; the last is the weight's.
float SignalOf(int k, size_t site, Grid grid, float unit, __global const int* places,
               __global const float* signals) {
  if (k < CHANNELS) return signals[k * SitesOf(grid) + site];
  if (k == SIGNALS) return 1.0f;
  return k == CHANNELS ? PositionOf(XOf(site, grid, places), grid.width, unit)
                       : PositionOf(YOf(site, grid, places), grid.height, unit);
}

// On `manifolds` manifolds. The points of cell c are order[firsts[c]] to order[firsts[c + 1] - 1], summed after its pixels.
__kernel void Splat(Grid grid, int manifolds, float unit, __global const int* places, __global const int* firsts,
                    __global const int* order, __global const float* signals, __global const float* masses,
                    __global const float* weights, __global float* psi) {
  const size_t item = get_global_id(0);
  if (item >= (size_t)manifolds * CellsOf(grid)) return;
  const int cell = (int)(item % CellsOf(grid));
  __global const float* on_manifold = weights + item / CellsOf(grid) * SitesOf(grid);
  float own[MOST_STEP * MOST_STEP], values[MOST_STEP * MOST_STEP];
  for (int i = 0; i < STEP * STEP; ++i) {
    const int pixel = PixelOfCell(cell, i, grid);
    own[i] = pixel < 0 ? 0.0f : masses[pixel] * on_manifold[pixel];
  }
  for (int k = 0; k <= SIGNALS; ++k) {
    for (int i = 0; i < STEP * STEP; ++i) {
      const int pixel = PixelOfCell(cell, i, grid);
      values[i] = pixel < 0 ? 0.0f : SignalOf(k, pixel, grid, unit, places, signals);
    }
    float sum = CellSum(own, values);
    for (int i = firsts[cell]; i < firsts[cell + 1]; ++i) {
      const size_t site = PixelsOf(grid) + order[i];
      sum += masses[site] * on_manifold[site] * SignalOf(k, site, grid, unit, places, signals);
    }
    psi[item * PLANES + (k == SIGNALS ? RESULTS : k)] = sum / (float)AreaOf(cell, grid);
  }
}

// The moments of the fit. A cell's light counts as if it were at the mean position of its pixels.
__kernel void Moments(Grid grid, int manifolds, __global float* psi) {
  const size_t item = get_global_id(0);
  if (item >= (size_t)manifolds * CellsOf(grid)) return;
  __global float* at = psi + item * PLANES;
  const float weight = at[RESULTS];
  const float inverse = weight >= 1.17549435e-38f ? 1.0f / weight : 0.0f;
  const float sum_x = at[3], sum_y = at[4];
  const float x = sum_x * inverse, y = sum_y * inverse;
  for (int c = 0; c < 3; ++c) {
    at[5 + c] = x * at[c];
    at[8 + c] = y * at[c];
  }
  at[11] = x * sum_x;
  at[12] = x * sum_y;
  at[13] = y * sum_y;
}

// The links of each cell of the manifolds from `first` on with the cell to the left and the one above.
__kernel void Links(Grid grid, int manifolds, int first, float sigma, float stretch, __global const float* eta,
                    __global float* across, __global float* down) {
  const size_t item = get_global_id(0);
  if (item >= (size_t)manifolds * CellsOf(grid)) return;
  const int cell = (int)(item % CellsOf(grid));
  __global const float* here = eta + (first * CellsOf(grid) + item) * FEATURES;
  for (int i = 0; i < 2; ++i) {
    const int before = i == 0 ? 1 : grid.columns;  // cells
    const int has_before = i == 0 ? cell % grid.columns > 0 : cell >= grid.columns;
    float square = 0.0f;
    for (int k = 0; k < FEATURES && has_before; ++k) {
      const float difference = here[k] - here[k - before * FEATURES];
      square += difference * difference;
    }
    const float link = Exp((-kSqrt2 / sigma) * sqrt(1.0f + stretch * square));
    if (i == 0)
      across[item] = link;
    else
      down[item] = link;
  }
}

// The blur along the rows of all planes of all manifolds, in place; a work-item a chain.
__kernel void GuidedRows(Grid grid, int manifolds, __global const float* across, __global float* psi) {
  const size_t item = get_global_id(0);
  if (item >= (size_t)manifolds * grid.rows * PLANES) return;
  const size_t row = item / PLANES;
  __global float* at = psi + row * grid.columns * PLANES + item % PLANES;
  __global const float* links = across + row * grid.columns;
  float last = at[0];
  for (int x = 1; x < grid.columns; ++x) {
    const float value = at[x * PLANES];
    last = value + links[x] * (last - value);
    at[x * PLANES] = last;
  }
  for (int x = grid.columns - 2; x >= 0; --x) {
    const float value = at[x * PLANES];
    last = value + links[x + 1] * (last - value);
    at[x * PLANES] = last;
  }
}

// Then along the columns.
__kernel void GuidedColumns(Grid grid, int manifolds, __global const float* down, __global float* psi) {
  const size_t item = get_global_id(0);
  const size_t row = (size_t)grid.columns * PLANES;
  if (item >= (size_t)manifolds * row) return;
  __global float* at = psi + item / row * grid.rows * row + item % row;
  __global const float* links = down + item / row * CellsOf(grid) + item % row / PLANES;
  float last = at[0];
  for (int y = 1; y < grid.rows; ++y) {
    const float value = at[y * row];
    last = value + links[y * grid.columns] * (last - value);
    at[y * row] = last;
  }
  for (int y = grid.rows - 2; y >= 0; --y) {
    const float value = at[y * row];
    last = value + links[(y + 1) * grid.columns] * (last - value);
    at[y * row] = last;
  }
}

// The fitted plane's value of colour c at (x, y); `m`: the moments.
float PlaneAt(const float* m, int c, float ridge, float x, float y) {
  const float xx = Greatest(m[11] - m[3] * m[3], 0.0f) + ridge;
  const float yy = Greatest(m[13] - m[4] * m[4], 0.0f) + ridge;
  const float xy = m[12] - m[3] * m[4];
  const float determinant = Greatest(xx * yy - xy * xy, ridge * ridge);
  const float off_x = x - m[3], off_y = y - m[4];
  float by_x = (off_x * yy - off_y * xy) / determinant;
  float by_y = (off_y * xx - off_x * xy) / determinant;
  const float deviations = sqrt(off_x * by_x + off_y * by_y);
  if (deviations > kMostDeviations) {
    by_x *= kMostDeviations / deviations;
    by_y *= kMostDeviations / deviations;
  }
  return m[c] + by_x * (m[5 + c] - m[3] * m[c]) + by_y * (m[8 + c] - m[4] * m[c]);
}

// Sums over manifolds, those before being in `planes` unless these are the first. With the last: quotient, and what the fit makes of
// it, in the place of the sums. A pixel that no manifold reaches keeps its own signals; a point is 0 then, and so is what it found.
__kernel void Slice(Grid grid, int manifolds, int is_first, int is_last, float unit, float ridge,
                    __global const int* places, __global const float* signals, __global const float* weights,
                    __global const float* psi, __global float* planes, __global float* found) {
  const size_t site = get_global_id(0);
  if (site >= SitesOf(grid)) return;
  const int x = XOf(site, grid, places), y = YOf(site, grid, places);
  const Place at = PlaceOf(x, y, grid);
  float sums[MOST_PLANES];
  for (int k = 0; k < PLANES; ++k) sums[k] = is_first ? 0.0f : planes[k * SitesOf(grid) + site];
  for (int m = 0; m < manifolds; ++m) {
    const float weight = weights[m * SitesOf(grid) + site];
    if (weight == 0.0f) continue;
    __global const float* cells = psi + m * CellsOf(grid) * PLANES;
    for (int k = 0; k < PLANES; ++k) sums[k] += weight * Read(cells, PLANES, k, at, grid);
  }
  if (!is_last) {
    for (int k = 0; k < PLANES; ++k) planes[k * SitesOf(grid) + site] = sums[k];
    return;
  }
  const int is_lost = sums[RESULTS] < kLeastWeight;
  const int keeps = site < PixelsOf(grid);
  for (int k = 0; k < RESULTS; ++k) {
    const float own = keeps && k < SIGNALS ? SignalOf(k, site, grid, unit, places, signals) : 0.0f;
    sums[k] = is_lost ? own : sums[k] / sums[RESULTS];
  }
  const float own_x = PositionOf(x, grid.width, unit), own_y = PositionOf(y, grid.height, unit);
  for (int c = 0; c < CHANNELS; ++c)
    planes[c * SitesOf(grid) + site] = FITS ? PlaneAt(sums, c, ridge, own_x, own_y) : sums[c];
  if (!keeps) found[site - PixelsOf(grid)] = is_lost ? 0.0f : sums[RESULTS];
}
