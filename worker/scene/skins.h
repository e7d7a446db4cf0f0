#pragma once

#include <optional>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/scene/document.h"

namespace lumifold::scene {

/// The maps of skins' joints, each skin worked out once.
class SkinTable {
 public:
  /// `world_from_node` is as in NodeContents; both arguments must outlive the table.
  SkinTable(const Document& document, const std::vector<std::optional<Affine>>& world_from_node)
      : document_(document), world_from_node_(world_from_node), skins_(document.skins.size()) {}

  /// One map a joint, from the pose the mesh was bound in to world space. The span lives as long as the
  /// table. Errors: kInvalidArgument naming the skin, for joints that do not exist or stand outside the
  /// scene, and for too few inverse bind matrices.
  absl::StatusOr<std::span<const Affine>> WorldFromBind(int skin);

 private:
  absl::StatusOr<std::vector<Affine>> Compute(const Skin& skin) const;

  const Document& document_;
  const std::vector<std::optional<Affine>>& world_from_node_;
  std::vector<std::vector<Affine>> skins_;  // empty: not yet computed
};

}  // namespace lumifold::scene
