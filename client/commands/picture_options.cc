#include "client/commands/picture_options.h"

#include <filesystem>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "client/farm/download.h"
#include "client/options/display_options.h"
#include "client/pictures/output_file.h"
#include "client/pictures/output_template.h"
#include "client/reports/job_report.h"
#include "filter/image/exr_copy.h"
#include "filter/image/exr_io.h"
#include "filter/image/file_io.h"
#include "filter/image/layers.h"

namespace lumifold::client {
namespace {

/// Value of --exr for all layers in floats.
constexpr char kFullExr[] = "full";

/// The folder of a path with placeholders.
absl::Status MakeFolderOf(const std::string& path) {
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  std::error_code error;
  if (!folder.empty()) std::filesystem::create_directories(folder, error);
  if (!error) return absl::OkStatus();
  return absl::PermissionDeniedError(absl::StrCat("cannot make ", folder.string(), ": ", error.message()));
}

}  // namespace

std::string FilesOf(const std::string& path, const v1::JobStatus& job, const Frames& frames) {
  const std::string first = PathOfOutput(path, job, frames.first());
  return frames.IsOne() ? first : absl::StrCat(first, " to ", PathOfOutput(path, job, frames.last()));
}

void PictureOptions::AddTo(CommandLine& command_line, const std::string& output_option, bool is_required) {
  output_option_ = output_option.substr(0, output_option.find(','));
  const char* const help =
      "Output file: .exr, .png or .jpg; ### is replaced by the frame number, {job}, {name} "
      "and {user} "
      "by those of the job";
  if (is_required) {
    command_line.AddRequiredText(output_option, "FILE", &output, help);
  } else {
    command_line.AddText(output_option, "FILE", &output, help);
  }
  command_line.AddText("--noisy", "FILE", &noisy, "Also write the unfiltered picture, as .png or .jpg");
  AddDisplayOptions(command_line, &display);
  command_line.AddChoice(
      "--exr", "WHICH", {"lean", kFullExr}, &exr,
      "Of an .exr: 'lean', what compositors use, in half floats; 'full', all layers in floats (default lean; "
      "full with --reproducible, and of jobs with --save-film)");
  command_line.AddChoice(
      "--compression", "HOW", {"none", "zips", "zip", "piz", "dwaa"}, &compression,
      "Of an .exr: none, zips, zip (default), piz or dwaa, which loses a little of the colours");
  command_line.AddChoice(
      "--parts", "WHICH", {"single", "layers"}, &parts,
      "Of an .exr: 'single' (default) has all layers in one part, 'layers' a part for each");
  command_line.AddFlag("--reproducible", &is_reproducible,
                       "Leave date, owner and times out of an .exr, so that equal jobs give equal files");
}

absl::Status PictureOptions::CheckName(const char* option, const std::string& path,
                                       const Frames& frames) const {
  const absl::Status known = CheckTemplate(path);
  if (!known.ok()) return absl::InvalidArgumentError(absl::StrCat(option, ": ", known.message()));
  if (frames.IsOne() || HasFrameNumber(path)) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(option, ": expected a name with ### for the frame's number; got '", path, "'"));
}

std::optional<ExitCode> PictureOptions::Check(const Frames& frames, const std::string& command,
                                              const Environment& environment) const {
  const absl::StatusOr<PictureFormat> format = PictureFormatOf(output);
  if (!format.ok())
    return ReportUsage(environment, command, absl::StrCat(output_option_, ": ", format.status().message()));
  const absl::StatusOr<PictureFormat> noisy_format = PictureFormatOf(noisy);
  if (!noisy.empty() && (!noisy_format.ok() || !IsDisplayed(*noisy_format))) {
    return ReportUsage(environment, command,
                       absl::StrCat("--noisy: expected a name that ends in .png or .jpg; got '", noisy, "'"));
  }
  for (const auto& [option, path] :
       {std::pair(output_option_.c_str(), output), std::pair("--noisy", noisy)}) {
    if (path.empty()) continue;
    const absl::Status name = CheckName(option, path, frames);
    if (!name.ok()) return ReportUsage(environment, command, std::string(name.message()));
    const absl::Status writable = NeedsJob(path) ? CheckFolder(path, KnownFolderOf(path))
                                                 : CheckOutput(PathOfFrame(path, frames.first()));
    if (!writable.ok()) return ReportError(environment, writable);
  }
  return std::nullopt;
}

std::string PictureOptions::OutputOf(const v1::JobStatus& job, int frame) const {
  return PathOfOutput(output, job, frame);
}

absl::Status PictureOptions::Fetch(FarmClient& farm, const v1::JobStatus& job, int frame, Progress& progress,
                                   Backoff backoff) const {
  const std::string path = OutputOf(job, frame);
  const absl::StatusOr<std::string> part = PartPath(path, job.job_id(), frame);
  if (!part.ok()) return part.status();
  if (NeedsJob(output)) {
    if (absl::Status made = MakeFolderOf(path); !made.ok()) return made;
  }
  const absl::Status downloaded =
      DownloadFrame(farm, job.job_id(), frame, *part, progress, std::move(backoff));
  return downloaded.ok() ? Write(*part, job, frame) : downloaded;
}

absl::Status PictureOptions::FetchAll(FarmClient& farm, const v1::JobStatus& job, const Frames& frames,
                                      Progress& progress, const Backoff& backoff) const {
  const std::vector<FrameRange> skipped = SkippedFrames(job);
  for (const FrameRange& range : frames.ranges) {
    for (int frame = range.first; frame <= range.last; ++frame) {
      if (HasFrame(skipped, frame)) continue;
      absl::Status fetched = Fetch(farm, job, frame, progress, backoff);
      if (!fetched.ok()) return fetched;
    }
  }
  return absl::OkStatus();
}

absl::Status PictureOptions::Write(const std::string& part_path, const v1::JobStatus& job, int frame) const {
  const std::string path = OutputOf(job, frame);
  if (!noisy.empty()) {
    const std::string noisy_path = PathOfOutput(noisy, job, frame);
    if (NeedsJob(noisy)) {
      if (absl::Status made = MakeFolderOf(noisy_path); !made.ok()) return made;
    }
    absl::Status written = WriteLayer(part_path, std::string(layers::kNoisy), display, noisy_path);
    if (!written.ok()) return written;
  }
  const absl::StatusOr<PictureFormat> format = PictureFormatOf(output);
  if (!format.ok()) return format.status();
  absl::Status written = IsDisplayed(*format)
                             ? WriteLayer(part_path, std::string(layers::kBeauty), display, path)
                             : WriteExr(part_path, job, path);
  if (!written.ok()) return written;
  std::error_code ignored;  // the picture is written; a leftover part is harmless
  std::filesystem::remove(part_path, ignored);
  return absl::OkStatus();
}

absl::Status PictureOptions::WriteExr(const std::string& part_path, const v1::JobStatus& job,
                                      const std::string& path) const {
  const bool is_full = exr.empty() ? is_reproducible || job.settings().save_film() : exr == kFullExr;
  ExrCopyOptions copy{.compression = compression, .layers_as_parts = parts == "layers", .is_lean = !is_full};
  if (!is_reproducible) {
    const absl::Time submitted = absl::FromUnixMillis(job.submitted_unix_ms());
    copy.texts["capDate"] = absl::FormatTime("%Y:%m:%d %H:%M:%S", submitted, absl::UTCTimeZone());
    copy.texts["owner"] = job.scheduling().user();
    copy.numbers["utcOffset"] = 0;
    copy.numbers["renderTime"] = static_cast<float>(job.times().render_seconds());
  } else if (compression.empty() && !copy.layers_as_parts && is_full) {
    return OfThisMachine(MoveIntoPlace(part_path, path));
  }
  SetExrThreads(threads);
  return OfThisMachine(CopyExr(part_path, path, copy));
}

}  // namespace lumifold::client
