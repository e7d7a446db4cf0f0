#include "client/cli/suggestion.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

namespace lumifold::client {
namespace {

// Words that differ by more edits are not suggested.
constexpr int kMaxEdits = 3;

}  // namespace

int EditDistance(absl::string_view a, absl::string_view b) {
  const size_t columns = b.size() + 1;
  std::vector<int> distance((a.size() + 1) * columns);
  const auto at = [&](size_t i, size_t j) -> int& { return distance[i * columns + j]; };
  for (size_t i = 0; i <= a.size(); ++i) at(i, 0) = static_cast<int>(i);
  for (size_t j = 0; j <= b.size(); ++j) at(0, j) = static_cast<int>(j);
  for (size_t i = 1; i <= a.size(); ++i) {
    for (size_t j = 1; j <= b.size(); ++j) {
      const int replace = at(i - 1, j - 1) + (a[i - 1] == b[j - 1] ? 0 : 1);
      at(i, j) = std::min({replace, at(i - 1, j) + 1, at(i, j - 1) + 1});
      const bool swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
      if (swapped) at(i, j) = std::min(at(i, j), at(i - 2, j - 2) + 1);
    }
  }
  return distance.back();
}

std::string Suggestion(absl::string_view unknown, const std::vector<std::string>& words) {
  // At most half of the letters may differ.
  const int limit = std::min(kMaxEdits, static_cast<int>(unknown.size()) / 2);
  int best = limit + 1;
  absl::string_view nearest;
  for (const std::string& word : words) {
    const int edits = EditDistance(unknown, word);
    if (edits < best) {
      best = edits;
      nearest = word;
    }
  }
  return best > limit ? "" : absl::StrCat("; did you mean '", nearest, "'?");
}

}  // namespace lumifold::client
