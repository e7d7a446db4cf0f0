#pragma once

#include <optional>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/scene/document.h"

namespace lumifold::scene {

/// The joint transforms of skins; each skin is computed once.
class SkinTable {
 public:
  /// `world_from_node` is as in NodeContents; both arguments must outlive the table.
  SkinTable(const Document& document, const std::vector<std::optional<Affine>>& world_from_node)
      : document_(document), world_from_node_(world_from_node), skins_(document.skins.size()) {}

  /// The transform from the bind pose to world space for each joint. The span is valid as long as the table.
  /// Errors: kInvalidArgument naming the skin, for joints that do not exist or are not part of the scene, and
  /// for too few inverse bind matrices.
  absl::StatusOr<std::span<const Affine>> WorldFromBind(int skin);

 private:
  absl::StatusOr<std::vector<Affine>> Compute(const Skin& skin) const;

  const Document& document_;
  const std::vector<std::optional<Affine>>& world_from_node_;
  std::vector<std::vector<Affine>> skins_;  // empty: not yet computed
};

}  // namespace lumifold::scene
