// Runs a fuzz target on changed copies of its seeds and of the files in a folder. It needs no compiler of its
// own, so that every build has it, with sanitizers or without; libFuzzer finds more where there is clang.

#include <fcntl.h>
#include <signal.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "tests/fuzz/fuzz_target.h"

namespace {

namespace fs = std::filesystem;

constexpr size_t kMaxInputBytes = size_t{1} << 18;
constexpr unsigned kSecondsPerInput = 60;

std::string ReadAll(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// A file that always holds the input that is being tried, also after a crash.
class CurrentInput {
 public:
  explicit CurrentInput(const fs::path& path)
      : path_(path), file_(open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644)) {
    if (file_ < 0) std::abort();
  }
  ~CurrentInput() {
    close(file_);
    std::error_code ignored;
    fs::remove(path_, ignored);
  }
  CurrentInput(const CurrentInput&) = delete;
  CurrentInput& operator=(const CurrentInput&) = delete;

  void Set(const std::string& input) {
    const auto size = static_cast<ssize_t>(input.size());
    if (pwrite(file_, input.data(), input.size(), 0) != size || ftruncate(file_, size) != 0) std::abort();
  }

 private:
  const fs::path path_;
  const int file_;
};

class Mutator {
 public:
  Mutator(const std::vector<std::string>& inputs, uint64_t seed) : inputs_(inputs), random_(seed) {}

  std::string Next() {
    std::string input = Pick();
    const size_t changes = size_t{1} << Below(5);
    for (size_t i = 0; i < changes; ++i) Change(&input);
    if (input.size() > kMaxInputBytes) input.resize(kMaxInputBytes);
    return input;
  }

 private:
  size_t Below(size_t count) { return count == 0 ? 0 : random_() % count; }
  const std::string& Pick() { return inputs_[Below(inputs_.size())]; }

  /// Numbers at the limits of types, in 1 to 8 bytes of either order, or as a varint.
  std::string Number() {
    constexpr uint64_t kNumbers[] = {0,
                                     1,
                                     2,
                                     127,
                                     128,
                                     255,
                                     256,
                                     32767,
                                     65535,
                                     1 << 20,
                                     0x7fffffff,
                                     0x80000000,
                                     0xffffffff,
                                     uint64_t{1} << 40,
                                     0x7fffffffffffffff,
                                     0x8000000000000000,
                                     0xffffffffffffffff};
    uint64_t value = kNumbers[Below(std::size(kNumbers))] + Below(3) - 1;
    std::string bytes;
    if (Below(2) == 0) {
      do {
        bytes += static_cast<char>((value & 0x7f) | (value > 0x7f ? 0x80 : 0));
        value >>= 7;
      } while (value != 0);
      return bytes;
    }
    for (size_t count = size_t{1} << Below(4); count > 0; --count, value >>= 8)
      bytes += static_cast<char>(value);
    if (Below(2) == 0) std::reverse(bytes.begin(), bytes.end());
    return bytes;
  }

  void Change(std::string* input) {
    const size_t at = Below(input->size() + 1);
    const size_t length = std::min(input->size() - at, size_t{1} << Below(8));
    switch (Below(9)) {
      case 0:
        if (at < input->size()) (*input)[at] = static_cast<char>((*input)[at] ^ (1 << Below(8)));
        return;
      case 1:
        if (at < input->size()) (*input)[at] = static_cast<char>(random_());
        return;
      case 2:
        input->erase(at, length);
        return;
      case 3:
        input->insert(at, input->substr(Below(input->size() + 1), length));
        return;
      case 4:
        input->replace(at, std::min(length, size_t{8}), Number());
        return;
      case 5:
        input->insert(at, Number());
        return;
      case 6: {
        const std::string& other = Pick();
        input->replace(at, length, other.substr(Below(other.size() + 1), size_t{1} << Below(8)));
        return;
      }
      case 7: {
        const std::string& other = Pick();
        *input = input->substr(0, at) + other.substr(Below(other.size() + 1));
        return;
      }
      default:
        if (Below(8) == 0) {
          input->resize(at);
        } else {
          input->insert(at, std::string(size_t{1} << Below(6), static_cast<char>(random_())));
        }
    }
  }

  const std::vector<std::string>& inputs_;
  std::mt19937_64 random_;
};

struct Flags {
  std::string corpus;
  std::string found = ".";
  std::string write_seeds;
  std::vector<std::string> files;
  double seconds = std::numeric_limits<double>::infinity();
  double minutes = std::numeric_limits<double>::infinity();
  uint64_t runs = std::numeric_limits<uint64_t>::max();
  uint64_t seed = 1;
};

void Try(const std::string& input, CurrentInput* current) {
  current->Set(input);
  alarm(kSecondsPerInput);  // an input that never ends ends the process
  LLVMFuzzerTestOneInput(reinterpret_cast<const uint8_t*>(input.data()), input.size());
}

int Run(const Flags& flags, const std::string& name) {
  std::vector<std::string> inputs = lumifold::fuzz::Seeds();
  if (!flags.corpus.empty() && fs::is_directory(flags.corpus)) {
    for (const auto& entry : fs::directory_iterator(flags.corpus)) inputs.push_back(ReadAll(entry.path()));
  }
  for (std::string& input : inputs) input.resize(std::min(input.size(), kMaxInputBytes));
  const fs::path path = fs::path(flags.found) / (name + ".input");
  std::printf("%s: %zu seeds; after a crash the input is in %s\n", name.c_str(), inputs.size(), path.c_str());
  std::fflush(stdout);
  CurrentInput current(path);
  const auto start = std::chrono::steady_clock::now();
  const auto elapsed = [&] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  for (const std::string& input : inputs) Try(input, &current);
  Mutator mutator(inputs, flags.seed);
  const double limit = std::min(flags.seconds, 60 * flags.minutes);
  uint64_t runs = 0;
  for (; runs < flags.runs && elapsed() < limit; ++runs) Try(mutator.Next(), &current);
  alarm(0);
  std::printf("%s: %zu seeds and %llu inputs in %.1f s, nothing found\n", name.c_str(), inputs.size(),
              static_cast<unsigned long long>(runs), elapsed());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  signal(SIGPIPE, SIG_IGN);
  CLI::App app("Tries changed inputs on one entry point.");
  Flags flags;
  app.add_option("FILES", flags.files, "Inputs to try as they are; then it ends");
  app.add_option("--corpus", flags.corpus, "Folder of further inputs to change");
  app.add_option("--found", flags.found, "Folder for the input at fault");
  app.add_option("--write-seeds", flags.write_seeds, "Writes the seeds to this folder and ends");
  app.add_option("--seconds", flags.seconds, "Ends after this time");
  app.add_option("--minutes", flags.minutes, "Ends after this time");
  app.add_option("--runs", flags.runs, "Ends after so many inputs");
  app.add_option("--seed", flags.seed, "Of the random changes");
  CLI11_PARSE(app, argc, argv);
  if (!flags.write_seeds.empty()) {
    int count = 0;
    for (const std::string& seed : lumifold::fuzz::Seeds())
      std::ofstream(fs::path(flags.write_seeds) / std::to_string(count++), std::ios::binary) << seed;
    return 0;
  }
  for (const std::string& file : flags.files) {
    const std::string input = ReadAll(file);
    LLVMFuzzerTestOneInput(reinterpret_cast<const uint8_t*>(input.data()), input.size());
  }
  return flags.files.empty() ? Run(flags, fs::path(argv[0]).filename().string()) : 0;
}
