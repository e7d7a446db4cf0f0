#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

/// A fuzz target: one entry point for bytes from outside. It returns for any input; what it finds ends the
/// process.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);

namespace lumifold::fuzz {

/// Valid inputs of the target, from which others are made. Each target defines it.
std::vector<std::string> Seeds();

/// Ends the process with this finding.
[[noreturn]] inline void Fail(const char* what, const std::string& detail) {
  std::fprintf(stderr, "fuzz: %s: %s\n", what, detail.c_str());
  std::abort();
}

/// A folder for files that go with the process; in memory where the machine has that, since a target waits
/// for each.
inline std::filesystem::path InMemory() {
  return std::filesystem::is_directory("/dev/shm") ? "/dev/shm" : std::filesystem::temp_directory_path();
}

/// Splits an input into pieces: each has two bytes of length before it. What is left over is one more piece.
inline std::vector<std::string> Pieces(std::string_view input) {
  std::vector<std::string> pieces;
  while (input.size() > 2) {
    size_t length = static_cast<unsigned char>(input[0]) |
                    (static_cast<size_t>(static_cast<unsigned char>(input[1])) << 8);
    input.remove_prefix(2);
    if (length > input.size()) length = input.size();
    pieces.emplace_back(input.substr(0, length));
    input.remove_prefix(length);
  }
  return pieces;
}

/// The inverse of Pieces.
inline std::string Joined(const std::vector<std::string>& pieces) {
  std::string input;
  for (const std::string& piece : pieces) {
    input += static_cast<char>(piece.size());
    input += static_cast<char>(piece.size() >> 8);
    input += piece;
  }
  return input;
}

}  // namespace lumifold::fuzz
