#pragma once

#include <map>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace lumifold::client {

/// An option in a file: its long name without dashes, or that of an argument in lower case.
struct FileOption {
  std::string name;
  std::vector<std::string> values;  // one, or those of a list
  int line = 0;                     // from 1
};
using FileOptions = std::vector<FileOption>;

/// Options in a file of YAML, of which JSON is a part: a map from names to values or lists of values. Job
/// files and the configuration have this form, so that each option is checked by the code that checks the
/// command line.
struct OptionFile {
  std::string path;
  FileOptions options;
  /// Of the map `profiles`, by name.
  std::map<std::string, FileOptions> profiles;
};

enum class OptionFileKind { kJob, kConfiguration };  // a job has no profiles

/// Errors: kNotFound; kInvalidArgument naming the file and the line for anything that is not such a map, for
/// a name that appears twice and for files over 1 MiB.
absl::StatusOr<OptionFile> ReadOptionFile(const std::string& path, OptionFileKind kind);

/// The same for the file's text.
absl::StatusOr<OptionFile> ParseOptionFile(const std::string& path, const std::string& text,
                                           OptionFileKind kind);

/// "$XDG_CONFIG_HOME/lumifold/config.yaml" where `folder` is that of the profiles; empty for none.
std::string ConfigurationPath(const std::string& folder);

}  // namespace lumifold::client
