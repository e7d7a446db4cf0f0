// ProjectPatches (filter/layers/nlm_space.h), for a device and as C++. Follows manifold.cl in one program.

// Asinh of filter/image/portable_math.h.
float Asinh(float x) {
  const float magnitude = fabs(x) < 1e18f ? fabs(x) : 1e18f;
  const float t = magnitude + sqrt(1.0f + magnitude * magnitude);
  const int bits = as_int(t);
  const int exponent = (bits - 0x3f3504f3) >> 23;
  const float f = as_float(bits - exponent * (1 << 23)) - 1.0f;
  const float e = (float)exponent;
  float p = 7.0376836292e-2f;
  p = p * f - 1.1514610310e-1f;
  p = p * f + 1.1676998740e-1f;
  p = p * f - 1.2420140846e-1f;
  p = p * f + 1.4249322787e-1f;
  p = p * f - 1.6668057665e-1f;
  p = p * f + 2.0000714765e-1f;
  p = p * f - 2.4999993993e-1f;
  p = p * f + 3.3333331174e-1f;
  const float square = f * f;
  const float logarithm = (f + ((p * f * square + e * -2.12194440e-4f) - 0.5f * square)) + e * 0.693359375f;
  const float m2 = magnitude * magnitude;
  const float series = magnitude * (1.0f - m2 * (1.0f / 6.0f - m2 * (3.0f / 40.0f - m2 * (15.0f / 336.0f))));
  return copysign(magnitude < 0.125f ? series : logarithm, x);
}

// StabiliseRow of filter/kernels/row_kernels.h.
__kernel void Stabilise(int count, float inverse_knee, float shift, __global float* values) {
  const size_t item = get_global_id(0);
  if (item < (size_t)count) values[item] = Asinh(values[item] * inverse_knee) - shift;
}

// Subtracts a plane from the pixels of a plane of sites.
__kernel void Subtract(Grid grid, int plane, __global const float* from, __global float* planes) {
  const size_t item = get_global_id(0);
  if (item < PixelsOf(grid)) planes[plane * SitesOf(grid) + item] -= from[item];
}

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
