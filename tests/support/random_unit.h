#pragma once

#include <cmath>
#include <cstdint>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "filter/image/edged_image.h"
#include "filter/image/layers.h"
#include "server/film/unit_layout.h"
#include "server/job/tile_grid.h"

namespace lumifold {

/// Two edge pixels of a tile, made up.
inline LayeredImage RandomEdges(const Rect& rect, std::mt19937* random) {
  std::uniform_real_distribution<float> value(0.0f, 1.0f);
  LayeredImage edges(kSubSamples, 2);
  for (const std::string& name : layers::EdgeChannels()) {
    const FloatView view = edges.Add(name);
    for (int i = 0; i < kSubSamples; ++i) {
      for (int row = 0; row < 2; ++row) view.At(i, row) = value(*random);
    }
  }
  for (int i = 0; i < kSubSamples; ++i) {
    for (int row = 0; row < 2; ++row) {
      edges.Get(layers::kPixelX).At(i, row) = static_cast<float>(rect.x1 - 1 - row);
      edges.Get(layers::kPixelY).At(i, row) = static_cast<float>(rect.y0 + row);
    }
  }
  return edges;
}

/// Fragments of the same two pixels, made up: the samples of each pixel are on two surfaces, the second of
/// which is not the same in each pass.
inline LayeredImage RandomFragments(const Rect& rect, uint32_t count_a, uint32_t count_b,
                                    std::mt19937* random) {
  std::uniform_real_distribution<float> value(0.0f, 1.0f);
  std::vector<std::vector<float>> rows;
  const std::vector<std::string> names = layers::FragmentChannels();
  for (int pixel = 0; pixel < 2; ++pixel) {
    for (const bool is_first : {true, false}) {
      const uint32_t a = is_first ? count_a - count_a / 2 : count_a / 2;
      const uint32_t b = is_first ? count_b / 2 : count_b - count_b / 2;
      if (a + b == 0) continue;
      std::vector<float> row = {static_cast<float>(rect.x1 - 1 - pixel), static_cast<float>(rect.y0 + pixel),
                                is_first ? 7.0f : 100.0f + std::floor(3 * value(*random))};
      while (row.size() + 2 < names.size()) row.push_back(value(*random));
      row.insert(row.end(), {static_cast<float>(a), static_cast<float>(b)});
      rows.push_back(std::move(row));
    }
  }
  LayeredImage fragments(1, static_cast<int>(rows.size()));
  for (size_t i = 0; i < names.size(); ++i) {
    const FloatView view = fragments.Add(names[i]);
    for (size_t row = 0; row < rows.size(); ++row) view.At(0, static_cast<int>(row)) = rows[row][i];
  }
  return fragments;
}

/// The list of a unit, which has at most one.
inline const LayeredImage& ListOf(const EdgedImage& unit) {
  return unit.fragments.height() > 0 ? unit.fragments : unit.edges;
}

/// The level beyond the first surface that units of a tile carry, if any.
inline std::optional<layers::Level> LevelOfTile(int32_t tile) {
  if (tile % 3 == 0) return std::nullopt;
  return tile % 3 == 1 ? layers::Level{layers::Branch::kReflection, 1}
                       : layers::Level{layers::Branch::kTransmission, 2};
}

/// The model of a full plan for a job.
inline film::UnitModel FullModelOf(const v1::JobSpec& spec) {
  film::UnitModel model;
  model.has_matte = spec.background() == v1::BACKGROUND_TRANSPARENT;
  model.carried.lens = spec.has_lens();
  return model;
}

/// What a worker might deliver for a unit: made-up pixels that depend on (seed, unit) alone, with the counts
/// a pass of `samples` has. Some tiles carry a level; those of more than one row and column have edges, and
/// every other one of these has fragments.
inline EdgedImage RandomUnit(const job::UnitKey& key, const Rect& rect, SampleRange samples, uint32_t seed,
                             const film::UnitModel& model = {}) {
  std::seed_seq mix{seed, static_cast<uint32_t>(key.frame), static_cast<uint32_t>(key.tile),
                    static_cast<uint32_t>(key.pass), static_cast<uint32_t>(key.kind)};
  std::mt19937 random(mix);
  std::uniform_real_distribution<float> value(0.0f, 1.0f);
  LayeredImage unit(rect.width(), rect.height());
  const bool is_pass = key.kind == v1::UNIT_KIND_PASS;
  std::vector<std::string> names = is_pass ? film::PassChannels(model) : film::GeometryChannels(model);
  if (const auto level = LevelOfTile(key.tile); level.has_value()) {
    for (std::string& name : is_pass ? layers::LevelPassChannels(*level, model.carried.lens)
                                     : layers::LevelFeatureChannels(*level))
      names.push_back(std::move(name));
  }
  for (const std::string& name : names) {
    const FloatView view = unit.Add(name);
    for (int y = 0; y < rect.height(); ++y) {
      for (int x = 0; x < rect.width(); ++x)
        view.At(x, y) = value(random) * (is_pass ? static_cast<float>(samples.count()) : 1.0f);
    }
  }
  const bool has_list = rect.width() > 1 && rect.height() > 1;
  if (is_pass) {
    // Even sample indices are half A's, odd ones half B's.
    const uint32_t count_b = samples.last / 2 - samples.first / 2;
    const uint32_t count_a = samples.count() - count_b;
    const auto set = [&unit, &rect](const std::string& name, uint32_t count) {
      if (!unit.Has(name)) return;
      for (int y = 0; y < rect.height(); ++y) {
        for (int x = 0; x < rect.width(); ++x) unit.Get(name).At(x, y) = static_cast<float>(count);
      }
    };
    set(std::string(layers::kSamplesA), count_a);
    set(std::string(layers::kSamplesB), count_b);
    for (size_t i = 0; i < layers::kLevelCount; ++i) {
      set(layers::OfLevel(layers::Level::Of(i), layers::kSamplesA), count_a);
      set(layers::OfLevel(layers::Level::Of(i), layers::kSamplesB),
          count_b / 2);  // the others left the scene
    }
    if (!has_list || key.tile % 2 != 0) return {std::move(unit)};
    return {std::move(unit), {}, RandomFragments(rect, count_a, count_b, &random)};
  }
  return {std::move(unit), has_list ? RandomEdges(rect, &random) : LayeredImage()};
}

}  // namespace lumifold
