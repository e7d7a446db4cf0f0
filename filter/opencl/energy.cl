// ReturnRemoved (filter/denoise/firefly.h): the energy of fireflies, for a device and as C++. Follows choice.cl and reals.cl in one
// program.
//
// Layouts: planes of pixels. Of energy: three of half A, three of half B. Signals that are filtered: four of each half, of which the
// last has a sign of its own at each pixel.

float LuminanceOf(float r, float g, float b) { return 0.2126f * r + 0.7152f * g + 0.0722f * b; }

float MeanOfPair(float share, float a, float b) { return share * a + (1.0f - share) * b; }

// As if by chance: MixBits of filter/image/mix_bits.h.
float RandomSign(int x, int y) {
  ulong bits = ((ulong)y << 32 | (ulong)x) + 1;
  bits = (bits ^ bits >> 30) * 0xbf58476d1ce4e5b9UL;
  bits = (bits ^ bits >> 27) * 0x94d049bb133111ebUL;
  return ((bits ^ bits >> 31) & 1) == 0 ? 1.0f : -1.0f;
}

// What is returned nearby: the signals that guide it are the features from `first` on.
__kernel void EnergyFeatures(Grid grid, int first, float inverse_knee, float shift, float range, __global const float* weight,
                             __global const float* light, __global float* features) {
  const size_t item = get_global_id(0), pixels = PixelsOf(grid);
  if (item >= 3 * pixels) return;
  const float value = (Asinh(light[item] * inverse_knee) - shift) / range;
  const int is_usable = weight[item % pixels] > 0.0f && fabs(value) <= kLargestFeature;
  features[first * pixels + item] = is_usable ? value : 0.0f;
}

__kernel void EnergySignals(Grid grid, __global const float* removed, __global float* signals) {
  const size_t pixel = get_global_id(0), pixels = PixelsOf(grid);
  if (pixel >= pixels) return;
  for (int h = 0; h < 2; ++h) {
    __global const float* from = removed + 3 * h * pixels + pixel;
    __global float* to = signals + 4 * h * pixels + pixel;
    for (int c = 0; c < 3; ++c) to[c * pixels] = from[c * pixels];
    to[3 * pixels] = RandomSign((int)(pixel % grid.width), (int)(pixel / grid.width)) *
                     LuminanceOf(from[0], from[pixels], from[2 * pixels]);
  }
}

// The light of a picture, 3 planes; behind it the luminance of what was removed, and its square.
__kernel void LightAndRemoved(Grid grid, __global const float* share_a, __global const float* picture,
                              __global const float* removed, __global float* planes) {
  const size_t pixel = get_global_id(0), pixels = PixelsOf(grid);
  if (pixel >= pixels) return;
  const float share = share_a[pixel];
  float of_half[2];
  for (int c = 0; c < 3; ++c)
    planes[c * pixels + pixel] =
        MeanOfPair(share, picture[PlaneOf(0, c, grid) + pixel], picture[PlaneOf(1, c, grid) + pixel]);
  for (int h = 0; h < 2; ++h) {
    __global const float* from = removed + 3 * h * pixels + pixel;
    of_half[h] = LuminanceOf(from[0], from[pixels], from[2 * pixels]);
  }
  const float mean = MeanOfPair(share, of_half[0], of_half[1]);
  planes[3 * pixels + pixel] = mean;
  planes[4 * pixels + pixel] = mean * mean;
}

// The filtered signals, times SharedPart() of them.
__kernel void SharedEnergy(Grid grid, __global const float* share_a, __global const float* filtered, __global float* energy) {
  const size_t pixel = get_global_id(0), pixels = PixelsOf(grid);
  if (pixel >= pixels) return;
  float of_half[2];
  for (int h = 0; h < 2; ++h) {
    __global const float* from = filtered + 4 * h * pixels + pixel;
    of_half[h] = LuminanceOf(from[0], from[pixels], from[2 * pixels]);
  }
  const float share = share_a[pixel];
  const float sum = MeanOfPair(share, of_half[0], of_half[1]);
  const float ratio = MeanOfPair(share, filtered[3 * pixels + pixel], filtered[7 * pixels + pixel]) / sum;
  const float part = ratio > -1.0f && ratio < 1.0f ? 1.0f - ratio * ratio : 0.0f;
  for (int i = 0; i < 6; ++i) energy[i * pixels + pixel] = filtered[(i / 3 * 4 + i % 3) * pixels + pixel] * part;
}

// Weighted sums over the rows of planes. A work-item a row.
__kernel void RowTotals(Grid grid, int planes, __global const float* weight, __global const float* values,
                        __global Real* totals) {
  const size_t item = get_global_id(0);
  if (item >= (size_t)planes * grid.height) return;
  const size_t row = item % grid.height * grid.width;
  __global const float* of_row = values + item / grid.height * PixelsOf(grid) + row;
  Real total = RealOf(0.0f);
  for (int x = 0; x < grid.width; ++x) total = Sum(total, Product(RealOf(weight[row + x]), RealOf(of_row[x])));
  totals[item] = total;
}

// Adds light to a plane of energy, in proportion to plane `of_light`.
__kernel void AddRest(Grid grid, int plane, int of_light, float gain, __global const float* light, __global float* energy) {
  const size_t pixel = get_global_id(0), pixels = PixelsOf(grid);
  if (pixel < pixels) energy[plane * pixels + pixel] += gain * Greatest(0.0f, light[of_light * pixels + pixel]);
}

// Adds energy to a picture. A work-item a site.
__kernel void AddEnergy(Grid grid, __global const int* places, __global const float* energy, __global float* picture) {
  const size_t site = get_global_id(0);
  if (site >= SitesOf(grid)) return;
  const size_t pixel = PixelOfSite(site, grid, places);
  for (int i = 0; i < 6; ++i) picture[i * SitesOf(grid) + site] += energy[i * PixelsOf(grid) + pixel];
}

// Makes energy what makes it the same in both halves; `apart`: what it was apart. A work-item a value of a half.
__kernel void ShareEnergy(Grid grid, __global const float* share_a, __global float* energy, __global float* apart) {
  const size_t item = get_global_id(0), pixels = PixelsOf(grid);
  if (item >= 3 * pixels) return;
  const float a = energy[item], b = energy[3 * pixels + item];
  const float mean = MeanOfPair(share_a[item % pixels], a, b);
  apart[item] = a - b;
  energy[item] = mean - a;
  energy[3 * pixels + item] = mean - b;
}
