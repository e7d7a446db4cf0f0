#include "client/pictures/preview_file.h"

#include <filesystem>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/exit_code.h"
#include "client/pictures/output_file.h"
#include "filter/image/exr_io.h"
#include "filter/image/file_io.h"
#include "filter/image/layers.h"
#include "proto/rpc/image_codec.h"

namespace lumifold::client {
namespace {

/// After a coordinator that could not be reached, or that has nothing new yet.
constexpr absl::Duration kPause = absl::Milliseconds(200);
/// A preview has no more pixels than this on a side.
constexpr rpc::PixelLimits kLimits = {.max_width = 4096, .max_height = 4096, .max_channels = 4};

}  // namespace

PreviewFile::PreviewFile(std::unique_ptr<FarmClient> farm, PreviewFileOptions options)
    : farm_(std::move(farm)), options_(std::move(options)), thread_([this] { result_ = Run(); }) {}

absl::Status PreviewFile::Stop() {
  stop_.Notify();
  if (thread_.joinable()) thread_.join();
  return result_;
}

absl::Status PreviewFile::Run() {
  v1::GetPreviewRequest request;
  request.set_job_id(options_.job_id);
  request.set_frame(options_.frame);
  while (!stop_.HasBeenNotified()) {
    const absl::StatusOr<v1::Preview> preview = farm_->GetPreview(request);
    if (preview.ok()) {
      if (absl::Status status = Write(*preview); !status.ok()) return status;
      if (preview->finished()) return absl::OkStatus();
      request.set_newer_than_units(preview->units());
      continue;
    }
    if (absl::IsFailedPrecondition(preview.status()))
      return absl::OkStatus();  // the job has ended without the frame
    const bool may_come = absl::IsOutOfRange(preview.status()) || absl::IsUnavailable(preview.status()) ||
                          absl::IsDeadlineExceeded(preview.status()) ||
                          absl::IsResourceExhausted(preview.status());
    if (!may_come) return preview.status();
    stop_.WaitFor(kPause);
  }
  return absl::OkStatus();
}

absl::Status PreviewFile::Show(const std::string& path, const LayeredImage& picture) const {
  const ConstColorView colours = picture.GetColor(layers::kBeauty);
  if (!picture.Has(layers::kAlpha)) return pictures::WriteDisplayed(path, colours, options_.display);
  const ConstFloatView alpha = picture.Get(layers::kAlpha);
  return pictures::WriteDisplayed(path, colours, options_.display, &alpha);
}

absl::Status PreviewFile::Write(const v1::Preview& preview) const {
  const absl::StatusOr<PictureFormat> format = PictureFormatOf(options_.path);
  if (!format.ok()) return format.status();
  // Beside it, with the same ending, which says what is written.
  const std::string ending = std::filesystem::path(options_.path).extension().string();
  const std::string part = NameBeside(FileBehind(options_.path), ".part" + ending);
  const absl::StatusOr<LayeredImage> picture =
      rpc::ImageFromBytes(preview.layout(), preview.planes(), kLimits);
  if (!picture.ok()) return picture.status();
  if (!picture->HasColor(layers::kBeauty)) return absl::InternalError("the preview has no colours");
  const absl::Status written =
      *format == PictureFormat::kExr ? WriteExr(part, *picture) : Show(part, *picture);
  if (!written.ok()) return OfThisMachine(written);
  return OfThisMachine(MoveIntoPlace(part, options_.path));
}

}  // namespace lumifold::client
