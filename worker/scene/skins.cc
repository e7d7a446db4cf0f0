#include "worker/scene/skins.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/scene/accessors.h"

namespace lumifold::scene {

absl::StatusOr<std::span<const Affine>> SkinTable::WorldFromBind(int skin) {
  std::vector<Affine>& maps = skins_[skin];
  if (maps.empty()) {
    auto computed = Compute(document_.skins[skin]);
    if (!computed.ok())
      return WithContext(computed.status(), Place("skin", skin, document_.skins[skin].name));
    maps = *std::move(computed);
  }
  return std::span<const Affine>(maps);
}

absl::StatusOr<std::vector<Affine>> SkinTable::Compute(const Skin& skin) const {
  std::vector<Affine> maps;
  maps.reserve(skin.joints.size());
  for (const int joint : skin.joints) {
    if (joint < 0 || static_cast<size_t>(joint) >= world_from_node_.size()) {
      return absl::InvalidArgumentError(
          absl::StrCat("joint node ", joint, " does not exist (there are ", world_from_node_.size(), ")"));
    }
    if (!world_from_node_[joint].has_value()) {
      return absl::InvalidArgumentError(absl::StrCat("joint node ", joint, " is not part of the scene"));
    }
    maps.push_back(*world_from_node_[joint]);
  }
  if (skin.inverse_bind_matrices == kNone) return maps;
  const auto joint_from_bind = ReadMatrices(document_, skin.inverse_bind_matrices);
  if (!joint_from_bind.ok()) return WithContext(joint_from_bind.status(), "inverseBindMatrices");
  if (joint_from_bind->size() < maps.size()) {
    return absl::InvalidArgumentError(absl::StrCat("inverseBindMatrices: ", joint_from_bind->size(),
                                                   " matrices for ", maps.size(), " joints"));
  }
  for (size_t i = 0; i < maps.size(); ++i) maps[i] = maps[i] * (*joint_from_bind)[i];
  return maps;
}

}  // namespace lumifold::scene
