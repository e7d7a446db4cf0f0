#include "server/film/cryptomatte.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstring>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "filter/image/layers.h"

namespace lumifold::film {
namespace {

using Objects = google::protobuf::RepeatedPtrField<v1::SceneObject>;

/// Two ranks in each group of four channels.
constexpr size_t kGroups = 3;
constexpr size_t kRanks = 2 * kGroups;

/// What covers a pixel: numbers of names, with their share of it.
using Covers = std::vector<std::pair<float, float>>;

void AddCover(float number, float share, Covers* covers) {
  const auto found =
      std::find_if(covers->begin(), covers->end(), [&](const auto& cover) { return cover.first == number; });
  if (found == covers->end()) {
    covers->emplace_back(number, share);
  } else {
    found->second += share;
  }
}

/// One layer: its name, and the number of each object's name.
class Layer {
 public:
  Layer(std::string name, const Objects& objects, const std::string& (v1::SceneObject::*field)() const,
        LayeredImage* result)
      : name_(std::move(name)) {
    nlohmann::json manifest = nlohmann::json::object();
    numbers_.reserve(static_cast<size_t>(objects.size()));
    for (const v1::SceneObject& object : objects) {
      const std::string& text = (object.*field)();
      const uint32_t hash = CryptomatteHash(text);
      numbers_.push_back(CryptomatteNumber(hash));
      manifest[text] = absl::StrFormat("%08x", hash);
    }
    const std::string key =
        absl::StrCat("cryptomatte/", absl::StrFormat("%08x", CryptomatteHash(name_)).substr(0, 7));
    result->metadata()[key + "/name"] = name_;
    result->metadata()[key + "/hash"] = "MurmurHash3_32";
    result->metadata()[key + "/conversion"] = "uint32_to_float32";
    result->metadata()[key + "/manifest"] =
        manifest.dump(-1, ' ', /*ensure_ascii=*/true, nlohmann::json::error_handler_t::replace);
    for (size_t group = 0; group < kGroups; ++group) {
      for (const char channel : {'R', 'G', 'B', 'A'})
        channels_.push_back(result->Add(absl::StrFormat("%s%02d.%c", name_, group, channel)));
    }
  }

  /// The number of the name of object `id`; 0: nothing is hit, or an object that is not known.
  float NumberOf(float id) const {
    const auto index = static_cast<size_t>(id);
    return id >= 1 && index <= numbers_.size() ? numbers_[index - 1] : 0;
  }

  void Store(int x, int y, Covers covers) {
    std::sort(covers.begin(), covers.end(), [](const auto& a, const auto& b) {
      return a.second != b.second ? a.second > b.second
                                  : std::bit_cast<uint32_t>(a.first) < std::bit_cast<uint32_t>(b.first);
    });
    for (size_t rank = 0; rank < std::min(covers.size(), kRanks); ++rank) {
      channels_[2 * rank].At(x, y) = covers[rank].first;
      channels_[2 * rank + 1].At(x, y) = covers[rank].second;
    }
  }

 private:
  std::string name_;
  std::vector<float> numbers_;
  std::vector<FloatView> channels_;
};

/// A pixel outside the edge set: one object.
Covers OfPixel(const Layer& layer, float id, float coverage) {
  Covers covers;
  if (const float number = layer.NumberOf(id); number != 0 && coverage > 0)
    AddCover(number, coverage, &covers);
  return covers;
}

Covers OfSubSamples(const Layer& layer, const ConstFloatView& ids, int row) {
  Covers covers;
  for (int i = 0; i < kSubSamples; ++i) {
    if (const float number = layer.NumberOf(ids.At(i, row)); number != 0)
      AddCover(number, 1.0f / kSubSamples, &covers);
  }
  return covers;
}

}  // namespace

uint32_t CryptomatteHash(std::string_view name) {
  constexpr uint32_t kFirst = 0xcc9e2d51;
  constexpr uint32_t kSecond = 0x1b873593;
  const auto scramble = [](uint32_t k) { return std::rotl(k * kFirst, 15) * kSecond; };
  uint32_t hash = 0;
  size_t i = 0;
  for (; i + 4 <= name.size(); i += 4) {
    uint32_t block = 0;
    std::memcpy(&block, name.data() + i,
                sizeof(block));  // little-endian, as all machines that this is built for
    hash = std::rotl(hash ^ scramble(block), 13) * 5 + 0xe6546b64;
  }
  uint32_t tail = 0;
  for (size_t j = name.size(); j > i; --j) tail = (tail << 8) | static_cast<unsigned char>(name[j - 1]);
  if (name.size() > i) hash ^= scramble(tail);
  hash ^= static_cast<uint32_t>(name.size());
  hash = (hash ^ (hash >> 16)) * 0x85ebca6b;
  hash = (hash ^ (hash >> 13)) * 0xc2b2ae35;
  return hash ^ (hash >> 16);
}

float CryptomatteNumber(uint32_t hash) {
  const uint32_t exponent = (hash >> 23) & 0xff;
  if (exponent == 0 || exponent == 0xff) hash ^= uint32_t{1} << 23;
  return std::bit_cast<float>(hash);
}

void AddCryptomatte(const Objects& objects, const LayeredImage& edges, LayeredImage* result) {
  if (objects.empty()) return;
  std::array<Layer, 2> layers_of_names = {
      Layer("CryptoObject", objects, &v1::SceneObject::name, result),
      Layer("CryptoMaterial", objects, &v1::SceneObject::material, result)};
  const LayeredImage& film = *result;
  const ConstFloatView ids = film.Get(layers::kObjectId);
  const ConstFloatView alpha = film.Get(layers::kAlpha);
  for (Layer& layer : layers_of_names) {
    for (int y = 0; y < film.height(); ++y) {
      for (int x = 0; x < film.width(); ++x) layer.Store(x, y, OfPixel(layer, ids.At(x, y), alpha.At(x, y)));
    }
    if (edges.channels().empty()) continue;
    const ConstFloatView sub_samples = edges.Get(layers::kObjectId);
    for (int row = 0; row < edges.height(); ++row) {
      const auto x = static_cast<int>(edges.Get(layers::kPixelX).At(0, row));
      const auto y = static_cast<int>(edges.Get(layers::kPixelY).At(0, row));
      layer.Store(x, y, OfSubSamples(layer, sub_samples, row));
    }
  }
}

}  // namespace lumifold::film
