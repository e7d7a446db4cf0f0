#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace lumifold::rpc {

/// `text` as one line of at most `max_bytes`, at least 64: control characters become spaces, and a longer
/// text is cut between two characters and ends with the number of bytes that are left out. Text that fits and
/// has no control characters is unchanged. `text` is UTF-8.
std::string BoundedLine(std::string_view text, size_t max_bytes);

/// `text` in one line of a terminal that nobody else's text can change: control characters and bytes that are
/// not UTF-8 are shown as "\n", "\x1b" and the like. Other text is unchanged.
std::string Printable(std::string_view text);

/// `text` as UTF-8, which messages must be: bytes that are not become U+FFFD.
std::string AsUtf8(std::string_view text);

/// Each of `lines` once, in the order of first occurrence, as BoundedLine. If there are more than
/// `max_lines`, the last line returned is the number of lines that are left out. Applied to its own result,
/// it changes nothing.
template <typename Lines>
std::vector<std::string> BoundedLines(const Lines& lines, size_t max_lines, size_t max_bytes);

/// Implementation of BoundedLines.
class LineCollector {
 public:
  LineCollector(size_t max_lines, size_t max_bytes) : max_lines_(max_lines), max_bytes_(max_bytes) {}
  void Add(std::string_view line);
  std::vector<std::string> Take();

 private:
  const size_t max_lines_;
  const size_t max_bytes_;
  std::vector<std::string> lines_;
  size_t left_out_ = 0;
};

template <typename Lines>
std::vector<std::string> BoundedLines(const Lines& lines, size_t max_lines, size_t max_bytes) {
  LineCollector collector(max_lines, max_bytes);
  for (const auto& line : lines) collector.Add(line);
  return collector.Take();
}

}  // namespace lumifold::rpc
