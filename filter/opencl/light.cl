// FitLight (filter/edges/light_regression.h) around the fit itself, for a device and as C++. Follows shared.cl and fit.cl in one
// program; the host defines the constants of filter/manifold/fit_call.h by their names.

// Samples of sites `sites`, and their weights. `share_a`, `share_b`: of points, those of their samples.
__kernel void LightSamples(Grid grid, int count, int features, float inverse_reach, float inverse_light,
                           float inverse_knee, float inverse_unit, __global const int* sites,
                           __global const int* places, __global const float* offsets, __global const float* mask_a, __global const float* mask_b,
                           __global const float* share_a, __global const float* share_b, __global const float* noisy,
                           __global const float* filtered, __global const float* geometry, __global float* samples,
                           __global float* weights) {
  const size_t item = get_global_id(0);
  if (item >= (size_t)count) return;
  const size_t site = (size_t)sites[item], pixels = PixelsOf(grid);
  const float a = site < pixels ? mask_a[site] : share_a[site - pixels];
  const float b = site < pixels ? mask_b[site] : share_b[site - pixels];
  float weight = site < pixels ? Least(a, b) : a > 0.0f && b > 0.0f ? 0.5f * (a + b) : 0.0f;
  __global float* sample = samples + item * FIT_SAMPLE;
  for (int k = 0; k < FIT_SAMPLE; ++k) sample[k] = 0.0f;
  const int x = XOf(site, grid, places), y = YOf(site, grid, places);
  sample[FIT_SIGNALS] = 1.0f;
  const float right = site < pixels ? 0.0f : offsets[2 * (site - pixels)];
  const float down = site < pixels ? 0.0f : offsets[2 * (site - pixels) + 1];
  sample[FIT_SIGNALS + 1] = ((float)x + right) * inverse_reach;
  sample[FIT_SIGNALS + 2] = ((float)y + down) * inverse_reach;
  for (int k = 0; k < features && k < kMostLightFeatures; ++k) {
    const float value = geometry[(features - 1 - k) * SitesOf(grid) + site];
    sample[FIT_ROW + 2 + 3 + k] = value;
    if (k < kMostLightTerms) sample[FIT_SIGNALS + 3 + k] = value;
  }
  for (int c = 0; c < 3; ++c) {
    const size_t in_a = PlaneOf(0, c, grid) + site, in_b = PlaneOf(1, c, grid) + site;
    const float light_a = noisy[in_a] * inverse_unit, light_b = noisy[in_b] * inverse_unit;
    const float f = 0.5f * (filtered[in_a] + filtered[in_b]) * inverse_unit;
    sample[c] = light_a;
    sample[3 + c] = light_b;
    sample[FIT_VARIANCE] += weight * (light_a - light_b) * (light_a - light_b) / 12.0f;
    sample[FIT_POWER] += f * f / 3.0f;
    sample[FIT_ROW + 2 + c] = Asinh(f * inverse_knee) * inverse_light;
    if (!(fabs(light_a) < kMaxLightSignal && fabs(light_b) < kMaxLightSignal && fabs(f) < kMaxLightSignal))
      weight = 0.0f;
  }
  sample[FIT_WEIGHT] = weight;
  sample[FIT_WEIGHT + 1] = (float)x;
  sample[FIT_WEIGHT + 2] = (float)y;
  weights[item] = weight;
}

// Puts what the models say into a picture. Pixels without weight keep what they have.
__kernel void TakeFit(Grid grid, int count, float level, __global const int* targets, __global const int* sites,
                      __global const float* weights, __global const float* values, __global const float* totals,
                      __global float* picture) {
  const size_t item = get_global_id(0);
  if (item >= (size_t)count || !(totals[item] > 0.0f)) return;
  const int sample = targets[item];
  const size_t site = (size_t)sites[sample];
  if (site < PixelsOf(grid) && !(weights[sample] > 0.0f)) return;
  for (int i = 0; i < 6; ++i)
    picture[PlaneOf(i / 3, i % 3, grid) + site] = level * (values[item * FIT_SIGNALS + i] / totals[item]);
}
