#include "client/pictures/output_template.h"

#include <array>
#include <filesystem>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "client/cli/frame_range.h"

namespace lumifold::client {
namespace {

using Field = const std::string& (*)(const v1::JobStatus& job);

constexpr std::array<std::pair<const char*, Field>, 3> kPlaceholders = {{
    {"{job}", [](const v1::JobStatus& job) -> const std::string& { return job.job_id(); }},
    {"{name}", [](const v1::JobStatus& job) -> const std::string& { return job.display_name(); }},
    {"{user}", [](const v1::JobStatus& job) -> const std::string& { return job.scheduling().user(); }},
}};

std::string AsFileName(std::string text) {
  for (char& c : text) {
    if (c == '/' || c == '#' || absl::ascii_iscntrl(static_cast<unsigned char>(c))) c = '_';
  }
  if (text.starts_with('.')) text[0] = '_';
  return text;
}

}  // namespace

absl::Status CheckTemplate(const std::string& path) {
  std::string rest = path;
  for (const auto& [placeholder, field] : kPlaceholders)
    rest = absl::StrReplaceAll(rest, {{placeholder, ""}});
  if (rest.find_first_of("{}") == std::string::npos) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("expected no { or } but in {job}, {name} and {user}; got '", path, "'"));
}

bool NeedsJob(const std::string& path) { return path.find('{') != std::string::npos; }

std::string PathOfOutput(const std::string& path, const v1::JobStatus& job, int frame) {
  std::string with_frame = PathOfFrame(path, frame);
  for (const auto& [placeholder, field] : kPlaceholders)
    with_frame = absl::StrReplaceAll(with_frame, {{placeholder, AsFileName(field(job))}});
  return with_frame;
}

std::string KnownFolderOf(const std::string& path) {
  return std::filesystem::path(path.substr(0, path.find('{'))).parent_path().string();
}

}  // namespace lumifold::client
