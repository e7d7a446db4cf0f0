#include "server/page/downloads.h"

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "server/page/farm_calls.h"
#include "server/page/result_stream.h"
#include "server/page/zip_writer.h"

namespace lumifold::page {
namespace {

using http::Request;
using http::Response;

constexpr size_t kMaxNameBytes = 80;

absl::StatusOr<v1::JobStatus> JobOf(const FarmCalls& calls, const v1::PageSession& session,
                                    const Request& request) {
  v1::GetJobRequest wanted;
  wanted.set_job_id(request.Parameter("job").value_or(""));
  if (!session.job_id().empty() && session.job_id() != wanted.job_id())
    return absl::PermissionDeniedError("this link shows another job");
  v1::JobStatus job;
  if (absl::Status status = calls.Call(session, "GetJob", wanted, &job); !status.ok()) return status;
  return job;
}

std::vector<int32_t> FramesOf(const v1::JobStatus& job) {
  std::vector<int32_t> frames;
  const auto add = [&frames](int32_t first, int32_t count) {
    for (int32_t i = 0; i < count; ++i) frames.push_back(first + i);
  };
  add(job.first_frame(), job.frame_count());
  for (const v1::FrameRange& range : job.more_frames()) add(range.first(), range.count());
  return frames;
}

std::string ResultName(const v1::JobStatus& job, int32_t frame) {
  return FileNameOf(job.display_name(),
                    job.frames_total() > 1 ? absl::StrFormat(".%04d.exr", frame) : ".exr");
}

std::pair<std::string, std::string> Attachment(const std::string& name) {
  return {"Content-Disposition", absl::StrCat("attachment; filename=\"", name, "\"")};
}

/// The first byte that is wanted, of a header "bytes=FIRST-"; all others mean the whole file, as HTTP allows.
uint64_t FirstByteOf(absl::string_view range) {
  uint64_t first = 0;
  const bool is_rest = absl::ConsumePrefix(&range, "bytes=") && absl::ConsumeSuffix(&range, "-");
  return is_rest && absl::SimpleAtoi(range, &first) ? first : 0;
}

/// Files of frames, one after the other, as an archive.
class Archive {
 public:
  Archive(const FarmCalls& calls, v1::PageSession session, v1::JobStatus job)
      : calls_(calls), session_(std::move(session)), job_(std::move(job)), frames_(FramesOf(job_)) {}

  /// Errors: kFailedPrecondition without a finished frame.
  absl::Status Open() {
    const absl::StatusOr<bool> has_first = OpenNext();
    if (!has_first.ok()) return has_first.status();
    return *has_first ? absl::OkStatus() : absl::FailedPreconditionError("no frame of the job is finished");
  }

  absl::StatusOr<std::optional<std::string>> Next() {
    if (file_ == nullptr) return std::exchange(is_over_, true) ? std::nullopt : std::optional(zip_.End());
    if (std::exchange(begins_, false)) return zip_.Begin(ResultName(job_, frames_[next_ - 1]), file_->size());
    absl::StatusOr<std::optional<std::string>> piece = file_->Next();
    if (!piece.ok()) return piece;
    if (piece->has_value()) {
      zip_.Add(**piece);
      return piece;
    }
    if (const absl::StatusOr<bool> opened = OpenNext(); !opened.ok()) return opened.status();
    return "";
  }

 private:
  /// False: there is no further one.
  absl::StatusOr<bool> OpenNext() {
    file_ = nullptr;
    while (next_ < frames_.size()) {
      v1::DownloadResultRequest request;
      request.set_job_id(job_.job_id());
      request.set_frame(frames_[next_++]);
      absl::StatusOr<std::unique_ptr<ResultStream>> file = ResultStream::Open(calls_, session_, request);
      if (absl::IsFailedPrecondition(file.status())) continue;  // it is not finished, or skipped
      if (!file.ok()) return file.status();
      file_ = *std::move(file);
      begins_ = true;
      return true;
    }
    return false;
  }

  const FarmCalls& calls_;
  const v1::PageSession session_;
  const v1::JobStatus job_;
  const std::vector<int32_t> frames_;
  ZipWriter zip_;
  size_t next_ = 0;
  std::unique_ptr<ResultStream> file_;  // of the frame before next_; null at the end
  bool begins_ = false;
  bool is_over_ = false;
};

}  // namespace

std::string FileNameOf(absl::string_view display_name, absl::string_view suffix) {
  std::string name(display_name.substr(0, display_name.rfind('.')));
  if (name.size() > kMaxNameBytes) name.resize(kMaxNameBytes);
  std::replace_if(
      name.begin(), name.end(),
      [](char c) { return !absl::ascii_isalnum(static_cast<unsigned char>(c)) && c != '-' && c != '_'; },
      '_');
  return absl::StrCat(name.empty() ? "picture" : name, suffix);
}

absl::StatusOr<Response> AnswerResult(const FarmCalls& calls, const v1::PageSession& session,
                                      const Request& request) {
  const absl::StatusOr<v1::JobStatus> job = JobOf(calls, session, request);
  if (!job.ok()) return job.status();
  int32_t frame = job->first_frame();
  const std::optional<std::string> text = request.Parameter("frame");
  if (text.has_value() && !absl::SimpleAtoi(*text, &frame))
    return absl::InvalidArgumentError("frame is a whole number");
  v1::DownloadResultRequest wanted;
  wanted.set_job_id(job->job_id());
  wanted.set_frame(frame);
  wanted.set_offset(FirstByteOf(request.Header("Range")));
  absl::StatusOr<std::unique_ptr<ResultStream>> opened = ResultStream::Open(calls, session, wanted);
  if (!opened.ok()) return opened.status();
  const std::shared_ptr<ResultStream> file = *std::move(opened);
  const std::string digest = absl::Base64Escape(absl::HexStringToBytes(file->sha256()));
  Response response = {.content_type = "image/x-exr",
                       .headers = {Attachment(ResultName(*job, frame)),
                                   {"Accept-Ranges", "bytes"},
                                   {"Repr-Digest", absl::StrCat("sha-256=:", digest, ":")}},
                       .stream = [file] { return file->Next(); },
                       .stream_bytes = file->size() - wanted.offset()};
  if (wanted.offset() > 0) {
    response.status = 206;
    response.headers.emplace_back(
        "Content-Range", absl::StrCat("bytes ", wanted.offset(), "-", file->size() - 1, "/", file->size()));
  }
  return response;
}

absl::StatusOr<Response> AnswerArchive(const FarmCalls& calls, const v1::PageSession& session,
                                       const Request& request) {
  absl::StatusOr<v1::JobStatus> job = JobOf(calls, session, request);
  if (!job.ok()) return job.status();
  const std::string name = FileNameOf(job->display_name(), ".zip");
  const auto archive = std::make_shared<Archive>(calls, session, *std::move(job));
  if (absl::Status status = archive->Open(); !status.ok()) return status;
  return Response{.content_type = "application/zip", .headers = {Attachment(name)}, .stream = [archive] {
                    return archive->Next();
                  }};
}

}  // namespace lumifold::page
