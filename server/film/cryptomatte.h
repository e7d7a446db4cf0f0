#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "filter/image/edged_image.h"
#include "filter/image/layered_image.h"
#include "google/protobuf/repeated_ptr_field.h"
#include "lumifold/v1/worker.pb.h"

/// Cryptomatte 1.2: channels that tell how much of each pixel each object covers, so that a compositor makes
/// mattes of objects by their names.
/// Source: Friedman and Jones 2015, "Fully Automatic ID Mattes with Support for Motion Blur and
/// Transparency", and its specification (Psyop).
namespace lumifold::film {

/// MurmurHash3_x86_32 with seed 0 of a name.
uint32_t CryptomatteHash(std::string_view name);

/// The number that stands for a hash in a channel: its bits as float32, with one bit of the exponent flipped
/// where they are no normal number.
float CryptomatteNumber(uint32_t hash);

/// Adds the layers CryptoObject and CryptoMaterial, of 6 ranks each, and their metadata to `result`, the
/// whole or some rows of a frame with the channels A and id.Y. The covers of a pixel are those of its 16
/// sub-samples in `edges`, with coordinates relative to these rows; elsewhere one object has the pixel's
/// coverage. `objects` are those of the numbers 1, 2, ...; an empty list: nothing is added.
void AddCryptomatte(const google::protobuf::RepeatedPtrField<v1::SceneObject>& objects,
                    const LayeredImage& edges, LayeredImage* result);

}  // namespace lumifold::film
