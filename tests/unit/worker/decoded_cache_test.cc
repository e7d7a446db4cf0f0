#include "worker/units/decoded_cache.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/support/gltf_fixture.h"

namespace lumifold::worker {
namespace {

constexpr int64_t kPlenty = 1 << 20;

/// A grey picture of 4x2 pixels.
std::string Png(uint8_t grey) { return scene::EncodePng(4, 2, 1, 8, false, std::vector<uint8_t>(8, grey)); }

TEST(DecodedCache, ScenesShareATextureWithTheSameFile) {
  DecodedCache cache;
  const auto first = cache.Texture(Png(7), kPlenty);
  const auto again = cache.Texture(Png(7), kPlenty);
  const auto other = cache.Texture(Png(8), kPlenty);
  ASSERT_TRUE(first.ok() && again.ok() && other.ok());
  EXPECT_EQ(*first, *again);
  EXPECT_NE(*first, *other);
  EXPECT_EQ((*other)->rgba[0], 8);
}

TEST(DecodedCache, ATextureThatIsKeptStillMeetsTheLimitOfItsScene) {
  DecodedCache cache;
  ASSERT_TRUE(cache.Texture(Png(7), kPlenty).ok());
  EXPECT_EQ(cache.Texture(Png(7), 7).status().message(), "4x2 pixels are over the limit of 7");
  EXPECT_TRUE(cache.Texture(Png(7), 8).ok());
}

TEST(DecodedCache, MipLevelsAreSharedByPictureAndTransferFunction) {
  DecodedCache cache;
  const scene::SharedImage image = *cache.Texture(Png(7), kPlenty);
  const render::SharedMips linear = cache.Mips(image, /*srgb=*/false);
  ASSERT_EQ(linear->size(), 2u);  // 2x1, 1x1
  EXPECT_EQ(cache.Mips(image, /*srgb=*/false), linear);
  EXPECT_NE(cache.Mips(image, /*srgb=*/true), linear);
}

TEST(DecodedCache, MipLevelsInUseKeepTheirPictureSoThatItsAddressIsItsOwn) {
  DecodedCache cache(/*max_bytes=*/0);
  scene::SharedImage image = *cache.Texture(Png(7), kPlenty);
  const std::weak_ptr<const scene::ImageData> watched = image;
  render::SharedMips mips = cache.Mips(image, false);
  image.reset();
  EXPECT_FALSE(watched.expired());
  mips.reset();
  EXPECT_TRUE(watched.expired());
}

}  // namespace
}  // namespace lumifold::worker
