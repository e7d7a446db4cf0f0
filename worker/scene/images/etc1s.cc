#include "worker/scene/images/etc1s.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "worker/scene/images/bit_reader.h"

namespace lumifold::scene {
namespace {

using Color = std::array<uint8_t, 4>;     // opaque
using Endpoint = std::array<Color, 4>;    // the four colours of a block, dark to light
using Selector = std::array<uint8_t, 4>;  // four rows of four 2-bit indices into them, left one lowest

struct Codebooks {
  std::vector<Endpoint> endpoints;
  std::vector<Selector> selectors;
};

struct SliceTables {
  HuffmanTable prediction;
  HuffmanTable endpoint_delta;
  HuffmanTable selector;
  HuffmanTable selector_run;
  uint32_t history_size = 0;
};

absl::Status Damaged(const char* part) {
  return absl::InvalidArgumentError(absl::StrCat("damaged KTX2: its ", part, " cannot be read"));
}

/// The colours of a block from its base colour of 5 bits per channel and its intensity table.
Endpoint MakeEndpoint(const std::array<uint32_t, 3>& base, uint32_t table) {
  constexpr int kSmallStep[8] = {2, 5, 9, 13, 18, 24, 33, 47};
  constexpr int kLargeStep[8] = {8, 17, 29, 42, 60, 80, 106, 183};
  const int steps[4] = {-kLargeStep[table], -kSmallStep[table], kSmallStep[table], kLargeStep[table]};
  Endpoint endpoint;
  for (int i = 0; i < 4; ++i) {
    for (int c = 0; c < 3; ++c) {
      const int value = static_cast<int>(base[c] << 3 | base[c] >> 2);
      endpoint[i][c] = static_cast<uint8_t>(std::clamp(value + steps[i], 0, 255));
    }
    endpoint[i][3] = 255;
  }
  return endpoint;
}

bool ReadEndpoints(std::string_view bytes, int count, std::vector<Endpoint>* endpoints) {
  BitReader bits(bytes);
  HuffmanTable color_delta[3];  // by the range of the previous value
  for (HuffmanTable& table : color_delta) table = HuffmanTable::Read(&bits);
  const HuffmanTable table_delta = HuffmanTable::Read(&bits);
  const int channels = bits.Read(1) != 0 ? 1 : 3;
  std::array<uint32_t, 3> base = {16, 16, 16};
  uint32_t table = 0;
  for (int i = 0; i < count && bits.ok(); ++i) {
    table = (table + table_delta.Decode(&bits)) & 7;
    for (int c = 0; c < channels; ++c) {
      const int range = base[c] < 10 ? 0 : base[c] < 22 ? 1 : 2;
      base[c] = (base[c] + color_delta[range].Decode(&bits)) & 31;
    }
    if (channels == 1) base[1] = base[2] = base[0];
    endpoints->push_back(MakeEndpoint(base, table));
  }
  return bits.ok();
}

bool ReadSelectors(std::string_view bytes, int count, std::vector<Selector>* selectors) {
  BitReader bits(bytes);
  if (bits.Read(2) != 0) return false;
  const bool is_raw = bits.Read(1) != 0;
  const HuffmanTable delta = is_raw ? HuffmanTable() : HuffmanTable::Read(&bits);
  Selector selector = {};
  for (int i = 0; i < count && bits.ok(); ++i) {
    for (uint8_t& row : selector) {
      if (is_raw || i == 0) {
        row = static_cast<uint8_t>(bits.Read(8));
      } else {
        row = static_cast<uint8_t>(row ^ delta.Decode(&bits));
      }
    }
    selectors->push_back(selector);
  }
  return bits.ok();
}

bool ReadTables(std::string_view bytes, SliceTables* tables) {
  BitReader bits(bytes);
  for (HuffmanTable* table :
       {&tables->prediction, &tables->endpoint_delta, &tables->selector, &tables->selector_run})
    *table = HuffmanTable::Read(&bits);
  tables->history_size = bits.Read(13);
  return bits.ok();
}

/// The selectors used before, those in use towards the front.
class SelectorHistory {
 public:
  explicit SelectorHistory(size_t size) : values_(size), next_(size / 2) {}

  size_t size() const { return values_.size(); }

  void Add(uint32_t value) {
    if (values_.empty()) return;
    values_[next_] = value;
    if (++next_ == values_.size()) next_ = values_.size() / 2;
  }

  uint32_t Use(size_t index) {
    const uint32_t value = values_[index];
    std::swap(values_[index], values_[index / 2]);
    return value;
  }

 private:
  std::vector<uint32_t> values_;
  size_t next_;  // the place of the next one added, in the rear half
};

/// The indices of one slice's blocks, in order. Damage makes the reader fail.
class SliceReader {
 public:
  SliceReader(std::string_view bytes, const Codebooks& codebooks, const SliceTables& tables, int columns)
      : codebooks_(codebooks),
        tables_(tables),
        bits_(bytes),
        row_predictions_((static_cast<size_t>(columns) + 1) / 2),
        row_endpoints_(columns),
        history_(tables.history_size) {}

  bool ok() const { return bits_.ok(); }

  /// To be called for each block, before NextSelector.
  const Endpoint& NextEndpoint(int x, int y);
  const Selector& NextSelector();

 private:
  static constexpr uint32_t kRepeatPrediction = 256;
  static constexpr uint32_t kLongRun = 63;
  static constexpr uint64_t kMinRun = 3;

  uint32_t ReadPredictions();

  const Codebooks& codebooks_;
  const SliceTables& tables_;
  BitReader bits_;
  uint32_t predictions_ = 0;              // of the blocks of this row and pair, two bits each
  uint32_t group_predictions_ = 0;        // of the last 2x2 blocks that have their own
  uint64_t prediction_repeats_ = 0;       // groups that follow with the same
  std::vector<uint8_t> row_predictions_;  // of the second row of a group
  std::vector<uint32_t> row_endpoints_;   // of the row above, and of this one left of the block
  uint32_t upper_left_ = 0;               // the endpoint above the block at the left
  uint32_t endpoint_ = 0;                 // of the block before
  SelectorHistory history_;
  uint64_t selector_repeats_ = 0;  // blocks that follow with the first of the history
};

/// How the four blocks of a group get their endpoints.
uint32_t SliceReader::ReadPredictions() {
  if (prediction_repeats_ > 0) {
    --prediction_repeats_;
    return group_predictions_;
  }
  const uint32_t symbol = tables_.prediction.Decode(&bits_);
  if (symbol > kRepeatPrediction) bits_.Fail();
  if (symbol == kRepeatPrediction) {
    prediction_repeats_ = bits_.ReadChunked(4) + kMinRun - 1;
  } else {
    group_predictions_ = symbol;
  }
  return group_predictions_;
}

const Endpoint& SliceReader::NextEndpoint(int x, int y) {
  if (x % 2 == 0 && y % 2 == 0) {
    predictions_ = ReadPredictions();
    row_predictions_[x / 2] = static_cast<uint8_t>(predictions_ >> 4);
  } else if (x % 2 == 0) {
    predictions_ = row_predictions_[x / 2];
  }
  enum { kLeft, kAbove, kUpperLeft, kDelta };
  const uint32_t prediction = predictions_ & 3;
  predictions_ >>= 2;
  const bool exists =
      prediction == kDelta || ((prediction == kAbove || x > 0) && (prediction == kLeft || y > 0));
  if (!exists) bits_.Fail();
  const uint32_t above = row_endpoints_[x];
  if (prediction == kAbove) {
    endpoint_ = above;
  } else if (prediction == kUpperLeft) {
    endpoint_ = upper_left_;
  } else if (prediction == kDelta) {
    endpoint_ += tables_.endpoint_delta.Decode(&bits_);
    const auto count = static_cast<uint32_t>(codebooks_.endpoints.size());
    if (endpoint_ >= count) endpoint_ -= count;
    if (endpoint_ >= count) {
      bits_.Fail();
      endpoint_ = 0;
    }
  }
  upper_left_ = above;
  row_endpoints_[x] = endpoint_;
  return codebooks_.endpoints[endpoint_];
}

const Selector& SliceReader::NextSelector() {
  const auto count = static_cast<uint32_t>(codebooks_.selectors.size());
  uint32_t symbol = count;
  if (selector_repeats_ > 0) {
    --selector_repeats_;
  } else {
    symbol = tables_.selector.Decode(&bits_);
    if (symbol == count + tables_.history_size) {
      const uint32_t run = tables_.selector_run.Decode(&bits_);
      selector_repeats_ = (run == kLongRun ? bits_.ReadChunked(7) : run) + kMinRun - 1;
      symbol = count;
    }
  }
  if (symbol < count) {
    history_.Add(symbol);
    return codebooks_.selectors[symbol];
  }
  if (symbol - count >= history_.size()) {
    bits_.Fail();
    return codebooks_.selectors[0];
  }
  return codebooks_.selectors[history_.Use(symbol - count)];
}

/// Copies the part of a block that is inside the picture: all channels, or green as alpha.
void WriteBlock(const Endpoint& endpoint, const Selector& selector, bool is_alpha, int x, int y,
                ImageData* image) {
  const int width = std::min(4, image->width - x), height = std::min(4, image->height - y);
  for (int row = 0; row < height; ++row) {
    const size_t first =
        static_cast<size_t>(y + row) * static_cast<size_t>(image->width) + static_cast<size_t>(x);
    uint8_t* pixel = image->rgba.data() + 4 * first;
    for (int column = 0; column < width; ++column, pixel += 4) {
      const Color& color = endpoint[selector[row] >> (2 * column) & 3];
      if (is_alpha) {
        pixel[3] = color[1];
      } else {
        std::memcpy(pixel, color.data(), color.size());
      }
    }
  }
}

bool DecodeSlice(std::string_view bytes, const Codebooks& codebooks, const SliceTables& tables, bool is_alpha,
                 ImageData* image) {
  SliceReader reader(bytes, codebooks, tables, (image->width + 3) / 4);
  for (int y = 0; y < image->height && reader.ok(); y += 4) {
    for (int x = 0; x < image->width; x += 4) {
      const Endpoint& endpoint = reader.NextEndpoint(x / 4, y / 4);
      WriteBlock(endpoint, reader.NextSelector(), is_alpha, x, y, image);
    }
  }
  return reader.ok();
}

}  // namespace

absl::Status DecodeEtc1s(const Etc1sPicture& picture, ImageData* image) {
  Codebooks codebooks;
  if (picture.endpoint_count == 0 ||
      !ReadEndpoints(picture.endpoints, picture.endpoint_count, &codebooks.endpoints))
    return Damaged("colours");
  if (picture.selector_count == 0 ||
      !ReadSelectors(picture.selectors, picture.selector_count, &codebooks.selectors))
    return Damaged("selectors");
  SliceTables tables;
  if (!ReadTables(picture.tables, &tables)) return Damaged("Huffman codes");
  if (!DecodeSlice(picture.color_slice, codebooks, tables, false, image)) return Damaged("pixels");
  const bool has_alpha = !picture.alpha_slice.empty();
  if (has_alpha && !DecodeSlice(picture.alpha_slice, codebooks, tables, true, image)) return Damaged("alpha");
  return absl::OkStatus();
}

}  // namespace lumifold::scene
