#include "tests/charts/methods/samples/sample_set.h"

#include <algorithm>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "filter/image/layers.h"

namespace lumifold::charts {
namespace {

ChartSample WithoutBadNumbers(const render::SampleRecord& record) {
  ChartSample sample;
  sample.point = record.point;
  sample.lens = record.lens;
  sample.random = record.random;
  if (!render::IsFinite(record.layers)) return sample;
  sample.radiance = record.layers.combined;
  sample.direct = record.layers.direct;
  sample.indirect = record.layers.indirect;
  sample.albedo = record.layers.albedo;
  sample.emitted = record.layers.emitted;
  if (!record.geometry.hit) return sample;
  sample.position = record.geometry.position;
  sample.normal = record.geometry.normal;
  sample.distance = record.geometry.distance;
  return sample;
}

void TraceGuide(const render::Renderer& renderer, TaskPool* pool, SampleSet* set) {
  const absl::Time start = absl::Now();
  set->guide = LayeredImage(set->width, set->height);
  for (const std::string_view layer : {layers::kDirect, layers::kIndirect}) set->guide.AddColor(layer);
  ParallelFor(pool, set->height, [&](int64_t row) {
    const int y = static_cast<int>(row);
    const LayeredImage line = render::ChartsAccess(renderer).RenderGuide({0, y, set->width, y + 1}, 0);
    for (const LayeredImage::Channel& channel : line.channels())
      std::copy_n(channel.plane.Row(0), set->width, set->guide.Get(channel.name).Row(y));
  });
  set->guide_seconds = absl::ToDoubleSeconds(absl::Now() - start);
}

}  // namespace

absl::StatusOr<SampleSet> TraceSampleSet(const render::Renderer& renderer, const FilmSettings& settings,
                                         const LayeredImage& film, TaskPool* pool) {
  if (film.width() != settings.width || film.height() != settings.height)
    return absl::InvalidArgumentError("samples and film differ in size");
  const int64_t count = int64_t{settings.width} * settings.height * settings.samples;
  if (count > kMostChartSamples) {
    return absl::ResourceExhaustedError(
        absl::StrCat(count, " samples are more than the ", kMostChartSamples, " that are kept one by one"));
  }
  SampleSet set;
  set.width = settings.width;
  set.height = settings.height;
  set.samples_per_pixel = settings.samples;
  set.samples.resize(static_cast<size_t>(count));
  set.film = &film;
  ParallelFor(pool, settings.height, [&](int64_t row) {
    const int y = static_cast<int>(row);
    render::ChartsAccess(renderer).TraceSamples(
        {0, y, settings.width, y + 1}, 0, {0, settings.samples}, [&set](const render::SampleRecord& record) {
          set.samples[static_cast<size_t>(record.pixel) * set.samples_per_pixel + record.index] =
              WithoutBadNumbers(record);
        });
  });
  TraceGuide(renderer, pool, &set);
  return set;
}

}  // namespace lumifold::charts
