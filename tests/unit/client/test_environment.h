#pragma once

#include <gtest/gtest.h>
#include <stdlib.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "absl/time/time.h"
#include "client/cli/environment.h"
#include "filter/image/check.h"

namespace lumifold::client {

/// An empty temporary folder of a test, removed with its contents.
class ScratchFolder {
 public:
  ScratchFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "lumifold-client-XXXXXX").string();
    LUMIFOLD_CHECK(mkdtemp(name.data()) != nullptr);
    path_ = name;
  }
  ~ScratchFolder() { std::filesystem::remove_all(path_); }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;

  std::string File(const std::string& name) const { return (path_ / name).string(); }

  std::string Write(const std::string& name, const std::string& content) const {
    const std::filesystem::path file = path_ / name;
    std::filesystem::create_directories(file.parent_path());
    std::ofstream(file, std::ios::binary) << content;
    return file.string();
  }

  std::string Read(const std::string& name) const {
    std::ifstream file(path_ / name, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }

  int FileCount() const {
    int count = 0;
    for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(path_)) ++count;
    return count;
  }

 private:
  std::filesystem::path path_;
};

/// A clock that moves only during its own sleep and when the test moves it.
struct FakeTime {
  absl::Time now = absl::UnixEpoch();
  int sleeps = 0;

  rpc::RetryEnvironment Environment() {
    return {.now = [this] { return now; },
            .sleep =
                [this](absl::Duration pause) {
                  ++sleeps;
                  now += pause;
                },
            .jitter = [] { return 0.0; }};
  }
};

/// The environment of a command, with its recorded output.
struct TestEnvironment {
  std::ostringstream out;
  std::ostringstream err;
  FakeTime time;
  bool interrupted = false;
  Environment environment{.out = out, .err = err};

  TestEnvironment() {
    environment.time = time.Environment();
    environment.interrupted = [this] { return interrupted; };
  }
};

}  // namespace lumifold::client
