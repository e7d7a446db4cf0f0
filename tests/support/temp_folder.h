#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>
#include <system_error>

#include "filter/image/check.h"

namespace lumifold {

/// A new empty folder that goes, with all in it, when the test ends.
class TempFolder {
 public:
  explicit TempFolder(const std::filesystem::path& parent = std::filesystem::temp_directory_path())
      : path_((parent / "lumifold_test_XXXXXX").string()) {
    LUMIFOLD_CHECK(mkdtemp(path_.data()) != nullptr);
  }
  ~TempFolder() {
    std::error_code ignored;  // what cannot be removed only takes room
    std::filesystem::remove_all(path_, ignored);
  }
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;

  const std::string& path() const { return path_; }
  std::string PathOf(const std::string& name) const { return path_ + "/" + name; }

 private:
  std::string path_;
};

}  // namespace lumifold
