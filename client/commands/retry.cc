#include <optional>

#include "absl/strings/str_cat.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "proto/rpc/rect_codec.h"

namespace lumifold::client {
namespace {

constexpr int kMaxFrames = 100'000;  // of a job

}  // namespace

ExitCode RunRetry(const std::vector<std::string>& arguments, const Environment& environment) {
  v1::RetryJobRequest request;
  Frames frames{.ranges = {}};
  std::optional<Rect> region;
  bool filter_only = false;
  bool skips = false;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("retry"));
  command_line.AddArgument("JOB", request.mutable_job_id(), kJobArgumentHelp);
  command_line.AddFrames("--frame,--frames", &frames, "Frames to render again, or to skip (default: all)");
  command_line.AddRect("--region", &region,
                       "Only the tiles that touch these pixels, from X0,Y0 to before X1,Y1");
  command_line.AddFlag("--filter-only", &filter_only, "Keep the units; filter and write the frames again");
  command_line.AddFlag(
      "--skip", &skips,
      "Go on without the frame that failed the job, and without others that fail; with --frames, "
      "without these");
  remote.AddTo(command_line);
  command_line.SetFooter(
      "The rest of the job is kept. A job that has ended runs again. One that is done with gaps renders "
      "these, "
      "unless something else is named.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  if (skips && (region.has_value() || filter_only))
    return ReportUsage(environment, "lumifold retry", "--skip: not together with --region or --filter-only");
  if (region.has_value()) *request.mutable_region() = rpc::ProtoOf(*region);
  for (const FrameRange& range : frames.ranges) {
    if (range.count() > kMaxFrames - request.frames_size())
      return ReportUsage(environment, "lumifold retry", absl::StrCat("--frames: at most ", kMaxFrames));
    for (int frame = range.first; frame <= range.last; ++frame) request.add_frames(frame);
  }
  request.set_filter_only(filter_only);
  request.set_skip(skips);
  const absl::StatusOr<std::unique_ptr<FarmClient>> farm =
      remote.ConnectFor(request.mutable_job_id(), environment);
  if (!farm.ok()) return ReportError(environment, farm.status());
  return ReportJob(environment, remote.json, (*farm)->RetryJob(request));
}

}  // namespace lumifold::client
