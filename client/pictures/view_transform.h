#pragma once

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"

namespace lumifold::pictures {

/// How linear light of a scene becomes values of a display. Five transforms are always there:
///
///   standard  the sRGB curve; what is brighter than white is white
///   filmic    a curve with a soft shoulder (Hable's), then sRGB: bright light keeps its colour and detail
///             longer
///   agx       AgX, then sRGB: saturated light fades to white
///   neutral   Khronos PBR Neutral, then sRGB: colours of materials stay as they are
///   raw       the values themselves
///
/// Where the environment variable OCIO names an OpenColorIO configuration, its views are there too: "VIEW" of
/// its default display, or "DISPLAY/VIEW".
class ViewTransform {
 public:
  /// Errors: kInvalidArgument naming the views for one that there is not, and for a configuration that cannot
  /// be read.
  static absl::StatusOr<ViewTransform> Create(const std::string& view);
  ViewTransform(ViewTransform&&) noexcept;
  ViewTransform& operator=(ViewTransform&&) noexcept;
  ~ViewTransform();

  /// Names of the views that Create takes.
  static std::vector<std::string> Views();

  /// Replaces linear Rec. 709 light by display values, 0 to 1 on the display. `rgb`: 3 numbers for each
  /// pixel. A NaN becomes black.
  /// Threads: safe.
  void Apply(absl::Span<float> rgb) const;

 private:
  struct Processor;
  explicit ViewTransform(std::unique_ptr<Processor> processor);

  std::unique_ptr<Processor> processor_;
};

}  // namespace lumifold::pictures
