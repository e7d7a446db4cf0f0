// The axes that split clusters: covariances and power iteration in double precision. Follows manifold.cl and reals.cl in one program.
// kLeastSpread is defined as the bits of its number.

#define ONE 0x3ff0000000000000UL
#define HALF 0x3fe0000000000000UL
#define MINUS_HALF 0xbfe0000000000000UL
#define START_STEP 0x3fc0a3d70a3d70a4UL  // .13

// Of every row_step-th row of cells its part of the covariance around the manifold, and its weight; a work-item an entry.
__kernel void RowCovariance(Grid grid, int images, int first, int row_step, __global const float* sums,
                            __global const float* eta, __global Real* rows) {
  const size_t item = get_global_id(0);
  const int count = (grid.rows + row_step - 1) / row_step;
  if (item >= (size_t)images * count * ENTRIES) return;
  const int entry = (int)(item % ENTRIES), row = (int)(item / ENTRIES % count);
  const size_t image = item / ENTRIES / count;
  int i = 0, j = entry;
  while (j > i) {
    ++i;
    j -= i;
  }
  Real total = RealOf(0.0f);
  for (int x = 0; x < grid.columns; ++x) {
    const size_t cell = (size_t)row * row_step * grid.columns + x;
    __global const float* sum = sums + (image * CellsOf(grid) + cell) * (FEATURES + 1);
    __global const float* mean = eta + ((first + image) * CellsOf(grid) + cell) * FEATURES;
    const float weight = sum[FEATURES];
    if (entry == PAIRS)
      total = Sum(total, RealOf(weight));
    else if (!(weight < kLeastClusterMass))
      total = Sum(total, Product(Product(RealOf(weight), RealOf(sum[i] / weight - mean[i])),
                                 RealOf(sum[j] / weight - mean[j])));
  }
  rows[item] = total;
}

// The sums over rows, in their order.
__kernel void Covariance(Grid grid, int images, int row_step, __global const Real* rows,
                         __global Real* covariance) {
  const size_t item = get_global_id(0);
  const int count = (grid.rows + row_step - 1) / row_step;
  if (item >= (size_t)images * ENTRIES) return;
  __global const Real* at = rows + item / ENTRIES * count * ENTRIES + item % ENTRIES;
  Real total = RealOf(0.0f);
  for (int row = 0; row < count; ++row) total = Sum(total, at[row * ENTRIES]);
  covariance[item] = total;
}

// The principal axes of clusters, from cluster `first` on, by power iteration; a work-item a cluster.
__kernel void Axis(int images, int first, int iterations, __global const Real* covariance, __global float* axes) {
  const size_t image = get_global_id(0);
  if (image >= (size_t)images) return;
  __global const Real* lower = covariance + image * ENTRIES;
  Real axis[MOST_FEATURES], next[MOST_FEATURES], spread = RealOf(0.0f);
  for (int k = 0; k < FEATURES; ++k) {
    const Real step = Product(RealOfBits(START_STEP), RealOf((float)k));
    axis[k] = Product(RealOfBits(k % 2 == 0 ? HALF : MINUS_HALF), Sum(RealOfBits(ONE), step));
    spread = Sum(spread, lower[k * (k + 1) / 2 + k]);
  }
  if (!IsGreater(spread, Product(RealOfBits(kLeastSpread), lower[PAIRS]))) iterations = 0;
  for (int step = 0; step < iterations; ++step) {
    Real squares = RealOf(0.0f);
    for (int i = 0; i < FEATURES; ++i) {
      next[i] = RealOf(0.0f);
      for (int j = 0; j < FEATURES; ++j)
        next[i] = Sum(next[i], Product(lower[i >= j ? i * (i + 1) / 2 + j : j * (j + 1) / 2 + i], axis[j]));
    }
    for (int i = 0; i < FEATURES; ++i) squares = Sum(squares, Product(next[i], next[i]));
    const Real length = IsGreater(squares, RealOf(0.0f)) ? Root(squares) : RealOfBits(ONE);
    for (int i = 0; i < FEATURES; ++i) axis[i] = Quotient(next[i], length);
  }
  for (int k = 0; k < FEATURES; ++k) axes[(first + image) * FEATURES + k] = FloatOf(axis[k]);
}
