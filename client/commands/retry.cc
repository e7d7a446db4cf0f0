#include <array>
#include <optional>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"

namespace lumifold::client {
namespace {

constexpr int kMaxFrames = 100'000;  // of a job

/// Parses "x0,y0,x1,y1": pixels from (x0, y0) to before (x1, y1).
std::optional<v1::Rect> ParseRegion(const std::string& text) {
  const std::vector<std::string> words = absl::StrSplit(text, ',');
  std::array<int, 4> values = {};
  if (words.size() != values.size()) return std::nullopt;
  for (size_t i = 0; i < values.size(); ++i) {
    if (!absl::SimpleAtoi(words[i], &values[i]) || values[i] < 0) return std::nullopt;
  }
  if (values[0] >= values[2] || values[1] >= values[3]) return std::nullopt;
  v1::Rect region;
  region.set_x0(values[0]);
  region.set_y0(values[1]);
  region.set_x1(values[2]);
  region.set_y1(values[3]);
  return region;
}

}  // namespace

ExitCode RunRetry(const std::vector<std::string>& arguments, const Environment& environment) {
  v1::RetryJobRequest request;
  Frames frames{.ranges = {}};
  std::string region;
  bool filter_only = false;
  RemoteOptions remote(environment);
  CommandLine command_line("retry", SummaryOf("retry"));
  command_line.AddArgument("JOB", request.mutable_job_id(), kJobArgumentHelp);
  command_line.AddFrames("--frame,--frames", &frames, "Frames to render again (default: all)");
  command_line.AddText("--region", "X0,Y0,X1,Y1", &region,
                       "Only the tiles that touch these pixels, from X0,Y0 to before X1,Y1");
  command_line.AddFlag("--filter-only", &filter_only, "Keep the units; filter and write the frames again");
  remote.AddTo(command_line);
  command_line.SetFooter("The rest of the job is kept. A job that has ended runs again.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  if (!region.empty()) {
    const std::optional<v1::Rect> rect = ParseRegion(region);
    if (!rect.has_value()) {
      return ReportUsage(environment, "lumifold retry",
                         "--region: expected X0,Y0,X1,Y1, X0 below X1 and Y0 below Y1; got '" + region + "'");
    }
    *request.mutable_region() = *rect;
  }
  for (const FrameRange& range : frames.ranges) {
    if (range.count() > kMaxFrames - request.frames_size())
      return ReportUsage(environment, "lumifold retry", absl::StrCat("--frames: at most ", kMaxFrames));
    for (int frame = range.first; frame <= range.last; ++frame) request.add_frames(frame);
  }
  request.set_filter_only(filter_only);
  return ReportJob(environment, remote.json, remote.Connect(environment)->RetryJob(request));
}

}  // namespace lumifold::client
