#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "lumifold/v1/job.pb.h"
#include "worker/cache/content_cache.h"
#include "worker/render/environment.h"
#include "worker/render/mip_chain.h"
#include "worker/scene/scene.h"

namespace lumifold::worker {

/// Bytes of textures, of their mip levels and of environments that a worker keeps after the last scene that
/// used them, each. Those of the scenes in use are shared whatever their size.
inline constexpr uint64_t kDecodedCacheBytes = uint64_t{256} << 20;

/// What is decoded from the files of a scene and does not change from frame to frame, by the content of the
/// files: an animation loads its scene for each frame, but decodes each picture once.
/// Threads: safe concurrently.
class DecodedCache {
 public:
  explicit DecodedCache(uint64_t max_bytes = kDecodedCacheBytes)
      : textures_(max_bytes), mips_(max_bytes), environments_(max_bytes) {}

  /// Errors: those of scene::DecodeImage.
  absl::StatusOr<scene::SharedImage> Texture(std::string_view file, int64_t max_pixels);
  render::SharedMips Mips(const scene::SharedImage& image, bool srgb);
  /// `read` returns the picture's file.
  /// Errors: those of `read`, DecodeLinearPicture and render::Environment::Create.
  absl::StatusOr<std::shared_ptr<const render::Environment>> Environment(
      const v1::EnvironmentMap& environment, const std::string& sha256,
      const std::function<absl::StatusOr<std::string>(const std::string& uri)>& read);
  /// Forgets what only this cache keeps.
  void Drop();

 private:
  /// Mip levels, and the picture they are of: while it is kept its address names no other one.
  struct MipsOf {
    scene::SharedImage image;
    render::MipLevels levels;
  };

  ContentCache<scene::ImageData> textures_;
  ContentCache<MipsOf> mips_;
  ContentCache<render::Environment> environments_;
};

}  // namespace lumifold::worker
