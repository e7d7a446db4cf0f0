#include "worker/scene/diagnostics.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

namespace lumifold::scene {

void Diagnostics::Note(const std::string& line) { entries_.push_back({OneLine(line), "", 0}); }

void Diagnostics::Count(const std::string& what, const std::string& where, int64_t n) {
  if (n == 0) return;
  const auto entry = std::find_if(entries_.begin(), entries_.end(),
                                  [&](const Entry& e) { return e.count > 0 && e.what == what; });
  if (entry != entries_.end()) {
    entry->count += n;
  } else {
    entries_.push_back({std::string(what), OneLine(where), n});
  }
}

std::vector<std::string> Diagnostics::Lines() const {
  std::vector<std::string> lines;
  for (const Entry& entry : entries_) {
    lines.push_back(entry.count == 0 ? entry.what
                                     : absl::StrCat(entry.what, ": ", entry.count, " (the first in ",
                                                    entry.first_place, ")"));
  }
  return lines;
}

std::string OneLine(const std::string& text) {
  std::string line = text;
  std::replace_if(line.begin(), line.end(), [](char c) { return (c >= 0 && c < 0x20) || c == 0x7f; }, ' ');
  return line;
}

absl::Status WithContext(const absl::Status& status, const std::string& context) {
  if (status.ok()) return status;
  return absl::Status(status.code(), absl::StrCat(context, ": ", status.message()));
}

std::string Place(const std::string& kind, int64_t index, const std::string& name) {
  return name.empty() ? absl::StrCat(kind, " ", index) : absl::StrCat(kind, " ", index, " \"", name, "\"");
}

}  // namespace lumifold::scene
