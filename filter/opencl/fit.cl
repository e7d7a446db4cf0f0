// The local linear models of ModelGrid (filter/edges/model_grid.h), for a device of OpenCL 1.2 and as C++, as manifold.cl. It
// follows probe.cl in a program of its own.
//
// The host defines FIT_TERMS, FIT_SIGNALS and FIT_TRAITS, a multiple of four, and the constants of filter/edges/linear_fit.h
// (filter/manifold/fit_call.h) by their names.
//
// Layouts: as FitCall has them; sums of a model: for each term a row, then the sums of variances and of powers. No sum crosses
// work-items; those over samples follow their numbers.
#ifdef __OPENCL_VERSION__
#pragma OPENCL FP_CONTRACT OFF
#endif

#define FIT_ROW ((FIT_SIGNALS + FIT_TERMS + 3) / 4 * 4)
#define FIT_VARIANCE FIT_ROW
#define FIT_POWER (FIT_ROW + 1)
#define FIT_WEIGHT (FIT_ROW + 2 + FIT_TRAITS)
#define FIT_SAMPLE (FIT_WEIGHT + 3)  // x and y follow the weight
#define FIT_SUMS (FIT_ROW + 2)       // of a term
#define FIT_MODEL (FIT_TERMS * FIT_SIGNALS)

typedef struct {
  int width, height;  // pixels
  int radius;
  float falloff;  // 1 / sigma^2
} FitWindow;

// What sample b counts for a; 0: nothing.
float LikenessOf(__global const float* a, __global const float* b, float falloff) {
  const float dx = a[FIT_WEIGHT + 1] - b[FIT_WEIGHT + 1], dy = a[FIT_WEIGHT + 2] - b[FIT_WEIGHT + 2];
  float sums[4] = {0.0f, 0.0f, 0.0f, 0.0f};
  for (int k = 0; k < FIT_TRAITS; ++k) {
    const float difference = a[FIT_ROW + 2 + k] - b[FIT_ROW + 2 + k];
    sums[k % 4] += difference * difference;
  }
  const float square = falloff * (dx * dx + dy * dy) + ((sums[0] + sums[1]) + (sums[2] + sums[3]));
  const float part = 1.0f - square / kMaxFitSquare;
  return part > 0.0f ? part * part * part : 0.0f;
}

int FirstOfWindow(float place, int radius) {
  const int first = (int)place - radius;
  return first < 0 ? 0 : first;
}
int EndOfWindow(float place, int radius, int size) {
  const int end = (int)place + radius + 1;
  return end < size ? end : size;
}

// Term i of a sample, relative to the centre.
float TermOf(int i, __global const float* sample, __global const float* centre) {
  return i == 0 ? sample[FIT_SIGNALS] : sample[FIT_SIGNALS + i] - centre[FIT_SIGNALS + i];
}

// The sums of term item % FIT_TERMS of the models around some samples.
__kernel void FitSums(FitWindow window, int count, int from, __global const int* centres,
                      __global const int* firsts, __global const float* samples, __global float* sums) {
  const size_t item = get_global_id(0);
  if (item >= (size_t)count * FIT_TERMS) return;
  const int own = (int)(item % FIT_TERMS);
  __global const float* centre = samples + (size_t)centres[from + item / FIT_TERMS] * FIT_SAMPLE;
  const int x0 = FirstOfWindow(centre[FIT_WEIGHT + 1], window.radius);
  const int x1 = EndOfWindow(centre[FIT_WEIGHT + 1], window.radius, window.width);
  const int y0 = FirstOfWindow(centre[FIT_WEIGHT + 2], window.radius);
  const int y1 = EndOfWindow(centre[FIT_WEIGHT + 2], window.radius, window.height);
  float row[MOST_FIT_ROW], variance = 0.0f, power = 0.0f;
  for (int k = 0; k < FIT_ROW; ++k) row[k] = 0.0f;
  for (int y = y0; y < y1; ++y) {
    __global const int* in_row = firsts + (size_t)y * window.width;
    for (int i = in_row[x0]; i < in_row[x1]; ++i) {
      __global const float* sample = samples + (size_t)i * FIT_SAMPLE;
      if (!(sample[FIT_WEIGHT] > 0.0f)) continue;
      const float weight = LikenessOf(sample, centre, window.falloff) * sample[FIT_WEIGHT];
      if (!(weight > 0.0f)) continue;
      variance += weight * sample[FIT_VARIANCE];
      power += weight * sample[FIT_POWER];
      const float by = weight * TermOf(own, sample, centre);
      for (int k = 0; k < FIT_SIGNALS; ++k) row[k] += by * sample[k];
      for (int k = 0; k < FIT_TERMS; ++k) row[FIT_SIGNALS + k] += by * TermOf(k, sample, centre);
    }
  }
  __global float* to = sums + item * FIT_SUMS;
  for (int k = 0; k < FIT_ROW; ++k) to[k] = row[k];
  to[FIT_VARIANCE] = variance;
  to[FIT_POWER] = power;
}

// Models from their sums, which are used up, and the weights of their windows. The models go from `from` on.
__kernel void FitModels(int count, int from, float slope, __global float* sums, __global float* models,
                        __global float* weights) {
  const size_t item = get_global_id(0);
  if (item >= (size_t)count) return;
  __global float* rows = sums + item * FIT_TERMS * FIT_SUMS;
  const float weight = rows[FIT_SIGNALS];
  const float expected = slope * slope * (rows[FIT_POWER] + kMinFitPower * weight);
  const float free_ridge = rows[FIT_VARIANCE] / expected, most = kMaxFitRidge * weight;
  const float ridge = (most < free_ridge ? most : free_ridge) + kMinFitRidge * weight;
  for (int k = 1; k < FIT_TERMS; ++k) rows[k * FIT_SUMS + FIT_SIGNALS + k] += ridge;
  for (int k = FIT_TERMS - 1; k > 0; --k) {
    const float inverse = 1.0f / rows[k * FIT_SUMS + FIT_SIGNALS + k];
    for (int i = 0; i < k; ++i) {
      const float by = -rows[k * FIT_SUMS + FIT_SIGNALS + i] * inverse;
      for (int j = 0; j <= FIT_SIGNALS + i; ++j) rows[i * FIT_SUMS + j] += by * rows[k * FIT_SUMS + j];
    }
  }
  __global float* model = models + (from + item) * FIT_MODEL;
  for (int i = 0; i < FIT_TERMS; ++i) {
    const float inverse = 1.0f / rows[i * FIT_SUMS + FIT_SIGNALS + i];
    for (int s = 0; s < FIT_SIGNALS; ++s) {
      float right = rows[i * FIT_SUMS + s];
      for (int j = 0; j < i; ++j) right -= rows[i * FIT_SUMS + FIT_SIGNALS + j] * model[j * FIT_SIGNALS + s];
      model[i * FIT_SIGNALS + s] = right * inverse;
    }
  }
  weights[item] = weight;
}

void AddModel(__global const float* model, __global const float* centre, __global const float* at, float weight,
              float* sum) {
  for (int i = 0; i < FIT_TERMS; ++i) {
    const float term = i == 0 ? weight : weight * TermOf(i, at, centre);
    for (int s = 0; s < FIT_SIGNALS; ++s) sum[s] += term * model[i * FIT_SIGNALS + s];
  }
}

// The sums over the models around the targets, and of the models' weights.
__kernel void FitValues(FitWindow window, int count, __global const int* targets, __global const int* firsts,
                        __global const float* samples, __global const int* model_of,
                        __global const float* models, __global float* values, __global float* totals) {
  const size_t item = get_global_id(0);
  if (item >= (size_t)count) return;
  __global const float* at = samples + (size_t)targets[item] * FIT_SAMPLE;
  const int x0 = (FirstOfWindow(at[FIT_WEIGHT + 1], window.radius) + kFitStep - 1) / kFitStep * kFitStep;
  const int x1 = EndOfWindow(at[FIT_WEIGHT + 1], window.radius, window.width);
  const int y0 = (FirstOfWindow(at[FIT_WEIGHT + 2], window.radius) + kFitStep - 1) / kFitStep * kFitStep;
  const int y1 = EndOfWindow(at[FIT_WEIGHT + 2], window.radius, window.height);
  float sum[MOST_FIT_ROW], total = 0.0f;
  for (int s = 0; s < FIT_SIGNALS; ++s) sum[s] = 0.0f;
  for (int y = y0; y < y1; y += kFitStep) {
    for (int x = x0; x < x1; x += kFitStep) {
      const size_t pixel = (size_t)y * window.width + x;
      for (int i = firsts[pixel]; i < firsts[pixel + 1]; ++i) {
        if (model_of[i] < 0) continue;
        __global const float* centre = samples + (size_t)i * FIT_SAMPLE;
        const float weight = LikenessOf(centre, at, window.falloff);
        if (!(weight > 0.0f)) continue;
        total += weight;
        AddModel(models + (size_t)model_of[i] * FIT_MODEL, centre, at, weight, sum);
      }
    }
  }
  for (int s = 0; s < FIT_SIGNALS; ++s) values[item * FIT_SIGNALS + s] = sum[s];
  totals[item] = total;
}

// Models of their own for targets with too little weight of models around them: those of numbers `lacking`, from `from` on.
__kernel void FitOwn(int count, int from, __global const int* lacking, __global const int* targets,
                     __global const float* samples, __global const float* models,
                     __global const float* weights, __global float* values, __global float* totals) {
  const size_t item = get_global_id(0);
  if (item >= (size_t)count || !(weights[item] > 0.0f)) return;
  const size_t target = (size_t)lacking[from + item];
  __global const float* at = samples + (size_t)targets[target] * FIT_SAMPLE;
  const float weight = kMinModelWeight - totals[target];
  float sum[MOST_FIT_ROW];
  for (int s = 0; s < FIT_SIGNALS; ++s) sum[s] = values[target * FIT_SIGNALS + s];
  AddModel(models + item * FIT_MODEL, at, at, weight, sum);
  for (int s = 0; s < FIT_SIGNALS; ++s) values[target * FIT_SIGNALS + s] = sum[s];
  totals[target] += weight;
}
