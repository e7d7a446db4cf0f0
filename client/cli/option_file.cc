#include "client/cli/option_file.h"

#include <yaml-cpp/yaml.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"

namespace lumifold::client {
namespace {

constexpr uintmax_t kMaxBytes = uintmax_t{1} << 20;
constexpr char kProfiles[] = "profiles";

absl::Status Invalid(const std::string& path, const YAML::Mark& mark, const std::string& why) {
  const std::string place = mark.is_null() ? path : absl::StrCat(path, ":", mark.line + 1);
  return absl::InvalidArgumentError(absl::StrCat(place, ": ", why));
}

/// The value of an option, or the values of its list.
absl::StatusOr<std::vector<std::string>> ValuesOf(const std::string& path, const YAML::Node& name,
                                                  const YAML::Node& node) {
  if (node.IsScalar()) return std::vector<std::string>{node.Scalar()};
  std::vector<std::string> values;
  if (node.IsSequence()) {
    for (const YAML::Node& value : node) {
      if (!value.IsScalar()) break;
      values.push_back(value.Scalar());
    }
    if (!values.empty() && values.size() == node.size()) return values;
  }
  return Invalid(path, name.Mark(), absl::StrCat(name.Scalar(), ": expected a value or a list of values"));
}

/// Reads a map of options; `other` takes what is none, or returns false.
template <typename Other>
absl::StatusOr<FileOptions> OptionsOf(const std::string& path, const YAML::Node& map, const Other& other) {
  if (!map.IsMap()) return Invalid(path, map.Mark(), "expected lines of 'option: value'");
  FileOptions options;
  std::set<std::string> names;
  for (const auto& entry : map) {
    if (!entry.first.IsScalar()) return Invalid(path, entry.first.Mark(), "expected the name of an option");
    const std::string& name = entry.first.Scalar();
    if (!names.insert(name).second)
      return Invalid(path, entry.first.Mark(), absl::StrCat(name, " appears twice"));
    const absl::StatusOr<bool> taken = other(name, entry.second);
    if (!taken.ok()) return taken.status();
    if (*taken) continue;
    absl::StatusOr<std::vector<std::string>> values = ValuesOf(path, entry.first, entry.second);
    if (!values.ok()) return values.status();
    options.push_back({name, *std::move(values), entry.first.Mark().line + 1});
  }
  return options;
}

absl::StatusOr<OptionFile> FileOf(const std::string& path, const YAML::Node& root, OptionFileKind kind) {
  OptionFile file{.path = path, .options = {}, .profiles = {}};
  if (root.IsNull()) return file;
  const auto none = [](const std::string&, const YAML::Node&) -> absl::StatusOr<bool> { return false; };
  const auto profiles = [&](const std::string& name, const YAML::Node& node) -> absl::StatusOr<bool> {
    if (kind != OptionFileKind::kConfiguration || name != kProfiles) return false;
    if (!node.IsMap()) return Invalid(path, node.Mark(), "profiles: expected a map of names");
    for (const auto& profile : node) {
      if (!profile.first.IsScalar())
        return Invalid(path, profile.first.Mark(), "expected the name of a profile");
      absl::StatusOr<FileOptions> options = OptionsOf(path, profile.second, none);
      if (!options.ok()) return options.status();
      if (!file.profiles.emplace(profile.first.Scalar(), *std::move(options)).second)
        return Invalid(path, profile.first.Mark(), absl::StrCat(profile.first.Scalar(), " appears twice"));
    }
    return true;
  };
  absl::StatusOr<FileOptions> options = OptionsOf(path, root, profiles);
  if (!options.ok()) return options.status();
  file.options = *std::move(options);
  return file;
}

}  // namespace

absl::StatusOr<OptionFile> ParseOptionFile(const std::string& path, const std::string& text,
                                           OptionFileKind kind) {
  try {
    return FileOf(path, YAML::Load(text), kind);
  } catch (const YAML::Exception& error) {
    return Invalid(path, error.mark, error.msg);
  }
}

absl::StatusOr<OptionFile> ReadOptionFile(const std::string& path, OptionFileKind kind) {
  std::error_code error;
  const uintmax_t bytes = std::filesystem::file_size(path, error);
  if (error) return absl::NotFoundError(absl::StrCat("cannot read ", path, ": ", error.message()));
  if (bytes > kMaxBytes)
    return absl::InvalidArgumentError(absl::StrCat(path, " has ", bytes, " bytes, more than ", kMaxBytes));
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  if (!file || (bytes > 0 && !(text << file.rdbuf())))
    return absl::NotFoundError(absl::StrCat("cannot read ", path));
  return ParseOptionFile(path, text.str(), kind);
}

std::string ConfigurationPath(const std::string& folder) {
  return folder.empty() ? "" : absl::StrCat(folder, "/config.yaml");
}

}  // namespace lumifold::client
