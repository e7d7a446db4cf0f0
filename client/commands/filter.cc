#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/output_file.h"
#include "filter/image/exr_io.h"
#include "filter/image/file_io.h"
#include "filter/image/film_layout.h"
#include "filter/image/layers.h"
#include "filter/image/png_io.h"

namespace lumifold::client {
namespace {

constexpr int kMostThreads = 4096;
constexpr int64_t kMostLayoutBytes = 64 * 1024;

struct FilterOptions {
  std::string picture;
  std::string half_b;
  std::string layout = "lumifold";
  std::string method = "default";
  std::string output;
  float exposure = 1;
  int threads = 1;
};

std::optional<ExitCode> ParseFilter(const std::vector<std::string>& arguments, const Environment& environment,
                                    FilterOptions* options) {
  options->threads = environment.default_threads;
  CommandLine command_line("filter", SummaryOf("filter"));
  command_line.AddArgument("PICTURE", &options->picture,
                           "The OpenEXR picture: a film of --save-film, any of our pictures, or another "
                           "renderer's passes");
  command_line.AddText("--half-b", "FILE", &options->half_b,
                       "A picture of as many other samples: tells noise from detail best");
  command_line.AddText("--layout", "NAME", &options->layout,
                       "'lumifold', 'cycles', or a file that names the layers (default 'lumifold')");
  command_line.AddText("--method", "METHOD", &options->method,
                       "'default', 'paper', 'none', or a method to compare with, below (default 'default')");
  command_line.AddRequiredText("-o,--output", "FILE", &options->output,
                               "Where the picture goes: .exr with the noisy one as a layer, or .png");
  command_line.AddPositiveNumber("--exposure", &options->exposure,
                                 "Factor on the light of a .png (default 1)");
  command_line.AddWholeNumber("--threads", &options->threads, 1, kMostThreads,
                              "Threads to filter with (default: all of this machine)");
  command_line.SetFooter(
      "A layout file has lines of ROLE = LAYER or ROLE = LAYER + LAYER, with the roles combined, direct,\n"
      "indirect, albedo, emission, normal and depth. What it leaves out is filtered as part of the rest.\n\n"
      "Methods to compare with: manifolds-color, bilateral, cross-bilateral, a-trous, a-trous-variance, "
      "guided\n"
      "and nlm; with parameters as in --method bilateral:sigma_s=4,sigma_r=0.1 (docs/method.md lists them).");
  if (const auto ended = command_line.Parse(arguments, environment)) return ended;
  const absl::StatusOr<PictureFormat> format = PictureFormatOf(options->output);
  if (!format.ok())
    return ReportUsage(environment, "lumifold filter", absl::StrCat("-o: ", format.status().message()));
  const absl::Status writable = CheckOutput(options->output);
  if (!writable.ok()) return ReportError(environment, writable);
  return std::nullopt;
}

absl::StatusOr<FilmLayout> LayoutOf(const std::string& name) {
  if (const FilmLayout* known = FindFilmLayout(name)) return *known;
  const absl::StatusOr<std::string> text = ReadFile(name, kMostLayoutBytes);
  if (absl::IsNotFound(text.status())) {
    return absl::NotFoundError(
        absl::StrCat("--layout: no layout is named '", name, "', and there is no such file"));
  }
  if (!text.ok()) return text.status();
  return ParseFilmLayout(name, *text);
}

absl::StatusOr<ForeignFilm> ReadFilm(const std::string& path, const FilmLayout& layout) {
  const absl::StatusOr<LayeredImage> file = ReadExr(path);
  if (!file.ok()) return file.status();
  return ReadForeignFilm(path, *file, layout);
}

/// What is wrong with a picture is no fault of the command line.
absl::Status AsPictureError(const absl::Status& status) {
  return absl::IsInvalidArgument(status) ? absl::DataLossError(status.message()) : status;
}

/// A film that holds its own halves: what --save-film writes.
bool IsWholeFilm(const LayeredImage& file) {
  return file.Has(layers::kSamplesA) && file.HasColor(layers::HalfA(layers::kDirect));
}

/// What is to be filtered, and what the user should know of it.
struct Input {
  EdgedImage film;
  std::vector<std::string> notes;
};

absl::StatusOr<Input> ReadInput(const FilterOptions& options) {
  const absl::StatusOr<FilmLayout> layout = LayoutOf(options.layout);
  if (!layout.ok()) return layout.status();
  absl::StatusOr<EdgedImage> file = ReadEdgedExr(options.picture);
  if (!file.ok()) return file.status();
  if (options.layout == "lumifold" && options.half_b.empty() && IsWholeFilm(file->pixels))
    return Input{*std::move(file), {}};
  absl::StatusOr<ForeignFilm> film = ReadForeignFilm(options.picture, file->pixels, *layout);
  if (!film.ok()) return film.status();
  if (options.half_b.empty()) {
    film->notes.push_back("one picture: its noise is estimated from it, which takes fine detail for noise");
    return Input{{std::move(film->film), {}}, std::move(film->notes)};
  }
  const absl::StatusOr<ForeignFilm> other = ReadFilm(options.half_b, *layout);
  if (!other.ok()) return other.status();
  absl::StatusOr<LayeredImage> joined = JoinHalves(film->film, other->film);
  if (!joined.ok()) return joined.status();
  return Input{{*std::move(joined), {}}, std::move(film->notes)};
}

absl::Status WriteResult(const FilterOptions& options, std::array<Plane, 3> filtered,
                         const LayeredImage& film) {
  LayeredImage result(film.width(), film.height());
  const auto beauty = layers::ColorChannels(layers::kBeauty);
  for (size_t c = 0; c < beauty.size(); ++c) result.Add(beauty[c], std::move(filtered[c]));
  CopyPlane(film.Get(layers::kAlpha), result.Add(layers::kAlpha));
  const ColorView noisy = result.AddColor(layers::kNoisy);
  for (size_t c = 0; c < noisy.size(); ++c) CopyPlane(film.GetColor(layers::kNoisy)[c], noisy[c]);
  result.metadata()["lumifold.filter"] = options.method;
  if (*PictureFormatOf(options.output) == PictureFormat::kExr) return WriteExr(options.output, result);
  return WritePng(options.output, std::as_const(result).GetColor(layers::kBeauty), options.exposure);
}

}  // namespace

ExitCode RunFilter(const std::vector<std::string>& arguments, const Environment& environment) {
  FilterOptions options;
  if (const auto ended = ParseFilter(arguments, environment, &options)) return *ended;
  if (!environment.film_filter)
    return ReportError(environment, absl::UnimplementedError("this build has no filter"));
  absl::StatusOr<Input> read = ReadInput(options);
  if (!read.ok()) return ReportError(environment, AsPictureError(read.status()));
  for (const std::string& note : read->notes)
    ReportLine(environment, absl::StrCat(options.picture, ": ", note));
  const absl::Time start = absl::Now();
  absl::StatusOr<std::array<Plane, 3>> filtered =
      environment.film_filter(&read->film, options.method, options.threads);
  if (!filtered.ok()) return ReportError(environment, filtered.status());
  const double seconds = absl::ToDoubleSeconds(absl::Now() - start);
  const absl::Status written = WriteResult(options, *std::move(filtered), read->film.pixels);
  if (!written.ok()) return ReportError(environment, OfThisMachine(written));
  ReportLine(environment, absl::StrFormat("wrote %s (filtered in %.2f s)", options.output, seconds));
  return ExitCode::kOk;
}

}  // namespace lumifold::client
