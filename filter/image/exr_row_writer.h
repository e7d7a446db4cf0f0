#pragma once

#include <array>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/image/file_system.h"
#include "filter/image/layered_image.h"

namespace lumifold {

struct ExrOrigin;

/// Place of a picture in a larger frame: the file's display window is the frame, its data window the picture.
struct ExrFrame {
  int width = 0;  // 0: the frame is the picture
  int height = 0;
  int x = 0;  // pixel of the frame at the picture's top left corner
  int y = 0;
};

/// Standard attributes of OpenEXR. Those without a value are not written.
struct ExrStandard {
  /// Row vectors times matrices of 4x4 numbers, row by row.
  std::optional<std::array<float, 16>> world_to_camera = {};
  std::optional<std::array<float, 16>> world_to_ndc = {};
  /// The colours are linear with the primaries and white of Rec. 709.
  bool is_rec709 = false;
  std::optional<float> exposure_seconds = {};
  /// 0: not known.
  double frames_per_second = 0;
};

/// The size, channels and metadata of a picture in an OpenEXR file.
struct ExrLayout {
  int width = 0;
  int height = 0;
  std::vector<std::string> channels;
  std::map<std::string, std::string> metadata;
  ExrFrame frame = {};
  ExrStandard standard = {};
  /// The file that the picture was made of, whose windows and attributes it keeps; null: none. `frame` is not
  /// looked at then.
  std::shared_ptr<const ExrOrigin> origin = {};
};

/// The layouts of a picture's lists, see EdgedImage. The file has a part for each that is not empty.
struct ExrLists {
  ExrLayout edges = {};
  ExrLayout fragments = {};
};

/// The layout of a picture in memory.
ExrLayout ExrLayoutOf(const LayeredImage& image);

/// Writes an OpenEXR file some rows at a time, from the top down, so that the picture need not be in memory.
/// Every channel is 32-bit float, in ZIP-compressed scan lines. The same rows give the same bytes, however
/// they are divided among calls. The file is written atomically.
/// Errors:  kInvalidArgument for a picture without channels or pixels, or for rows whose size or channels
///          differ from the layout; kUnavailable with the system's message if the file cannot be written.
/// Threads: one at a time.
class ExrRowWriter {
 public:
  /// `files` must outlive the writer.
  static absl::StatusOr<ExrRowWriter> Create(const std::string& path, const ExrLayout& picture,
                                             const ExrLists& lists = {},
                                             FileSystem* files = RealFileSystem());
  ExrRowWriter(ExrRowWriter&&) noexcept;
  ~ExrRowWriter();

  /// The next rows of the picture.
  absl::Status Append(const LayeredImage& rows);
  /// The next rows of the edge set and of the fragments; a list without channels has none.
  absl::Status AppendEdges(const LayeredImage& rows);
  absl::Status AppendFragments(const LayeredImage& rows);
  /// Completes the file and renames it to its path. All rows must have been appended. Call once.
  absl::Status Finish();

 private:
  struct File;
  explicit ExrRowWriter(std::unique_ptr<File> file);
  absl::Status AppendTo(std::string_view name, const LayeredImage& rows);

  std::unique_ptr<File> file_;
};

}  // namespace lumifold
