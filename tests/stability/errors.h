#pragma once

#include "absl/functional/function_ref.h"
#include "tests/stability/drawn_film.h"

namespace lumifold::stability {

/// Which pixels count.
using Where = absl::FunctionRef<bool(int x, int y)>;

/// Mean over the pixels that count, and channels, of the squared difference: in 8-bit steps as displayed, or
/// in light as it is. 0 where none counts.
double DisplayError(const ConstColorView& a, const ConstColorView& b, Where where);
double LinearError(const ConstColorView& a, const ConstColorView& b, Where where);

/// Mean over the pixels that count, and channels.
double MeanOf(const ConstColorView& picture, Where where);

/// Mean over the pixels that count, and channels, of a - b in 8-bit steps as displayed.
double DisplayShift(const ConstColorView& a, const ConstColorView& b, Where where);

/// Pixels with a channel that is not finite.
int CountNotFinite(const ConstColorView& picture);

/// Pixels with a channel of other bits.
int CountDifferent(const ConstColorView& a, const ConstColorView& b);

/// The largest of |a - b| / max(|b|, mean |b|) over the pixels that count.
double LargestRelativeDifference(const ConstColorView& a, const ConstColorView& b, Where where);

/// CIE 1976 colour difference of the mean colours over the pixels that count (sRGB primaries, D65).
double DeltaE(const ConstColorView& a, const ConstColorView& b, Where where);

/// Over how many pixels the mean of `plane` at each distance from an edge goes from 10 % to 90 % of the way
/// between its two ends. `distance` is signed, in pixels, within +-reach.
double EdgeWidth(ConstFloatView plane, float reach, absl::FunctionRef<float(int x, int y)> distance);

}  // namespace lumifold::stability
