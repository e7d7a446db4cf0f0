#include "filter/image/exr_copy.h"

#include <ImfChannelList.h>
#include <ImfCompression.h>
#include <ImfFloatAttribute.h>
#include <ImfInputPart.h>
#include <ImfMultiPartInputFile.h>
#include <ImfMultiPartOutputFile.h>
#include <ImfOutputPart.h>
#include <ImfPartType.h>
#include <ImfStringAttribute.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <filesystem>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "filter/image/exr_parts.h"
#include "filter/image/exr_stream.h"
#include "filter/image/file_io.h"

namespace lumifold {
namespace {

/// Rows that are in memory at a time.
constexpr int kRows = 64;

constexpr std::array<std::pair<std::string_view, Imf::Compression>, 5> kCompressions = {
    {{"none", Imf::NO_COMPRESSION},
     {"zips", Imf::ZIPS_COMPRESSION},
     {"zip", Imf::ZIP_COMPRESSION},
     {"piz", Imf::PIZ_COMPRESSION},
     {"dwaa", Imf::DWAA_COMPRESSION}}};

const Imf::Compression* Find(const std::string& name) {
  const auto* const found = std::find_if(kCompressions.begin(), kCompressions.end(),
                                         [&](const auto& entry) { return entry.first == name; });
  return found == kCompressions.end() ? nullptr : &found->second;
}

/// A part of the copy: channels of a part of the original, under other names.
struct PartPlan {
  Imf::Header header;
  int from = 0;
  std::vector<std::pair<std::string, std::string>> channels;  // name in the original, name in the copy
};

/// Channels of a lean copy in halves, and those that keep what halves have not enough digits for.
constexpr std::array<std::string_view, 13> kLeanHalves = {
    "R",          "G",          "B",          "A",   "albedo.R", "albedo.G", "albedo.B",
    "emission.R", "emission.G", "emission.B", "N.X", "N.Y",      "N.Z"};
constexpr std::array<std::string_view, 2> kLeanFloats = {"Z", "id.Y"};
constexpr float kLargestHalf = 65504;
constexpr std::string_view kCryptomatte = "Crypto";

bool IsLeanHalf(std::string_view name) {
  return std::find(kLeanHalves.begin(), kLeanHalves.end(), name) != kLeanHalves.end();
}

bool IsInLean(std::string_view name) {
  return IsLeanHalf(name) || name.starts_with(kCryptomatte) ||
         std::find(kLeanFloats.begin(), kLeanFloats.end(), name) != kLeanFloats.end();
}

/// The header of a lean copy's only part.
Imf::Header LeanHeader(const Imf::Header& original) {
  Imf::Header header = original;
  header.channels() = Imf::ChannelList();
  const Imf::ChannelList& channels = original.channels();
  for (auto it = channels.begin(); it != channels.end(); ++it) {
    if (!IsInLean(it.name())) continue;
    Imf::Channel channel = it.channel();
    if (IsLeanHalf(it.name())) channel.type = Imf::HALF;
    header.channels().insert(it.name(), channel);
  }
  return header;
}

bool IsColour(const PartPlan& part) {
  return std::all_of(part.channels.begin(), part.channels.end(), [](const auto& channel) {
    const std::string& name = channel.second;
    return name == "R" || name == "G" || name == "B" || name == "A" || name == "Z";
  });
}

void AddAttributes(const ExrCopyOptions& options, Imf::Header* header) {
  for (const auto& [name, text] : options.texts) header->insert(name, Imf::StringAttribute(text));
  for (const auto& [name, number] : options.numbers) header->insert(name, Imf::FloatAttribute(number));
}

/// A part without channels.
PartPlan EmptyPart(const Imf::Header& original, int from, const std::string& name) {
  PartPlan part{original, from, {}};
  part.header.channels() = Imf::ChannelList();
  part.header.setName(name);
  part.header.setType(Imf::SCANLINEIMAGE);
  return part;
}

void AddChannel(const Imf::ChannelList& channels, const std::string& original, const std::string& name,
                PartPlan* part) {
  part->header.channels().insert(name, *channels.findChannel(original));
  part->channels.emplace_back(original, name);
}

/// One part for each layer, in the order of their first channels; the picture itself comes first.
std::vector<PartPlan> PartsOfLayers(const Imf::Header& original) {
  std::vector<PartPlan> parts = {EmptyPart(original, 0, kExrPicturePart)};
  const Imf::ChannelList& channels = original.channels();
  for (auto it = channels.begin(); it != channels.end(); ++it) {
    const std::string name = it.name();
    const size_t dot = name.rfind('.');
    const std::string layer = dot == std::string::npos ? kExrPicturePart : name.substr(0, dot);
    auto part =
        std::find_if(parts.begin(), parts.end(), [&](const PartPlan& p) { return p.header.name() == layer; });
    if (part == parts.end()) part = parts.insert(parts.end(), EmptyPart(original, 0, layer));
    AddChannel(channels, name, dot == std::string::npos ? name : name.substr(dot + 1), &*part);
  }
  return parts;
}

PartPlan SamePart(const Imf::Header& original, int from) {
  PartPlan part{original, from, {}};
  for (auto it = original.channels().begin(); it != original.channels().end(); ++it)
    part.channels.emplace_back(it.name(), it.name());
  return part;
}

std::vector<PartPlan> PlanParts(const Imf::MultiPartInputFile& file, const ExrCopyOptions& options) {
  const Imf::Compression* const compression = Find(options.compression);
  const bool is_lossy = compression != nullptr && *compression == Imf::DWAA_COMPRESSION;
  const Imf::Header header = options.is_lean ? LeanHeader(file.header(0)) : file.header(0);
  std::vector<PartPlan> parts;
  if (options.layers_as_parts || is_lossy) {
    parts = PartsOfLayers(header);
  } else {
    parts = {SamePart(header, 0)};
  }
  for (int i = 1; i < file.parts() && !options.is_lean; ++i) parts.push_back(SamePart(file.header(i), i));
  for (PartPlan& part : parts) {
    if (compression == nullptr) continue;
    const bool is_cryptomatte = part.header.hasName() && part.header.name().starts_with(kCryptomatte);
    const bool may_lose = part.from == 0 && IsColour(part) && !is_cryptomatte;
    part.header.compression() = is_lossy && !may_lose ? Imf::ZIP_COMPRESSION : *compression;
  }
  AddAttributes(options, &parts.front().header);
  return parts;
}

/// Whether the parts are those of the file as they are stored.
bool IsSame(const Imf::MultiPartInputFile& file, const std::vector<PartPlan>& parts) {
  if (static_cast<int>(parts.size()) != file.parts()) return false;
  for (const PartPlan& part : parts) {
    const Imf::Header& original = file.header(part.from);
    if (part.header.compression() != original.compression() || part.header.channels() != original.channels())
      return false;
  }
  return true;
}

/// Rows of a channel as halves.
class HalfRows {
 public:
  HalfRows(ConstFloatView rows, int x0, int y0) : width_(rows.width()), x0_(x0), y0_(y0) {
    values_.reserve(static_cast<size_t>(rows.width()) * static_cast<size_t>(rows.height()));
    for (int y = 0; y < rows.height(); ++y) {
      for (const float value : std::span(rows.Row(y), static_cast<size_t>(width_)))
        values_.push_back(std::isnan(value) ? half(value)
                                            : half(std::clamp(value, -kLargestHalf, kLargestHalf)));
    }
  }
  /// Valid as long as this.
  Imf::Slice slice() {
    const Imath::Box2i window({x0_, y0_}, {x0_ + width_ - 1, y0_});
    return Imf::Slice::Make(Imf::HALF, values_.data(), window, sizeof(half),
                            sizeof(half) * static_cast<size_t>(width_));
  }

 private:
  std::vector<half> values_;
  int width_;
  int x0_;
  int y0_;
};

/// Copies the parts that are made from one part of the original, which is read once: some rows for all of
/// them, then the next ones.
void CopyRows(Imf::MultiPartInputFile& file, int from, const std::vector<PartPlan>& parts,
              std::vector<Imf::OutputPart>& outputs) {
  const Imf::Header& header = file.header(from);
  const Imath::Box2i window = header.dataWindow();
  Imf::InputPart input(file, from);
  for (int y = window.min.y; y <= window.max.y; y += kRows) {
    const int rows = std::min(kRows, window.max.y + 1 - y);
    const LayeredImage image = ExrImage(header, window.max.x - window.min.x + 1, rows);
    const Imf::FrameBuffer all = ExrFrameOf(image, window.min.x, y);
    input.setFrameBuffer(all);
    input.readPixels(y, y + rows - 1);
    for (size_t i = 0; i < parts.size(); ++i) {
      if (parts[i].from != from) continue;
      Imf::FrameBuffer some;
      std::deque<HalfRows> halves;
      for (const auto& [original, name] : parts[i].channels) {
        if (parts[i].header.channels().findChannel(name)->type == Imf::HALF) {
          halves.emplace_back(image.Get(original), window.min.x, y);
          some.insert(name, halves.back().slice());
        } else {
          some.insert(name, *all.findSlice(original));
        }
      }
      outputs[i].setFrameBuffer(some);
      outputs[i].writePixels(rows);
    }
  }
}

void WriteParts(Imf::MultiPartInputFile& file, const std::vector<PartPlan>& parts, ExrFileStream& stream) {
  std::vector<Imf::Header> headers;
  headers.reserve(parts.size());
  for (const PartPlan& part : parts) headers.push_back(part.header);
  Imf::MultiPartOutputFile output(stream, headers.data(), static_cast<int>(headers.size()),
                                  /*overrideSharedAttributes=*/true);
  std::vector<Imf::OutputPart> outputs;
  outputs.reserve(parts.size());
  for (size_t i = 0; i < parts.size(); ++i) outputs.emplace_back(output, static_cast<int>(i));
  if (!IsSame(file, parts)) {
    for (int from = 0; from < file.parts(); ++from) CopyRows(file, from, parts, outputs);
    return;
  }
  for (size_t i = 0; i < parts.size(); ++i) {
    Imf::InputPart original(file, parts[i].from);
    outputs[i].copyPixels(original);
  }
}

}  // namespace

absl::Status CopyExr(const std::string& from, const std::string& to, const ExrCopyOptions& options) {
  if (absl::Status status = CheckIsFile(from); !status.ok()) return status;
  absl::StatusOr<AtomicFile> target = AtomicFile::Create(to);
  if (!target.ok()) return target.status();
  ExrFileStream stream(to, &*target);
  const absl::Status status = CatchExr(from, [&]() -> absl::Status {
    Imf::MultiPartInputFile file(from.c_str());
    if (absl::Status read = CheckExr(from, file, std::filesystem::file_size(from)); !read.ok()) return read;
    WriteParts(file, PlanParts(file, options), stream);
    return absl::OkStatus();
  });
  if (!stream.status().ok()) return stream.status();
  return status.ok() ? target->Commit() : status;
}

}  // namespace lumifold
