#pragma once

#include "absl/functional/function_ref.h"
#include "tests/stability/drawn_film.h"

namespace lumifold::stability {

/// Selects the pixels to measure.
using Where = absl::FunctionRef<bool(int x, int y)>;

/// Mean squared difference over selected pixels and channels: in displayed 8-bit steps, or in linear light. 0
/// if no pixel is selected.
double DisplayError(const ConstColorView& a, const ConstColorView& b, Where where);
double LinearError(const ConstColorView& a, const ConstColorView& b, Where where);

/// Mean over selected pixels and channels.
double MeanOf(const ConstColorView& picture, Where where);

/// Mean of a - b over selected pixels and channels, in displayed 8-bit steps.
double DisplayShift(const ConstColorView& a, const ConstColorView& b, Where where);

/// Pixels with a channel that is not finite.
int CountNotFinite(const ConstColorView& picture);

/// Pixels with a channel whose bits differ.
int CountDifferent(const ConstColorView& a, const ConstColorView& b);

/// Pixels per 10,000 whose luminance is more than 24 of 255 steps above or below that of all their
/// neighbours, where the truth's pixel is not even half as far above or below them.
double LonePixels(const ConstColorView& picture, const ConstColorView& truth);

/// The largest of |a - b| / max(|b|, mean |b|) over selected pixels.
double LargestRelativeDifference(const ConstColorView& a, const ConstColorView& b, Where where);

/// CIE 1976 colour difference of the mean colours over selected pixels (sRGB primaries, D65).
double DeltaE(const ConstColorView& a, const ConstColorView& b, Where where);

/// The 10-90 % width of an edge in pixels, from the profile of means of `plane` by distance from the edge.
/// `distance` is signed, in pixels, within +-reach.
double EdgeWidth(ConstFloatView plane, float reach, absl::FunctionRef<float(int x, int y)> distance);

}  // namespace lumifold::stability
