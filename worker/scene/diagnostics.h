#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"

namespace lumifold::scene {

/// Gathers what a load leaves out, so that a thousand degenerate triangles make one line and not a thousand.
class Diagnostics {
 public:
  /// One line of its own.
  void Note(const std::string& line);

  /// Adds `n` to the count of `what`; the first `where` is kept as an example.
  void Count(const std::string& what, const std::string& where, int64_t n = 1);

  /// All lines, in the order in which each kind first came up.
  std::vector<std::string> Lines() const;

 private:
  struct Entry {
    std::string what;
    std::string first_place;  // empty for a Note
    int64_t count = 0;
  };
  std::vector<Entry> entries_;
};

/// `text` with every control character replaced by a space: names out of a file must not break a line.
std::string OneLine(const std::string& text);

/// The status with "`context`: " before its message; OK stays OK.
absl::Status WithContext(const absl::Status& status, const std::string& context);

/// How messages name a thing of the document: `mesh 3 "Chair"`, without quotes where it has no name.
std::string Place(const std::string& kind, int64_t index, const std::string& name);

}  // namespace lumifold::scene
