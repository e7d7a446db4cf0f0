#pragma once

#include <optional>
#include <string>

#include "absl/strings/string_view.h"
#include "filter/image/rect.h"
#include "lumifold/v1/image.pb.h"

namespace lumifold::rpc {

Rect RectOf(const v1::Rect& rect);
v1::Rect ProtoOf(const Rect& rect);

/// "x0,y0,x1,y1": pixels from (x0, y0) to before (x1, y1).
std::string RectText(const Rect& rect);
/// nullopt for other texts, and for rectangles that are empty or begin below 0.
std::optional<Rect> ParseRect(absl::string_view text);

}  // namespace lumifold::rpc
