#include "server/film/cryptomatte.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "filter/image/layers.h"

namespace lumifold::film {
namespace {

using ::testing::HasSubstr;

float NumberOf(const char* name) { return CryptomatteNumber(CryptomatteHash(name)); }

// The examples of the specification, section "Hash function".
TEST(Cryptomatte, NumbersAreThoseOfTheSpecification) {
  EXPECT_FLOAT_EQ(NumberOf("hello"), 6.0705627102400005616e-17f);
  EXPECT_FLOAT_EQ(NumberOf("cube"), -4.08461912519e+15f);
  EXPECT_FLOAT_EQ(NumberOf("sphere"), 2.79018604383e+15f);
  EXPECT_FLOAT_EQ(NumberOf("plane"), 3.66557617593e-11f);
}

TEST(Cryptomatte, NumbersAreNormal) {
  for (const uint32_t hash : {0u, 1u, 0x80000000u, 0x7f800000u, 0xffffffffu, 0x007fffffu, 0x7fc00000u})
    EXPECT_TRUE(std::isnormal(CryptomatteNumber(hash))) << hash;
  EXPECT_EQ(CryptomatteNumber(0x3f800000), 1);
}

google::protobuf::RepeatedPtrField<v1::SceneObject> Objects() {
  google::protobuf::RepeatedPtrField<v1::SceneObject> objects;
  for (const auto& [name, material] :
       {std::pair("cube", "wood"), std::pair("sphere", "wood"), std::pair("cube", "tin")}) {
    v1::SceneObject* const object = objects.Add();
    object->set_name(name);
    object->set_material(material);
  }
  return objects;
}

/// Three pixels: objects 1 and 2, and nothing; the middle one's coverage is `coverage`.
LayeredImage Film(float coverage) {
  LayeredImage film(3, 1);
  const FloatView id = film.Add(layers::kObjectId);
  const FloatView alpha = film.Add(layers::kAlpha);
  id.At(0, 0) = 1;
  id.At(1, 0) = 2;
  alpha.At(0, 0) = 1;
  alpha.At(1, 0) = coverage;
  return film;
}

TEST(Cryptomatte, AnObjectHasThePixelsCoverage) {
  LayeredImage film = Film(0.75f);
  AddCryptomatte(Objects(), {}, &film);
  EXPECT_EQ(film.Get("CryptoObject00.R").At(0, 0), NumberOf("cube"));
  EXPECT_EQ(film.Get("CryptoObject00.G").At(0, 0), 1);
  EXPECT_EQ(film.Get("CryptoObject00.R").At(1, 0), NumberOf("sphere"));
  EXPECT_EQ(film.Get("CryptoObject00.G").At(1, 0), 0.75f);
  EXPECT_EQ(film.Get("CryptoMaterial00.R").At(1, 0), NumberOf("wood"));
  EXPECT_EQ(film.Get("CryptoObject00.G").At(2, 0), 0);
  EXPECT_EQ(film.Get("CryptoObject02.A").At(0, 0), 0);
}

TEST(Cryptomatte, AnEdgePixelHasTheSharesOfItsSubSamples) {
  LayeredImage film = Film(1);
  LayeredImage edges(kSubSamples, 1);
  edges.Add(layers::kPixelX);
  edges.Add(layers::kPixelY);
  const FloatView id = edges.Add(layers::kObjectId);
  for (int i = 0; i < kSubSamples; ++i) {
    edges.Get(layers::kPixelX).At(i, 0) = 2;
    id.At(i, 0) = i < 4 ? 1.0f : i < 10 ? 2.0f : i < 13 ? 3.0f : 0.0f;
  }
  AddCryptomatte(Objects(), edges, &film);
  // Objects 1 and 3 have the same name.
  EXPECT_EQ(film.Get("CryptoObject00.R").At(2, 0), NumberOf("cube"));
  EXPECT_EQ(film.Get("CryptoObject00.G").At(2, 0), 7 / 16.0f);
  EXPECT_EQ(film.Get("CryptoObject00.B").At(2, 0), NumberOf("sphere"));
  EXPECT_EQ(film.Get("CryptoObject00.A").At(2, 0), 6 / 16.0f);
  EXPECT_EQ(film.Get("CryptoMaterial00.G").At(2, 0), 10 / 16.0f);
  EXPECT_EQ(film.Get("CryptoMaterial00.A").At(2, 0), 3 / 16.0f);
}

TEST(Cryptomatte, TheManifestNamesTheHashes) {
  LayeredImage film = Film(1);
  AddCryptomatte(Objects(), {}, &film);
  EXPECT_EQ(film.metadata().at("cryptomatte/3ae39a5/name"), "CryptoObject");
  EXPECT_EQ(film.metadata().at("cryptomatte/3ae39a5/hash"), "MurmurHash3_32");
  EXPECT_EQ(film.metadata().at("cryptomatte/3ae39a5/conversion"), "uint32_to_float32");
  EXPECT_THAT(film.metadata().at("cryptomatte/3ae39a5/manifest"), HasSubstr(R"("cube":")"));
}

TEST(Cryptomatte, AnUnknownObjectIsNone) {
  LayeredImage film = Film(1);
  film.Get(layers::kObjectId).At(0, 0) = 9;
  film.Get(layers::kObjectId).At(1, 0) = -1;
  AddCryptomatte(Objects(), {}, &film);
  EXPECT_EQ(film.Get("CryptoObject00.G").At(0, 0), 0);
  EXPECT_EQ(film.Get("CryptoObject00.G").At(1, 0), 0);
}

}  // namespace
}  // namespace lumifold::film
