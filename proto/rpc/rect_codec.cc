#include "proto/rpc/rect_codec.h"

#include <array>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace lumifold::rpc {

Rect RectOf(const v1::Rect& rect) { return {rect.x0(), rect.y0(), rect.x1(), rect.y1()}; }

v1::Rect ProtoOf(const Rect& rect) {
  v1::Rect proto;
  proto.set_x0(rect.x0);
  proto.set_y0(rect.y0);
  proto.set_x1(rect.x1);
  proto.set_y1(rect.y1);
  return proto;
}

std::string RectText(const Rect& rect) {
  return absl::StrCat(rect.x0, ",", rect.y0, ",", rect.x1, ",", rect.y1);
}

std::optional<Rect> ParseRect(absl::string_view text) {
  const std::vector<absl::string_view> words = absl::StrSplit(text, ',');
  std::array<int, 4> values = {};
  if (words.size() != values.size()) return std::nullopt;
  for (size_t i = 0; i < values.size(); ++i) {
    if (!absl::SimpleAtoi(words[i], &values[i]) || values[i] < 0) return std::nullopt;
  }
  const Rect rect = {values[0], values[1], values[2], values[3]};
  if (rect.IsEmpty()) return std::nullopt;
  return rect;
}

}  // namespace lumifold::rpc
