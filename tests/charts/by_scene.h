#pragma once

#include <vector>

#include "absl/types/span.h"

namespace lumifold::charts {

/// The parts of `rows` that have one scene each; the rows of a scene follow one another, and outlive the
/// result.
template <typename Row>
std::vector<absl::Span<const Row>> ByScene(const std::vector<Row>& rows) {
  std::vector<absl::Span<const Row>> parts;
  for (size_t first = 0, end = 0; first < rows.size(); first = end) {
    while (end < rows.size() && rows[end].scene == rows[first].scene) ++end;
    parts.push_back(absl::MakeConstSpan(rows).subspan(first, end - first));
  }
  return parts;
}

}  // namespace lumifold::charts
