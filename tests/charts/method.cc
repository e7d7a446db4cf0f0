#include "tests/charts/method.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "filter/methods.h"
#include "proto/rpc/checksum.h"
#include "tests/charts/methods/rendering/render_method.h"
#include "tests/support/cpu_seconds.h"

namespace lumifold::charts {
namespace {

using Values = absl::Span<const float>;

absl::Status NotRun(const std::string& why) { return absl::UnimplementedError(why); }

/// A method of filter::Methods(). NFOR takes a minute for a film of 1024x768.
Method FilterOf(const filter::MethodInfo& info) {
  Method method{info, false, false, info.name == "nfor" ? Probe::kCrop : Probe::kFilm, {}};
  method.make = [&info](Subject* subject, Values values, TaskPool* pool) -> absl::StatusOr<MadePicture> {
    const EdgedImage& film = subject->rendered.film;
    const std::string call =
        values.empty() ? info.name : absl::StrCat(info.name, ":", filter::FormatParameters(info, values));
    const double start = CpuSeconds();
    absl::StatusOr<Picture> picture =
        filter::FilterFilm(film.pixels, call, pool, &film.edges, &film.fragments);
    if (!picture.ok()) return picture.status();
    return MadePicture{*std::move(picture), info.name == "none" ? 0 : CpuSeconds() - start};
  };
  return method;
}

absl::Status TraceSamples(Subject* subject, TaskPool* pool) {
  if (subject->samples.has_value()) return absl::OkStatus();
  const auto [width, height, samples, seed] = subject->settings;
  if (subject->source == nullptr) return NotRun("a film from a file has no samples");
  if (const int64_t count = int64_t{width} * height * samples; count > kMostChartSamples)
    return NotRun(
        absl::StrFormat("cost: %.1f GB of samples",
                        1e-9 * static_cast<double>(sizeof(ChartSample)) * static_cast<double>(count)));
  const absl::StatusOr<std::unique_ptr<render::Renderer>> renderer =
      subject->source->MakeRenderer(subject->settings);
  if (!renderer.ok()) return renderer.status();
  absl::StatusOr<SampleSet> set =
      TraceSampleSet(**renderer, subject->settings, subject->rendered.film.pixels, pool);
  if (!set.ok()) return set.status();
  subject->samples = *std::move(set);
  return absl::OkStatus();
}

Method SampleMethodOf(const SampleMethod& sampled) {
  Method method{sampled.info, false, true, Probe::kSmallFilms, {}};
  method.make = [&sampled](Subject* subject, Values values, TaskPool* pool) -> absl::StatusOr<MadePicture> {
    if (const absl::Status status = TraceSamples(subject, pool); !status.ok()) return status;
    const double start = CpuSeconds();
    absl::StatusOr<Picture> picture = sampled.filter(*subject->samples, values, pool);
    if (!picture.ok()) return picture.status();
    const double guide = sampled.uses_guide ? subject->samples->guide_seconds : 0;
    return MadePicture{*std::move(picture), CpuSeconds() - start + guide};
  };
  return method;
}

Method RenderMethodOf(const RenderMethod& rendering) {
  Method method{rendering.info, true, true, Probe::kSmallFilms, {}};
  method.make = [&rendering](Subject* subject, Values values, TaskPool* pool) -> absl::StatusOr<MadePicture> {
    if (subject->source == nullptr) return NotRun("a film from a file has no scene");
    const absl::StatusOr<std::shared_ptr<const scene::Scene>> scene = subject->source->LoadScene();
    if (!scene.ok()) return scene.status();
    const double start = CpuSeconds();
    absl::StatusOr<RenderedPicture> rendered = rendering.render(
        *scene, subject->source->SettingsFor(subject->settings), subject->settings.samples, values, pool);
    if (!rendered.ok()) return rendered.status();
    return MadePicture{std::move(rendered->picture), CpuSeconds() - start};
  };
  return method;
}

std::vector<Method> ListMethods() {
  std::vector<Method> methods;
  for (const filter::MethodInfo& info : filter::Methods()) methods.push_back(FilterOf(info));
  for (const SampleMethod& sampled : SampleMethods()) methods.push_back(SampleMethodOf(sampled));
  for (const RenderMethod& rendering : RenderMethods()) methods.push_back(RenderMethodOf(rendering));
  return methods;
}

/// Adds the bits of a method's default picture to `bits`.
absl::StatusOr<MadePicture> MakeBits(const Method& method, Subject* subject, TaskPool* pool,
                                     std::string* bits) {
  absl::StatusOr<MadePicture> made = method.make(subject, filter::DefaultsOf(method.info), pool);
  if (!made.ok()) return made;
  for (const Plane& plane : made->picture) {
    for (int y = 0; y < plane.height(); ++y)
      bits->append(reinterpret_cast<const char*>(plane.Row(y)), sizeof(float) * plane.width());
  }
  return made;
}

absl::StatusOr<Fingerprint> FingerprintOfFilm(const Method& method, Subject* subject, TaskPool* pool) {
  std::string bits;
  absl::StatusOr<MadePicture> made = MakeBits(method, subject, pool, &bits);
  if (!made.ok()) return made.status();
  return Fingerprint{rpc::Checksum(bits), *std::move(made)};
}

/// The middle of a picture, at most kCropWidth x kCropHeight.
constexpr int kCropWidth = 128;
constexpr int kCropHeight = 96;

Rect MiddleOf(const Rect& bounds) {
  const int width = std::min(kCropWidth, bounds.width());
  const int height = std::min(kCropHeight, bounds.height());
  const int x = (bounds.width() - width) / 2;
  const int y = (bounds.height() - height) / 2;
  return {x, y, x + width, y + height};
}

absl::StatusOr<Fingerprint> FingerprintOfCrop(const Method& method, const Subject& subject, TaskPool* pool) {
  const EdgedImage& film = subject.rendered.film;
  const Rect middle = MiddleOf(film.pixels.bounds());
  Subject crop;
  crop.scene = subject.scene;
  crop.settings = {middle.width(), middle.height(), subject.settings.samples, subject.settings.seed};
  crop.rendered.film = {film.pixels.Crop(middle), EdgesInside(film.edges, middle)};
  std::string bits;
  const absl::StatusOr<MadePicture> made = MakeBits(method, &crop, pool, &bits);
  if (!made.ok()) return made.status();
  return Fingerprint{rpc::Checksum(bits), std::nullopt};
}

/// Samples per pixel of the small films: some methods behave differently with many.
constexpr uint32_t kFewSamples = 8;
constexpr uint32_t kManySamples = 64;

absl::Status AddSmallFilm(const Method& method, uint32_t samples, const std::string& cache_folder,
                          TaskPool* pool, std::string* bits) {
  const absl::StatusOr<FilmSource> source = FilmSource::Create("meeting-room", cache_folder);
  if (!source.ok()) return source.status();
  Subject subject;
  subject.scene = "meeting-room";
  subject.source = &*source;
  subject.settings = {48, 36, samples, 3};
  absl::StatusOr<RenderedFilm> film = source->Get(subject.settings, pool);
  if (!film.ok()) return film.status();
  subject.rendered = *std::move(film);
  return MakeBits(method, &subject, pool, bits).status();
}

absl::StatusOr<Fingerprint> FingerprintOfSmallFilms(const Method& method, const std::string& cache_folder,
                                                    TaskPool* pool) {
  std::string bits;
  for (const uint32_t samples : {kFewSamples, kManySamples}) {
    if (samples == kManySamples && method.grows_with_samples) continue;  // that would take minutes
    const absl::Status status = AddSmallFilm(method, samples, cache_folder, pool, &bits);
    if (!status.ok()) return status;
  }
  return Fingerprint{rpc::Checksum(bits), std::nullopt};
}

}  // namespace

const std::vector<Method>& AllMethods() {
  static const std::vector<Method> methods = ListMethods();
  return methods;
}

std::vector<filter::MethodInfo> AllMethodInfos() {
  std::vector<filter::MethodInfo> infos;
  for (const Method& method : AllMethods()) infos.push_back(method.info);
  return infos;
}

absl::StatusOr<std::vector<const Method*>> FindMethods(const std::vector<std::string>& names) {
  const std::vector<Method>& all = AllMethods();
  std::vector<const Method*> found;
  for (const Method& method : all) {
    if (names.empty() || std::find(names.begin(), names.end(), method.info.name) != names.end())
      found.push_back(&method);
  }
  for (const std::string& name : names) {
    if (std::none_of(all.begin(), all.end(), [&](const Method& method) { return method.info.name == name; }))
      return absl::NotFoundError(absl::StrCat("no method is named '", name, "'"));
  }
  return found;
}

absl::StatusOr<Fingerprint> FingerprintOf(const Method& method, Subject* subject,
                                          const std::string& cache_folder, TaskPool* pool) {
  switch (method.probe) {
    case Probe::kFilm:
      return FingerprintOfFilm(method, subject, pool);
    case Probe::kCrop:
      return FingerprintOfCrop(method, *subject, pool);
    case Probe::kSmallFilms:
      return FingerprintOfSmallFilms(method, cache_folder, pool);
  }
  return absl::InternalError("no such probe");
}

}  // namespace lumifold::charts
