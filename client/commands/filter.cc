#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/time.h"
#include "client/cli/json_line.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/options/display_options.h"
#include "client/pictures/film_file.h"
#include "client/pictures/output_file.h"
#include "filter/image/exr_film.h"
#include "filter/image/exr_io.h"
#include "filter/image/exr_row_writer.h"
#include "filter/image/film_source.h"
#include "filter/image/layers.h"
#include "filter/image/memory.h"
#include "filter/image/planes.h"
#include "proto/rpc/monotonic.h"

namespace lumifold::client {
namespace {

struct FilterOptions {
  std::string picture;
  std::string half_b;
  std::string layout = "auto";
  std::string method = "default";
  std::string output;
  pictures::DisplayOptions display;
  FilterMachine machine;
  bool lists_methods = false;
  bool json = false;
};

void AddListOptions(CommandLine* command_line, FilterOptions* options) {
  command_line->AddFlag("--list-methods", &options->lists_methods,
                        "Print all methods with their parameters and sources; needs no other option");
  command_line->AddFlag("--json", &options->json, "Print JSON for programs, one object a line");
}

/// Runs `lumifold filter --list-methods [--json]`.
ExitCode ListMethods(const std::vector<std::string>& arguments, const Environment& environment) {
  FilterOptions options;
  CommandLine command_line(WordsOf("filter"));
  AddListOptions(&command_line, &options);
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  environment.out << (options.json ? environment.local.methods.json : environment.local.methods.table)
                  << std::flush;
  return ExitCode::kOk;
}

std::optional<ExitCode> ParseFilter(const std::vector<std::string>& arguments, const Environment& environment,
                                    FilterOptions* options) {
  options->machine.threads = environment.defaults.threads;
  CommandLine command_line(WordsOf("filter"));
  command_line.AddArgument("PICTURE", &options->picture,
                           "The picture: a film of --save-film, any of our pictures or another renderer's "
                           "passes, .exr; or, with less to go by, .png or .jpg");
  command_line.AddText("--half-b", "FILE", &options->half_b,
                       "A picture with the same number of other samples, for a better estimate of the noise");
  command_line.AddText("--layout", "NAME", &options->layout,
                       "'lumifold', 'cycles', 'arnold', 'vray', 'plain', or a file that names the layers "
                       "(default: found by the layers of the picture)");
  command_line.AddText("--method", "METHOD", &options->method,
                       "One of the methods below (default 'default')");
  command_line.AddRequiredText("-o,--output", "FILE", &options->output,
                               "Output file: .exr with the noisy picture as a layer, .png or .jpg");
  AddDisplayOptions(command_line, &options->display);
  command_line.AddWholeNumber("--threads", &options->machine.threads, 1, kMaxThreads,
                              "Threads of the filter (default: all of this machine)");
  AddDevice(command_line, &options->machine.device, &options->machine.allows_other_bits);
  AddListOptions(&command_line, options);
  command_line.SetFooter(absl::StrCat(
      "A layout file has lines of ROLE = LAYER or ROLE = LAYER + LAYER, with the roles combined, direct,\n"
      "indirect, albedo, emission, normal, depth, glossy, glossy_albedo, transmitted and transmittance. "
      "Light of\n"
      "other layers is filtered as the remainder.\n\n"
      "Methods:\n  ",
      environment.local.methods.names,
      ".\nParameters of a method follow its name, as in --method bilateral:sigma_s=4,sigma_r=0.1."));
  if (const auto ended = command_line.Parse(arguments, environment)) return ended;
  const absl::StatusOr<PictureFormat> format = PictureFormatOf(options->output);
  if (!format.ok())
    return ReportUsage(environment, "lumifold filter", absl::StrCat("-o: ", format.status().message()));
  const absl::Status writable = CheckOutput(options->output);
  if (!writable.ok()) return ReportError(environment, writable);
  return std::nullopt;
}

/// The folder of a file.
std::string FolderOf(const std::string& path) {
  const std::string folder = std::filesystem::path(path).parent_path().string();
  return folder.empty() ? "." : folder;
}

/// What a filter cannot know of a picture for a display.
constexpr char kOfDisplayed[] =
    "a picture for a display: light brighter than white, dark detail and layers are lost, and its noise is "
    "estimated from the picture itself; an .exr gives more";

bool IsForDisplay(const std::string& path) {
  const absl::StatusOr<PictureFormat> format = PictureFormatOf(path);
  return format.ok() && IsDisplayed(*format);
}

/// An input that may be a picture for a display: the filter then reads a copy of it as OpenEXR, beside the
/// output, which is removed at the end.
class InputFile {
 public:
  ~InputFile() {
    std::error_code ignored;
    if (!copy_.empty()) std::filesystem::remove(copy_, ignored);
  }

  absl::Status Open(const std::string& path, const std::string& output, const Environment& environment) {
    path_ = path;
    if (!IsForDisplay(path)) return absl::OkStatus();
    if (!environment.local.displayed_reader)
      return absl::UnimplementedError("this build reads .exr only: it has no worker");
    const absl::StatusOr<LayeredImage> picture = environment.local.displayed_reader(path);
    if (!picture.ok()) return picture.status();
    ReportLine(environment, absl::StrCat(path, ": ", kOfDisplayed));
    path_ = copy_ = absl::StrCat(output, ".", getpid(), ".input.exr");
    return OfThisMachine(WriteExr(copy_, *picture));
  }

  const std::string& path() const { return path_; }

 private:
  std::string path_;
  std::string copy_;
};

/// The output file; takes bands of filtered rows.
class Output {
 public:
  /// Channels of the film that are copied to the result.
  static std::vector<std::string> PassedOn(PictureFormat format, const FilmFile& film) {
    std::vector<std::string> names = {std::string(layers::kAlpha)};
    if (IsDisplayed(format)) return film.is_transparent() ? names : std::vector<std::string>();
    for (std::string& name : layers::ColorChannels(layers::kNoisy)) names.push_back(std::move(name));
    return names;
  }

  /// `film` is the picture's, whose other channels and attributes the output keeps.
  absl::Status Open(const FilterOptions& options, const FilmFile& film) {
    const PictureFormat format = *PictureFormatOf(options.output);
    const int width = film.width(), height = film.height();
    if (IsDisplayed(format)) {
      absl::StatusOr<pictures::DisplayWriter> writer =
          pictures::DisplayWriter::Create(options.output, width, height, options.display);
      if (!writer.ok()) return OfThisMachine(writer.status());
      displayed_ = std::make_unique<pictures::DisplayWriter>(*std::move(writer));
      return absl::OkStatus();
    }
    ExrLayout layout{width, height, PassedOn(format, film), {{"lumifold.method", options.method}}};
    for (std::string& name : layers::ColorChannels(layers::kBeauty))
      layout.channels.push_back(std::move(name));
    layout.origin = film.origin();
    for (std::string& name : film.OtherChannels()) {
      if (std::find(layout.channels.begin(), layout.channels.end(), name) == layout.channels.end())
        kept_.push_back(std::move(name));
    }
    layout.channels.insert(layout.channels.end(), kept_.begin(), kept_.end());
    if (!kept_.empty()) {
      absl::StatusOr<std::unique_ptr<ExrFilm>> source =
          ExrFilm::Open(options.picture, FolderOf(options.output));
      if (!source.ok()) return source.status();
      source_ = *std::move(source);
    }
    absl::StatusOr<ExrRowWriter> writer = ExrRowWriter::Create(options.output, layout);
    if (!writer.ok()) return OfThisMachine(writer.status());
    exr_ = std::make_unique<ExrRowWriter>(*std::move(writer));
    return absl::OkStatus();
  }

  absl::Status Append(const LayeredImage& rows) {
    if (displayed_ != nullptr) {
      if (!rows.Has(layers::kAlpha)) {
        displayed_->Append(rows.GetColor(layers::kBeauty));
      } else {
        const ConstFloatView alpha = rows.Get(layers::kAlpha);
        displayed_->Append(rows.GetColor(layers::kBeauty), &alpha);
      }
      return absl::OkStatus();
    }
    if (source_ == nullptr) return OfThisMachine(exr_->Append(rows));
    absl::StatusOr<EdgedImage> kept = source_->Read({0, done_, rows.width(), done_ + rows.height()});
    if (!kept.ok()) return kept.status();
    done_ += rows.height();
    LayeredImage all = rows.Crop(rows.bounds());
    for (const std::string& name : kept_) CopyPlane(std::as_const(kept->pixels).Get(name), all.Add(name));
    return OfThisMachine(exr_->Append(all));
  }

  absl::Status Finish() { return OfThisMachine(exr_ != nullptr ? exr_->Finish() : displayed_->Finish()); }

 private:
  std::unique_ptr<ExrRowWriter> exr_;  // null where `displayed_` is not
  std::unique_ptr<pictures::DisplayWriter> displayed_;
  std::unique_ptr<ExrFilm> source_;  // of the channels that are kept; null without any
  std::vector<std::string> kept_;
  int done_ = 0;  // rows written
};

/// The time spent in reads and writes.
class IoClock {
 public:
  void Begin() { start_ = rpc::MonotonicNow(); }
  void End() { spent_ += rpc::MonotonicNow() - start_; }
  absl::Duration spent() const { return spent_; }

 private:
  absl::Time start_;
  absl::Duration spent_;
};

/// Filters the film into the output file. Returns the time of the filter in seconds, without reads and
/// writes.
absl::StatusOr<double> FilterInto(const FilterOptions& options, FilmFile* film,
                                  const Environment& environment) {
  const std::unique_ptr<Progress> progress = MakeProgressPrinter(environment);
  FilterMachine machine = options.machine;
  machine.warn = [&](const std::string& line) { progress->Message(line); };
  constexpr int kSteps = 1000;
  ProgressState state = {.stage = "filtering", .total = kSteps, .unit = ProgressUnit::kTime};
  const auto show = [&](double share) {
    state.done = std::max(state.done, static_cast<int64_t>(share * kSteps));
    progress->Update(state);
  };
  Output output;
  if (absl::Status status = output.Open(options, *film); !status.ok()) return status;
  IoClock io;
  int written = 0;
  const auto before_read = [&] {
    if (environment.interrupted()) return absl::CancelledError("interrupted");
    io.Begin();
    return absl::OkStatus();
  };
  TimedFilm timed(film, before_read, [&] { io.End(); });
  const auto write = [&](const LayeredImage& rows) {
    io.Begin();
    absl::Status status = output.Append(rows);
    io.End();
    written += rows.height();
    show(static_cast<double>(written) / film->height());
    return status;
  };
  show(0);
  const absl::Time start = rpc::MonotonicNow();
  absl::Status filtered =
      environment.local.film_filter(&timed, options.method, machine,
                                    Output::PassedOn(*PictureFormatOf(options.output), *film), write, show);
  if (!filtered.ok()) return filtered;
  const double seconds = absl::ToDoubleSeconds(rpc::MonotonicNow() - start - io.spent());
  if (absl::Status status = output.Finish(); !status.ok()) return status;
  return seconds;
}

}  // namespace

ExitCode RunFilter(const std::vector<std::string>& arguments, const Environment& environment) {
  if (std::find(arguments.begin(), arguments.end(), "--list-methods") != arguments.end())
    return ListMethods(arguments, environment);
  FilterOptions options;
  if (const auto ended = ParseFilter(arguments, environment, &options)) return *ended;
  if (!environment.local.film_filter)
    return ReportError(environment, absl::UnimplementedError("this build has no filter"));
  KeepFreedMemory();
  SetExrThreads(options.machine.threads);
  InputFile picture;
  InputFile half_b;
  absl::Status opened = picture.Open(options.picture, options.output, environment);
  if (opened.ok()) opened = half_b.Open(options.half_b, options.output + ".b", environment);
  if (!opened.ok()) return ReportError(environment, opened);
  const absl::StatusOr<std::unique_ptr<FilmFile>> film =
      FilmFile::Open({picture.path(), half_b.path(), options.layout, FolderOf(options.output)});
  if (!film.ok()) return ReportError(environment, film.status());
  for (const std::string& note : (*film)->notes())
    ReportLine(environment, absl::StrCat(options.picture, ": ", note));
  options.picture = picture.path();
  const absl::StatusOr<double> seconds = FilterInto(options, film->get(), environment);
  if (!seconds.ok()) return ReportError(environment, seconds.status());
  if (options.json) {
    environment.out << JsonLine({{"output", options.output},
                                 {"method", options.method},
                                 {"filter_seconds", *seconds}})
                    << "\n"
                    << std::flush;
  }
  ReportLine(environment, absl::StrFormat("wrote %s (filtered in %.2f s)", options.output, *seconds));
  return ExitCode::kOk;
}

}  // namespace lumifold::client
