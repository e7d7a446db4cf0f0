// What programs of OpenCL 1.2 have in common, also as C++: a picture with its cells and points.
//
// Sites are the pixels, row by row, and then the points of SlicePoints. Work-items are numbered along one dimension; those beyond
// the last do nothing.
#ifdef __OPENCL_VERSION__
#pragma OPENCL FP_CONTRACT OFF
#endif

typedef struct {
  int width, height;  // pixels
  int columns, rows;  // cells
  int points;
} Grid;

size_t PixelsOf(Grid grid) { return (size_t)grid.width * (size_t)grid.height; }
size_t SitesOf(Grid grid) { return PixelsOf(grid) + (size_t)grid.points; }
size_t CellsOf(Grid grid) { return (size_t)grid.columns * (size_t)grid.rows; }

// Where plane c of a half begins in a picture, which is two halves of three planes of sites.
size_t PlaneOf(int half_of, int c, Grid grid) { return (3 * half_of + c) * SitesOf(grid); }

float Least(float a, float b) { return b < a ? b : a; }
float Greatest(float a, float b) { return a < b ? b : a; }

// x and y of a site. `places`: x, y of each point's pixel.
int XOf(size_t site, Grid grid, __global const int* places) {
  return site < PixelsOf(grid) ? (int)(site % grid.width) : places[2 * (site - PixelsOf(grid))];
}
int YOf(size_t site, Grid grid, __global const int* places) {
  return site < PixelsOf(grid) ? (int)(site / grid.width) : places[2 * (site - PixelsOf(grid)) + 1];
}

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
