#include "worker/scene/images/ktx2.h"

#include <zstd.h>

#include <algorithm>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/scene/images/etc1s.h"
#include "worker/scene/images/image_size.h"
#include "worker/scene/images/uastc.h"

namespace lumifold::scene {
namespace {

constexpr std::string_view kMagic("\xabKTX 20\xbb\r\n\x1a\n", 12);
constexpr size_t kHeaderBytes = 80;

enum Supercompression : uint32_t { kStored, kBasisLz, kZstandard };
enum ColorModel : uint32_t { kEtc1sModel = 163, kUastcModel = 166 };

// Channels of a sample of the data format descriptor.
enum Etc1sChannel : uint32_t { kEtc1sRrr = 3, kEtc1sGgg = 4 };
enum UastcChannel : uint32_t { kUastcRrr = 4, kUastcRrrg = 5 };

absl::Status Refused(const std::string& what) {
  return absl::InvalidArgumentError(absl::StrCat("a KTX2 picture ", what));
}

absl::Status Damaged(const std::string& what) {
  return absl::InvalidArgumentError(absl::StrCat("damaged KTX2: ", what));
}

/// Reads a little-endian number of N bytes that are there.
template <size_t N>
uint64_t Number(std::string_view bytes, size_t offset) {
  uint64_t value = 0;
  for (size_t i = N; i-- > 0;) value = value << 8 | static_cast<uint8_t>(bytes[offset + i]);
  return value;
}

uint32_t U32(std::string_view bytes, size_t offset) {
  return static_cast<uint32_t>(Number<4>(bytes, offset));
}

std::optional<std::string_view> Part(std::string_view bytes, uint64_t offset, uint64_t length) {
  if (offset > bytes.size() || length > bytes.size() - offset) return std::nullopt;
  return bytes.substr(static_cast<size_t>(offset), static_cast<size_t>(length));
}

/// What the header and the data format descriptor say.
struct Container {
  uint64_t width = 0, height = 0;
  uint32_t supercompression = kStored;
  uint32_t levels = 1;
  uint32_t color_model = 0;
  std::string channels = "rgba";  // where each channel of the picture comes from; also 0 and 1
  bool has_two_slices = false;    // ETC1S
  std::string_view global;        // BasisLZ
  std::string_view level;         // the largest
  uint64_t level_bytes = 0;       // of it, uncompressed
};

absl::Status ReadShape(std::string_view bytes, Container* container) {
  const uint32_t format = U32(bytes, 12), depth = U32(bytes, 28), layers = U32(bytes, 32),
                 faces = U32(bytes, 36);
  container->width = U32(bytes, 20);
  container->height = U32(bytes, 24);
  container->levels = std::max(U32(bytes, 40), 1u);
  container->supercompression = U32(bytes, 44);
  if (format != 0)
    return Refused(absl::StrCat("of Vulkan format ", format, " (glTF has only ETC1S and UASTC)"));
  if (depth != 0 || layers > 1 || faces != 1) return Refused("that is not a single 2D picture is no texture");
  // A picture of 2^31 pixels along a side has as many levels; each has an entry of 24 bytes.
  if (container->levels > 32) return Damaged(absl::StrCat("it has ", container->levels, " levels"));
  return absl::OkStatus();
}

/// Reads the basic block, the first one, of the data format descriptor.
absl::Status ReadDescriptor(std::string_view descriptor, Container* container) {
  constexpr size_t kBlockStart = 4, kBlockHeader = 24, kSample = 16;
  if (descriptor.size() < kBlockStart + kBlockHeader + kSample) return Damaged("no data format descriptor");
  const std::string_view block = descriptor.substr(kBlockStart);
  const uint64_t block_bytes = Number<2>(block, 6);
  if (U32(block, 0) != 0 || block_bytes > block.size() || block_bytes < kBlockHeader + kSample)
    return Damaged("no data format descriptor");
  container->color_model = static_cast<uint32_t>(Number<1>(block, 8));
  if ((Number<1>(block, 11) & 1) != 0) return Refused("whose alpha is premultiplied is no texture");
  const auto channel = [&](size_t sample) {
    return Number<1>(block, kBlockHeader + sample * kSample + 3) & 15;
  };
  const uint64_t samples = (block_bytes - kBlockHeader) / kSample;
  switch (container->color_model) {
    case kEtc1sModel:
      if (samples > 2) return Damaged(absl::StrCat("ETC1S of ", samples, " channels"));
      container->has_two_slices = samples == 2;
      if (channel(0) == kEtc1sRrr) container->channels = samples == 2 ? "ra01" : "r001";
      if (samples == 2 && (channel(1) == kEtc1sGgg) != (channel(0) == kEtc1sRrr))
        return Damaged("ETC1S of unknown channels");
      return absl::OkStatus();
    case kUastcModel:
      if (channel(0) == kUastcRrr) container->channels = "r001";
      if (channel(0) == kUastcRrrg) container->channels = "ra01";
      return absl::OkStatus();
    default:
      return Refused(
          absl::StrCat("of color model ", container->color_model, " (glTF has only ETC1S and UASTC)"));
  }
}

/// Reads the entries that change what the pixels mean.
absl::Status ReadMetadata(std::string_view data, Container* container) {
  while (data.size() >= 4) {
    const auto entry = Part(data, 4, U32(data, 0));
    if (!entry) return Damaged("its metadata are cut short");
    const std::string_view key = entry->substr(0, entry->find('\0'));
    std::string_view value = entry->substr(std::min(key.size() + 1, entry->size()));
    value = value.substr(0, value.find('\0'));
    if (key == "KTXorientation" && value.substr(0, 2) != "rd")
      return Refused("that is not stored from the top left is no texture");
    if (key == "KTXswizzle") {
      if (value.size() != 4 || value.find_first_not_of("rgba01") != std::string_view::npos)
        return Damaged("its KTXswizzle is none");
      std::string swizzled(value);
      for (char& source : swizzled) {
        const size_t c = std::string_view("rgba").find(source);
        if (c != std::string_view::npos) source = container->channels[c];
      }
      container->channels = swizzled;
    }
    data.remove_prefix(std::min(data.size(), 4 + (entry->size() + 3) / 4 * 4));
  }
  return absl::OkStatus();
}

absl::StatusOr<Container> ReadContainer(std::string_view bytes) {
  if (bytes.size() < kHeaderBytes) return Damaged("cut short");
  Container container;
  if (auto s = ReadShape(bytes, &container); !s.ok()) return s;
  const auto levels = Part(bytes, kHeaderBytes, uint64_t{24} * container.levels);
  const auto descriptor = Part(bytes, U32(bytes, 48), U32(bytes, 52));
  const auto metadata = Part(bytes, U32(bytes, 56), U32(bytes, 60));
  const auto global = Part(bytes, Number<8>(bytes, 64), Number<8>(bytes, 72));
  if (!levels || !descriptor || !metadata || !global) return Damaged("cut short");
  const auto level = Part(bytes, Number<8>(*levels, 0), Number<8>(*levels, 8));
  if (!level) return Damaged("cut short");
  container.level = *level;
  container.level_bytes = Number<8>(*levels, 16);
  container.global = *global;
  if (auto s = ReadDescriptor(*descriptor, &container); !s.ok()) return s;
  if (auto s = ReadMetadata(*metadata, &container); !s.ok()) return s;
  return container;
}

absl::Status DecodeBasisLz(const Container& container, ImageData* image) {
  constexpr size_t kCounts = 20, kImage = 20;
  const std::string_view global = container.global;
  // The first image is that of the largest level; the codebooks follow those of all levels.
  const size_t images = kImage * container.levels;
  if (global.size() < kCounts + images) return Damaged("no codebooks");
  Etc1sPicture picture;
  picture.endpoint_count = static_cast<int>(Number<2>(global, 0));
  picture.selector_count = static_cast<int>(Number<2>(global, 2));
  uint64_t offset = kCounts + images;
  size_t length_at = 4;
  for (std::string_view* part : {&picture.endpoints, &picture.selectors, &picture.tables}) {
    const uint64_t length = U32(global, length_at);
    const auto found = Part(global, offset, length);
    if (!found) return Damaged("its codebooks are cut short");
    *part = *found;
    offset += length;
    length_at += 4;
  }
  constexpr uint32_t kDependsOnFrameBefore = 2;
  if ((U32(global, kCounts) & kDependsOnFrameBefore) != 0)
    return Refused("that depends on another frame is no texture");
  const auto color = Part(container.level, U32(global, kCounts + 4), U32(global, kCounts + 8));
  const auto alpha = Part(container.level, U32(global, kCounts + 12), U32(global, kCounts + 16));
  if (!color || !alpha || alpha->empty() == container.has_two_slices)
    return Damaged("its pixels are cut short");
  picture.color_slice = *color;
  picture.alpha_slice = *alpha;
  return DecodeEtc1s(picture, image);
}

/// Checks the bytes of a UASTC picture, before memory is allocated.
absl::Status CheckUastcBytes(const Container& container) {
  const uint64_t blocks = (container.width + 3) / 4 * ((container.height + 3) / 4);
  if (container.level_bytes != blocks * kUastcBlockBytes)
    return Damaged("its level has not the bytes of its pixels");
  // Zstandard makes at most 2^17 bytes, as many as pixels, of 4.
  constexpr int64_t kMaxPixelsPerByte = 1 << 15;
  return CheckImageBytes(container.width, container.height, kMaxPixelsPerByte,
                         static_cast<int64_t>(container.level.size()));
}

absl::Status DecodeUastcLevel(const Container& container, ImageData* image) {
  if (container.supercompression == kStored) return DecodeUastc(container.level, image);
  std::string level(static_cast<size_t>(container.level_bytes), '\0');
  const size_t size =
      ZSTD_decompress(level.data(), level.size(), container.level.data(), container.level.size());
  if (ZSTD_isError(size) != 0) return Damaged(ZSTD_getErrorName(size));
  return DecodeUastc(std::string_view(level).substr(0, size), image);
}

void Rearrange(std::string_view channels, ImageData* image) {
  if (channels == "rgba") return;
  for (size_t i = 0; i < image->rgba.size(); i += 4) {
    uint8_t values[6] = {0, 0, 0, 0, 0, 255};
    std::copy_n(&image->rgba[i], 4, values);
    for (size_t c = 0; c < 4; ++c) image->rgba[i + c] = values[std::string_view("rgba01").find(channels[c])];
  }
}

}  // namespace

bool IsKtx2(std::string_view bytes) { return bytes.substr(0, kMagic.size()) == kMagic; }

absl::StatusOr<ImageData> DecodeKtx2(std::string_view bytes, int64_t max_pixels) {
  const absl::StatusOr<Container> container = ReadContainer(bytes);
  if (!container.ok()) return container.status();
  const uint32_t scheme = container->supercompression;
  const bool is_etc1s = container->color_model == kEtc1sModel;
  if (is_etc1s ? scheme != kBasisLz : scheme != kStored && scheme != kZstandard)
    return Refused(absl::StrCat(is_etc1s ? "of ETC1S" : "of UASTC", " with supercompression ", scheme));
  if (auto s = CheckImageSize(container->width, container->height, max_pixels); !s.ok()) return s;
  if (auto s = is_etc1s ? absl::OkStatus() : CheckUastcBytes(*container); !s.ok()) return s;
  ImageData image = EmptyImage(container->width, container->height);
  if (auto s = is_etc1s ? DecodeBasisLz(*container, &image) : DecodeUastcLevel(*container, &image); !s.ok())
    return s;
  Rearrange(container->channels, &image);
  return image;
}

}  // namespace lumifold::scene
