// ProjectPatches (filter/layers/nlm_space.h), for a device and as C++, as manifold.cl.

// Coordinates along the axes of a basis: plane k of the result is the correlation of the picture's patches with the taps of axis
// k, channel after channel and row after row, added in groups of three taps. Edges are clamped. A work-item a value.
__kernel void Project(int width, int height, int channels, int dimensions, int radius,
                      __global const float* color, __global const float* taps, __global float* coordinates) {
  const size_t pixels = (size_t)width * (size_t)height;
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
  coordinates[item] = sum;
}
