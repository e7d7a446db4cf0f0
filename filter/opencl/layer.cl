// What leads from one filtering of a layer to the next, for a device and as C++. Follows shared.cl in a program of its own, with
// choice.cl and energy.cl.
//
// Layouts: pictures as shared.cl has them; other planes are of pixels.

// StabiliseRow of filter/kernels/row_kernels.h.
__kernel void Stabilise(int count, float inverse_knee, float shift, __global float* values) {
  const size_t item = get_global_id(0);
  if (item < (size_t)count) values[item] = Asinh(values[item] * inverse_knee) - shift;
}

// Combine of filter/layers/halves.h, plane by plane, in place of half A. A work-item a value.
__kernel void MeanOfHalves(Grid grid, int planes, __global const float* share_a, __global const float* b, __global float* a) {
  const size_t item = get_global_id(0);
  if (item >= planes * PixelsOf(grid)) return;
  const float share = share_a[item % PixelsOf(grid)];
  a[item] = share * a[item] + (1.0f - share) * b[item];
}

// Subtracts a half of a picture from signals, which are planes of sites. A work-item a value.
__kernel void SubtractHalf(Grid grid, int half_of, __global const float* picture, __global float* signals) {
  const size_t item = get_global_id(0);
  if (item < 3 * SitesOf(grid)) signals[item] -= picture[PlaneOf(half_of, 0, grid) + item];
}

// Dimension i of the patch around a pixel, times the window; 1 behind the last.
float PatchValue(int i, int x, int y, Grid grid, int size, int radius, __global const float* window,
                 __global const float* color) {
  if (i == size - 1) return 1.0f;
  const int side = 2 * radius + 1, tap = i % (side * side);
  const int at_x = x + tap % side - radius, at_y = y + tap / side - radius;
  const int in_x = at_x < 0 ? 0 : at_x < grid.width ? at_x : grid.width - 1;
  const int in_y = at_y < 0 ? 0 : at_y < grid.height ? at_y : grid.height - 1;
  return window[tap] * color[i / (side * side) * PixelsOf(grid) + (size_t)in_y * grid.width + in_x];
}

// PatchProductsOf of filter/manifold/nlm_space.h: sums of a part of `part_rows` rows of the lattice, of `rows` in all; a work-item an
// entry of a part, of which `size` rows have one entry more each.
__kernel void PatchProducts(Grid grid, int size, int radius, int part_rows, int rows, int columns, __global const int* at_rows,
                            __global const int* at_columns, __global const float* window, __global const float* mask,
                            __global const float* color, __global float* products) {
  const size_t item = get_global_id(0), entries = (size_t)size * (size + 1) / 2;
  const int parts = (rows + part_rows - 1) / part_rows;
  if (item >= parts * entries) return;
  const int first = (int)(item / entries) * part_rows;
  int i = 0, j = (int)(item % entries);
  while (j > i) {
    ++i;
    j -= i;
  }
  float sum = 0.0f;
  for (int row = first; row < first + part_rows && row < rows; ++row) {
    const int y = at_rows[row];
    for (int column = 0; column < columns; ++column) {
      const int x = at_columns[column];
      if (!(mask[(size_t)y * grid.width + x] > 0.0f)) continue;
      sum += PatchValue(i, x, y, grid, size, radius, window, color) * PatchValue(j, x, y, grid, size, radius, window, color);
    }
  }
  products[item] = sum;
}

// Adds six planes to the pixels of a picture. A work-item a value.
__kernel void AddToPixels(Grid grid, __global const float* planes, __global float* picture) {
  const size_t item = get_global_id(0), pixels = PixelsOf(grid);
  if (item < 6 * pixels) picture[item / pixels * SitesOf(grid) + item % pixels] += planes[item];
}
