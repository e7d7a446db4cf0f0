#include "filter/image/hdr_io.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "filter/image/exr_io.h"

namespace lumifold {
namespace {

constexpr absl::string_view kMagic = "#?";

using Rgbe = std::array<uint8_t, 4>;

/// Lengths of lines that may use the new run-length coding; others are flat or in the old coding.
constexpr int kShortestCodedLine = 8;
constexpr int kLongestCodedLine = 0x7fff;

/// The longest run of the new coding: seven bits are left for the count.
constexpr int kLongestRun = 127;

/// Bytes at the start of a line: one pixel, or the mark of the new coding.
constexpr int64_t kLeastLineBytes = 4;

/// A line of one colour takes 12 bytes in the old coding with runs of up to 2^16 pixels; a picture of
/// 16384x8192 pixels has 1365 pixels to a byte then. What claims more is a bomb or cut short.
constexpr int64_t kMaxPixelsPerByte = 4096;

struct Header {
  int width = 0;  // of the picture in its final orientation
  int height = 0;
  bool columns = false;  // the lines of the file are columns of the picture
  bool from_right = false;
  bool from_bottom = false;
  double exposure = 1;
  bool is_xyz = false;

  int line_pixels() const { return columns ? height : width; }
  int lines() const { return columns ? width : height; }
};

/// The bytes that are not read yet.
class Reader {
 public:
  explicit Reader(absl::string_view bytes) : rest_(bytes) {}

  size_t size() const { return rest_.size(); }
  std::optional<absl::string_view> Line() {
    const size_t end = rest_.find('\n');
    if (end == absl::string_view::npos) return std::nullopt;
    absl::string_view line = rest_.substr(0, end);
    rest_.remove_prefix(end + 1);
    absl::ConsumeSuffix(&line, "\r");  // a program of Windows has written the header as text
    return line;
  }
  /// False, and nothing consumed, if fewer are left.
  bool Take(uint8_t* target, size_t count) {
    if (count > rest_.size()) return false;
    for (size_t i = 0; i < count; ++i) target[i] = static_cast<uint8_t>(rest_[i]);
    rest_.remove_prefix(count);
    return true;
  }
  std::optional<uint8_t> Peek(size_t offset) const {
    if (offset >= rest_.size()) return std::nullopt;
    return static_cast<uint8_t>(rest_[offset]);
  }

 private:
  absl::string_view rest_;
};

/// "-Y 512 +X 1024" and the seven other orientations.
bool ParseResolution(absl::string_view line, Header* header) {
  const std::vector<absl::string_view> words = absl::StrSplit(line, ' ', absl::SkipWhitespace());
  if (words.size() != 4 || words[0].size() != 2 || words[2].size() != 2) return false;
  header->columns = words[0][1] == 'X';
  const absl::string_view y = header->columns ? words[2] : words[0];
  const absl::string_view x = header->columns ? words[0] : words[2];
  if ((y != "-Y" && y != "+Y") || (x != "-X" && x != "+X")) return false;
  header->from_bottom = y == "+Y";
  header->from_right = x == "-X";
  return absl::SimpleAtoi(words[header->columns ? 3 : 1], &header->height) &&
         absl::SimpleAtoi(words[header->columns ? 1 : 3], &header->width) && header->width > 0 &&
         header->height > 0;
}

/// Reads the text before the pixels. Result: the error, or nothing.
std::string ParseHeader(Reader& reader, Header* header) {
  std::optional<absl::string_view> line = reader.Line();
  if (!line || !absl::StartsWith(*line, kMagic)) return "not a Radiance picture";
  while ((line = reader.Line()) && !line->empty()) {
    if (absl::ConsumePrefix(&*line, "FORMAT=")) {
      header->is_xyz = *line == "32-bit_rle_xyze";
      if (!header->is_xyz && *line != "32-bit_rle_rgbe") {
        return absl::StrCat("its format ", absl::CHexEscape(line->substr(0, 64)),
                            " is not read; 32-bit_rle_rgbe and 32-bit_rle_xyze are");
      }
    }
    double factor = 1;
    if (absl::ConsumePrefix(&*line, "EXPOSURE=")) {
      if (!absl::SimpleAtod(*line, &factor) || !(factor > 0) || !std::isfinite(factor)) {
        return "its EXPOSURE is no positive number";
      }
      header->exposure *= factor;  // each program that changed the picture may have added one
    }
  }
  if (!line) return "cut short within its header";
  if (!(header->exposure > 1e-30 && header->exposure < 1e30)) return "its EXPOSURE is out of range";
  line = reader.Line();
  if (!line || !ParseResolution(*line, header)) return "its resolution line is not understood";
  return "";
}

/// New coding: the four components of a line one after the other.
bool ReadCodedLine(Reader& reader, std::vector<Rgbe>* line) {
  for (int component = 0; component < 4; ++component) {
    for (size_t x = 0; x < line->size();) {
      uint8_t count = 0;
      if (!reader.Take(&count, 1) || count == 0) return false;
      const bool run = count > kLongestRun + 1;
      const size_t length = run ? count - (kLongestRun + 1) : count;
      if (length > line->size() - x) return false;
      uint8_t value = 0;
      if (run && !reader.Take(&value, 1)) return false;
      for (size_t i = 0; i < length; ++i) {
        if (!run && !reader.Take(&value, 1)) return false;
        (*line)[x++][component] = value;
      }
    }
  }
  return true;
}

/// Flat pixels, and the old coding: (1, 1, 1, n) repeats the pixel before; in a sequence of these, n are the
/// digits of one count in base 256.
bool ReadFlatLine(Reader& reader, std::vector<Rgbe>* line) {
  int shift = 0;
  for (size_t x = 0; x < line->size();) {
    Rgbe pixel;
    if (!reader.Take(pixel.data(), 4)) return false;
    if (pixel[0] != 1 || pixel[1] != 1 || pixel[2] != 1) {
      (*line)[x++] = pixel;
      shift = 0;
      continue;
    }
    if (x == 0 || shift > 16) return false;
    const size_t length = static_cast<size_t>(pixel[3]) << shift;
    if (length > line->size() - x) return false;
    for (size_t i = 0; i < length; ++i, ++x) (*line)[x] = (*line)[x - 1];
    shift += 8;
  }
  return true;
}

bool ReadLine(Reader& reader, std::vector<Rgbe>* line) {
  const int length = static_cast<int>(line->size());
  const bool coded = length >= kShortestCodedLine && length <= kLongestCodedLine && reader.Peek(0) == 2 &&
                     reader.Peek(1) == 2 && reader.Peek(2).value_or(0x80) < 0x80;
  if (!coded) return ReadFlatLine(reader, line);
  Rgbe start;
  return reader.Take(start.data(), 4) && ((start[2] << 8) | start[3]) == length &&
         ReadCodedLine(reader, line);
}

/// Component `c` of the colour in the primaries that Radiance means by RGBE, whose white is that of equal
/// energy: so both formats of one picture give the same. Colours outside of them are cut off at 0.
double FromXyz(int c, const double xyz[3]) {
  constexpr double kRgbFromXyz[3][3] = {{2.565312843, -1.166849616, -0.398463227},
                                        {-1.022108172, 1.978286617, 0.043821555},
                                        {0.074724377, -0.251939567, 1.177215190}};
  const double* row = kRgbFromXyz[c];
  return std::max(row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2], 0.0);
}

void StoreLine(const std::vector<Rgbe>& line, int index, const Header& header, const ColorView& picture) {
  for (int i = 0; i < static_cast<int>(line.size()); ++i) {
    int x = header.columns ? index : i;
    int y = header.columns ? i : index;
    if (header.from_right) x = header.width - 1 - x;
    if (header.from_bottom) y = header.height - 1 - y;
    const Rgbe& pixel = line[i];
    const double unit = pixel[3] == 0 ? 0.0 : std::ldexp(1.0, pixel[3] - (128 + 8)) / header.exposure;
    const double stored[3] = {pixel[0] * unit, pixel[1] * unit, pixel[2] * unit};
    for (int c = 0; c < 3; ++c)
      picture[c].At(x, y) = static_cast<float>(header.is_xyz ? FromXyz(c, stored) : stored[c]);
  }
}

}  // namespace

bool LooksLikeHdr(std::string_view bytes) { return absl::StartsWith({bytes.data(), bytes.size()}, kMagic); }

absl::StatusOr<LayeredImage> DecodeHdr(const std::string& name, std::string_view bytes) {
  const auto invalid = [&name](const std::string& why) {
    return absl::InvalidArgumentError(absl::StrCat(name, ": ", why));
  };
  Reader reader({bytes.data(), bytes.size()});
  Header header;
  if (const std::string problem = ParseHeader(reader, &header); !problem.empty()) return invalid(problem);
  if (int64_t{header.width} * header.height > kMaxPixels) {
    return invalid(
        absl::StrCat(header.width, "x", header.height, " pixels is more than is read: ", kMaxPixels));
  }
  if (int64_t{header.width} * header.height / kMaxPixelsPerByte > static_cast<int64_t>(reader.size())) {
    return invalid(absl::StrCat("claims ", header.width, "x", header.height, " pixels, but has only ",
                                bytes.size(), " bytes"));
  }
  // Checked before memory is allocated for a size that only the header claims.
  if (header.lines() * kLeastLineBytes > static_cast<int64_t>(reader.size())) return invalid("cut short");
  LayeredImage image(header.width, header.height);
  const ColorView picture = image.AddColor("");
  std::vector<Rgbe> line(static_cast<size_t>(header.line_pixels()));
  for (int i = 0; i < header.lines(); ++i) {
    if (!ReadLine(reader, &line)) {
      return invalid(absl::StrCat("line ", i, " of ", header.lines(), " is cut short or damaged"));
    }
    StoreLine(line, i, header, picture);
  }
  return image;
}

}  // namespace lumifold
