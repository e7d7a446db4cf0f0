#pragma once

#include "filter/kernels/recursion_kernels.h"
#include "filter/kernels/row_kernels.h"

// The kernels of the filter written plainly, a pixel at a time, with the order of operations that they
// promise: equal to the last bit.
namespace lumifold::filter::oracle {

void RecurseRows(const RecurseArgs& args, const float* const* weights);
void RecurseRowsEvenly(const RecurseArgs& args, float weight);
void PullRow(const float* weight, const float* from, int count, float* to);
void PullRowEvenly(float weight, const float* from, int count, float* to);
void BlendCells(const BlendArgs& args);
bool WeighRow(const Phases& phases, const WeighArgs& args, const SplitArgs* split);
bool SplatRow(const SplatArgs& args);
void SliceRow(const Phases& phases, const SliceArgs& args);
void AddProductRow(const float* a, const float* b, int count, float* sums);
void SumPhases(float* sums, std::ptrdiff_t stride, int step, float scale, int count, float* means);
void QuotientRow(const float* total, float least, const float* instead, int count, float* sums);
void StabiliseRow(const float* in, float inverse_knee, float shift, int count, float* out);

}  // namespace lumifold::filter::oracle
