#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"

namespace lumifold::scene {

/// Collects warnings of a load and merges those of one kind, so that a thousand degenerate triangles give one
/// line.
class Diagnostics {
 public:
  /// Adds a line.
  void Note(const std::string& line);

  /// Adds `n` to the count of `what`; the first `where` is reported as an example.
  void Count(const std::string& what, const std::string& where, int64_t n = 1);

  /// All lines, in the order in which each kind first occurred.
  std::vector<std::string> Lines() const;

 private:
  struct Entry {
    std::string what;
    std::string first_place;  // empty for a Note
    int64_t count = 0;
  };
  std::vector<Entry> entries_;
};

/// `text` with every control character replaced by a space, so that names from a file cannot break a line.
std::string OneLine(const std::string& text);

/// The status with "`context`: " before its message; OK is returned unchanged.
absl::Status WithContext(const absl::Status& status, const std::string& context);

/// The name of an object of the document in messages: `mesh 3 "Chair"`, or `mesh 3` if it has no name.
std::string Place(const std::string& kind, int64_t index, const std::string& name);

}  // namespace lumifold::scene
