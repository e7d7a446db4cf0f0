#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/pictures/view_transform.h"
#include "filter/image/plane.h"

namespace lumifold::pictures {

/// How a picture is shown on a display.
struct DisplayOptions {
  std::string view = "standard";  // see ViewTransform
  /// Factor on the radiance; nothing: AutomaticExposure of the picture.
  std::optional<float> exposure = 1;
  int jpeg_quality = 92;  // 1 to 100
};

/// Writes linear light as a picture of 8 bits a channel, .png or .jpg by the end of the path, after exposure
/// and view transform. The rows arrive some at a time, from the top down. Until Finish() it has 3 bytes in
/// memory for each pixel, or 12 where the exposure is automatic; a third more with A.
///
/// With A, by which the light is premultiplied, a .png gets it as its fourth channel and the view's values of
/// the light divided by it, as PNG has it. A .jpg shows the light over black.
class DisplayWriter {
 public:
  /// Errors: those of ViewTransform::Create.
  static absl::StatusOr<DisplayWriter> Create(const std::string& path, int width, int height,
                                              const DisplayOptions& options);
  /// The next rows, of the picture's width. `alpha`: null in all calls or in none.
  void Append(const ConstColorView& linear, const ConstFloatView* alpha = nullptr);
  /// Writes the file, atomically. All rows must have been appended.
  /// Errors: kInvalidArgument for an empty picture; kUnavailable if the file cannot be written.
  absl::Status Finish();

 private:
  DisplayWriter(std::string path, int width, int height, const DisplayOptions& options, ViewTransform view);
  void Show(const ConstColorView& linear, const ConstFloatView* alpha, float exposure);
  bool IsPng() const;

  std::string path_;
  int width_;
  int height_;
  DisplayOptions options_;
  ViewTransform view_;
  std::array<Plane, 3> linear_;  // where the exposure is not known yet
  Plane alpha_;                  // where it is not known and there is A
  int rows_ = 0;                 // of linear_
  std::vector<uint8_t> bytes_;   // 3 for each pixel, or 4 with A
};

/// The same for a picture in memory. `alpha` may be null.
absl::Status WriteDisplayed(const std::string& path, const ConstColorView& linear,
                            const DisplayOptions& options, const ConstFloatView* alpha = nullptr);

}  // namespace lumifold::pictures
