#pragma once

#include <functional>

#include "filter/image/planes.h"

namespace lumifold {

/// A filtered picture, and how far its noise may have moved it.
struct FilteredPicture {
  Picture picture;  // W x H, R G B
  /// sqrt(nA nB) / n (F_A - F_B), where F_A is what the filter makes of half A of the samples, and F_B of
  /// half B: its square estimates the picture's variance at each pixel, as far as the halves do not share
  /// errors. 0 where one has no samples.
  Picture deviation;
  /// The same of the energy that outliers return, which `deviation` leaves out: the noise of the picture is
  /// the sum of both. Apart, because samples of the places where it returns do not make it surer. 0 where
  /// nothing returns.
  Picture returned;
};

/// Told the share of a film that is filtered, by the caller's thread: it rises, below 1, at whatever steps
/// the method has.
using FilterProgress = std::function<void(double share)>;

}  // namespace lumifold
