// ProjectPatches (filter/manifold/nlm_space.h), for a device and as C++. Follows manifold.cl in one program.

// Coordinates along the axes of a basis: plane k of the result is the correlation of the picture's patches with the taps of axis
// k, channel after channel and row after row, added in groups of three taps, times `scale`. Edges are clamped. A work-item a value.
__kernel void Project(Grid grid, int channels, int dimensions, int radius, float scale, __global const float* color,
                      __global const float* taps, __global float* features) {
  const size_t pixels = PixelsOf(grid);
  const int width = grid.width, height = grid.height;
  const size_t item = get_global_id(0);
  if (item >= pixels * dimensions) return;
  const int side = 2 * radius + 1;
  const int x = (int)(item % pixels % width), y = (int)(item % pixels / width);
  __global const float* tap = taps + item / pixels * channels * side * side;
  float sum = 0.0f;
  for (int c = 0; c < channels; ++c) {
    for (int dy = -radius; dy <= radius; ++dy) {
      const int at_y = y + dy < 0 ? 0 : y + dy < height ? y + dy : height - 1;
      __global const float* row = color + c * pixels + (size_t)at_y * width;
      float group = 0.0f;
      for (int j = 0; j < side; ++j, ++tap) {
        const int at_x = x + j - radius < 0 ? 0 : x + j - radius < width ? x + j - radius : width - 1;
        const float product = *tap * row[at_x];
        const int is_single = j >= side / 3 * 3;
        group = is_single || j % 3 == 0 ? product : group + product;
        if (is_single || j % 3 == 2) sum += group;
      }
    }
  }
  features[item / pixels * SitesOf(grid) + item % pixels] = sum * scale;
}
