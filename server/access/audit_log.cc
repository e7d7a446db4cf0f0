#include "server/access/audit_log.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <string_view>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "filter/image/file_calls.h"
#include "proto/logging/line_writer.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/trace_context.h"
#include "server/access/authorisation.h"

namespace lumifold::access {
namespace {

constexpr absl::Duration kFlushTime = absl::Seconds(1);
/// Bytes of the caller's text in a line.
constexpr size_t kMaxSubjectBytes = 256;
constexpr size_t kMaxReasonBytes = 512;

std::string Quoted(const std::string& text, size_t max_bytes) {
  return absl::StrCat("\"", absl::Utf8SafeCEscape(rpc::BoundedLine(text, max_bytes)), "\"");
}

std::string Stamp(absl::Time time) {
  return absl::FormatTime("%Y-%m-%dT%H:%M:%E3S", time, absl::UTCTimeZone()) + "Z";
}

int OpenFile(const std::string& path) {
  return open(path.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, S_IRUSR | S_IWUSR);
}

uint64_t SizeOf(int file) {
  struct stat info = {};
  return fstat(file, &info) == 0 ? static_cast<uint64_t>(info.st_size) : 0;
}

/// Of the last event, in milliseconds since 1970.
using LatestTime = std::atomic<int64_t>;

class RotatedFile final : public logging::LineWriter::File {
 public:
  RotatedFile(const AuditLogOptions& options, int file, std::shared_ptr<LatestTime> latest)
      : options_(options), latest_(std::move(latest)), file_(file), bytes_(SizeOf(file)) {}
  RotatedFile(const RotatedFile&) = delete;
  RotatedFile& operator=(const RotatedFile&) = delete;
  ~RotatedFile() override {
    if (file_ >= 0) close(file_);
  }

  /// Lines that were lost are counted in a line of their own once the file takes lines again.
  void Write(std::string_view lines, uint64_t dropped) override {
    lost_ += dropped;
    const uint64_t failed = Append(lines);
    if (failed == 0 && lost_ > 0) {
      const std::string line = absl::StrCat(Stamp(absl::FromUnixMillis(*latest_)),
                                            " warn event=audit_dropped lines=", lost_, "\n");
      if (Append(line) == 0) lost_ = 0;
    }
    lost_ += failed;
  }

 private:
  /// Appends whole lines. Returns how many were lost.
  uint64_t Append(std::string_view lines) {
    uint64_t lost = 0;
    while (!lines.empty()) {
      const size_t end = lines.find('\n') + 1;
      if (!AppendLine(lines.substr(0, end))) ++lost;
      lines.remove_prefix(end);
    }
    return lost;
  }

  bool AppendLine(std::string_view line) {
    if (bytes_ > 0 && bytes_ + line.size() > options_.max_file_bytes) Rotate();
    if (file_ < 0) file_ = OpenFile(options_.path);
    if (file_ < 0) return false;
    if (is_torn_ && WriteBytes("\n") != 1) return false;
    const size_t written = WriteBytes(line);
    is_torn_ = written > 0 && written < line.size();
    return written == line.size();
  }

  size_t WriteBytes(std::string_view bytes) {
    const ssize_t written = write(file_, bytes.data(), bytes.size());
    if (written <= 0) return 0;
    bytes_ += static_cast<uint64_t>(written);
    return static_cast<size_t>(written);
  }

  // Errors leave the name as it is: the file grows on, and nothing is lost.
  void Rotate() {
    const auto name = [this](int number) { return absl::StrCat(options_.path, ".", number); };
    for (int i = options_.kept_files; i > 1; --i) rename(name(i - 1).c_str(), name(i).c_str());
    if (rename(options_.path.c_str(), name(1).c_str()) != 0) return;
    close(file_);
    file_ = OpenFile(options_.path);
    bytes_ = 0;
  }

  const AuditLogOptions options_;
  const std::shared_ptr<LatestTime> latest_;
  uint64_t lost_ = 0;  // since the last line about lost lines
  int file_;
  uint64_t bytes_;
  bool is_torn_ = false;  // the disk took only a part of the last line
};

class AuditLogImpl final : public AuditLog {
 public:
  AuditLogImpl(const AuditLogOptions& options, int file)
      : latest_(std::make_shared<LatestTime>(0)),
        writer_({.max_waiting_bytes = options.max_waiting_bytes, .flush_time = kFlushTime},
                std::make_unique<RotatedFile>(options, file, latest_)) {}

  void Write(absl::Time time, const AuditEvent& event) override {
    *latest_ = absl::ToUnixMillis(time);
    writer_.Add(AuditLine(time, event) + "\n");
  }

 private:
  const std::shared_ptr<LatestTime> latest_;
  logging::LineWriter writer_;
};

}  // namespace

std::string AuditLine(absl::Time time, const AuditEvent& event) {
  const Rule* rule = FindRule(event.rpc_path);
  std::string line = absl::StrCat(Stamp(time), event.outcome.ok() ? " info" : " warn",
                                  " event=call identity=", Quoted(event.caller.name, kMaxSubjectBytes),
                                  " role=", NameOf(RoleOf(event.caller)),
                                  " id=", event.caller.id.empty() ? "-" : event.caller.id,
                                  " address=", event.address.empty() ? "-" : event.address,
                                  " rpc=", rule == nullptr ? "unknown" : rule->rpc_path.substr(1));
  if (!event.subject.empty()) absl::StrAppend(&line, " subject=", Quoted(event.subject, kMaxSubjectBytes));
  if (!event.trace_parent.empty()) absl::StrAppend(&line, " trace=", rpc::TraceIdOf(event.trace_parent));
  absl::StrAppend(&line, " outcome=", absl::StatusCodeToString(event.outcome.code()));
  if (!event.outcome.ok())
    absl::StrAppend(&line, " error=", Quoted(std::string(event.outcome.message()), kMaxReasonBytes));
  return line;
}

absl::StatusOr<std::unique_ptr<AuditLog>> AuditLog::Open(const AuditLogOptions& options) {
  const int file = OpenFile(options.path);
  if (file < 0) return StorageError(options.path, errno);
  return std::make_unique<AuditLogImpl>(options, file);
}

}  // namespace lumifold::access
