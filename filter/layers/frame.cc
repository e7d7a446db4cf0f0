#include "filter/layers/frame.h"

#include <string>
#include <string_view>

#include "filter/image/level_mask.h"

namespace lumifold::filter {
namespace {

/// Reads channels by name; those that the film lacks give empty views.
class Channels {
 public:
  explicit Channels(const LayeredImage& film) : film_(film) {}

  ConstFloatView One(std::string_view name) const {
    return film_.Has(name) ? film_.Get(name) : ConstFloatView{};
  }
  ConstColorView Color(std::string_view layer) const {
    return film_.HasColor(layer) ? film_.GetColor(layer) : ConstColorView{};
  }
  HalvedLayer Halved(std::string_view layer) const {
    return {Color(layer), Color(layers::HalfA(layer)), Color(layers::HalfB(layer))};
  }
  ColorOfHalves OfHalves(std::string_view layer) const {
    const HalvedLayer halves = Halved(layer);
    return halves.IsEmpty() ? ColorOfHalves{halves.mean, halves.mean} : ColorOfHalves{halves.a, halves.b};
  }

 private:
  const LayeredImage& film_;
};

SurfaceViews FirstSurface(const Channels& film) {
  return {film.Color(layers::kAlbedo),
          film.OfHalves(layers::kAlbedo),
          film.OfHalves(layers::kEmission),
          {film.One(layers::kNormalX), film.One(layers::kNormalY), film.One(layers::kNormalZ)},
          film.One(layers::kDistance),
          film.One(layers::kMask),
          film.One(layers::kBlur)};
}

LevelViews LevelOf(const Channels& film, layers::Level level) {
  const auto name = [&](std::string_view channel) { return layers::OfLevel(level, channel); };
  return {
      level,
      film.Halved(name(layers::kDirect)),
      film.Halved(name(layers::kIndirect)),
      film.Color(name(layers::kEmission)),
      {film.Color(name(layers::kAlbedo)),
       film.OfHalves(name(layers::kAlbedo)),
       film.OfHalves(name(layers::kEmission)),
       {film.One(name(layers::kNormalX)), film.One(name(layers::kNormalY)), film.One(name(layers::kNormalZ))},
       film.One(name(layers::kDistance)),
       film.One(name(layers::kMask)),
       {}},
      {film.One(name(layers::kSamplesA)), film.One(name(layers::kSamplesB))}};
}

FragmentViews FragmentsIn(const Channels& list) {
  const auto halves = [&](std::string_view layer) {
    return std::array<ConstColorView, 2>{list.Color(layers::HalfA(layer)), list.Color(layers::HalfB(layer))};
  };
  return {list.One(layers::kPixelX),
          list.One(layers::kPixelY),
          list.One(layers::kSurface),
          list.One(layers::kDistance),
          list.One(layers::kRoughness),
          {list.One(layers::kNormalX), list.One(layers::kNormalY), list.One(layers::kNormalZ)},
          list.Color(layers::kAlbedo),
          list.Color(layers::kEmission),
          list.Color(layers::kGlossyAlbedo),
          halves(layers::kDirect),
          halves(layers::kIndirect),
          halves(layers::kGlossy),
          {list.One(layers::kSamplesA), list.One(layers::kSamplesB)}};
}

bool HasAny(const LevelViews& level) {
  return !level.direct.mean[0].IsEmpty() || !level.emission[0].IsEmpty() ||
         !level.surface.albedo[0].IsEmpty() || !level.surface.mask.IsEmpty() || !level.samples.a.IsEmpty() ||
         !level.samples.b.IsEmpty();
}

}  // namespace

Frame::Frame(const LayeredImage& film, const LayeredImage* edge_set, const LayeredImage* fragment_list)
    : width(film.width()), height(film.height()), level_mask(LevelMask(film)) {
  const Channels channels(film);
  combined = channels.Halved(layers::kNoisy);
  direct = channels.Halved(layers::kDirect);
  indirect = channels.Halved(layers::kIndirect);
  emission = channels.Color(layers::kEmission);
  surface = FirstSurface(channels);
  object_id = channels.One(layers::kObjectId);
  gloss = {channels.One(layers::kRoughness), channels.Color(layers::kGlossyAlbedo)};
  samples = {channels.One(layers::kSamplesA), channels.One(layers::kSamplesB)};
  surface.is_foreign = film.HasColor(layers::HalfA(layers::kAlbedo)) && surface.blur.IsEmpty();
  for (const layers::LobeLayer& lobe : layers::kLobeLayers) {
    if (film.HasColor(lobe.light) && film.HasColor(lobe.factor))
      lobes.push_back({lobe.light, channels.Halved(lobe.light), channels.Color(lobe.factor),
                       channels.OfHalves(lobe.factor)});
  }
  for (size_t i = 0; i < layers::kLevelCount; ++i) {
    LevelViews level = LevelOf(channels, layers::Level::Of(i));
    if (HasAny(level)) levels.push_back(level);
  }
  if (edge_set != nullptr && !edge_set->channels().empty()) edges.emplace(*edge_set);
  const bool has_fragments = fragment_list != nullptr && fragment_list->Has(layers::kSurface);
  if (has_fragments) fragments = FragmentsIn(Channels(*fragment_list));
}

}  // namespace lumifold::filter
